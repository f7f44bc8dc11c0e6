"""Quasi-steady flight of a glider, in the vertical plane and over ground, by a published polar.

The attitude is an input, measured or commanded; depth and displacement follow.
Sources: Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4), 424-436 (Seaglider); Merckelbach, Smeed and Griffiths 2010, J.
Atmos. Oceanic Technol. 27, 547-563 (Slocum).  Depth and vertical velocity are positive down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, inf, pi, radians, sin
from typing import Any

import numpy as np

from auv_gym.compiled import compiled, view_as
from auv_gym.param import list_paths, param, part, record_type
from auv_gym.physics.actuators import command_within
from auv_gym.physics.buoyancy import GRAVITY, air_volume, exposed_volume, volume_change
from auv_gym.physics.polar import steady_glide
from auv_gym.physics.sensors import deviation
from auv_gym.vehicles.depth_sensor import sense, settle_sensors
from auv_gym.vehicles.family import Family, RightHandSide, copied, registered
from auv_gym.vehicles.glide_effects import STEERED, GlideEffects
from auv_gym.vehicles.glide_steering import Steering
from auv_gym.vehicles.operators_constants import seaglider_constants


@dataclass(frozen=True)
class GlideHull:
    """Mass, displaced volume and polar of a glider.

    With its buoyancy engine at 0 it displaces V = volume exp(-compressibility P + expansion (T - temperature)), with P
    the pressure of the water above; the engine's volume is added.  With q = density speed^2 / 2 in Pa, drag is area q
    (drag_0 q^drag_power + drag_2 attack^2) and lift area q lift_1 attack.
    """

    density: float = param(1027.5, "kg/m^3", "water density where none is measured", bounds=(900.0, 1100.0))
    mass: float = param(54.0, "kg", "mass", bounds=(1.0, 1e4))
    volume: float = param(0.0525, "m^3", "displaced volume with the engine at 0", bounds=(1e-3, 10.0))
    compressibility: float = param(0.0, "1/Pa", "compressibility", bounds=(0.0, 5e-9), probe=3e-11)
    expansion: float = param(0.0, "1/K", "thermal expansion", bounds=(-1e-3, 1e-3), probe=2e-5)
    temperature: float = param(15.0, "degC", "temperature at which the volume is stated", bounds=(-5.0, 50.0))
    area: float = param(1.0, "m^2", "reference area", bounds=(1e-4, 100.0))
    drag_0: float = param(0.01, "1", "drag at no angle of attack", bounds=(1e-5, 10.0), probe=5e-4)
    drag_power: float = param(0.0, "1", "power of the dynamic pressure with which drag_0 goes", bounds=(-0.5, 0.5))
    drag_2: float = param(0.0, "1/rad^2", "drag per angle of attack squared", bounds=(0.0, 1e3), probe=1e-3)
    lift_1: float = param(0.1, "1/rad", "lift slope", bounds=(1e-4, 1e3), probe=5e-3)
    engine_low: float = param(-3e-4, "m^3", "smallest volume of the buoyancy engine", bounds=(-1.0, 1.0))
    engine_neutral: float = param(0.0, "m^3", "volume of the buoyancy engine at rest", bounds=(-1.0, 1.0))
    engine_high: float = param(3e-4, "m^3", "largest volume of the buoyancy engine", bounds=(-1.0, 1.0))
    engine_slowness: float = param(0.0, "s/m^3", "rate limit of the engine, as time per volume", bounds=(0.0, 1e9))
    pitch_limit: float = param(1.0, "rad", "steepest pitch that it is flown at", bounds=(0.05, 1.5))
    waterplane: float = param(0.03, "m^2", "cross-section at the surface", bounds=(1e-4, 10.0))
    trim_known: float = param(1.0, "1", "0 where each dive starts with a volume of its own", bounds=(0.0, 1.0))
    as_logged: float = param(0.0, "1", "1 where constants that a log states replace these", bounds=(0.0, 1.0))


@dataclass(frozen=True)
class GlideParameters:
    """The parameter tree of a glider that flies by its polar."""

    hull: GlideHull = part(GlideHull)
    steering: Steering = part(Steering)
    effects: GlideEffects = part(GlideEffects)


_SALTS = 0.78  # kg/m^3 per unit of practical salinity, near 10 degC and 35 (TEOS-10)
_RATE_LAG = 30.0  # s, with which the depth rate state follows the balance; the depth itself has no such lag
_AT_SURFACE, _CALM, _KEPT = 2.0, 0.5, 4  # s, step at the surface; m/s, fastest rise for it; steps between evaluations


@compiled
def water_velocity(depth, time, water):
    """Velocity of the water down, m/s, at a depth, m, and a time, s: steady plus an internal wave."""
    steady = water.current + water.current_with_depth * max(depth, 0.0)
    if water.heave_sin == 0.0 and water.heave_cos == 0.0:  # the usual case, without trigonometry
        return steady
    phase = 2.0 * pi / water.heave_period * time
    return steady + water.heave_sin * sin(phase) + water.heave_cos * cos(phase)


@compiled
def net_buoyancy(depth, unknown, engine, hull_temperature, density, time, p):
    """Buoyancy minus weight, N, up.

    unknown: m^3, of this dive.  engine: m^3.  hull_temperature: degC.  density: kg/m^3.  time: s, since the log began.
    """
    hull, volume = p.hull, p.effects.volume
    pressure = hull.density * GRAVITY * max(depth, 0.0)
    squeezed, warmed = hull.compressibility + volume.compressibility, hull.expansion + volume.expansion
    displaced = (
        hull.volume
        + volume_change(hull.volume, squeezed, pressure, warmed, hull_temperature - hull.temperature)
        + engine
        + unknown
        + volume.offset
        + air_volume(volume.air, depth, hull.density)
        - volume.leak * time
        - exposed_volume(depth, hull.waterplane)
    )
    return GRAVITY * (density * displaced - hull.mass)


@compiled
def flight(depth, unknown, actuators, inputs, time, p):
    """Speed through the water, m/s, path angle, rad, up, and angle of attack, rad, in steady flight.

    actuators: [engine m^3, hull temperature degC].  inputs: as in the family.
    """
    pitch = inputs[2] - p.effects.inclinometer.pitch_bias
    return flight_at(depth, unknown, actuators[0], actuators[1], pitch, inputs[4], time, p)


@compiled
def flight_at(depth, unknown, engine, hull_temperature, pitch, density, time, p):
    """Steady flight as in `flight`, at a true pitch, rad, in water of a measured or assumed density, kg/m^3."""
    hull, polar, water = p.hull, p.effects.polar, p.effects.water
    density = density + _SALTS * water.salinity + water.gradient * depth
    force = net_buoyancy(depth, unknown, engine, hull_temperature, density, time, p)
    drag_0, lift_1 = hull.drag_0 * (1.0 + polar.growth), hull.lift_1 * (1.0 + polar.lift)
    return steady_glide(force, pitch, density, hull.area, drag_0, hull.drag_power, hull.drag_2, lift_1)


@compiled
def stable_step(x, inputs, p):
    """The longest RK4 step, s: it must not pass the surface, nor exceed twice the lag of the depth rate."""
    return min(max(x[0] / (_KEPT * _CALM), _AT_SURFACE), 2.0 * _RATE_LAG)


@compiled
def true_heading(read, compass):
    """The heading, rad, at which a compass has this reading: reading minus bias and deviation, to second order."""
    heading = read - compass.bias - deviation(read - compass.bias, compass)
    return read - compass.bias - deviation(heading, compass)


@compiled
def derivative(x, actuators, inputs, p, dx, scratch):
    """State derivative of [depth, depth rate, north, east, unknown volume, time into the sample] into dx.

    The glider flies without sideslip in the direction of its bow, minus the angle of attack, and drifts with the water.
    """
    time = inputs[5] + x[5]
    speed, path, _ = flight(x[0], x[4], actuators, inputs, time, p)
    carry(x, speed, path, true_heading(inputs[3], p.effects.compass), time, p, dx)
    dx[4] = 0.0
    dx[5] = 1.0


@compiled
def carry(x, speed, path, heading, time, p, dx):
    """Write the derivatives of depth, depth rate, north and east into dx, for flight on a true heading, rad."""
    rate = water_velocity(x[0], time, p.effects.water) - speed * sin(path)
    if x[0] <= 0.0:  # afloat
        rate = max(rate, 0.0)
    dx[0] = rate
    dx[1] = (rate - x[1]) / _RATE_LAG
    along = speed * cos(path)
    dx[2] = along * cos(heading) + p.effects.current.north
    dx[3] = along * sin(heading) + p.effects.current.east


@compiled
def enter(x, z):
    """Convert kept states to integrated ones, by adding a clock that starts with the sample."""
    z[0], z[1], z[2], z[3], z[4], z[5] = x[0], x[1], x[2], x[3], x[4], 0.0


@compiled
def shape(inputs, memory, p, shaped):
    """Write the engine's volume after its gain and stops, and the water's temperature, into shaped."""
    hull, engine = p.hull, p.effects.engine
    rest, low, high = hull.engine_neutral, hull.engine_low, hull.engine_high
    shaped[0], memory[0] = command_within(inputs[0], memory[0], rest, low, high, engine.gain, 0.0, 0.0, 0.0, 0.0, 0.0)
    shaped[1] = inputs[1]


@compiled
def actuator_times(index, p):
    """Dead time s, lag s and slowness of the engine (0), and of the hull's temperature (1), which lags the water's."""
    if index == 1:
        return 0.0, p.effects.volume.expansion_lag, 0.0
    engine = p.effects.engine
    return engine.dead_time, engine.lag, p.hull.engine_slowness + engine.slowness


@compiled
def output(x, actuators, sensors, p, y):
    """Write the outputs [measured depth, north, east] into y."""
    depth = p.effects.depth
    y[0] = x[0] + depth.scale * x[0] + sensors[0] + depth.bias
    y[1] = x[2]
    y[2] = x[3]


def engine_problem(parameters: GlideParameters) -> str:
    """The problem of the buoyancy engine's range or of the trim, or nothing."""
    hull = parameters.hull
    if not hull.engine_low < hull.engine_high:
        return "hull.engine_low must be less than hull.engine_high"
    if not hull.engine_low <= hull.engine_neutral <= hull.engine_high:
        return "hull.engine_neutral must lie between hull.engine_low and hull.engine_high"
    return ""


