"""An environment that a monitor watches while it runs."""

from __future__ import annotations

from typing import Any

import gymnasium

from identification.monitor.monitor import Monitor

_SAME_STEP = 0.01  # of a step; tolerated difference between step lengths


class Monitored(gymnasium.Wrapper):
    """An environment with a monitor: `info["alarm"]` is an `Alarm` or None at each step.

    The monitor sees what the controller could: `info["command"]` and `info["reading"]`.

    Example:

        >>> import gymnasium
        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Monitor, Monitored, closed_loop
        >>> glider = load_vehicle("slocum")
        >>> monitor = Monitor.learn(closed_loop(glider, rng=np.random.default_rng(0), duration=1200), glider)
        >>> env = Monitored(gymnasium.make("auv_gym/GliderHeading-v0", vehicle="slocum"), monitor)
        >>> observation, info = env.reset(seed=0)
        >>> env.step(np.zeros(1))[-1]["alarm"] is None
        True
    """

    def __init__(self, env: gymnasium.Env, monitor: Monitor):
        """Wrap an environment; raises ValueError if its commands, readings or step differ from the monitor's."""
        super().__init__(env)
        self.monitor = monitor
        own, learned = env.unwrapped.get_wrapper_attr("plant"), monitor.learned
        if (own.inputs, own.outputs) != (learned.plant.inputs, learned.plant.outputs):
            raise ValueError(
                f"This monitor has learned {learned.plant.name}, and the environment simulates {own.name}, which has "
                "other commands or readings: learn a monitor from a log of that vehicle."
            )
        if abs(own.dt - learned.interval) > _SAME_STEP * learned.interval:
            raise ValueError(
                f"This monitor has learned from samples {learned.interval:g} s apart, and a step of the environment "
                f"takes {own.dt:g} s: make it with dt={learned.interval:g}, or learn from a log with its step."
            )

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(**options)
        self.monitor.begin(info["command"], info["reading"])
        return observation, {**info, "alarm": None}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        alarm = self.monitor.step(info["command"], info["reading"])
        return observation, reward, terminated, truncated, {**info, "alarm": alarm}
