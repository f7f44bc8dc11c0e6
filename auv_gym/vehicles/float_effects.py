"""The effects of a profiling float, each neutral by default; see `auv_gym.effects`.

Probes are the smallest changes worth detecting in dives over forty minutes or, for oil, over several days.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from auv_gym.effects import ClockEffects, Sampling
from auv_gym.param import param, part
from auv_gym.physics.discovered import DiscoveredHeave

# What in a log would distinguish an effect from similar ones.
_PROFILE = "a profile of the water's density, measured with the log"
_TRIM = "a known trim, weighed in water of known density"
_SHALLOW = "a slow dive through the uppermost twenty metres"
_WARM = "the same depths in water of another temperature"
_STAY = "a long stay at one depth"
_PACE = "dives and rises at several speeds"
_FREE = "a dive without the line"
_LINE = "dives at several speeds, near the surface and deep"
_OIL = "a measured oil volume"
_VALVE = "valve actions at several depths, with a measured oil volume"


@dataclass(frozen=True)
class PistonEffects:
    """Effects of a piston: gain about mid-stroke, offset, backlash, stiction, delays, rate limit."""

    offset: float = param(0.0, "m", "piston offset", bounds=(-0.1, 0.1), probe=1e-3)
    gain: float = param(1.0, "1", "piston gain", bounds=(0.05, 5.0), probe=0.10)
    backlash: float = param(0.0, "m", "piston backlash (full width)", bounds=(0.0, 0.1), probe=2e-3)
    stiction: float = param(0.0, "m", "piston stiction (smallest movement)", bounds=(0.0, 0.1), probe=2e-3)
    dead_time: float = param(0.0, "s", "piston dead time", bounds=(0.0, 60.0), probe=2.0)
    lag: float = param(0.0, "s", "piston lag (time constant)", bounds=(0.0, 120.0), probe=2.0)
    slowness: float = param(0.0, "s/m", "piston slower than given, as time per travel", bounds=(0.0, 1e4), probe=50.0)


@dataclass(frozen=True)
class VolumeEffects:
    """Displaced volume missing in a simple model of a float; positive lifts."""

    offset: float = param(0.0, "m^3", "initial volume offset", bounds=(-5e-3, 5e-3), probe=2e-6, apart=_TRIM)
    compressibility: float = param(
        0.0, "m^3/m", "lift with depth, by compressibility", bounds=(-1e-5, 1e-5), probe=5e-8, apart=_PROFILE
    )
    air: float = param(0.0, "m^3", "trapped air, at the surface", bounds=(0.0, 5e-3), probe=5e-6, apart=_SHALLOW)
    expansion: float = param(
        0.0, "m^3/K", "thermal expansion against the water's", bounds=(-1e-4, 1e-4), probe=3e-7, apart=_WARM
    )
    expansion_lag: float = param(0.0, "s", "lag of the hull's temperature", bounds=(0.0, 7200.0), probe=20.0)
    leak: float = param(0.0, "m^3/s", "leak rate", bounds=(0.0, 1e-6), probe=3e-9, apart=_STAY)


@dataclass(frozen=True)
class ColumnEffects:
    """The water column: density that grows with depth, vertical currents (down positive), heave of internal waves."""

    gradient: float = param(0.0, "kg/m^4", "density stratification", bounds=(0.0, 0.5), probe=1e-3, apart=_PROFILE)
    current: float = param(0.0, "m/s", "vertical current, down", bounds=(-0.5, 0.5), probe=2e-3, apart=_PACE)
    current_with_depth: float = param(
        0.0, "1/s", "downward current that grows with depth", bounds=(-0.01, 0.01), probe=1e-5, apart=_PACE
    )
    heave_sin: float = param(0.0, "m/s", "internal-wave heave, sine of time", bounds=(-0.5, 0.5), probe=3e-3)
    heave_cos: float = param(0.0, "m/s", "internal-wave heave, cosine of time", bounds=(-0.5, 0.5), probe=3e-3)
    heave_period: float = param(300.0, "s", "period of the internal-wave heave", bounds=(20.0, 1e5), probe=10.0)


@dataclass(frozen=True)
class TetherEffects:
    """A line to the surface: its pull, up positive, and the drag of the line paid out."""

    pull: float = param(0.0, "N", "tether pull", bounds=(-50.0, 50.0), probe=0.02, apart=_FREE)
    drag: float = param(0.0, "kg/m^2", "tether drag per length paid out", bounds=(0.0, 10.0), probe=0.05, apart=_LINE)


@dataclass(frozen=True)
class FloatDragEffects:
    """Relative errors of the drag coefficients."""

    quadratic: float = param(0.0, "1", "quadratic drag error", bounds=(-0.9, 10.0), probe=0.1)
    linear: float = param(0.0, "1", "linear drag error", bounds=(-0.9, 10.0), probe=0.2)


@dataclass(frozen=True)
class OilEffects:
    """Errors of the logged oil volume: pump rate, valve rate, and a valve that lets in more under pressure."""

    pump_gain: float = param(0.0, "1", "pump rate error", bounds=(-0.9, 5.0), probe=0.02, apart=_OIL)
    valve_gain: float = param(0.0, "1", "valve rate error", bounds=(-0.9, 5.0), probe=0.05, apart=_OIL)
    valve_with_depth: float = param(
        0.0, "1/m", "valve flow with pressure, per depth", bounds=(-0.01, 0.01), probe=1e-4, apart=_VALVE
    )


@dataclass(frozen=True)
class FloatDepthSensor:
    """Errors of a float's measured depth; a wrong scale differs from a wrong drag only while the float starts."""

    bias: float = param(0.0, "m", "depth sensor bias", bounds=(-100.0, 100.0), probe=0.05)
    scale: float = param(0.0, "1", "depth sensor scale error", bounds=(-0.5, 0.5), probe=0.04)
    lag: float = param(0.0, "s", "depth sensor lag (time constant)", bounds=(0.0, 60.0), probe=0.5)


@dataclass(frozen=True)
class FloatSampling:
    """Sampling of a float's readings."""

    depth: Sampling = part(Sampling, "depth sensor")


@dataclass(frozen=True)
class FloatTerms:
    """Forces down that no named effect explains, found in data."""

    heave: Any = part(DiscoveredHeave)


@dataclass(frozen=True)
class FloatEffects:
    """All effects of the profiling-float family."""

    piston: PistonEffects = part(PistonEffects)
    volume: VolumeEffects = part(VolumeEffects)
    water: ColumnEffects = part(ColumnEffects)
    tether: TetherEffects = part(TetherEffects)
    drag: FloatDragEffects = part(FloatDragEffects)
    oil: OilEffects = part(OilEffects)
    depth: FloatDepthSensor = part(FloatDepthSensor)
    discovered: FloatTerms = part(FloatTerms)
    sampling: FloatSampling = part(FloatSampling)
    clock: ClockEffects = part(ClockEffects)
