"""Runs of environments that several tests are made of."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class InPython:
    """A plant that the environments do not know as one."""

    plant: Any

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.plant, name)


def run(env, actions, seed=0, **options):
    """The steps of an episode with these actions; options of the reset."""
    env.reset(seed=seed, options=options)
    return [env.step(np.atleast_1d(np.array(action, np.float32))) for action in actions]


def drawn_actions(env, count, seed=1, size=0.4):
    """Actions up to a size that stay for a while each."""
    draws = np.random.default_rng(seed).uniform(-size, size, (count // 10 + 1, *env.action_space.shape))
    return np.repeat(draws, 10, axis=0)[:count]


def ends(env, actions):
    """Step over the ends of episodes; the reasons of those that were terminated, and how many were truncated."""
    reasons, whole = [], 0
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            assert np.isfinite([reward, *observation, *info["state"].values()]).all()
            assert terminated == bool(info["reason"])
            reasons += [info["reason"]] * terminated
            whole += truncated
            env.reset()
    return reasons, whole
