"""The environments' names and where each class is; the classes are imported when an environment is made."""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

ENVIRONMENTS = {
    "auv_gym/GliderHeading-v0": "auv_gym.envs.glider_heading:GliderHeading",
}


def register_envs() -> None:
    """Enter all environments into gymnasium's registry; those that are there already stay as they are."""
    for name, entry_point in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, entry_point=entry_point)
