"""Evaluation of agents in an environment: returns of whole episodes on given seeds, and their summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np

TRAINING, SELECTION, FRESH = 0, 1, 2  # purposes of seeds; each has its own seeds
_RESAMPLES = 10_000
_LEVEL = 0.95

Acting = Callable[[np.ndarray, Mapping[str, Any]], np.ndarray]


class Agent(Protocol):
    """An agent that drives an environment: a policy, or a controller in `controllers.piloting`."""

    def begin(self, env: Any) -> Acting:
        """A function that returns an action for each observation and info of one new episode."""
        ...


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Results of whole episodes: undiscounted sums of rewards, steps, and the reasons of early ends.

    Example:

        >>> import numpy as np
        >>> from auv_gym.rl import Evaluation
        >>> found = Evaluation((7, 8, 9), np.array([-9.0, -12.0, -30.0]), np.array([20, 20, 5]), ("", "", "too deep"))
        >>> found.cut, found.summary.mean
        (1, -17.0)
    """

    seeds: tuple[int, ...]
    returns: np.ndarray
    steps: np.ndarray
    reasons: tuple[str, ...]

    @property
    def cut(self) -> int:
        """Number of episodes that ended early."""
        return sum(bool(reason) for reason in self.reasons)

    @property
    def summary(self) -> Summary:
        """The summary of the returns."""
        return Summary.of(self.returns)


@dataclass(frozen=True)
class Summary:
    """Mean and mean of the middle half, each with its 95 % interval by the bootstrap over episodes.

    Example:

        >>> from auv_gym.rl import Summary
        >>> found = Summary.of([-9.0, -10.0, -11.0, -12.0, -13.0, -14.0, -15.0, -60.0])
        >>> found.mean, found.iqm
        (-18.0, -12.5)
    """

    mean: float
    mean_interval: tuple[float, float]
    iqm: float
    iqm_interval: tuple[float, float]
    std: float
    lowest: float
    highest: float
    episodes: int

    @classmethod
    def of(cls, values: Sequence[float] | np.ndarray) -> Summary:
        """The summary of returns; the resampling is the same for the same number of returns."""
        x = np.asarray(values, dtype=float)
        if x.ndim != 1 or x.size < 2 or not np.isfinite(x).all():
            raise ValueError(f"A summary needs 2 finite returns or more, got {x!r}.")
        # a fixed seed, so that agents on the same episodes are resampled alike
        drawn = np.sort(x[np.random.default_rng(0).integers(x.size, size=(_RESAMPLES, x.size))], axis=1)
        return cls(
            float(x.mean()),
            _interval(drawn.mean(axis=1)),
            float(_middle(np.sort(x)[None])[0]),
            _interval(_middle(drawn)),
            float(x.std(ddof=1)),
            float(x.min()),
            float(x.max()),
            x.size,
        )


def fresh_seeds(seed: int, count: int, purpose: int = FRESH) -> list[int]:
    """Seeds of episodes, reproducible from `seed` and different for each purpose: training, selection, evaluation.

    Example:

        >>> from auv_gym.rl import fresh_seeds
        >>> fresh_seeds(0, 2)
        [3141116543, 4003597245]
    """
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"A seed needs a whole number from 0 on, got {seed!r}.")
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise ValueError(f"The number of episodes needs a whole number from 1 on, got {count!r}.")
    return [int(one) for one in np.random.SeedSequence([seed, purpose]).generate_state(count)]


def evaluate(
    agent: Agent, env: gymnasium.Env, seeds: Sequence[int], progress: Callable[[float], Any] | None = None
) -> Evaluation:
    """Run one whole episode for each seed, driven by the agent; progress: called with the completed share.

    Example:

        >>> import gymnasium
        >>> from auv_gym.rl import evaluate, fresh_seeds
        >>> from controllers import pilot_for
        >>> env = gymnasium.make("auv_gym/GliderHeading-v0", duration=80.0)
        >>> found = evaluate(pilot_for(env, "pid"), env, fresh_seeds(0, 3))
        >>> found.steps.tolist(), found.cut, round(found.summary.mean, 1)
        ([20, 20, 20], 0, -2.2)
    """
    sums, lengths, reasons = [], [], []
    for done, seed in enumerate(seeds):
        observation, info = env.reset(seed=int(seed))
        act = agent.begin(env)
        total, steps, terminated, truncated = 0.0, 0, False, False
        while not (terminated or truncated):
            observation, reward, terminated, truncated, info = env.step(act(observation, info))
            total += float(reward)
            steps += 1
        sums.append(total)
        lengths.append(steps)
        reasons.append(str(info.get("reason") or "terminated") if terminated else "")
        if progress is not None:
            progress((done + 1) / len(seeds))
    return Evaluation(tuple(int(seed) for seed in seeds), np.array(sums), np.array(lengths), tuple(reasons))


def returns(agent: Agent, env: gymnasium.Env, seeds: Sequence[int]) -> np.ndarray:
    """The undiscounted sum of rewards of one whole episode for each seed.

    Example:

        >>> import gymnasium
        >>> from auv_gym.rl import returns
        >>> from controllers import pilot_for
        >>> env = gymnasium.make("auv_gym/GliderHeading-v0", duration=80.0)
        >>> returns(pilot_for(env, "pid"), env, [1, 2]).round(1)
        array([-3.4, -0.8])
    """
    return evaluate(agent, env, seeds).returns


def _middle(rows: np.ndarray) -> np.ndarray:
    """The mean of the middle half of each sorted row, with fractions of the values at its edges."""
    n = rows.shape[1]
    at = np.arange(n)
    weight = np.clip(np.minimum(at + 1, 0.75 * n) - np.maximum(at, 0.25 * n), 0.0, None)
    return rows @ weight / weight.sum()


def _interval(estimates: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(estimates, [0.5 * (1.0 - _LEVEL), 0.5 * (1.0 + _LEVEL)])
    return float(low), float(high)
