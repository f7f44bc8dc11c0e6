"""The named signals that records, models, environments and reports share, and the units of columns in files.

Signals are in SI and radians; a name ends in its unit (`heading_rad`).  Angles follow SNAME: body axes forward,
starboard, down; heading clockwise from north; roll to starboard and pitch up positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi
from typing import Final, Literal, NamedTuple

import numpy as np

from auv_gym.param import did_you_mean

Kind = Literal["time", "motion", "input", "command", "auxiliary"]


@dataclass(frozen=True)
class Channel:
    """A signal: its name, unit, label for reports, and treatment between samples.

    kind: motion and inputs must be known at every sample of a record; commands (set points) and auxiliary signals may
    be missing.  angle: on a circle, so that records unwrap it and residuals are wrapped.
    """

    name: str
    unit: str
    label: str
    kind: Kind = "auxiliary"
    angle: bool = False

    @property
    def held(self) -> bool:
        """Whether the value is held until the next sample, as those of inputs, set points and flags are."""
        return self.kind in ("input", "command") or self.unit == ""

    @property
    def needed(self) -> bool:
        """Whether a sample without it is useless."""
        return self.kind in ("time", "motion", "input")


_LISTED: Final = (
    Channel("time_s", "s", "time", "time"),
    Channel("north_m", "m", "north", "motion"),
    Channel("east_m", "m", "east", "motion"),
    Channel("depth_m", "m", "depth", "motion"),
    Channel("roll_rad", "rad", "roll", "motion", angle=True),
    Channel("pitch_rad", "rad", "pitch", "motion", angle=True),
    Channel("heading_rad", "rad", "heading", "motion", angle=True),
    Channel("quaternion_w", "1", "attitude quaternion, w", "motion"),
    Channel("quaternion_x", "1", "attitude quaternion, x", "motion"),
    Channel("quaternion_y", "1", "attitude quaternion, y", "motion"),
    Channel("quaternion_z", "1", "attitude quaternion, z", "motion"),
    Channel("quaternion_enu_flu_w", "1", "attitude quaternion of ENU and FLU axes, w"),
    Channel("quaternion_enu_flu_x", "1", "attitude quaternion of ENU and FLU axes, x"),
    Channel("quaternion_enu_flu_y", "1", "attitude quaternion of ENU and FLU axes, y"),
    Channel("quaternion_enu_flu_z", "1", "attitude quaternion of ENU and FLU axes, z"),
    Channel("heading_magnetic_rad", "rad", "magnetic heading", angle=True),
    Channel("magnetic_variation_rad", "rad", "magnetic variation, east positive"),
    Channel("latitude_rad", "rad", "latitude"),
    Channel("longitude_rad", "rad", "longitude"),
    Channel("u_mps", "m/s", "forward speed through the water", "motion"),
    Channel("v_mps", "m/s", "starboard speed through the water", "motion"),
    Channel("w_mps", "m/s", "downward body speed through the water", "motion"),
    Channel("p_radps", "rad/s", "roll rate", "motion"),
    Channel("q_radps", "rad/s", "pitch rate", "motion"),
    Channel("r_radps", "rad/s", "yaw rate", "motion"),
    Channel("rudder_rad", "rad", "rudder", "input"),
    Channel("stern_plane_rad", "rad", "stern plane", "input"),
    Channel("bow_plane_rad", "rad", "bow plane", "input"),
    Channel("propeller_rpm", "rpm", "propeller speed", "input"),
    Channel("propeller_V", "V", "propeller voltage", "input"),
    Channel("bow_thruster_N", "N", "bow thruster", "input"),
    Channel("stern_thruster_N", "N", "stern thruster", "input"),
    Channel("piston_m", "m", "piston position", "input"),
    Channel("oil_volume_m3", "m3", "oil volume outside the hull", "input"),
    Channel("pumped_volume_m3", "m3", "oil pumped out since the dive began", "input"),
    Channel("valved_volume_m3", "m3", "oil let in since the dive began", "input"),
    Channel("valved_depth_m4", "m4", "oil let in, each part times its depth", "input"),
    Channel("volume_m3", "m3", "volume beyond neutral trim"),
    Channel("buoyancy_volume_m3", "m3", "volume of the buoyancy engine"),
    Channel("battery_position_m", "m", "position of the battery along the hull"),
    Channel("battery_roll_rad", "rad", "angle of the turned battery"),
    Channel("elapsed_s", "s", "time since the log began"),
    Channel("heading_cmd_rad", "rad", "commanded heading", "command", angle=True),
    Channel("pitch_cmd_rad", "rad", "commanded pitch", "command", angle=True),
    Channel("depth_cmd_m", "m", "commanded depth", "command"),
    Channel("u_cmd_mps", "m/s", "commanded forward speed", "command"),
    Channel("speed_cmd_mps", "m/s", "commanded speed through the water", "input"),
    Channel("rudder_cmd_rad", "rad", "commanded rudder", "command"),
    Channel("elevator_cmd_rad", "rad", "commanded elevator", "command"),
    Channel("u_dvl_mps", "m/s", "forward speed over ground"),
    Channel("v_dvl_mps", "m/s", "starboard speed over ground"),
    Channel("w_dvl_mps", "m/s", "downward body speed over ground"),
    Channel("speed_mps", "m/s", "speed through the water"),
    Channel("speed_ground_mps", "m/s", "speed over ground"),
    Channel("course_rad", "rad", "course over ground", angle=True),
    Channel("depth_rate_mps", "m/s", "rate of change of depth"),
    Channel("altitude_m", "m", "height above the bottom"),
    Channel("pressure_dbar", "dbar", "sea pressure"),
    Channel("temperature_C", "degC", "water temperature"),
    Channel("conductivity_Spm", "S/m", "conductivity of the water"),
    Channel("salinity_psu", "psu", "practical salinity"),
    Channel("density_kgpm3", "kg/m3", "water density"),
    Channel("density_gradient_kgpm4", "kg/m4", "water density's growth with depth"),
    Channel("density_depth_m", "m", "depth of the water density"),
)
CHANNELS: Final[dict[str, Channel]] = {channel.name: channel for channel in _LISTED}

_PULSES: Final = ("us",)

# Columns that divide a file into segments; their cells may be any text.
SEGMENT_COLUMNS: Final = ("segment", "dive_id", "run")
_FLAG_ENDINGS: Final = ("_good", "_valid", "_ok", "_flag", "_id")
_FLAGS: Final = ("stage",)

# The attribute `units` of a record's variable for each suffix.
_SI: Final[dict[str, str]] = {
    "s": "s", "m": "m", "rad": "rad", "mps": "m/s", "radps": "rad/s", "mps2": "m/s2", "radps2": "rad/s2", "m3": "m3",
    "m4": "m4", "m3ps": "m3/s", "kg": "kg", "kgpm3": "kg/m3", "kgpm4": "kg/m4", "N": "N", "Nm": "N m", "V": "V",
    "us": "us", "share": "1", "norm": "1", "A": "A", "W": "W", "J": "J", "Hz": "Hz", "rpm": "rpm", "dbar": "dbar",
    "C": "degC", "psu": "psu", "pct": "%", "Spm": "S/m", "T": "T",
}  # fmt: skip
# suffix -> (SI suffix, factor); knots, feet and degrees by definition
_SCALED: Final[dict[str, tuple[str, float]]] = {
    "deg": ("rad", pi / 180.0),
    "degps": ("radps", pi / 180.0),
    "kn": ("mps", 1852.0 / 3600.0),
    "kmph": ("mps", 1.0 / 3.6),
    "cmps": ("mps", 1e-2),
    "mmps": ("mps", 1e-3),
    "km": ("m", 1e3),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "ft": ("m", 0.3048),
    "L": ("m3", 1e-3),
    "mL": ("m3", 1e-6),
    "cm3": ("m3", 1e-6),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "bar": ("dbar", 10.0),
    "hPa": ("dbar", 0.01),
    "mbar": ("dbar", 0.01),
    "mSpcm": ("Spm", 0.1),
    "uT": ("T", 1e-6),
    "kPa": ("dbar", 0.1),
    "Pa": ("dbar", 1e-4),
    "mV": ("V", 1e-3),
    "mA": ("A", 1e-3),
    "degC": ("C", 1.0),
}
# Spellings of the attribute `units` in NetCDF files; suffixes themselves are understood too.
_SPELLINGS: Final[dict[str, str]] = {
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "degree_north": "deg", "degrees_north": "deg",
    "degree_east": "deg", "degrees_east": "deg", "angular_degree": "deg", "°": "deg", "rad/s": "radps",
    "rad s-1": "radps", "radians/s": "radps", "deg/s": "degps", "deg s-1": "degps", "degree/s": "degps",
    "degrees/s": "degps", "degree s-1": "degps", "degrees s-1": "degps", "m/s": "mps", "m s-1": "mps", "cm/s": "cmps",
    "cm s-1": "cmps", "mm/s": "mmps", "mm s-1": "mmps", "km/h": "kmph", "knot": "kn", "knots": "kn", "kt": "kn",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "kilometer": "km", "centimeter": "cm", "millimeter": "mm",
    "foot": "ft", "feet": "ft",
    "second": "s", "seconds": "s", "sec": "s", "millisecond": "ms", "milliseconds": "ms", "minute": "min",
    "minutes": "min", "hour": "h", "hours": "h", "m^3": "m3", "cc": "cm3", "cm^3": "cm3", "ml": "mL", "litre": "L",
    "liter": "L", "decibar": "dbar", "decibars": "dbar", "celsius": "C", "Celsius": "C", "degree_Celsius": "C",
    "degrees_Celsius": "C", "deg_C": "C", "kg/m3": "kgpm3", "kg m-3": "kgpm3", "kg/m^3": "kgpm3", "volt": "V",
    "volts": "V", "newton": "N", "newtons": "N", "N m": "Nm", "N.m": "Nm", "m/s2": "mps2", "m s-2": "mps2",
    "rad/s2": "radps2", "rad s-2": "radps2", "m3/s": "m3ps", "m3 s-1": "m3ps", "PSU": "psu", "1/min": "rpm", "%": "pct",
    "S/m": "Spm", "S m-1": "Spm", "mS/cm": "mSpcm", "mS cm-1": "mSpcm", "m/s/s": "mps2",
    "rad/s/s": "radps2", "m^3/s": "m3ps", "rpm": "rpm", "dps": "degps", "deg/sec": "degps", "psu": "psu",
    "pss-78": "psu",
}  # fmt: skip


class Conversion(NamedTuple):
    """The channel of a column, and the function from its values to the channel's unit."""

    channel: Channel
    convert: Callable[[np.ndarray], np.ndarray]


