"""The environment and the controller described by a run's settings; raises ValueError if they do not match."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from auv_gym.channels import CHANNELS
from auv_gym.model import Model
from auv_gym.param import did_you_mean, replace_at
from auv_gym.plant import Plant, load_vehicle
from controllers.autopilots import autopilot
from controllers.composed.envelope import Envelope as Enveloped
from controllers.composed.excited import Excited, added_by
from controllers.controller import Controller
from controllers.relay import Relay
from identification.campaign.file.settings import (
    Envelope,
    EnvExperiment,
    Excitation,
    MissionExperiment,
    RunSettings,
    Vehicle,
)
from identification.experiments.driving import check_followed, checked_steps, commanded
from identification.experiments.excitation import SIGNALS, make_signal

_OPTIONS = {  # keys of the file, by the environments' option names
    "duration": "duration_s",
    "actions": "actions",
    "target": "target",
    "waypoints": "waypoints",
    "near": "near",
    "depths": "depths",
    "randomise": "randomise",
    "compass_noise": "compass_noise_rad",
    "speed": "speed_mps",
}


# Excitations that respond to the vehicle instead of being fixed signals, with the defaults of their settings.
RELAYS: Mapping[str, Mapping[str, Any]] = {"relay": {}, "zigzag": {"measured": "heading_rad"}}


def make_campaign_vehicle(vehicle: Vehicle, folder: Path, *, effects: bool = True) -> Plant:
    """The plant of a campaign's vehicle, with or without its effects; files are in `folder`."""
    plant = load_vehicle(vehicle.preset or folder / str(vehicle.file), dt=vehicle.dt_s)
    return replace_at(plant, vehicle.effects) if effects else plant


def make_env(settings: RunSettings, folder: Path, *, model: Model | None = None) -> gymnasium.Env:
    """The environment of a run; if a model replaces the vehicle, the vehicle's effects are left out."""
    import auv_gym.envs  # noqa: F401  # registers them

    experiment = _env_experiment(settings)
    sampling = {f"effects.sampling.{path}": value for path, value in settings.sensors.items()}
    options = {ours: getattr(experiment, theirs) for ours, theirs in _OPTIONS.items()}
    options = {name: value for name, value in options.items() if value is not None}
    if model is not None:
        options["model"] = model
        options.pop("randomise", None)
    if settings.vehicle is not None:
        # without effects: scales, limits and gains are those of the vehicle as designed
        options["vehicle"] = make_campaign_vehicle(settings.vehicle, folder, effects=False)
        if model is None:
            sampling = {**settings.vehicle.effects, **sampling}
    if sampling:
        options["effects"] = sampling
    try:
        return gymnasium.make(experiment.env_id, **options)
    except gymnasium.error.UnregisteredEnv as error:
        raise ValueError(f"experiment.id: {error}. See docs/environments.md for those of this package.") from None
    except TypeError as error:  # an option of other environments
        raise ValueError(f"{experiment.env_id} does not take all of {', '.join(options)}: {error}.") from None


def make_campaign_controller(settings: RunSettings, env: gymnasium.Env, folder: Path = Path()) -> Controller:
    """The autopilot of a run, with its excitation added and its envelope around it; see `make_env`."""
    assert settings.controller is not None  # ensured by RunSettings
    inner: Any = env.unwrapped
    given = settings.controller.settings
    if settings.controller.gains_file is not None:
        given["gains"] = folder / settings.controller.gains_file
    try:
        plain = autopilot(inner.plant, settings.controller.kind, **given)
    except TypeError as error:
        raise ValueError(f"controller: kind {settings.controller.kind!r} does not take {given}: {error}.") from None
    controller = plain
    if settings.excitation:
        _, info = env.reset(seed=settings.seed)
        for number, given in enumerate(settings.excitation):
            if given.kind in RELAYS:
                controller = _relayed(controller, number, given, info["command"], commanded(env))
        signals = _signals(settings, env, (*info["target"], *added_by(plain)))
        # a command without a target moves about its initial value
        at_rest = {name: info["command"][name] for name in signals if name in commanded(env)}
        controller = Excited(controller, signals, inner.plant.dt, at_rest) if signals else controller
    if settings.envelope is not None:
        controller = _enveloped(controller, plain, settings.envelope)
    return controller


