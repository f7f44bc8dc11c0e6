"""Simulated dives and climbs of a glider that flies by its polar, in the form of its logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import exp, radians

import numpy as np

from auv_gym.model import check_finite
from auv_gym.plant import Plant
from auv_gym.plant.flying import battery_for, neutral_engine, turning_input
from auv_gym.records.record import Record, concat

_START = 12.0  # m, where a dive's record begins and ends, below bubbles and waves
_FINE = 1.0  # s, step at which attitude, engine and water change between samples
_PUMP = 2.5e-6  # m^3/s; a Seaglider pumps 300 cm3 in about two minutes
_ATTITUDE = ("roll_rad", "pitch_rad", "heading_rad")
_MASSES = ("battery_position_m", "battery_roll_rad", "rudder_rad")
_ANGLE_NOISE = radians(0.3)  # of attitude readings; assumed
_TURN = 15.0  # s, time constant of the transition from dive to climb
_NET = (1.0e-4, 2.0e-4)  # m^3 off neutral at the end of a dive or a climb
_PITCH = (radians(16.0), radians(28.0))
_WANDER, _PERIODS = radians(1.0), (140.0, 330.0)  # of the pitch, rad and s, if samples can follow it
_FOLLOWED = 8  # samples in the shorter period, at least
_MOST = 20_000.0  # s, of a dive that never returns


def open_sea(depth: float) -> float:
    """Water temperature, degC, at a depth, m: 12 at the surface and 5 deep down; assumed numbers."""
    return 5.0 + 7.0 * exp(-max(depth, 0.0) / 120.0)


def sea_density(depth: float) -> float:
    """Density, kg/m^3, of water of `open_sea` with salinity 35 at a depth, m; within 0.1 of TEOS-10 down to 500 m.

    Linear: 1027.7 at 5 degC and the surface, minus 0.17 per degree, plus sea water's compressibility of 4.6e-3 kg/m^4.
    """
    return 1027.7 - 0.17 * (open_sea(depth) - 5.0) + 4.6e-3 * max(depth, 0.0)


def yo_mission(
    plant: Plant,
    depths: Sequence[float] = (120.0, 300.0, 200.0, 300.0),
    *,
    rng: np.random.Generator,
    noise: float = 0.05,
    dt: float | None = None,
    measured: bool = True,
    truth: Callable[[Plant], Plant] = lambda plant: plant,
) -> Record:
    """A record of dives to these depths, one segment each, from 12 m down and back up to 12 m.

    Net buoyancy and pitch are drawn for each dive: 100 to 200 cm3 below neutral at the deepest point and above neutral
    at the end of the climb, and 16 to 28 degrees; pitch and heading wander slowly.  buoyancy_volume_m3 and pitch_rad
    are the logged values, before any effect.  If masses steer the glider, they are moved to reach these angles, and the
    attitude is what results.  noise: m, white, of the depth.  dt: s between samples, default the vehicle's.
    measured: whether the log has the water's density.  truth: maps the plant used for planning to the plant that flies.
    Raises Diverged.
    """
    low, high = plant.hull.engine_low, plant.hull.engine_high
    if not depths or not all(_START + 20.0 <= depth <= 1000.0 for depth in depths):
        raise ValueError(
            f"The dives of {plant.name!r} need target depths (--target-depth, target_depths) from {_START + 20.0:g} to "
            f"1000 m, one for each dive; got {', '.join(f'{depth:g}' for depth in depths) or 'none'}."
        )
    every = plant.dt if dt is None else dt
    if not every >= _FINE or not noise >= 0.0:
        raise ValueError(f"A mission needs dt of at least {_FINE:g} s and noise >= 0 m, got {every} and {noise}.")
    flying = replace(truth(plant), dt=_FINE, longest_step=_FINE)
    read = ("depth_m", *(name for name in _ATTITUDE if name in flying.outputs))
    records, begun = [], 0.0
    for depth in depths:
        deep, shallow = (neutral_engine(plant, d, sea_density(d), open_sea(d)) for d in (depth, _START))
        net, pitches = rng.uniform(*_NET, size=2), rng.uniform(*_PITCH, size=2)
        lift, turns, heading = rng.uniform(0.0, 6.28, size=3)
        engines = max(deep - net[0], low), min(shallow + net[1], high)
        columns, took = _flown(flying, read, depth, engines, pitches, (lift, turns), heading, every, begun)
        begun += took + 600.0  # at the surface
        records.append(_record(columns, read, rng, noise, measured))
    labels = [f"dive {k}" for k in range(1, len(records) + 1)]
    joined = concat(records).with_labels(labels)
    return joined.with_notes([], source="simulated", vehicle=plant.name, depth_noise_m=noise)


def _flown(
    flying: Plant,
    read: Sequence[str],
    depth: float,
    engines: tuple[float, float],
    pitches: np.ndarray,
    phases: tuple[float, float],
    heading: float,
    every: float,
    begun: float,
) -> tuple[dict[str, np.ndarray], float]:
    """The exact log of a dive, by column, and its duration, s.

    engines, pitches (2,): down and up.  phases: of the pitch's wandering.  begun: s of the record.
    """
    (sinking, rising), (down, up) = engines, pitches
    slower = max(1.0, _FOLLOWED * every / _PERIODS[0])
    engine, pitch, climbing, t = sinking, -down, False, 0.0
    rows: list[dict[str, float]] = []
    x = flying.initial(np.array([{"depth_m": _START, "heading_rad": heading}.get(n, 0.0) for n in flying.outputs]))
    x[flying.states.index("buoyancy_volume_m3 position")] = engine
    # a log has the measured positions of masses; the engine is moved at its rate here
    moved = {name: flying.states.index(f"{name} position") for name in flying.inputs if name in _MASSES}

    def given() -> dict[str, float]:
        """The inputs at the present time."""
        phase = 6.28 * t / slower
        wander = _WANDER * (np.sin(phase / _PERIODS[0] + phases[0]) + np.sin(phase / _PERIODS[1] + phases[1]))
        return {
            "buoyancy_volume_m3": engine,
            "temperature_C": open_sea(x[0]),
            **_steering(flying, pitch + wander, heading + 3.0 * wander, engine, np.sin(0.2 * t / every)),
            "density_kgpm3": sea_density(x[0]),
            "elapsed_s": begun + t,
        }

    while not (climbing and x[0] <= _START) and t < _MOST:
        climbing = climbing or x[0] >= depth
        u = given()
        if t % every < _FINE:
            measured = dict(zip(flying.outputs, flying.output(x), strict=True))
            own = {name: x[moved[name]] if name in moved else value for name, value in u.items()}
            rows.append({"time_s": t} | {name: measured[name] for name in read} | own)
        t += _FINE
        engine += min(max((rising if climbing else sinking) - engine, -_PUMP * _FINE), _PUMP * _FINE)
        pitch += ((up if climbing else -down) - pitch) * (1.0 - exp(-_FINE / _TURN))
        # the mean over the step, since logs are interpolated linearly: held initial values would be half a step late
        later = given()
        x = flying.step(x, np.array([0.5 * (u[name] + later[name]) for name in flying.inputs]))
        check_finite(flying.states, np.array([t]), x[None, :])
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}, t


def _steering(plant: Plant, pitch: float, heading: float, engine: float, weave: float) -> dict[str, float]:
    """The inputs that bring a glider to an attitude; a steered one turns to either side, following `weave`."""
    if "pitch_rad" in plant.inputs:
        return {"pitch_rad": pitch, "heading_rad": heading}
    turning, limit = turning_input(plant)
    still = dict.fromkeys(_MASSES, 0.0)
    return {**still, "battery_position_m": battery_for(plant, pitch, engine), turning: 0.5 * limit * weave}


def _record(
    columns: dict[str, np.ndarray], read: Sequence[str], rng: np.random.Generator, noise: float, measured: bool
) -> Record:
    """A dive as it is logged; columns: the exact log.  read: the outputs among them."""
    time, count = columns["time_s"], len(columns["time_s"])
    logged = {n: v for n, v in columns.items() if n != "time_s" and (measured or n != "density_kgpm3")}
    logged["depth_m"] = logged["depth_m"] + noise * rng.standard_normal(count)
    for name in read[1:]:
        logged[name] = logged[name] + _ANGLE_NOISE * rng.standard_normal(count)
    return Record.from_arrays(time, logged)
