"""Many environments as one: all advanced in a single compiled call on all cores."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from auv_gym.envs.infos import InfoIndex
from auv_gym.envs.kernel.layout import NO_REASON, NOISE_ROWS, TERMINATED, TRUNCATED, offset
from auv_gym.envs.model_driver import ModelDriver
from auv_gym.envs.plans import make_episodes
from auv_gym.envs.tasks import Task
from auv_gym.model import Model
from auv_gym.plant import Plant

_looping: dict[str, int] = {}  # the process whose threads have run the loop


class TaskVectorEnv(gymnasium.vector.VectorEnv):
    """A batch of `num_envs` environments, each bit for bit equal to the `TaskEnv` of its seed and actions.

    They differ in their seeds and in what is drawn from them. The compiled loop runs on numba's threads: call
    `numba.set_num_threads` to leave cores to other work. A process that has stepped the batch should start other
    processes by spawning.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        task: str | Task,
        num_envs: int = 1,
        vehicle: str | os.PathLike | Plant | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        effects: Mapping[str, float] | None = None,
        randomise: Mapping[str, tuple[float, float]] | None = None,
        model: Model | str | os.PathLike | None = None,
        dt: float | None = None,
        duration: float | None = None,
        target: float | Mapping[str, float] | None = None,
        render_mode: None = None,
        **own: Any,
    ):
        """Make environments with the options of `TaskEnv`; a model in Python is stepped for one after another.

        autoreset_mode: an environment that has ended restarts in the next step, which ignores its action (NextStep), at
        once (SameStep), or when reset with options={"reset_mask": ...} (Disabled).
        """
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs needs a whole number of environments, 1 or more, got {num_envs!r}.")
        if render_mode is not None:
            raise ValueError(
                f"The vector environment draws nothing, got render_mode {render_mode!r}: render a single one with "
                "gymnasium.make, or give vectorization_mode='sync' to gymnasium.make_vec."
            )
        self.episodes = episodes = make_episodes(
            task,
            vehicle,
            effects=effects,
            randomise=randomise,
            model=model,
            dt=dt,
            duration=duration,
            target=target,
            **own,
        )
        self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode(autoreset_mode)}
        self.num_envs = int(num_envs)
        self.single_action_space, self.single_observation_space = episodes.action_space, episodes.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._mode = AutoresetMode(autoreset_mode)
        self._drivers: list[ModelDriver] = []
        if episodes.by_model:  # each row is part of a buffer, like that of a single environment
            row_at = episodes.plan.size + episodes.derived.size
            buffers = np.tile(episodes.new_buffer(), (self.num_envs, 1))
            self._rows = rows = buffers[:, row_at : row_at + episodes.row_size]
            self._buffers = list(buffers)
            self._drivers = [ModelDriver(episodes, row) for row in rows]
        else:
            self._rows = rows = episodes.new_rows(self.num_envs)
        self._derived = np.tile(episodes.derived, (self.num_envs if episodes.randomise else 1, 1))
        record = episodes.row_type
        at = offset(record, "action")
        self._actions = rows[:, at : at + len(episodes.actions)]
        self._reasons = rows[:, offset(record, "reason")]
        self._noise_used = rows[:, offset(record, "noise_used")]
        self._rewards = rows[:, offset(record, "reward")]
        self._noisy = episodes.noise(rows[0]) is not None
        self._index = InfoIndex.of(episodes)
        shown: dict[str, Any] = {**self._index.groups, **({"state": episodes.driver.states} if self._drivers else {})}
        self._mask_names = {group: [f"_{name}" for name in names] for group, names in shown.items()}
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds: list[int | None] = [None] * self.num_envs
        self._ended = np.zeros(self.num_envs, dtype=bool)
        self._unbegun = np.ones(self.num_envs, dtype=bool)

    @property
    def plant(self) -> Plant:
        """The vehicle that scales, limits and gains come from."""
        return self.episodes.plant

    def reset(  # like SyncVectorEnv's, with a seed for each
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """First observations and infos; environment i gets the seed plus i, or the i-th of several seeds.

        options: as for a single environment, applied to all; reset_mask: (num_envs,) bool, those to reset.
        """
        options = dict(options or {})
        begins = self._reset_mask(options.pop("reset_mask", None))
        for i, one in enumerate(self._seeds_of(seed)):
            if one is not None and begins[i]:
                self._generators[i], self._seeds[i] = seeding.np_random(one)
        for i in np.flatnonzero(begins):
            self.episodes.set_start(self.episodes.record(self._rows[i]), options)
        observations = self._observations()
        self._begin(begins, observations)
        self._ended[begins] = False
        self._unbegun[begins] = False
        infos = self._infos()
        drawn = [self.episodes.randomised_values(row) for row in self._rows]
        infos["randomised"] = {path: np.array([values[path] for values in drawn]) for path in self.episodes.randomise}
        everywhere = infos["_randomised"] = np.ones(self.num_envs, dtype=bool)
        infos["randomised"].update({f"_{path}": everywhere for path in self.episodes.randomise})
        return observations, infos

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and infos one sample later; see the autoreset mode."""
        if self._unbegun.any():
            raise gymnasium.error.ResetNeeded(
                f"{self._unbegun.sum()} environments have not begun: call reset() before step()."
            )
        actions = np.asarray(actions)
        if actions.shape != self._actions.shape or not np.isfinite(actions).all():
            raise ValueError(
                f"Actions need finite numbers in [-1, 1] of shape {self._actions.shape} "
                f"({', '.join(self.episodes.actions)}), got {actions!r}."
            )
        begins = self._ended
        if begins.any():
            if self._mode is AutoresetMode.DISABLED:
                raise gymnasium.error.ResetNeeded(
                    f"{begins.sum()} environments have ended: reset them with options={{'reset_mask': ...}}."
                )
            self._draw(np.flatnonzero(begins))
        self._actions[:] = actions
        _check_process()
        if self._noisy:
            for i in np.flatnonzero((self._noise_used >= NOISE_ROWS) & ~begins):
                self._draw_noise(i)
        observations = np.empty((self.num_envs, len(self.episodes.observations)), dtype=np.float32)
        rewards = np.empty(self.num_envs)
        terminated, truncated = np.empty((2, self.num_envs), dtype=bool)
        if self._drivers:
            every = zip(self._drivers, self._buffers, begins.tolist(), strict=True)
            statuses = np.array(
                [driver.step(own) if not starts else driver.begin(own) for driver, own, starts in every]
            )
            rewards[:], observations[:] = self._rewards, self._observations()
            terminated[:], truncated[:] = statuses == TERMINATED, statuses == TRUNCATED
        else:
            given = (self.episodes.vector, self.episodes.plan, self._derived, self._rows, begins)
            self.episodes.kernel.step_many(*given, observations, rewards, terminated, truncated)
        ended = terminated | truncated
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            infos = self._restarted(ended, observations)
            ended = np.zeros(self.num_envs, dtype=bool)
        else:
            infos = self._infos()
        self._ended = ended
        return observations, rewards, terminated, truncated, infos

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # ty: ignore[incompatible-property-override]
        """The generator of each environment."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # ty: ignore[incompatible-property-override]
        """The seed of each environment's generator."""
        return tuple(self._seeds)

    def _seeds_of(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"reset needs one seed, or one for each of {self.num_envs} environments, got {len(seed)}.")
        return list(seed)

    def _reset_mask(self, mask: Any) -> np.ndarray:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"reset option 'reset_mask' needs an array of {self.num_envs} bool, at least one of them true, "
                f"got {mask!r}."
            )
        return mask

    def _generator(self, i: int | np.intp) -> np.random.Generator:
        generator = self._generators[i]
        if generator is None:
            generator, self._seeds[i] = seeding.np_random()
            self._generators[i] = generator
        return generator

    def _draw(self, chosen: np.ndarray) -> None:
        """Draw the episodes of the chosen environments into their rows."""
        for i in chosen:
            self._generator(i).random(out=self.episodes.draws(self._rows[i]))
            if self._noisy:
                self._draw_noise(i)

    def _draw_noise(self, i: np.intp) -> None:
        normals, uniforms = self.episodes.noise(self._rows[i]) or (None, None)
        self._generator(i).standard_normal(out=normals)
        self._generator(i).random(out=uniforms)
        self._noise_used[i] = 0.0

    def _begin(self, begins: np.ndarray, observations: np.ndarray) -> None:
        _check_process()
        self._draw(np.flatnonzero(begins))
        if self._drivers:
            for i in np.flatnonzero(begins):
                self._drivers[i].begin(self._buffers[i])
            observations[begins] = self._observations()[begins]
        else:
            given = (self.episodes.vector, self.episodes.plan, self._derived, self._rows, begins)
            self.episodes.kernel.begin_many(*given, observations)

    def _restarted(self, ended: np.ndarray, observations: np.ndarray) -> dict[str, Any]:
        """Infos with the last observations and infos of the environments that have ended, which restart."""
        last = self._infos()
        finals = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended):
            finals[i] = observations[i].copy()
        self._begin(ended, observations)
        infos = self._infos()
        final = {key: value for key, value in last.items() if not key.startswith("_")}
        final.update({f"_{key}": ended for key in final})
        return {**infos, "final_obs": finals, "_final_obs": ended, "final_info": final, "_final_info": ended}

    def _observations(self) -> np.ndarray:
        at = offset(self.episodes.row_type, "observation")
        found = np.ascontiguousarray(self._rows[:, at : at + 16]).view(np.float32)
        return found[:, : len(self.episodes.observations)].copy()

    def _infos(self) -> dict[str, Any]:
        index, everywhere = self._index, np.ones(self.num_envs, dtype=bool)
        shown = self._rows[:, index.first : index.last].copy()
        infos: dict[str, Any] = {name: shown[:, at] for name, at in index.single.items()}
        for group, places in index.groups.items():
            infos[group] = {name: shown[:, at] for name, at in places.items()}
        if self._drivers:
            states = np.array([driver.x for driver in self._drivers])
            infos["state"] = dict(zip(self.episodes.driver.states, states.T, strict=True))
        for group in index.groups:
            infos[group].update(dict.fromkeys(self._mask_names[group], everywhere))
        infos["reason"] = reasons = np.full(self.num_envs, "", dtype=object)
        for i in np.flatnonzero(self._reasons != NO_REASON):
            reasons[i] = self.episodes.reason(self.episodes.record(self._rows[i]))
        infos.update({f"_{name}": everywhere for name in list(infos)})
        return infos


def _check_process() -> None:
    """Raise in a process forked from one that has run the loop: it lacks the threads, and OpenMP would just end it."""
    here = os.getpid()
    if _looping.setdefault("process", here) != here:
        raise RuntimeError(
            "This process was forked from one that has stepped a vector environment, whose threads it does not have: "
            "start it by spawning, as with multiprocessing.get_context('spawn')."
        )
