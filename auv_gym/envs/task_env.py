"""Environments of a task: hold a depth, a heading, a speed; follow a path; dive."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from auv_gym.compiled import for_vector
from auv_gym.envs.infos import InfoIndex, Named
from auv_gym.envs.kernel.layout import NOISE_ROWS, OVER, REFUSED, RUNNING, TERMINATED, offset
from auv_gym.envs.model_driver import ModelDriver
from auv_gym.envs.plans import make_episodes
from auv_gym.envs.tasks import Task
from auv_gym.model import Model
from auv_gym.plant import Plant


class TaskEnv(gymnasium.Env):
    """One environment of a task; docs/environments.md describes its action, observation, reward and info.

    A step is one compiled call on one buffer of numbers, described in `layout`; a model in place of the vehicle is
    stepped in Python between two such calls. A copied or unpickled environment continues from its present state.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

    def __init__(
        self,
        task: str | Task,
        vehicle: str | os.PathLike | Plant | None = None,
        *,
        effects: Mapping[str, float] | None = None,
        randomise: Mapping[str, tuple[float, float]] | None = None,
        model: Model | str | os.PathLike | None = None,
        dt: float | None = None,
        duration: float | None = None,
        target: float | Mapping[str, float] | None = None,
        render_mode: str | None = None,
        **own: Any,
    ):
        """Make an environment for a preset, a vehicle file or a plant; raises if the options are inconsistent.

        task: a name in `tasks.TASKS`.  vehicle: by default the task's.  effects: values by parameter path.  randomise:
        ranges (low, high) by parameter path, from which each episode draws.  model: drives the environment in place of
        the vehicle, a Model or a vehicle file.  dt, duration: s.  target: fixed, in the task's channel, or for a pose
        by channel; by default it changes in steps.  own: options of the kind of vehicle: actions and waypoints of a
        vehicle in six degrees of freedom, near and depths of a float, speed and compass_noise of a glider, bottom of a
        flying glider.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is None, 'rgb_array' or 'human', got {render_mode!r}.")
        self._options: dict[str, Any] = {
            "task": task,
            "vehicle": vehicle,
            "effects": effects,
            "randomise": randomise,
            "model": model,
            "dt": dt,
            "duration": duration,
            "target": target,
            **own,
        }
        self.episodes = episodes = make_episodes(**self._options)
        self.action_space, self.observation_space = episodes.action_space, episodes.observation_space
        self.render_mode = render_mode
        record = episodes.row_type
        self._buffer = episodes.new_buffer()
        row_at = episodes.plan.size + episodes.derived.size
        self._row = row = self._buffer[row_at : row_at + episodes.row_size]
        self._record = episodes.record(row)
        # single numbers are three times as fast through a memoryview as through an array
        self._numbers = self._buffer.data
        self._actions = len(episodes.actions)
        self._action_at, self._reward_at = row_at + offset(record, "action"), row_at + offset(record, "reward")
        at = offset(record, "observation")
        self._observe = row[at : at + 16].view(np.float32)[: len(episodes.observations)].copy
        index = InfoIndex.of(episodes)
        self._show = row.data[index.first : index.last].tobytes
        first = row_at + index.first
        self._singles = tuple((name, first + at) for name, at in index.single.items() if name != "time_s")
        self._time_at = first + index.single["time_s"]
        self._places = tuple(index.groups[group] for group in ("target", "reading", "command", "state", "reward_terms"))
        self._draws, self._noise = episodes.draws(row), episodes.noise(row)
        self._driver = ModelDriver(episodes, row) if episodes.by_model else None
        plain = self._noise is None and self._driver is None and render_mode is None
        self._advance = for_vector(episodes.kernel.step_one) if plain else self._advance_otherwise
        self._camera: Any = None

    @property
    def plant(self) -> Plant:
        """The vehicle that scales, limits and gains come from."""
        return self.episodes.plant

    @property
    def model(self) -> Model:
        """The simulated model: the vehicle with its effects, or the model in its place."""
        return self.episodes.driver

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """The first observation and info of an episode with a drawn start.

        options: `start`, values of the initial state by channel, and `target`, the first one, instead of drawn ones.
        """
        super().reset(seed=seed)
        episodes = self.episodes
        episodes.set_start(self._record, options)
        self.np_random.random(out=self._draws)
        self._draw_noise()
        if self._driver is None:
            episodes.kernel.begin_one(episodes.vector, self._buffer)
        else:
            self._driver.begin(self._buffer)
        if self.render_mode is not None:
            self._follow(begin=True)
        return self._observe(), {**self._info(""), "randomised": episodes.randomised_values(self._row)}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info one sample later; actions beyond [-1, 1] are clipped."""
        numbers, at = self._numbers, self._action_at
        try:
            values = action.tolist()
        except AttributeError:  # a list or tuple
            values = action
        try:
            if len(values) != self._actions:
                raise self._refused(action)
            for value in values:
                numbers[at] = value
                at += 1
        except TypeError:
            raise self._refused(action) from None
        status = self._advance(self._buffer)
        if status == RUNNING:
            return self._observe(), numbers[self._reward_at], False, False, self._info("")
        if status == REFUSED:
            raise self._refused(action)
        if status == OVER:
            raise gymnasium.error.ResetNeeded("The episode has ended or not begun: call reset() before step().")
        terminated = status == TERMINATED
        reason = self.episodes.reason(self._record) if terminated else ""
        return self._observe(), numbers[self._reward_at], terminated, not terminated, self._info(reason)

    def action_for(self, command: Mapping[str, float]) -> np.ndarray:
        """The action for commands by channel, shape (number of actions,)."""
        return self.episodes.action_for(command)

    def render(self) -> np.ndarray | None:
        """An RGB image, shape (height, width, 3), uint8, with render_mode "rgb_array"; else None."""
        return self._camera.picture() if self.render_mode == "rgb_array" and self._camera is not None else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _info(self, reason: str) -> dict[str, Any]:
        # instead of a constructor in Python or a loop, which would take twice the time: see `Named`
        target, reading, command, state, terms = Named(), Named(), Named(), Named(), Named()
        target.index, reading.index, command.index, state.index, terms.index = self._places
        target.numbers = reading.numbers = command.numbers = state.numbers = terms.numbers = self._show()
        info = {
            "time_s": self._numbers[self._time_at],
            "target": target,
            "reading": reading,
            "command": command,
            "state": state if self._driver is None else self._driver.state(),
            "reward_terms": terms,
            "reason": reason,
        }
        for name, at in self._singles:
            info[name] = self._numbers[at]
        return info

    def _advance_otherwise(self, buffer: np.ndarray) -> int:
        """Step an environment with noisy sensors, a model in Python or pictures; returns the status."""
        if self._noise is not None and self._record["noise_used"] >= NOISE_ROWS:
            self._draw_noise()
        step = self.episodes.kernel.step_one if self._driver is None else self._driver.step
        status = step(buffer)
        if self.render_mode is not None and status not in (REFUSED, OVER):
            self._follow()
        return status

    def _draw_noise(self) -> None:
        if self._noise is not None:
            normals, uniforms = self._noise
            self.np_random.standard_normal(out=normals)
            self.np_random.random(out=uniforms)
            self._record["noise_used"] = 0.0

    def _follow(self, begin: bool = False) -> None:
        """Show the present position to the camera, which is made when an episode begins."""
        if self._camera is None and begin:
            from auv_gym.rendering import Camera  # imports matplotlib, so only when a picture is needed

            window = f"{self.episodes.task.name}, {self.plant.name}" if self.render_mode == "human" else ""
            self._camera = Camera(self.episodes.kind.view(self.episodes, self._row), window)
        if self._camera is not None:
            self._camera.follow(begin)

    def _refused(self, action: Any) -> ValueError:
        numbers = f"{self._actions} finite number{'s' * (self._actions > 1)}"
        return ValueError(f"An action needs {numbers} in [-1, 1] ({', '.join(self.episodes.actions)}), got {action!r}.")

    def __getstate__(self) -> dict[str, Any]:
        return {
            "options": {**self._options, "render_mode": self.render_mode},
            "numbers": self._buffer.copy(),
            "model_state": None if self._driver is None else self._driver.x,
            "random": (self._np_random, self._np_random_seed),
            "spec": self.spec,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["options"])
        self._buffer[:] = state["numbers"]
        if self._driver is not None:
            self._driver.x = state["model_state"]
        self.spec = state["spec"]
        self._np_random, self._np_random_seed = state["random"]
