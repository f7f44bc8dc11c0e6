"""The inputs of a training, its environments, and the file that records both."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from math import ceil
from pathlib import Path
from typing import Any

import gymnasium

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.model import Model
from auv_gym.models.files import save_model
from auv_gym.param import did_you_mean
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.rl.hyperparameters import Hyperparameters, checked, hyperparameters_for

FORMAT, VERSION = "auv-gym policy", 1
SETTINGS = "settings.json"
TRUE = "true"
_NOTABLY_MORE = 1.1  # times the steps asked for


@dataclass(frozen=True)
class Training:
    """The inputs of a training; with these, it is the same on the same machine and versions.

    env: `auv_gym/Depth-v0` or `Depth-v0`.  on: "true" for the vehicle of the environment, else what replaces it, a
    Model or a model or vehicle file.  steps, envs, frames: replace those of the hyperparameters.
    recurrent: whether the policy has a recurrent layer; such a policy cannot start from a controller.
    options: of the environment, such as {"vehicle": "npsauv", "effects": {...}, "randomise": {...}}.
    hyperparameters: replace the shipped ones.  evaluations: number during the training, each over `episodes`.

    Example:

        >>> from auv_gym.rl import Training
        >>> training = Training("Depth", steps=20_000, options={"vehicle": "npsauv"})
        >>> training.env, training.chosen.n_timesteps, training.learning_options["vehicle"]
        ('auv_gym/Depth-v0', 20000, 'npsauv')
    """

    env: str
    on: str | os.PathLike | Model = TRUE
    seed: int = 0
    steps: int | None = None
    envs: int | None = None
    frames: int | None = None
    recurrent: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    hyperparameters: Hyperparameters | Mapping[str, Any] | None = None
    evaluations: int = 20
    episodes: int = 16

    def __post_init__(self) -> None:
        object.__setattr__(self, "env", full_env_id(self.env))
        for name in ("evaluations", "episodes"):
            _check_count(name, getattr(self, name), 1)
        _check_count("seed", self.seed, 0)
        for name in ("model", "render_mode"):
            if name in self.options:
                raise ValueError(f"options holds {name}, which training sets itself: {_INSTEAD[name]}.")
        given = self.hyperparameters
        if given is None:
            found = hyperparameters_for(self.env)
        else:
            values = given.model_dump(exclude_unset=True) if isinstance(given, Hyperparameters) else dict(given)
            found = checked(values)
        kept = found.model_dump(exclude_unset=True)
        for label, name in (("steps", "n_timesteps"), ("envs", "n_envs"), ("frames", "frame_stack")):
            value = getattr(self, label)
            if value is not None:
                _check_count(label, value, 1)
                kept[name] = value
        if self.recurrent:
            kept |= {"policy": "MlpLstmPolicy", "imitate": None}
        object.__setattr__(self, "hyperparameters", checked(kept))
        object.__setattr__(self, "options", {**found.env_kwargs, **self.options})

    @property
    def chosen(self) -> Hyperparameters:
        """The hyperparameters with `steps`, `envs`, `frames` and `recurrent` applied."""
        assert isinstance(self.hyperparameters, Hyperparameters)
        return self.hyperparameters

    @property
    def whole_steps(self) -> int:
        """The training steps in whole rollouts of all environments, in which PPO learns."""
        rollout = self.chosen.n_envs * self.chosen.n_steps
        return ceil(self.chosen.n_timesteps / rollout) * rollout

    @property
    def remarks(self) -> tuple[str, ...]:
        """What few training steps lead to, in sentences; empty if there are enough."""
        found, chosen, steps = [], self.chosen, self.whole_steps
        if steps > _NOTABLY_MORE * chosen.n_timesteps:
            found.append(
                f"PPO learns in whole rollouts of {chosen.n_envs} environments and {chosen.n_steps} steps each: "
                f"training takes {steps} steps instead of {chosen.n_timesteps}. Fewer take a smaller n_envs or n_steps."
            )
        if chosen.imitate is not None and steps <= chosen.imitate.value_steps:
            found.append(
                f"The policy will be the imitated controller ({chosen.imitate.controller}) unchanged: in the first "
                f"{chosen.imitate.value_steps} steps only values are learned, and training takes {steps}. Give more "
                "steps, or hyperparameters with smaller value_steps."
            )
        return tuple(found)

    @property
    def learning_options(self) -> dict[str, Any]:
        """Options of the training environments."""
        return {**self.chosen.train_env_kwargs, **self.options}


_INSTEAD = {"model": "give it as `on`", "render_mode": "pictures are drawn of the trained policy"}


def full_env_id(env: str) -> str:
    """The name registered in Gymnasium: `auv_gym/Depth-v0` for `Depth-v0` or `Depth`; raises on others."""
    known = list(gymnasium.registry)
    for name in (env, f"auv_gym/{env}", f"auv_gym/{env}-v0"):
        if name in known:
            return name
    ours = [name for name in known if name.startswith("auv_gym/")]
    raise ValueError(f"No environment {env!r}. {did_you_mean(env, ours)}Ours are {', '.join(ours)}.")


def make_env(env: str, on: str | os.PathLike | Model = TRUE, render_mode: str | None = None, **options: Any) -> Any:
    """A single environment, driven by its vehicle or by `on`; options are the environment's."""
    if not isinstance(on, str) or on != TRUE:
        options = {**options, "model": on}
    given = {name: value for name, value in options.items() if value is not None}
    try:
        return gymnasium.make(full_env_id(env), disable_env_checker=True, render_mode=render_mode, **given)
    except TypeError as error:
        if "unexpected keyword" not in str(error):
            raise
        raise ValueError(
            f"{full_env_id(env)} does not take these options: {error}. See docs/environments.md."
        ) from None


