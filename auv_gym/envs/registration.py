"""The environments' names and where each class is; the classes are imported when an environment is made."""

from __future__ import annotations

ENVIRONMENTS = {
    "auv_gym/GliderHeading-v0": "auv_gym.envs.glider_heading:GliderHeading",
}


def register_envs() -> None:
    """Enter all environments into gymnasium's registry; those that are there already stay as they are."""
    # Imported here: the import of gymnasium may itself call this function, see `auv_gym.autoload`.
    from gymnasium.envs.registration import register, registry

    for name, entry_point in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, entry_point=entry_point)
