"""What agents reach in an environment: returns of whole episodes on given seeds, and what they say together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np

TRAINING, SELECTION, FRESH = 0, 1, 2  # what seeds are for; each has its own
_RESAMPLES = 10_000
_LEVEL = 0.95

Acting = Callable[[np.ndarray, Mapping[str, Any]], np.ndarray]


class Agent(Protocol):
    """An agent that drives an environment: a policy, or a controller in `controllers.piloting`."""

    def begin(self, env: Any) -> Acting:
        """What gives an action for each observation and info of one new episode."""
        ...


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Whole episodes, one by one: sums of rewards without discount, their steps, and why those that were cut were."""

    seeds: tuple[int, ...]
    returns: np.ndarray
    steps: np.ndarray
    reasons: tuple[str, ...]

    @property
    def cut(self) -> int:
        """How many episodes ended before their time."""
        return sum(bool(reason) for reason in self.reasons)

    @property
    def summary(self) -> Summary:
        """What the returns say together."""
        return Summary.of(self.returns)


@dataclass(frozen=True)
class Summary:
    """Mean and mean of the middle half, each with its 95 % interval by the bootstrap over episodes."""

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
        """The summary of returns; the resampling is the same for the same number of them."""
        x = np.asarray(values, dtype=float)
        if x.ndim != 1 or x.size < 2 or not np.isfinite(x).all():
            raise ValueError(f"A summary needs 2 finite returns or more, got {x!r}.")
        # drawn with a seed of their own, so that agents on the same episodes are resampled alike
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
    """Seeds of episodes, the same for the same seed; those of training and of choosing a policy are others."""
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"A seed needs a whole number from 0 on, got {seed!r}.")
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise ValueError(f"The number of episodes needs a whole number from 1 on, got {count!r}.")
    return [int(one) for one in np.random.SeedSequence([seed, purpose]).generate_state(count)]


def evaluate(
    agent: Agent, env: gymnasium.Env, seeds: Sequence[int], progress: Callable[[float], Any] | None = None
) -> Evaluation:
    """One whole episode of each seed, driven by the agent; progress: called with the share that is done."""
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
    """The sum of rewards, without discount, of one whole episode of each seed."""
    return evaluate(agent, env, seeds).returns


def _middle(rows: np.ndarray) -> np.ndarray:
    """The mean of the middle half of each sorted row, with parts of the values at its edges."""
    n = rows.shape[1]
    at = np.arange(n)
    weight = np.clip(np.minimum(at + 1, 0.75 * n) - np.maximum(at, 0.25 * n), 0.0, None)
    return rows @ weight / weight.sum()


def _interval(estimates: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(estimates, [0.5 * (1.0 - _LEVEL), 0.5 * (1.0 + _LEVEL)])
    return float(low), float(high)