SURFACE = 10.0  # m: there, an 8 s swell moves the water a third as much as at the surface
PUMPED = 3e-6  # m^3 from one sample to the next: more means the engine, less the resolution of its sensor
SETTLED = 20.0  # s after pumping: three times M / (2 B / U), with 60 kg, 1.3 N and 0.25 m/s
FLATTEST = radians(5.0)  # of a pitch; a smaller one is an inflection, or a stall (the basestation's min_stall_angle)


def beyond(time: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Samples of a dive, in order, that steady flight does not describe, as masks by reason."""
    depth, pitch, engine = columns["depth_m"], columns["pitch_rad"], columns["buoyancy_volume_m3"]
    moved = np.abs(np.diff(engine)) > PUMPED
    moving = np.r_[moved, False] | np.r_[False, moved]
    last = np.maximum.accumulate(np.where(moving, time, -inf))
    rate = np.gradient(depth, time) if depth.size > 1 else np.zeros(depth.size)
    read = [columns[name] for name in ("temperature_C", "density_kgpm3", "heading_rad") if name in columns]
    known = np.isfinite(np.stack([depth, pitch, engine, *read]))
    return {
        "near the surface": ~(depth >= SURFACE),
        "while the buoyancy engine moves and 20 s after": moving | (time - last < SETTLED),
        "in inflections and stalls": (np.abs(pitch) < FLATTEST) | (rate * pitch >= 0.0),
        "without a reading of an input": np.asarray(~known.all(axis=0)),
    }


def stated(parameters: GlideParameters, attrs: Mapping[str, Any]) -> Mapping[str, float]:
    """Values by path that a log states and that replace these, if the vehicle represents a series."""
    return seaglider_constants(attrs) if parameters.hull.as_logged else {}


GLIDE = Family(
    name="glide",
    kind="glide",
    title="steady flight of an underwater glider by its polar",
    parameters=GlideParameters,
    inputs=("buoyancy_volume_m3", "temperature_C", "pitch_rad", "heading_rad", "density_kgpm3", "elapsed_s"),
    constants={
        "buoyancy_volume_m3": "hull.engine_neutral",
        "temperature_C": "hull.temperature",
        "density_kgpm3": "hull.density",
    },
    required=("buoyancy_volume_m3", "pitch_rad"),
    states=("depth_m", "depth_rate_mps", "north_m", "east_m", "volume_m3"),
    integrated=6,
    block=_KEPT,
    differences=(1e-2, 1e-4),
    derived=len(list_paths(GlideParameters())),
    problem=engine_problem,
    actuators=("buoyancy_volume_m3", "temperature_C"),
    sensors=("depth_lag_m",),
    outputs=("depth_m", "north_m", "east_m"),
    coefficients=("hull.drag_0", "hull.lift_1"),
    twins={"effects.polar.growth": "hull.drag_0", "effects.polar.lift": "hull.lift_1"},
    coefficients_of=lambda parameters: {
        f"effects.volume.{name}": (f"hull.{name}", lambda given, size: given + size)
        for name in ("compressibility", "expansion")
    },
    ranges={
        "depth_m": (-5.0, inf),
        "pitch_rad": (-0.5 * pi, 0.5 * pi),
        "buoyancy_volume_m3": ("hull.engine_low", "hull.engine_high"),
        "density_kgpm3": (900.0, 1100.0),
        "temperature_C": (-5.0, 60.0),
    },
    measured={
        "effects.water.gradient": "density_kgpm3",
        # attitude is measured in every log, so its trim is not searched for
        **dict.fromkeys((*STEERED, "effects.inclinometer.roll_bias"), "pitch_rad"),
    },
    shared={"volume_m3": "effects.volume.offset"},
    shared_unless="hull.trim_known",
    adding={"effects.volume.leak": "effects.volume.offset"},
    by_dive=("effects.volume.air", "effects.volume.offset"),
    carried=True,
    interpolated=("buoyancy_volume_m3", "temperature_C", "pitch_rad", "heading_rad", "density_kgpm3"),
    assumed=("density_kgpm3", "temperature_C"),
    beyond=beyond,
    stated=stated,
    view=view_as(record_type(GlideParameters), "glide"),
    hooks=RightHandSide(
        derivative=derivative,
        stable_step=stable_step,
        shape=shape,
        actuator_times=actuator_times,
        sense=sense,
        settle_sensors=settle_sensors,
        output=output,
        enter=enter,
        leave=copied,
        derive=copied,
    ),
)
registered(GLIDE)
