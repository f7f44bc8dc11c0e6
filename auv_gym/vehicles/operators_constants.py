"""Constants of a glider from a log: those of its operators' flight model."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import Any

_LENGTH = 1.8  # m, of a Seaglider in the flight model, if the file does not state it (basestation3, glider_length)
_POWER = -0.25  # hd_s of a Seaglider, if the file does not state it (Eriksen et al. 2001)
_DBAR = 1e4  # Pa


def seaglider_constants(attrs: Mapping[str, Any]) -> dict[str, float]:
    """A glider's parameters by path, from the attributes of a Seaglider's dive; empty without `sg_cal_mass`.

    The volume with the engine at 0, its largest, is volmax minus vbdbias.  If the file does not state the engine's
    counts, its volume counts from the pilots' neutral one, at which the hull displaces mass / rho0.
    Source: basestation3 of APL-UW (MakeDiveProfiles.py: volmax, vbdbias, C_VBD, and the flight model's hd_a to hd_s).
    """

    def of(name: str) -> float | None:
        value = attrs.get(f"sg_cal_{name}")
        return None if value is None else float(value)

    mass = of("mass")
    if mass is None:
        return {}
    found: dict[str, float | None] = {
        "hull.mass": mass,
        "hull.density": of("rho0"),
        "hull.temperature": of("temp_ref"),
        "hull.expansion": of("therm_expan"),
        "hull.drag_0": of("hd_b"),
        "hull.area": (of("glider_length") or _LENGTH) ** 2,
    }
    compress, lift, drag, power = of("abs_compress"), of("hd_a"), of("hd_c"), of("hd_s")
    found["hull.compressibility"] = None if compress is None else compress / _DBAR
    found["hull.lift_1"] = None if lift is None else degrees(lift)
    found["hull.drag_2"] = None if drag is None else degrees(degrees(drag))
    found["hull.drag_power"] = _POWER if power is None else power
    found |= _engine(attrs, mass)
    return {path: value for path, value in found.items() if value is not None}


def _engine(attrs: Mapping[str, Any], mass: float) -> dict[str, float]:
    """Volume of the hull, and range of the engine, m^3."""
    at, largest, least = attrs.get("log_C_VBD"), attrs.get("sg_cal_vbd_min_cnts"), attrs.get("sg_cal_vbd_max_cnts")
    largest = attrs.get("log_VBD_MIN") if largest is None else largest
    least = attrs.get("log_VBD_MAX") if least is None else least
    counts, size, most = attrs.get("sg_cal_vbd_cnts_per_cc"), attrs.get("log_VBD_CNV"), attrs.get("sg_cal_volmax")
    size = 1.0 / float(counts) if counts else size
    if at is None or largest is None or least is None or size is None or most is None:
        return {"hull.volume": mass / float(attrs.get("sg_cal_rho0", 1027.5))}
    return {
        "hull.volume": 1e-6 * (float(most) - float(attrs.get("sg_cal_vbdbias", 0.0))),
        "hull.engine_low": 1e-6 * float(size) * (float(least) - float(largest)),
        "hull.engine_neutral": 1e-6 * float(size) * (float(at) - float(largest)),
        "hull.engine_high": 0.0,
    }