def channel(name: str) -> Channel:
    """The channel of a name in SI: a listed one, a flag, or an extra signal with a known unit.

    An extra name that begins with heading_ or course_ is an angle.  One that begins with excitation_, or whose unit
    follows _cmd, is held between samples as set points are; so is the length of a pulse to an actuator, `t1_us`.
    Raises if the unit is unknown or not SI.
    """
    return _channel(name)


def conversion(name: str, unit: str | None = None) -> Conversion:
    """The conversion of a column into a record by its name: `heading_deg` becomes `heading_rad`, times pi/180.

    unit: the unit stated elsewhere in the file (a NetCDF attribute); it overrides the suffix if both measure the same
    quantity.  Raises on an unknown unit, on a unit that does not fit the signal, and if the two contradict each other.
    """
    if name in CHANNELS and unit is None:
        return Conversion(CHANNELS[name], _same)
    if is_flag(name):
        return Conversion(channel(name), _same)
    stem, _, suffix = name.rpartition("_")
    stated = None if unit is None else _suffix_of(unit, name)
    if (not stem or not _is_suffix(suffix)) and stated is not None:
        stem, suffix = name, stated
    if not stem or not _is_suffix(suffix):
        raise unknown_suffix(name)
    target, convert = _to_si(stem, suffix)
    if stated is not None and stated != suffix:
        stated_target, stated_convert = _to_si(stem, stated)
        if stated_target != target:
            raise ValueError(
                f"Column {name!r} is in {suffix} by its name and in {unit!r} by its attribute `units`, which is "
                "another quantity: correct one of the two, or rename the column in a mapping."
            )
        convert = stated_convert
    return Conversion(_fitting(name, stem, target), convert)


