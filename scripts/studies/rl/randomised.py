"""The glider's environment with parameters that each episode draws, as the torpedo environments have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from auv_gym.envs.glider_heading import GliderHeading
from auv_gym.param import replace_at

NAME = "auv_gym_study/RandomGliderHeading-v0"


class Drawn(gymnasium.Wrapper):
    """GliderHeading whose vehicle is another one in each episode; observations stay those of the given vehicle."""

    def __init__(self, env: GliderHeading, randomise: Mapping[str, tuple[float, float]]):
        super().__init__(env)
        self._glider, self._ranges = env, dict(randomise)
        self._rng = np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """The first observation and info of an episode with a vehicle of its own."""
        if seed is not None:
            self._rng = np.random.default_rng([seed, 1])
        values = {path: float(self._rng.uniform(low, high)) for path, (low, high) in self._ranges.items()}
        self._glider.model = replace_at(self._glider.plant, values)
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, {**info, "randomised": values}


def make(randomise: Mapping[str, tuple[float, float]], **options: Any) -> Drawn:
    """The environment; options: of GliderHeading."""
    return Drawn(GliderHeading(**options), randomise)


if NAME not in gymnasium.registry:
    gymnasium.register(id=NAME, entry_point="scripts.studies.rl.randomised:make")
