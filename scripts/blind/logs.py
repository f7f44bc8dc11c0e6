"""Logs of the standard experiments, under drawn conditions, and which effects no log of a kind can show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np

from auv_gym.param import list_paths, replace_at, spec_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from controllers.pid import heading_pid
from identification.experiments.float_dives import depth_control, oil_mission, summer_lake
from identification.experiments.heading_control import closed_loop
from identification.experiments.manoeuvres import NOISE, steer

_COMPASS, _TRACK = radians(0.5), 1.0  # rad, m
_DEPTH = {"float_piston": 0.02, "float_oil": 0.1}  # m; a torpedo's is the first
_RUDDER, _FINS = 0.3, 0.15  # excitation of a glider and of a torpedo, over a fin's stop

_NO_PISTON = "a float with an oil bladder has no piston"
_NO_OIL = "a float with a piston logs no oil"
_OWN_VOLUME = "each dive has an unknown volume, which does the same"
_NO_WAVE = "without the wave its period says nothing"
_NO_GROWTH = "without the expansion its lag says nothing"
_NO_SURFACE = "the initial depth of each free run does the same, and none is at the surface"
HIDDEN: Mapping[str, Mapping[str, str]] = {
    "glider": {},
    "float_piston": {
        "effects.depth.bias": _NO_SURFACE,
        "effects.oil.pump_gain": _NO_OIL,
        "effects.oil.valve_gain": _NO_OIL,
        "effects.oil.valve_with_depth": _NO_OIL,
        "effects.water.heave_period": _NO_WAVE,
        "effects.volume.expansion_lag": _NO_GROWTH,
    },
    "float_oil": {
        **{f"effects.piston.{name}": _NO_PISTON for name in ("gain", "backlash", "dead_time", "lag", "slowness")},
        "effects.piston.offset": f"{_NO_PISTON}, and {_OWN_VOLUME}",
        "effects.volume.offset": _OWN_VOLUME,
        "effects.tether.pull": _OWN_VOLUME,
        "effects.water.heave_sin": "the wave's phase is not known from one dive to the next",
        "effects.water.heave_cos": "the wave's phase is not known from one dive to the next",
        "effects.water.heave_period": _NO_WAVE,
        "effects.volume.expansion_lag": _NO_GROWTH,
        "effects.depth.bias": _NO_SURFACE,
        "effects.depth.scale": "without inertia it acts as the drag coefficients do, which are refitted",
        "effects.depth.lag": "in a steady dive the initial depth does the same, and three probes move it by a noise",
    },
}


@dataclass(frozen=True)
class Conditions:
    """noise, excitation: factors of the usual ones.  duration: s, of a torpedo's or a glider's log."""

    noise: float
    excitation: float
    duration: float


def known(vehicle: str) -> Plant:
    """The preset with coefficients that are known to the diagnosis's usual doubt.

    Where a preset states wide deviations, as one whose coefficients are guesses does, an effect that acts as such a
    coefficient is nothing that a log could show.
    """
    return replace(load_vehicle(vehicle), deviations={})


def effects_of(vehicle: str) -> list[str]:
    """Every effect of a vehicle that can be probed and that a log of it can show."""
    plant = load_vehicle(vehicle)
    hidden = HIDDEN.get(plant.family.name, {})
    return [
        p for p in list_paths(plant) if p.startswith("effects.") and spec_at(plant, p).probe > 0.0 and p not in hidden
    ]


def lake_settings(rng: np.random.Generator) -> dict[str, Any]:
    """Forty minutes of a float, down and up ten times, once to the surface."""
    deep, shallow = rng.permutation([60.0, 50.0, 45.0, 40.0, 35.0]), rng.permutation([20.0, 15.0, 10.0, 5.0, 0.0])
    return {"target_depths": np.stack([deep, shallow], axis=1).ravel().tolist(), "duration": 2400.0}


def dive_settings(rng: np.random.Generator) -> dict[str, Any]:
    """Eight dives of a float with an oil bladder, to 300 to 1500 m."""
    return {"target_depths": rng.permutation(np.linspace(300.0, 1500.0, 8)).tolist()}


def log_of(plant: Plant, conditions: Conditions, seed: int, moving: Any = None) -> Record:
    """The log of a glider's or a float's standard experiment, or of a torpedo's; the same manoeuvres from one seed.

    moving: what moves in the plant's place: a glider that steps, or what starts a float (`under_way`).
    Raises ValueError or Diverged where the vehicle cannot be kept on its way.
    """
    rng, noise, excitation = np.random.default_rng(seed), conditions.noise, conditions.excitation
    family = plant.family.name
    if family == "glider":
        return closed_loop(
            moving or plant,
            heading_pid(plant),
            rng=rng,
            duration=conditions.duration,
            compass_noise=noise * _COMPASS,
            track_noise=noise * _TRACK,
            rudder_excitation=excitation * _RUDDER,
        )
    if family == "float_piston":
        settings = lake_settings(rng)
        targets = [excitation * depth for depth in settings["target_depths"]]
        hold, depth_noise = settings["duration"] / len(targets), noise * _DEPTH[family]
        return depth_control(
            plant, targets, rng=rng, hold=hold, noise=depth_noise, temperature_profile=summer_lake, under_way=moving
        )
    if family == "float_oil":
        targets = [excitation * depth for depth in dive_settings(rng)["target_depths"]]
        return oil_mission(plant, targets, rng=rng, noise=noise * _DEPTH[family], under_way=moving)
    sensors = {f"effects.sampling.{sensor}.noise": size for sensor, size in torpedo_noise(noise).items()}
    record = steer(replace_at(plant, sensors), rng=rng, duration=conditions.duration, excitation=excitation * _FINS)
    names = [name for name in record.names if not name.startswith("excitation_") and name != "pitch_cmd_rad"]
    return plain(record, names)


def torpedo_noise(level: float) -> dict[str, float]:
    """Standard deviations of a torpedo's sensors at a noise level."""
    return {name: level * size for name, size in {**NOISE, "compass": _COMPASS, "depth": 0.02}.items()}


def torpedo_excitation(excitation: float) -> float:
    """Amplitude over a fin's stop."""
    return excitation * _FINS


def plain(record: Record, names: list[str]) -> Record:
    """These channels of a record of one segment, with no word of how it came about."""
    attrs = {"source": "simulated", "vehicle": record.attrs["vehicle"]}
    return Record.from_arrays(record.time, {name: record[name] for name in names}, attrs=attrs)
