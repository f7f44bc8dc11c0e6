"""Names and classes of the environments; a class is imported when an environment is made."""

from __future__ import annotations

from typing import Any

_ONE, _MANY = "auv_gym.envs.task_env:TaskEnv", "auv_gym.envs.vector_env:TaskVectorEnv"

# Name to the other arguments of gymnasium's `register`.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    f"auv_gym/{task}-v0": {
        "entry_point": _ONE,
        "vector_entry_point": _MANY,
        "kwargs": {"task": task},
        # the environments check call order and observation bounds themselves: wrappers would only cost time
        "order_enforce": False,
        "disable_env_checker": True,
    }
    for task in ("GliderHeading", "Depth", "Heading", "Speed", "Path", "FloatDepth", "StationKeeping", "Pose", "Glide")
}


def register_envs() -> None:
    """Register all environments with gymnasium; names that are already registered stay unchanged."""
    # Imported here, since the import of gymnasium may itself call this function, see `auv_gym.autoload`.
    from gymnasium.envs.registration import register, registry

    for name, details in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, **details)