def check_campaign_run(settings: RunSettings, folder: Path) -> None:
    """Raise ValueError if a run cannot be performed; simulates two samples, which also compiles what the run needs."""
    if isinstance(settings.experiment, EnvExperiment):
        for name, steps in settings.experiment.steps.items():
            checked_steps(name, steps)
        env = make_env(settings, folder)
        controller = make_campaign_controller(settings, env, folder)
        try:
            check_followed(controller, settings.experiment.targets)
        except ValueError as error:
            raise ValueError(f"experiment.targets: {error}") from None
        _, info = env.reset(seed=settings.seed)
        inner: Any = env.unwrapped
        target = dict(info["target"]) | {n: s[0][1] for n, s in settings.experiment.steps.items()}
        reading = {**info["reading"], "dt_s": inner.plant.dt}
        command, _ = controller.act(controller.start(), reading, target)
        missing = [name for name in commanded(env) if name not in command]
        if missing:
            raise ValueError(
                f"{settings.experiment.env_id} waits for {', '.join(missing)}, and the controller commands "
                f"{', '.join(n for n in command if n in inner.plant.inputs) or 'nothing'}: set experiment.targets for "
                "what moves it, or leave it out of experiment.actions."
            )
        env.step(inner.action_for(command))
    elif isinstance(settings.experiment, MissionExperiment):
        from identification.experiments.missions import check_mission

        assert settings.vehicle is not None  # ensured by RunSettings
        check_mission(make_campaign_vehicle(settings.vehicle, folder), settings.experiment.settings)
    elif settings.vehicle is not None:
        make_campaign_vehicle(settings.vehicle, folder)


def _env_experiment(settings: RunSettings) -> EnvExperiment:
    if not isinstance(settings.experiment, EnvExperiment):
        raise ValueError(f"An environment needs an experiment of kind 'env', got {settings.experiment.kind!r}.")
    return settings.experiment


def _signals(settings: RunSettings, env: gymnasium.Env, target: Sequence[str]) -> dict[str, np.ndarray]:
    """The signals added to a controller, by channel; several signals at one channel are summed."""
    inner: Any = env.unwrapped
    experiment = _env_experiment(settings)
    if experiment.duration_s is None:
        raise ValueError("experiment.duration_s is needed where there is excitation, whose length it is.")
    samples = ceil(experiment.duration_s / inner.plant.dt - 1e-9) + 1
    known = (*commanded(env), *target, *experiment.targets)
    signals: dict[str, np.ndarray] = {}
    for number, given in enumerate(settings.excitation):
        if given.kind in RELAYS:
            continue
        if given.kind not in SIGNALS:
            kinds = (*SIGNALS, *RELAYS)
            raise ValueError(
                f"excitation.{number}.kind: no {given.kind!r}. {did_you_mean(given.kind, kinds)}"
                f"Kinds: {', '.join(kinds)}."
            )
        if given.at not in known:
            raise ValueError(
                f"excitation.{number}.at needs a command or a target of this experiment "
                f"({', '.join(dict.fromkeys(known))}), got {given.at!r}."
            )
        rng = np.random.default_rng([settings.seed, number])
        try:
            signal = make_signal(given.kind, samples, inner.plant.dt, rng, start_s=given.start_s, **given.settings)
        except ValueError as error:
            raise ValueError(f"excitation.{number}: {error}") from None
        signals[given.at] = signals.get(given.at, 0.0) + signal
    return signals


def _relayed(
    controller: Controller, number: int, given: Excitation, rest: Mapping[str, float], commands: Sequence[str]
) -> Controller:
    """The controller with a command that switches in response to the vehicle, about its value at rest."""
    settings = {**RELAYS[given.kind], **given.settings}
    if given.at not in commands or given.start_s:
        raise ValueError(
            f"excitation.{number}: a {given.kind} is at one of the commands {', '.join(commands)}, from the start on; "
            f"got at = {given.at!r}, start_s = {given.start_s:g}."
        )
    if "amplitude" in settings and "band" not in settings and given.kind == "zigzag":
        settings["band"] = abs(settings["amplitude"])
    try:
        return Relay(controller, given.at, neutral=rest[given.at], **settings)
    except TypeError as error:
        raise ValueError(f"excitation.{number}: a {given.kind} needs amplitude, measured and band: {error}.") from None


def _enveloped(controller: Controller, guard: Controller, envelope: Envelope) -> Controller:
    """The controller within an envelope, with the guard that takes over at its limits."""
    for name in envelope.limits:
        if name not in CHANNELS:
            raise ValueError(f"envelope needs readings by channel, got {name!r}.")
    try:
        return Enveloped(controller, guard, envelope.limits, **envelope.options)
    except TypeError as error:
        raise ValueError(f"envelope does not take {envelope.options}: {error}.") from None
