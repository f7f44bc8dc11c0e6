"""Many gliders that hold their headings, as one vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, isfinite, pi, sin
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from auv_gym.envs.glider_heading import (
    HEADING_LIMIT,
    RUDDER_TRAVEL_WEIGHT,
    GliderHeading,
    check_reset_options,
    draw_change,
    wrapped,
)
from auv_gym.model import Model
from auv_gym.plant import Plant


class GliderHeadingVector(gymnasium.vector.VectorEnv):
    """`num_envs` environments GliderHeading, each bit for bit the single one of its seed and actions.

    What needs no model is done for all at once; the model is stepped for one after the other, a plant without checks.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        **options: Any,
    ):
        """Environments with the options of GliderHeading; autoreset_mode: as in docs/environments.md."""
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs needs a whole number of environments, 1 or more, got {num_envs!r}.")
        if render_mode is not None:
            raise ValueError(
                f"The vector environment draws nothing, got render_mode {render_mode!r}: render a single one with "
                "gymnasium.make, or give vectorization_mode='sync' to gymnasium.make_vec."
            )
        self.one = one = GliderHeading(**options)
        self.num_envs = n = int(num_envs)
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.single_action_space, self.single_observation_space = one.action_space, one.observation_space
        self.action_space = batch_space(self.single_action_space, n)
        self.observation_space = batch_space(self.single_observation_space, n)
        self._model = _Stepper(one.model)
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seeds: list[int | None] = [None] * n
        self._x = np.zeros((n, len(one.model.states)))
        self._u = np.tile(one.inputs, (n, 1))
        self._y = np.zeros((n, len(one.model.outputs)))
        self._speed, self._target, self._change_at = np.zeros((3, n))
        self._action, self._reading, self._rate = np.zeros((3, n))
        self._count = np.zeros(n, dtype=int)
        self._terms = np.zeros((2, n))
        self._reasons = np.full(n, "", dtype=object)
        self._ended, self._unbegun = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)

    @property
    def plant(self) -> Plant:
        """The vehicle that scales and limits come from."""
        return self.one.plant

    def reset(  # pyright: ignore[reportIncompatibleMethodOverride]  (as SyncVectorEnv's, with a seed for each)
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """First observations and infos; environment i takes the seed plus i, or the i-th of several seeds.

        options: as for a single environment, for all of them; reset_mask: (num_envs,) bool, those to reset.
        """
        options = dict(options or {})
        mask = options.pop("reset_mask", np.ones(self.num_envs, dtype=bool))
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"reset option 'reset_mask' needs an array of {self.num_envs} bool, at least one of them true, "
                f"got {mask!r}."
            )
        check_reset_options(options)
        for i, one in enumerate(self._seeds_of(seed)):
            if one is not None and mask[i]:
                self._generators[i], self._seeds[i] = seeding.np_random(one)
        self._begin(mask, options)
        self._ended[mask], self._unbegun[mask] = False, False
        return self._observations(), self._infos()

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and infos one sample later; see the autoreset mode."""
        if self._unbegun.any():
            raise gymnasium.error.ResetNeeded(
                f"{self._unbegun.sum()} environments have not begun: call reset() before step()."
            )
        values = np.asarray(actions, dtype=float)
        if values.shape != (self.num_envs, 1) or not np.isfinite(values).all():
            raise ValueError(
                f"Actions need finite numbers in [-1, 1] of shape ({self.num_envs}, 1), the rudders, got {actions!r}."
            )
        begins = self._ended.copy()
        if begins.any() and self._mode is AutoresetMode.DISABLED:
            raise gymnasium.error.ResetNeeded(
                f"{begins.sum()} environments have ended: reset them with options={{'reset_mask': ...}}."
            )
        rewards, terminated, truncated = self._advance(values[:, 0], ~begins)
        if begins.any():
            self._begin(begins, {})
        self._ended = terminated | truncated
        observations, infos = self._observations(), self._infos()
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            ended, self._ended = self._ended, np.zeros(self.num_envs, dtype=bool)
            last, finals = infos, np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(ended):
                finals[i] = observations[i].copy()
            self._begin(ended, {})
            final = {key: value for key, value in last.items() if not key.startswith("_")}
            final.update({f"_{key}": ended for key in final})
            infos = {**self._infos(), "final_obs": finals, "_final_obs": ended}
            infos |= {"final_info": final, "_final_info": ended}
            observations = self._observations()
        return observations, rewards, terminated, truncated, infos

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The generator of each environment."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The seed of each environment's generator."""
        return tuple(self._seeds)

    def _advance(self, values: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One sample of the environments that move; rewards, terminations and truncations of all."""
        one, n = self.one, self.num_envs
        value = np.clip(values, -1.0, 1.0)
        change = np.abs(value - self._action)
        self._action = np.where(moves, value, self._action)
        self._u[moves, one.rudder_at] = value[moves] * one.rudder_limit
        self._count[moves] += 1
        rewards, terminated = np.zeros(n), np.zeros(n, dtype=bool)
        x, y = self._model.stepped(self._x, self._u, moves)
        sound = np.isfinite(x).all(axis=1) & (np.abs(y[:, one.heading_at]) < HEADING_LIMIT)
        good = sound & moves
        for i in np.flatnonzero(moves & ~sound):
            self._reasons[i] = one.fault(x[i], float(self._count[i] * one.model.dt))
            terminated[i] = True
            left = one.steps - self._count[i] + 1
            self._terms[:, i] = -1.0 * left, -RUDDER_TRAVEL_WEIGHT * left
        self._x, self._y = np.where(good[:, None], x, self._x), np.where(good[:, None], y, self._y)
        moved = np.flatnonzero(good)
        noise = np.zeros(n)
        for i in moved:
            noise[i] = self._generator(i).standard_normal()
        reading = self._y[:, one.heading_at] + one.compass_noise * noise
        rate = wrapped(reading - self._reading) / one.model.dt
        self._rate, self._reading = np.where(good, rate, self._rate), np.where(good, reading, self._reading)
        # the target is the one that the action was chosen for; a new one counts from the next step
        error = wrapped(self._target - self._headings())
        self._terms[0, moved] = (-np.abs(error) / pi)[moved]
        self._terms[1, moved] = (-RUDDER_TRAVEL_WEIGHT * 0.5 * change)[moved]
        if one.target is None:
            time = self._count * one.model.dt
            for i in np.flatnonzero(good & (time >= self._change_at - 1e-9)):
                self._change_target(i, float(time[i]))
        rewards[moves] = (self._terms[0] + self._terms[1])[moves]
        return rewards, terminated, good & (self._count >= one.steps)

    def _begin(self, chosen: np.ndarray, options: dict[str, Any]) -> None:
        """Start episodes of the chosen environments; draws as GliderHeading does."""
        one = self.one
        for i in np.flatnonzero(chosen):
            generator = self._generator(i)
            drawn = float(generator.uniform(-pi, pi))
            heading = float(options.get("heading", drawn))
            self._speed[i] = generator.uniform(*one.speed_range)
            self._target[i] = heading if one.target is None else one.target
            self._u[i] = one.inputs
            if one.speed_at is not None:
                self._u[i, one.speed_at] = self._speed[i]
            at_heading = np.arange(len(one.model.outputs)) == one.heading_at
            self._x[i] = one.model.initial(np.where(at_heading, heading, 0.0))
            if one.target is None:
                self._change_target(i, 0.0)
            if "target" in options:
                self._target[i] = float(options["target"])
            self._y[i] = one.model.output(self._x[i])
            self._reading[i] = self._y[i, one.heading_at] + one.compass_noise * generator.standard_normal()
            self._action[i], self._rate[i], self._count[i] = 0.0, 0.0, 0
            self._terms[:, i], self._reasons[i] = 0.0, ""

    def _change_target(self, i: int | np.intp, time: float) -> None:
        self._target[i], self._change_at[i] = draw_change(self._generator(i), float(self._target[i]), time)

    def _headings(self) -> np.ndarray:
        true = self.one.true_heading_at
        return self._y[:, self.one.heading_at] if true is None else self._x[:, true]

    def _observations(self) -> np.ndarray:
        error = (self._target - self._reading).tolist()  # math's sine is that of the single environment to the last bit
        columns = (
            [sin(e) for e in error],
            [cos(e) for e in error],
            self._rate / self.one.turn_rate_scale,
            self._action,
            self._speed / self.one.plant.hull.speed - 1.0,
        )
        return np.clip(np.column_stack(columns), -1.0, 1.0).astype(np.float32)

    def _infos(self) -> dict[str, Any]:
        heading, rudder = self._headings().copy(), self._action * self.one.rudder_limit
        everywhere = np.ones(self.num_envs, dtype=bool)
        target, reading, speed = self._target.copy(), self._reading.copy(), self._speed.copy()
        groups = {
            "target": {"heading_rad": target},
            "reading": {"heading_rad": reading, "u_mps": speed},
            "command": {"rudder_rad": rudder},
            "state": dict(zip(self.one.model.states, self._x.T.copy(), strict=True)),
            "reward_terms": {"heading": self._terms[0].copy(), "rudder_travel": self._terms[1].copy()},
        }
        for group in groups.values():
            group.update({f"_{name}": everywhere for name in list(group)})
        infos: dict[str, Any] = {
            "time_s": self._count * self.one.model.dt,
            "target_rad": target,
            "reading_rad": reading,
            "heading_rad": heading,
            "rudder_rad": rudder,
            "speed_mps": speed,
            **groups,
            "reason": self._reasons.copy(),
        }
        infos.update({f"_{name}": everywhere for name in list(infos)})
        return infos

    def _generator(self, i: int | np.intp) -> np.random.Generator:
        generator = self._generators[i]
        if generator is None:
            generator, self._seeds[i] = seeding.np_random()
            self._generators[i] = generator
        return generator

    def _seeds_of(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"reset needs one seed, or one for each of {self.num_envs} environments, got {len(seed)}.")
        return list(seed)


class _Stepper:
    """A model that steps several states; a plant's compiled programs are called without the checks of `Plant.step`."""

    def __init__(self, model: Model):
        self._model = model
        self._plant = model if isinstance(model, Plant) else None
        self._work = None if self._plant is None else self._plant.new_work()

    def stepped(self, x: np.ndarray, u: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States one sample later, and outputs in them, of those that move; a row that is not finite has outputs 0."""
        next_x, y = x.copy(), np.zeros((len(x), len(self._model.outputs)))
        model, plant = self._model, self._plant
        for i in np.flatnonzero(moves).tolist():
            row = next_x[i]
            if plant is not None:
                plant.programs.step(row, u[i], plant.ages, plant.longest_step, plant.derived, self._work)
            else:
                row[:] = model.step(x[i], u[i])
            if all(map(isfinite, row.tolist())):
                if plant is not None:
                    plant.programs.read(row, plant.derived, y[i])
                else:
                    y[i] = model.output(row)
        return next_x, y
