"""The environments' names and where each class is; the classes are imported when an environment is made."""

from __future__ import annotations

from typing import Any

_ONE, _MANY = "auv_gym.envs.task_env:TaskEnv", "auv_gym.envs.vector_env:TaskVectorEnv"

# Name to what gymnasium's `register` takes besides.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    f"auv_gym/{task}-v0": {
        "entry_point": _ONE,
        "vector_entry_point": _MANY,
        "kwargs": {"task": task},
        # they keep the order of calls and the bounds of observations themselves: wrappers would only cost time
        "order_enforce": False,
        "disable_env_checker": True,
    }
    for task in ("GliderHeading", "Depth", "Heading", "Speed", "Path", "FloatDepth", "StationKeeping", "Pose", "Glide")
}


def register_envs() -> None:
    """Enter all environments into gymnasium's registry; those that are there already stay as they are."""
    # Imported here: the import of gymnasium may itself call this function, see `auv_gym.autoload`.
    from gymnasium.envs.registration import register, registry

    for name, details in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, **details)
