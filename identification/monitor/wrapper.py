"""An environment that is watched while it runs."""

from __future__ import annotations

from typing import Any

import gymnasium

from identification.monitor.monitor import Monitor


class Monitored(gymnasium.Wrapper):
    """An environment with a monitor: `info["alarm"]` is an `Alarm` or None at each step.

    The monitor sees what the controller could: `info["command"]` and `info["reading"]`.
    """

    def __init__(self, env: gymnasium.Env, monitor: Monitor):
        super().__init__(env)
        self.monitor = monitor

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(**options)
        self.monitor.begin(info["command"], info["reading"])
        return observation, {**info, "alarm": None}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        alarm = self.monitor.step(info["command"], info["reading"])
        return observation, reward, terminated, truncated, {**info, "alarm": alarm}
