"""Logs of the standard experiments under drawn conditions, one function for each kind of vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import radians
from typing import Any

import numpy as np
from scipy.signal import lfilter

from auv_gym.param import replace_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from controllers.pid import heading_pid
from identification.experiments.float_dives import depth_control, oil_mission, summer_lake
from identification.experiments.glider_dives import yo_mission
from identification.experiments.heading_control import closed_loop
from identification.experiments.hovering import hover
from identification.experiments.manoeuvres import NOISE, steer
from scripts.blind.changing import SURFACED
from scripts.blind.own_torpedo import manoeuvred

_COMPASS, _TRACK = radians(0.5), 1.0  # rad, m
_LAKE_DEPTH, _SEA_DEPTH = 0.02, 0.1  # m, noise of a float's pressure sensor; a torpedo's is the first
_RUDDER, _FINS = 0.3, 0.15  # excitation of a glider and of a torpedo, over a fin's limit
_WRENCH, _THRUSTERS = 0.15, 0.3  # of a vehicle with thrusters, over their capacity: along an axis, each by itself
_SAMPLES = (5.0, 10.0, 20.0, 60.0)  # s, between the samples of a flying glider
_YOS, _YO_DEPTH = (100.0, 150.0, 200.0, 300.0), 0.05  # m, its dives and the noise of its pressure sensor
_HEAVE = (2e-3, 120.0)  # m/s and s, vertical velocity of its water, RMS and correlation time


@dataclass(frozen=True)
class Conditions:
    """The conditions of a log; noise, excitation: factors of the usual ones.

    duration: s, of a log of a torpedo, a glider or a vehicle with thrusters.  measured: by a vehicle with thrusters,
    see `identification.experiments.hovering.hover`.  sampling: "even" or "realistic", see `scripts.blind.sampling`.
    push: error that process noise causes in free runs of the true vehicle, over the noise of the leading sensor; 0: no
    process noise.  water: seed of the correlation times of the process noise.
    """

    noise: float
    excitation: float
    duration: float
    measured: str = "all"
    sampling: str = "even"
    push: float = 0.0
    water: int = 0


def lake_settings(rng: np.random.Generator) -> dict[str, Any]:
    """Forty minutes of a float, down and up ten times, once to the surface."""
    deep, shallow = rng.permutation([60.0, 50.0, 45.0, 40.0, 35.0]), rng.permutation([20.0, 15.0, 10.0, 5.0, 0.0])
    return {"target_depths": np.stack([deep, shallow], axis=1).ravel().tolist(), "duration": 2400.0}


def dive_settings(rng: np.random.Generator) -> dict[str, Any]:
    """Eight dives of a float with an oil bladder, to 300 to 1500 m."""
    return {"target_depths": rng.permutation(np.linspace(300.0, 1500.0, 8)).tolist()}


# `moving` replaces the plant, see `scripts.blind.changing`; each dive has its own clock unless the plant is replaced.


def glider_log(plant: Plant, conditions: Conditions, rng: np.random.Generator, moving: Any = None) -> Record:
    """A glider under heading control."""
    return closed_loop(
        moving or plant,
        heading_pid(plant),
        rng=rng,
        duration=conditions.duration,
        compass_noise=conditions.noise * _COMPASS,
        track_noise=conditions.noise * _TRACK,
        rudder_excitation=conditions.excitation * _RUDDER,
    )


def lake_log(plant: Plant, conditions: Conditions, rng: np.random.Generator, moving: Any = None) -> Record:
    """A float with a piston in a stratified lake."""
    settings = lake_settings(rng)
    targets = [conditions.excitation * depth for depth in settings["target_depths"]]
    hold, noise = settings["duration"] / len(targets), conditions.noise * _LAKE_DEPTH
    return depth_control(
        plant, targets, rng=rng, hold=hold, noise=noise, temperature_profile=summer_lake, under_way=moving
    )


def yo_log(plant: Plant, conditions: Conditions, rng: np.random.Generator, moving: Any = None) -> Record:
    """Dives of a flying glider in water that moves up and down at random.

    Raises ValueError if a dive ends at the depth of neutral buoyancy.
    """
    depths = [conditions.excitation * depth for depth in rng.permutation(_YOS).tolist()]
    noise, every = conditions.noise * _YO_DEPTH, float(rng.choice(_SAMPLES))
    record = yo_mission(plant, depths, rng=rng, noise=noise, dt=every, truth=lambda given: moving or given)
    ends = [(record["depth_m"][part][-1], record["depth_m"][part].max()) for part in record.segments]
    if any(last > 0.5 * deepest for last, deepest in ends):
        raise ValueError(f"{plant.name} does not come back from every dive: choose other effects.")
    kept, rate = np.exp(-every / _HEAVE[1]), np.zeros(len(record))
    for part in record.segments:
        pushes = conditions.noise * _HEAVE[0] * rng.standard_normal(part.stop - part.start)
        rate[part] = lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], pushes)
    record = heaved(record, rate)
    return record if moving is None else continued(record)


def heaved(record: Record, rate: np.ndarray) -> Record:
    """Dives in water that moves down at a rate, m/s, (n,), at each sample, together with its density.

    A dive ends if this brings it to the surface.
    """
    moved, under = np.zeros(len(record)), np.ones(len(record), dtype=bool)
    for part in record.segments:
        moved[part] = np.r_[0.0, np.cumsum(rate[part][:-1] * np.diff(record.time[part]))]
        depth = record["depth_m"][part] + moved[part]
        deepest = int(np.argmax(depth))
        under[part.start + deepest : part.stop] = np.minimum.accumulate(depth[deepest:]) > 0.0
    return record.with_channels({"depth_m": record["depth_m"] + moved}).select(under)


def sea_log(plant: Plant, conditions: Conditions, rng: np.random.Generator, moving: Any = None) -> Record:
    """Dives of a float with an oil bladder."""
    targets = [conditions.excitation * depth for depth in dive_settings(rng)["target_depths"]]
    record = oil_mission(plant, targets, rng=rng, noise=conditions.noise * _SEA_DEPTH, under_way=moving)
    return record if moving is None else continued(record)


def continued(record: Record) -> Record:
    """Dives on one clock, which rises through the log: that of `elapsed_s`, or one with `SURFACED` between dives."""
    time = record.time
    if record.has("elapsed_s"):
        time = record["elapsed_s"]
    else:
        for before, part in pairwise(record.segments):
            time[part] += time[before.stop - 1] + SURFACED - time[part.start]
    return Record(record.dataset.assign_coords(time_s=("time_s", time)))


def torpedo_log(plant: Plant, conditions: Conditions, rng: np.random.Generator, moving: Any = None) -> Record:
    """Manoeuvres of a torpedo."""
    noise, excitation = torpedo_noise(conditions.noise), torpedo_excitation(conditions.excitation)
    if moving is not None:
        return manoeuvred(plant, moving, rng, conditions.duration, excitation, noise)
    sensors = {f"effects.sampling.{sensor}.noise": size for sensor, size in noise.items()}
    record = steer(replace_at(plant, sensors), rng=rng, duration=conditions.duration, excitation=excitation)
    names = [name for name in record.names if not name.startswith("excitation_") and name != "pitch_cmd_rad"]
    return plain(record, names)


def hover_log(plant: Plant, conditions: Conditions, rng: np.random.Generator, moving: Any = None) -> Record:
    """A vehicle with thrusters: following steps, or uncontrolled without a measured position."""
    steered = conditions.measured == "all"
    record = hover(
        plant,
        rng=rng,
        duration=conditions.duration,
        loop="closed" if steered else "open",
        amplitude=conditions.excitation * (_WRENCH if steered else _THRUSTERS),
        measured=conditions.measured,
        noise=conditions.noise,
        under_way=moving,
    )
    return plain(record, [n for n in record.names if not n.startswith("excitation_") and not n.endswith(("_N", "_Nm"))])


def torpedo_noise(level: float) -> dict[str, float]:
    """Standard deviations of a torpedo's sensors at a noise level."""
    return {name: level * size for name, size in {**NOISE, "compass": _COMPASS, "depth": 0.02}.items()}


def torpedo_excitation(excitation: float) -> float:
    """Amplitude of the excitation over a fin's limit."""
    return excitation * _FINS


def plain(record: Record, names: list[str]) -> Record:
    """These channels of a record of one segment, with no trace of its origin."""
    attrs = {"source": "simulated", "vehicle": record.attrs["vehicle"]}
    return Record.from_arrays(record.time, {name: record[name] for name in names}, attrs=attrs)