def in_unit(name: str, unit: str | None) -> str:
    """The name of a column by which a mapping reads it as this channel in this unit: `heading_deg`.

    unit: as in `conversion`; None for the unit in the name.
    """
    if unit is None or is_flag(name):
        return name
    suffix, target = _suffix_of(unit, name), conversion(name, unit).channel.name
    return f"{target.rpartition('_')[0]}_{suffix}"


def is_flag(name: str) -> bool:
    """Whether a column holds no quantity (a label, a stage or a quality flag) and so needs no unit."""
    return name in SEGMENT_COLUMNS or name in _FLAGS or name.endswith(_FLAG_ENDINGS)


def set_point_of(name: str) -> str:
    """The channel of a signal's set point: `depth_cmd_m` for `depth_m`."""
    return _marked(name, "cmd")


def excitation_of(name: str) -> str:
    """The channel of the excitation added at an input or a set point."""
    return f"excitation_{name}"


def truth_of(name: str) -> str:
    """The channel of a signal's true value, beside the measured one: `depth_true_m` for `depth_m`."""
    return _marked(name, "true")


def wrap(angle: np.ndarray | float) -> np.ndarray:
    """The same angles in [-pi, pi), rad, for residuals of angles."""
    return np.mod(np.asarray(angle, dtype=float) + pi, 2.0 * pi) - pi


def depth_from_pressure(pressure: np.ndarray | float) -> np.ndarray:
    """Depth, m, of a sea pressure in dbar, at 45 degrees of latitude; elsewhere within 0.3 %.

    Standard ocean (35 psu, 0 degC).  Source: Saunders 1981, J. Phys. Oceanogr. 11, 573-574, with sin^2(lat) = 0.5.
    """
    pressure = np.asarray(pressure, dtype=float)
    return (1.0 - (5.92 + 5.25 * 0.5) * 1e-3) * pressure - 2.21e-6 * pressure**2


