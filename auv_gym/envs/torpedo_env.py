"""Environments with a vehicle in six degrees of freedom: hold a depth, a heading, a speed; follow a path."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np

from auv_gym.envs.episodes import InfoIndex, make_episodes
from auv_gym.envs.layout import NOISE_ROWS, REFUSED, RUNNING, TERMINATED, offset, row_type
from auv_gym.envs.model_driver import ModelDriver
from auv_gym.envs.named import Named
from auv_gym.envs.tasks import Task
from auv_gym.model import Model
from auv_gym.plant import Plant


class TorpedoEnv(gymnasium.Env):
    """One environment of a task; see docs/environments.md for its action, observation, reward and info.

    A step is one compiled call on one buffer of numbers, `layout` says which; a model in the place of the vehicle is
    stepped in Python between two such calls.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

    def __init__(
        self,
        task: str | Task,
        vehicle: str | os.PathLike | Plant = "remus100",
        *,
        effects: Mapping[str, float] | None = None,
        randomise: Mapping[str, tuple[float, float]] | None = None,
        model: Model | str | os.PathLike | None = None,
        dt: float | None = None,
        duration: float | None = None,
        target: float | None = None,
        waypoints: Sequence[Sequence[float]] | None = None,
        render_mode: str | None = None,
    ):
        """An environment of a preset, a vehicle file or a plant; raises on what does not fit together.

        task: Depth, Heading, Speed or Path.  effects: values by parameter path.  randomise: ranges (low, high) by
        parameter path, from which each episode draws.  model: drives the environment in place of the vehicle, a Model
        or a vehicle file.  dt, duration: s.  target: fixed, in the task's channel; by default it changes in steps.
        waypoints: rows of north, east, depth, m; by default they are drawn.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is None, 'rgb_array' or 'human', got {render_mode!r}.")
        self.episodes = episodes = make_episodes(
            task,
            vehicle,
            effects=effects,
            randomise=randomise,
            model=model,
            dt=dt,
            duration=duration,
            target=target,
            waypoints=waypoints,
        )
        self.action_space, self.observation_space = episodes.action_space, episodes.observation_space
        self.render_mode = render_mode
        self._buffer = episodes.new_buffer()
        row_at = episodes.plan.size + episodes.derived.size
        self._row = row = self._buffer[row_at : row_at + episodes.row_size]
        self._record = episodes.record(row)
        at = offset(row_type(episodes.plant.family), "action")
        self._action = row[at : at + len(episodes.actions)]
        at = offset(row_type(episodes.plant.family), "observation")
        self._observation = row[at : at + 16].view(np.float32)[: len(episodes.observations)]
        self._reward_at = row_at + offset(row_type(episodes.plant.family), "reward")
        index = InfoIndex.of(episodes)
        self._shown, self._time_at = row[index.first : index.last], index.time
        self._target_of, self._reading_of = index.groups["target"], index.groups["reading"]
        self._command_of, self._state_of = index.groups["command"], index.groups["state"]
        self._terms_of = index.groups["reward_terms"]
        self._draws, self._noise = episodes.draws(row), episodes.noise(row)
        self._kernel_step = episodes.kernel.step_one
        self._driver = ModelDriver(episodes, row) if episodes.by_model else None
        self._over = True
        self._camera: Any = None

    @property
    def plant(self) -> Plant:
        """The vehicle that scales, limits and gains come from."""
        return self.episodes.plant

    @property
    def model(self) -> Model:
        """What is simulated: the vehicle with the effects, or the model in its place."""
        return self.episodes.driver

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """The first observation and info of an episode that starts in cruise, at a drawn depth and heading.

        options: `start`, values of the first state by channel, and `target`, the first one, in place of drawn ones.
        """
        super().reset(seed=seed)
        episodes = self.episodes
        episodes.set_start(self._record, options)
        self.np_random.random(out=self._draws)
        self._draw_noise()
        episodes.kernel.begin_one(episodes.vector, self._buffer)
        if self._driver is not None:
            self._driver.begin()
            episodes.kernel.look_one(self._buffer)
        self._over = False
        if self.render_mode is not None:
            if self._camera is None:
                from auv_gym.envs.camera import Camera

                self._camera = Camera(episodes, self._row, human=self.render_mode == "human")
            self._camera.begin()
        info = self._info("")
        info["randomised"] = episodes.randomised_values(self._row)
        return self._observation.copy(), info

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info one sample later; actions beyond [-1, 1] are clipped."""
        if self._over:
            raise gymnasium.error.ResetNeeded("The episode has ended or not begun: call reset() before step().")
        if np.shape(action) != self._action.shape:
            raise self._refused(action)
        self._action[:] = action
        if self._noise is not None and self._record["noise_used"] >= NOISE_ROWS:
            self._draw_noise()
        if self._driver is None:
            status = self._kernel_step(self._buffer)
        else:
            status = self._driver.step(self._buffer)
        reason = ""
        if status != RUNNING:
            if status == REFUSED:
                raise self._refused(action)
            self._over = True
            if status == TERMINATED:
                reason = self.episodes.reason(self._record)
        if self._camera is not None:
            self._camera.follow()
        return (
            self._observation.copy(),
            self._buffer.item(self._reward_at),
            status == TERMINATED,
            self._over and status != TERMINATED,
            self._info(reason),
        )

    def render(self) -> np.ndarray | None:
        """An RGB image, shape (height, width, 3), uint8, with render_mode "rgb_array"; else None."""
        return self._camera.picture() if self.render_mode == "rgb_array" and self._camera is not None else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _info(self, reason: str) -> dict[str, Any]:
        shown = self._shown.copy()
        info = {
            "time_s": shown.item(self._time_at),
            "target": Named(self._target_of, shown),
            "reading": Named(self._reading_of, shown),
            "command": Named(self._command_of, shown),
            "state": Named(self._state_of, shown),
            "reward_terms": Named(self._terms_of, shown),
            "reason": reason,
        }
        if self._driver is not None:
            info["state"] = self._driver.state()
        return info

    def _draw_noise(self) -> None:
        if self._noise is not None:
            normals, uniforms = self._noise
            self.np_random.standard_normal(out=normals)
            self.np_random.random(out=uniforms)
            self._record["noise_used"] = 0.0

    def _refused(self, action: Any) -> ValueError:
        count = self._action.size
        numbers = f"{count} finite number{'s' * (count > 1)}"
        return ValueError(f"An action needs {numbers} in [-1, 1] ({', '.join(self.episodes.actions)}), got {action!r}.")
