"""Channels derived from others of a log: angles from quaternions, true headings, depth from pressure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from auv_gym.channels import depth_from_pressure
from auv_gym.extra import how_to_install
from auv_gym.records import seawater
from auv_gym.records.attitude import QUATERNION, QUATERNION_ENU_FLU, angles, continuous, from_enu_flu, proper
from auv_gym.records.mermaid import COLUMNS as MERMAID
from auv_gym.records.streams import Stream

_ANGLES = ("roll_rad", "pitch_rad", "heading_rad")
_MIDDLE = 45.0  # deg of latitude
# For each channel, those from which it may be derived if it was not measured.
SOURCES: Final[dict[str, tuple[str, ...]]] = {
    **dict.fromkeys(_ANGLES, (*QUATERNION, *QUATERNION_ENU_FLU)),
    "heading_rad": (*QUATERNION, *QUATERNION_ENU_FLU, "heading_magnetic_rad", "magnetic_variation_rad"),
    "depth_m": ("pressure_dbar", "latitude_rad"),
    "density_kgpm3": (
        "salinity_psu", "conductivity_Spm", "temperature_C", "pressure_dbar", "latitude_rad", "longitude_rad",
    ),
    "oil_volume_m3": MERMAID,
}  # fmt: skip


def completed(
    streams: Sequence[Stream], constants: Mapping[str, float], notes: list[str]
) -> tuple[list[Stream], dict[str, str]]:
    """The streams with channels derived from their own, and how each new channel was derived, in words.

    constants: values for the whole log, by channel: latitude_rad, magnetic_variation_rad.  Measured channels are not
    replaced.  Warnings are added to the notes.
    """
    measured = {name for stream in streams for name in stream.values}
    derived: dict[str, str] = {}
    place = _Place.of(streams, constants)
    result = []
    for stream in streams:
        new: dict[str, np.ndarray] = {}
        if set(QUATERNION_ENU_FLU) <= set(stream.values) and not set(QUATERNION) & measured:
            turned = from_enu_flu(_table(stream, QUATERNION_ENU_FLU))
            new |= dict(zip(QUATERNION, turned.T, strict=True))
            derived["attitude"] = "turned from ENU and FLU to NED and FRD axes"
        elif set(QUATERNION) <= set(stream.values):
            new |= dict(zip(QUATERNION, continuous(proper(_table(stream, QUATERNION))).T, strict=True))
        if new and not any(name in derived for name in _ANGLES):
            found = angles(np.column_stack([new[name] for name in QUATERNION]))
            for name, values in zip(_ANGLES, found, strict=True):
                if name not in measured:
                    new[name] = values
                    derived[name] = "from the attitude quaternion"
        if "heading_magnetic_rad" in stream.values and not {"heading_rad"} & (measured | set(derived)):
            new["heading_rad"], derived["heading_rad"] = _true_heading(stream, constants, notes)
        if "pressure_dbar" in stream.values and not {"depth_m"} & (measured | set(derived)):
            new["depth_m"], derived["depth_m"] = _depth(stream.values["pressure_dbar"], place)
        kept = {name: values for name, values in stream.values.items() if name not in QUATERNION_ENU_FLU}
        result.append(replace(stream, values=kept | new))
    return result, derived


def _table(stream: Stream, names: Sequence[str]) -> np.ndarray:
    return np.column_stack([stream.values[name] for name in names])


def _true_heading(stream: Stream, constants: Mapping[str, float], notes: list[str]) -> tuple[np.ndarray, str]:
    magnetic = stream.values["heading_magnetic_rad"]
    variation = stream.values.get("magnetic_variation_rad")
    if variation is not None and np.isfinite(variation).any():
        middle = float(np.nanmedian(variation))
        true = magnetic + np.where(np.isfinite(variation), variation, middle)
        return true, f"magnetic heading and the logged variation, {np.degrees(middle):.1f} deg in the middle"
    if "magnetic_variation_rad" in constants:
        stated = constants["magnetic_variation_rad"]
        return magnetic + stated, f"magnetic heading and a stated variation of {np.degrees(stated):.1f} deg"
    notes.append(
        "heading_rad is the magnetic heading, since no variation is stated: give it in a mapping, as in "
        "magnetic_variation_deg = 2.5 (east positive)."
    )
    return magnetic, "the magnetic heading, uncorrected"


def _depth(pressure: np.ndarray, place: _Place) -> tuple[np.ndarray, str]:
    fallback = "pressure of sea water at 45 deg of latitude, Saunders 1981, within 0.3 % elsewhere"
    if place.latitude is None:
        return depth_from_pressure(pressure), fallback
    try:
        deep = seawater.depth(pressure, place.latitude)
    except ValueError:  # gsw is not installed
        return depth_from_pressure(pressure), f"{fallback}; the extra seawater does better"
    return deep, f"pressure of sea water at {place.latitude:.1f} deg of latitude, TEOS-10"


def hydrography(
    values: Mapping[str, np.ndarray], streams: Sequence[Stream], constants: Mapping[str, float], notes: list[str]
) -> dict[str, np.ndarray]:
    """In-situ salinity and density from a CTD's channels on one time base, if these were not measured.

    If pressure was not measured, it is computed from depth.  streams, constants: of the log, for its location.
    Empty without gsw (the extra `seawater`), with a line in the notes.
    """
    told = {"salinity_psu", "conductivity_Spm"} & set(values) and {"pressure_dbar", "depth_m"} & set(values)
    if not told or "temperature_C" not in values or {"salinity_psu", "density_kgpm3"} <= set(values):
        return {}
    new: dict[str, np.ndarray] = {}
    place, temperature = _Place.of(streams, constants), values["temperature_C"]
    try:
        pressure = values.get("pressure_dbar")
        if pressure is None:
            pressure = seawater.pressure(values["depth_m"], _MIDDLE if place.latitude is None else place.latitude)
        salinity = values.get("salinity_psu")
        if salinity is None:
            salinity = seawater.practical_salinity(values["conductivity_Spm"], temperature, pressure)
            new["salinity_psu"] = salinity
        if "density_kgpm3" not in values:
            where = place.latitude, place.longitude
            new["density_kgpm3"] = seawater.density(salinity, temperature, pressure, *where)
    except ValueError:  # gsw is not installed
        notes.append(
            "The density of the water could be worked out from the salinity and temperature of the log with the "
            f"package gsw; {how_to_install('seawater')}."
        )
    return new


@dataclass(frozen=True)
class _Place:
    """The location of a log, deg, if known."""

    latitude: float | None
    longitude: float | None

    @classmethod
    def of(cls, streams: Sequence[Stream], constants: Mapping[str, float]) -> _Place:
        found: list[float | None] = []
        for name in ("latitude_rad", "longitude_rad"):
            logged = [stream.values[name] for stream in streams if name in stream.values]
            known = [float(np.nanmedian(values)) for values in logged if np.isfinite(values).any()]
            angle = constants.get(name, known[0] if known else None)
            found.append(None if angle is None else float(np.degrees(angle)))
        return cls(*found)
