"""Records and rollouts as Minari data sets, the form in which offline reinforcement learning shares episodes."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from auv_gym.extra import needs
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from auv_gym.rl.evaluation import Agent, evaluate

with needs("A Minari data set needs minari", "minari"):
    import minari
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_dataset import parse_dataset_id
    from minari.storage import get_dataset_path


def check_dataset_name(dataset_id: str) -> None:
    """Raise ValueError if Minari cannot take this name, or has a data set of it."""
    try:
        namespace, name, version = parse_dataset_id(dataset_id)
    except (TypeError, ValueError):  # Minari requires a version that its pattern leaves optional
        raise ValueError(
            f"A Minari data set needs a name that ends in its version, such as slocum/dives-v0, got {dataset_id!r}: "
            "use letters, digits, - and _, and at least two of them before a /."
        ) from None
    folder = get_dataset_path(dataset_id)
    if folder.exists():
        following = f"{namespace}/{name}-v{version + 1}" if namespace else f"{name}-v{version + 1}"
        raise ValueError(
            f"There is already a Minari data set {dataset_id}: give another name, such as {following}, or delete "
            f"{folder}."
        )


def _created(dataset_id: str, episodes: list[EpisodeBuffer], **about: Any) -> Any:
    """The data set, written as a whole or not at all; its name has been checked."""
    try:
        return minari.create_dataset_from_buffers(dataset_id, episodes, **about)
    except BaseException:
        shutil.rmtree(get_dataset_path(dataset_id), ignore_errors=True)  # or the name would be taken
        raise


def dataset_of_records(dataset_id: str, records: Record | Sequence[Record], plant: Plant, **about: Any) -> Any:
    """A Minari data set made from logs, with one episode per segment.

    Observations are the vehicle's outputs that every record has at all samples.  Actions are the vehicle's inputs at
    these samples; an optional input is constant if a log does not have it.  A log has no rewards, so they are 0.  The
    infos hold `time_s`.  dataset_id: such as "slocum/dives-v0".  about: further arguments of Minari, such as author.
    Raises ValueError if an input is missing, or if Minari does not accept the name.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from auv_gym.exports import dataset_of_records
        >>> from identification import closed_loop
        >>> glider = load_vehicle("slocum")
        >>> log = closed_loop(glider, rng=np.random.default_rng(0), duration=300)
        >>> data = dataset_of_records("slocum/heading-v0", log, glider)
        >>> data.total_episodes, data.total_steps
        (1, 75)
    """
    check_dataset_name(dataset_id)
    records = [records] if isinstance(records, Record) else list(records)
    seen = [name for name in plant.outputs if all(r.has(name) and np.isfinite(r[name]).all() for r in records)]
    missing = [name for name in plant.family.required if not all(record.has(name) for record in records)]
    if missing or not seen:
        raise ValueError(
            f"A data set for {plant.name} needs its inputs and outputs in every log, and one of them lacks "
            f"{', '.join(missing or plant.outputs)}: map the log's columns to these channels."
        )
    buffers = []
    for record in records:
        actions = np.stack(
            [
                record[name] if record.has(name) else np.full(len(record), plant.constants[name])
                for name in plant.inputs
            ],
            axis=1,
        )
        states = record.matrix(seen)
        for rows in record.segments:
            steps = rows.stop - rows.start - 1
            buffers.append(
                EpisodeBuffer(
                    id=len(buffers),
                    observations=list(states[rows]),
                    actions=list(actions[rows][:-1]),
                    rewards=[0.0] * steps,
                    terminations=[False] * steps,
                    truncations=[False] * (steps - 1) + [True],
                    infos={"time_s": record.time[rows]},
                )
            )
    about = {
        "description": f"Logs of {plant.name}. Observations: {', '.join(seen)}. Actions: {', '.join(plant.inputs)}.",
        "algorithm_name": "measured",
    } | about
    spaces: dict[str, Any] = {"observation_space": _space(len(seen)), "action_space": _space(len(plant.inputs))}
    return _created(dataset_id, buffers, **(spaces | about))


def dataset_of_rollouts(dataset_id: str, env: gymnasium.Env, agent: Agent, seeds: Sequence[int], **about: Any) -> Any:
    """A Minari data set of one whole episode per seed, in which an agent drives the environment.

    Example:

        >>> import gymnasium
        >>> from auv_gym.exports import dataset_of_rollouts
        >>> from controllers import pilot_for
        >>> env = gymnasium.make("auv_gym/GliderHeading-v0", duration=60.0)
        >>> data = dataset_of_rollouts("glider/pid-v0", env, pilot_for(env, "pid"), seeds=[3, 4])
        >>> data.total_episodes
        2
    """
    check_dataset_name(dataset_id)
    recorder = _Recorder(env)
    evaluate(agent, recorder, seeds)
    about = {"algorithm_name": type(agent).__name__} | about
    return _created(dataset_id, recorder.episodes, env=env, **about)


class _Recorder(gymnasium.Wrapper):
    """An environment that records its episodes."""

    def __init__(self, env: gymnasium.Env):
        super().__init__(env)
        self.episodes: list[Any] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        observation, info = self.env.reset(seed=seed, options=options)
        started = EpisodeBuffer(id=len(self.episodes), seed=seed, observations=[np.array(observation)], actions=[])
        self.episodes.append(started)
        return observation, info

    def step(self, action: Any) -> Any:
        happened = self.env.step(action)
        observation, reward, terminated, truncated, _ = happened
        kept = self.episodes[-1]
        kept.observations.append(np.array(observation))
        kept.actions.append(np.array(action))
        kept.rewards.append(float(reward))
        kept.terminations.append(bool(terminated))
        kept.truncations.append(bool(truncated))
        return happened


def _space(size: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