def described(training: Training, folder: Path) -> dict[str, Any]:
    """The content of `settings.json` for a training, without its result; the named files are put into the folder."""
    env = make_env(training.env, training.on, **training.options)
    actions = env.action_space
    if not isinstance(actions, gymnasium.spaces.Box) or (actions.low != -1.0).any() or (actions.high != 1.0).any():
        raise ValueError(
            f"Training needs actions from -1 to 1, got {actions} of {training.env}: wrap it, see Gymnasium."
        )
    files: dict[str, dict[str, str]] = {}
    model = getattr(env.unwrapped, "model", None)
    if model is not None:
        files["trained_on"] = _kept(model, folder, "trained_on")
    options = dict(training.options)
    vehicle = options.get("vehicle")
    if isinstance(vehicle, Plant) or (vehicle is not None and os.fspath(vehicle) not in list_vehicles()):
        plant = vehicle if isinstance(vehicle, Plant) else load_vehicle(vehicle)
        files["vehicle"] = _kept(plant, folder, "vehicle")
        options["vehicle"] = files["vehicle"]["name"]
    given = training.on
    on = str(given) if isinstance(given, str | os.PathLike) else type(given).__name__
    return {
        "format": FORMAT,
        "version": VERSION,
        "env": training.env,
        "on": on if on == TRUE else Path(on).name,
        "options": _plain(options),
        "seed": training.seed,
        "hyperparameters": _plain(training.chosen.model_dump(exclude_unset=True)),
        "evaluations": training.evaluations,
        "episodes": training.episodes,
        "files": files,
    }


def _kept(model: Model, folder: Path, stem: str) -> dict[str, str]:
    """Name and digest of the file to which a model is written."""
    path = folder / f"{stem}{'.toml' if isinstance(model, Plant) and model.learned is None else '.npz'}"
    save_model(model, path)
    return {"name": path.name, "sha256": content_digest(path)}


def content_digest(path: Path) -> str:
    """The hash of a file's content; for a .npz, of its arrays, since the archive includes the time of writing."""
    import numpy as np

    found = sha256()
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as content:
            for name in sorted(content.files):
                found.update(name.encode() + content[name].tobytes())
    else:
        found.update(path.read_bytes())
    return found.hexdigest()


def _plain(value: Any) -> Any:
    """The value in the form of JSON."""
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.item() if hasattr(value, "item") else value


def _check_count(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(f"{name} needs a whole number from {least} on, got {value!r}.")