def unknown_suffix(name: str) -> ValueError:
    """The error for a column whose unit cannot be read from its name."""
    known = ", ".join(known_suffixes())
    _, separator, suffix = name.rpartition("_")
    if not separator:
        return ValueError(
            f"Column {name!r} does not say its unit: names end in one, as in heading_deg or depth_m (known: {known}). "
            f"{did_you_mean(name, CHANNELS)}Rename it, or map it to a channel, or to '' to leave it out."
        )
    return ValueError(
        f"Column {name!r} has the unknown unit suffix '_{suffix}' (known: {known}). "
        f"{did_you_mean(suffix, known_suffixes())}Rename it, or map it to a channel, or to '' to leave it out."
    )


@lru_cache(maxsize=1)
def known_suffixes() -> list[str]:
    """All unit suffixes that a column may end in, without the underscore."""
    return sorted([*_SI, *_SCALED], key=str.lower)


def _marked(name: str, mark: str) -> str:
    stem, _, suffix = channel(name).name.rpartition("_")
    if not stem:
        raise ValueError(f"{name!r} names no signal with a unit: give one such as depth_m.")
    return f"{stem}_{mark}_{suffix}"


def _same(values: np.ndarray) -> np.ndarray:
    return values


def _is_suffix(suffix: str) -> bool:
    return suffix in _SI or suffix in _SCALED


def _suffix_of(unit: str, name: str) -> str:
    unit = unit.strip()
    suffix = _SPELLINGS.get(unit, _SPELLINGS.get(unit.lower(), unit))
    if not _is_suffix(suffix):
        raise ValueError(
            f"Column {name!r} has the unknown unit {unit!r} in its attribute `units`. "
            f"{did_you_mean(unit, [*_SPELLINGS, *known_suffixes()])}"
            "Correct it, or map the column to '' to leave it out."
        )
    return suffix


def _to_si(stem: str, suffix: str) -> tuple[str, Callable[[np.ndarray], np.ndarray]]:
    """The SI suffix, and the conversion to it; pressures become metres only if the stem says depth."""
    if suffix in _SI:
        factor = 1.0
    else:
        suffix, factor = _SCALED[suffix]
    if suffix == "dbar" and stem.split("_")[0] == "depth":
        return "m", lambda values: depth_from_pressure(factor * values)
    return suffix, _same if factor == 1.0 else lambda values: factor * values


def _fitting(name: str, stem: str, suffix: str) -> Channel:
    """The channel of a stem in SI; raises if the stem is listed, but never in this unit."""
    found = f"{stem}_{suffix}"
    listed = [known for known in CHANNELS if known.rpartition("_")[0] == stem]
    if listed and found not in listed:
        hint = " (ms reads as milliseconds)" if name.endswith("_ms") else ""
        raise ValueError(
            f"Column {name!r} cannot be in {_SI[suffix]}: the signal {stem!r} is {' or '.join(listed)}{hint}. "
            "Correct the suffix, or map the column to a channel, or to '' to leave it out."
        )
    return channel(found)


_DECLARED: dict[str, Channel] = {}


def declare_input(name: str, label: str) -> Channel:
    """The channel of a vehicle's input, which is registered as an input; a listed channel is left unchanged.

    Raises if the name states no unit.
    """
    found = channel(name)
    if name not in CHANNELS and name not in _DECLARED:
        _DECLARED[name] = replace(found, kind="input", label=label)
        _channel.cache_clear()
    return channel(name)


@lru_cache(maxsize=4096)
def _channel(name: str) -> Channel:
    if name in CHANNELS:
        return CHANNELS[name]
    if name in _DECLARED:
        return _DECLARED[name]
    if is_flag(name):
        return Channel(name, "", name.replace("_", " "))
    stem, _, suffix = name.rpartition("_")
    if stem and suffix in _SI:
        angle = suffix == "rad" and stem.split("_")[0] in ("heading", "course")
        held = stem.endswith("_cmd") or stem.startswith("excitation_") or suffix in _PULSES
        return Channel(name, _SI[suffix], stem.replace("_", " "), "command" if held else "auxiliary", angle)
    if stem and suffix in _SCALED:
        target, _ = _to_si(stem, suffix)
        raise ValueError(f"Channel {name!r} is not in SI: convert it, then call it {f'{stem}_{target}'!r}.")
    raise unknown_suffix(name)


def unit_after(name: str) -> str:
    """A channel's unit after a space, to follow a number; "" if it has none."""
    return f" {channel(name).unit}".removesuffix(" 1")


def unit_per(over: str, under: str) -> str:
    """The unit of one channel per unit of another, "1" if they are the same."""
    above, below = channel(over).unit, channel(under).unit
    if above == below:
        return "1"
    above, below = (f"({unit})" if "/" in unit or " " in unit else unit for unit in (above, below))
    return f"{above}/{below}" if below else above
