"""The effects of a glider that flies by its polar, each neutral by default; see `auv_gym.effects`.

Probes are the smallest changes worth detecting in a few dives: one or two millimetres per second of vertical velocity
at a net buoyancy of 1 to 2 N.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi
from typing import Any

from auv_gym.effects import ClockEffects, CurrentEffects, Sampling, effects_on_commands
from auv_gym.param import param, part

_TRIM = "dives to several depths, and a known trim"
_DEEP = "dives to several depths in water whose density is measured"
_WARM = "the same depths in water of another temperature"
_SHALLOW = "a slow dive through the uppermost thirty metres"
_LONG = "several dives over hours or days"
_PACE = "dives and climbs at several net buoyancies"
_ANGLES = "dives and climbs at several pitch angles"
_BOTH = "dives as well as climbs, at several pitch angles"
_SAMPLES = "a water sample, or a second CTD"
_FIX = "a track with a known current"
_TURNS = "turns to either side, diving and climbing"
_CIRCLE = "tracks over headings all around the circle"
_PROFILE = "a profile of the water's density, measured with the log"

EngineEffects = effects_on_commands(
    "EngineEffects",
    __name__,
    "m^3",
    {"gain": 0.03, "dead_time": 4.0, "lag": 5.0, "slowness": 3e4},
    slowest=1e8,
    titles={"slowness": "{} slower than given, as time per volume"},
)


@dataclass(frozen=True)
class DisplacementEffects:
    """Displaced volume missing in a simple model; positive lifts."""

    offset: float = param(0.0, "m^3", "volume bias", bounds=(-2e-3, 2e-3), probe=3e-6, apart=_TRIM)
    compressibility: float = param(
        0.0, "1/Pa", "change in compressibility", bounds=(-1e-9, 2e-9), probe=3e-11, apart=_DEEP
    )
    expansion: float = param(0.0, "1/K", "change in thermal expansion", bounds=(-3e-4, 3e-4), probe=2e-5, apart=_WARM)
    # without a probe: a log shows the hull's temperature only up to where samples are left out
    expansion_lag: float = param(0.0, "s", "lag of the hull's temperature", bounds=(0.0, 7200.0))
    air: float = param(0.0, "m^3", "trapped air, at the surface", bounds=(0.0, 1e-3), probe=1e-5, apart=_SHALLOW)
    leak: float = param(0.0, "m^3/s", "leak rate", bounds=(0.0, 1e-6), probe=1e-9, apart=_LONG)


@dataclass(frozen=True)
class PolarEffects:
    """Errors of the polar, relative to its coefficients."""

    growth: float = param(
        0.0, "1", "growth on the hull: relative change in drag", bounds=(-0.9, 10.0), probe=0.05, apart=_PACE
    )
    lift: float = param(0.0, "1", "relative change in lift slope", bounds=(-0.9, 10.0), probe=0.1, apart=_ANGLES)


@dataclass(frozen=True)
class GlideWaterEffects:
    """The water: velocity down, an internal wave's heave, salinity error of the CTD, and stratification.

    salinity: a fouled conductivity cell reads some tenths too low.  gradient: of the density, if that is assumed; a
    measured density already includes it.
    """

    current: float = param(
        0.0, "m/s", "vertical velocity of the water, down", bounds=(-0.5, 0.5), probe=2e-3, apart=_BOTH
    )
    current_with_depth: float = param(
        0.0,
        "1/s",
        "downward current that grows with depth",
        bounds=(-2e-3, 2e-3),
        probe=1e-5,
        apart=f"{_PACE}, and {_DEEP}",
    )
    heave_sin: float = param(0.0, "m/s", "internal-wave heave, sine of time", bounds=(-0.5, 0.5), probe=3e-3)
    heave_cos: float = param(0.0, "m/s", "internal-wave heave, cosine of time", bounds=(-0.5, 0.5), probe=3e-3)
    heave_period: float = param(600.0, "s", "period of the internal-wave heave", bounds=(60.0, 1e5), probe=20.0)
    salinity: float = param(0.0, "1", "salinity error of the CTD", bounds=(-1.0, 1.0), probe=0.05, apart=_SAMPLES)
    gradient: float = param(0.0, "kg/m^4", "density stratification", bounds=(0.0, 0.5), probe=1e-3, apart=_PROFILE)


@dataclass(frozen=True)
class GlideInclinometer:
    """Errors of the measured pitch and roll."""

    pitch_bias: float = param(0.0, "rad", "pitch sensor bias", bounds=(-0.3, 0.3), probe=0.01, apart=_BOTH)
    roll_bias: float = param(0.0, "rad", "roll sensor bias", bounds=(-0.3, 0.3), probe=0.01, apart=_TURNS)


@dataclass(frozen=True)
class GlideCompass:
    """Errors of the measured heading, which turn the track."""

    bias: float = param(0.0, "rad", "compass bias", bounds=(-pi, pi), probe=0.02, apart=_FIX)
    deviation_sin: float = param(
        0.0, "rad", "compass deviation, sine of heading", bounds=(-0.9, 0.9), probe=0.035, apart=_CIRCLE
    )
    deviation_cos: float = param(
        0.0, "rad", "compass deviation, cosine of heading", bounds=(-0.9, 0.9), probe=0.035, apart=_CIRCLE
    )


@dataclass(frozen=True)
class GlideDepthSensor:
    """Errors of the measured depth; in steady flight, a scale error is similar to a drag error."""

    bias: float = param(0.0, "m", "depth sensor bias", bounds=(-100.0, 100.0), probe=0.1)
    scale: float = param(0.0, "1", "depth sensor scale error", bounds=(-0.5, 0.5), probe=0.02)
    lag: float = param(0.0, "s", "depth sensor lag (time constant)", bounds=(0.0, 60.0), probe=2.0)


@dataclass(frozen=True)
class SteeringEffects:
    """Trim missing in the static relation of a glider's masses; if attitude is an input, that includes it."""

    pitch: float = param(0.0, "rad", "pitch trim", bounds=(-0.5, 0.5), probe=0.01, apart=_BOTH)
    roll: float = param(0.0, "rad", "roll trim", bounds=(-0.5, 0.5), probe=0.01, apart=_TURNS)
    roll_climb: float = param(0.0, "rad", "change in roll trim in climbs", bounds=(-0.5, 0.5), probe=0.01, apart=_TURNS)


STEERED = tuple(f"effects.steering.{field.name}" for field in fields(SteeringEffects))


@dataclass(frozen=True)
class GlideSampling:
    """Sampling of a glider's readings."""

    depth: Sampling = part(Sampling, "depth sensor")
    compass: Sampling = part(Sampling, "compass")
    inclinometer: Sampling = part(Sampling, "inclinometer")
    position: Sampling = part(Sampling, "position")


@dataclass(frozen=True)
class GlideEffects:
    """All effects of a glider that flies by its polar."""

    engine: Any = part(EngineEffects, "buoyancy engine")
    volume: DisplacementEffects = part(DisplacementEffects)
    polar: PolarEffects = part(PolarEffects)
    water: GlideWaterEffects = part(GlideWaterEffects)
    steering: SteeringEffects = part(SteeringEffects)
    inclinometer: GlideInclinometer = part(GlideInclinometer)
    compass: GlideCompass = part(GlideCompass)
    current: CurrentEffects = part(CurrentEffects)
    depth: GlideDepthSensor = part(GlideDepthSensor)
    sampling: GlideSampling = part(GlideSampling)
    clock: ClockEffects = part(ClockEffects)
