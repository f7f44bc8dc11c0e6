"""Dives of Seagliders, one NetCDF file each, as written by the operators' basestation software.

Heading is magnetic; pitch is positive nose up.  The battery's position and roll, and the volume of the buoyancy device
(VBD), count from the pilots' centres ($C_PITCH, $C_ROLL_DIVE and $C_ROLL_CLIMB, $C_VBD), in cm, deg and cm3.  Pilots
change $C_VBD between dives; `vbd_from_largest` counts from the largest volume, $VBD_MIN, if that is known.
Sources: Seaglider Parameter Reference Manual, University of Washington, 2012 ($PITCH_CNV, $ROLL_CNV, $VBD_CNV);
Seaglider Quality Control Manual, University of Washington (flags); basestation3 of APL-UW, which names the variables.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from auv_gym.records.log import FIXES, Column, Format, Group, Log, Scope
from auv_gym.records.readers.netcdf_variables import (
    CLASSIC_MAGIC,
    HDF5_MAGIC,
    NetcdfFile,
    Variable,
    is_netcdf,
    open_netcdf,
    span_of,
)

_SAMPLES: Final = "sg_data_point"  # the dimension that every dive's file has
_CLOCKS: Final = ("time", "ctd_time", "gc_st_secs", "log_gps_time")
# Units by the format's definition.  They override the attribute `units`, which is wrong for densities (g/m^3 for values
# around 1027), glide_angle (cm/s in files of 2008), gc_vbd_ctl (cm) and the temperature of optical sensors
# (degrees_Celsius for counts), and missing for others.  The attribute of eng_depth, cm, is right in the files seen.
# None: no unit is certain.
_UNITS: Final[dict[str, str | None]] = {
    "eng_depth": "cm", "eng_head": "deg", "eng_pitchAng": "deg", "eng_rollAng": "deg", "eng_pitchCtl": "cm",
    "eng_rollCtl": "deg", "eng_vbdCC": "cm3", "depth": "m", "ctd_depth": "m", "pressure": "dbar",
    "ctd_pressure": "dbar", "salinity": "psu", "salinity_raw": "psu", "density": "kg/m3", "density_insitu": "kg/m3",
    "sigma_t": "kg/m3", "sigma_theta": "kg/m3", "glide_angle": "deg", "glide_angle_gsm": "deg", "gc_pitch_ctl": "cm",
    "gc_roll_ctl": None, "gc_vbd_ctl": "cm3", "eng_wlbb2f_VFtemp": None, "log_gps_magvar": "deg",
    "log_gps_driftheading": "deg",
}  # fmt: skip
_SPELLINGS: Final = {"degrees_Celsius": "degC", "seconds": "s", "meters": "m", "kg/m^3": "kg/m3", "1": None}
_BAD: Final = (3, 4, 6, 9)  # probably bad, bad, unsampled, missing
# flags that also apply to variables other than their namesake
_JUDGED: Final = {
    "salinity_qc": ("salinity", "density", "density_insitu", "sigma_t", "sigma_theta", "sound_velocity", "theta",
                    "absolute_salinity", "conservative_temperature", "gsw_sigma0", "gsw_sigma3", "gsw_sigma4"),
    "speed_qc": ("speed", "glide_angle", "horz_speed", "vert_speed"),
    "log_gps_qc": ("log_gps_lat", "log_gps_lon"),
}  # fmt: skip
_NOT_KNOWN: Final = ("log_gps_driftspeed", "log_gps_driftheading", "log_gps_n_satellites", "log_gps_hpe")  # -1: unknown
_MOTORS: Final = ("pitch", "vbd", "roll")  # they move one after the other, in this order
_TURNING: Final = 1024  # flag of an event during autonomous turning; the turn is then in the next event
_WHEN_TURNING: Final = ("roll", "pitch", "vbd")
_END_OF_DIVE: Final = 1  # among gc_state_state
_OTHER_CONSTANTS: Final = re.compile(r"sg_cal_(optode|wl|sbe43|calibcomm|comm_|QC_|remap)")  # of other sensors
_POSITION: Final = re.compile(r"\$GPS\d?,\d+,\d+,-?[\d.]+,-?[\d.]+,[\d.]+,[\d.]+,[\d.]+,(-?[\d.]+)")


def is_seaglider(path: Path, head: bytes) -> bool:
    """Whether a file is a dive of a Seaglider, by its dimensions and attributes."""
    if not is_netcdf(head):
        return False
    if head.startswith(CLASSIC_MAGIC):  # in a classic file, the dimensions come first
        return _SAMPLES.encode() in head
    if head[:8] != HDF5_MAGIC:
        return False
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return _SAMPLES in file and "dive_number" in file.attrs
    except Exception:  # damaged; h5py has no specific error for this, and the NetCDF reader reports it
        return False


def _read(path: Path, scope: Scope) -> Log:
    """The log of a dive; samples flagged as bad are NaN and counted in the notes."""
    with open_netcdf(path) as file:
        along: dict[str, list[Variable]] = {}
        for variable in file.variables.values():
            if len(variable.shape) == 1 and variable.shape[0] > 0:
                along.setdefault(variable.dims[0], []).append(variable)
        clocks = {dim: clock for dim, found in along.items() if (clock := _clock(found)) is not None}
        if _SAMPLES not in clocks:
            raise ValueError(
                "A dive of a Seaglider needs the variable 'time' along sg_data_point, which the file is missing: let "
                "the basestation write it again."
            )
        clocks = {_SAMPLES: clocks[_SAMPLES], **clocks}
        notes: list[str] = []
        groups = []
        for k, (dim, clock) in enumerate(clocks.items()):
            if scope.wants(dim):
                scope.progress(k / len(clocks), f"reading the variables along {dim}")
                groups.append(_group(file, along[dim], clock, scope.most, notes))
        return Log("Seaglider NetCDF", path.name, tuple(groups), _attrs(file, notes), tuple(notes), _label(file))


def _clock(variables: list[Variable]) -> Variable | None:
    found = {variable.name: variable for variable in variables if " since 1970" in variable.unit()}
    return next((found[name] for name in _CLOCKS if name in found), next(iter(found.values()), None))


def _group(file: NetcdfFile, variables: list[Variable], clock: Variable, most: int | None, notes: list[str]) -> Group:
    dim, rows, time = clock.dims[0], clock.shape[0], clock.numbers()
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for variable in variables:
        if variable.is_text or " since " in variable.unit():
            continue
        values = np.asarray(variable.numbers(), dtype=float)
        columns[variable.name] = np.where(values == -1.0, np.nan, values) if variable.name in _NOT_KNOWN else values
        unit = _unit(variable)
        if unit is not None:
            units[variable.name] = unit
    _drop_bad(file, dim, columns, notes)
    if dim == _SAMPLES:
        for name, (unit, values) in _rebuilt(file, time, notes).items():
            columns[name], units[name] = values, unit
    if most is None or rows <= most:
        return Group(dim, columns, time, units)
    few = {name: column[:most] for name, column in columns.items()}
    return Group(dim, few, time[:most], units, rows=rows, span=span_of(time))


def _unit(variable: Variable) -> str | None:
    if variable.name in _UNITS:
        return _UNITS[variable.name]
    unit = variable.unit()
    return _SPELLINGS.get(unit, unit) or None


def _drop_bad(file: NetcdfFile, dim: str, columns: dict[str, Column], notes: list[str]) -> None:
    """Replace samples that are flagged as bad by NaN, and note how many had a value."""
    for flags in file.variables.values():
        if not flags.name.endswith("_qc") or flags.dims[:1] != (dim,):
            continue
        codes = [int(code) if code.isdecimal() else 0 for code in flags.lines()] if flags.is_text else flags.numbers()
        bad = np.isin(codes, _BAD)
        for name in _JUDGED.get(flags.name, (flags.name.removesuffix("_qc"),)):
            if name in columns:
                column = np.asarray(columns[name])
                lost = int(np.count_nonzero(bad & np.isfinite(column)))
                if lost:
                    notes.append(
                        f"{lost} of {column.size} samples of {name} {'is' if lost == 1 else 'are'} left out: "
                        f"{flags.name} calls {'it' if lost == 1 else 'them'} bad."
                    )
                columns[name] = np.where(bad, np.nan, column)


def _rebuilt(file: NetcdfFile, time: np.ndarray, notes: list[str]) -> dict[str, tuple[str, np.ndarray]]:
    """Signals that newer gliders do not log by sample, rebuilt from the events in which the motors moved."""
    sought = {
        "battery_position_cm": ("eng_pitchCtl", "pitch", "cm"),
        "battery_roll_deg": ("eng_rollCtl", "roll", "deg"),
        "vbd_cm3": ("eng_vbdCC", "vbd", "cm3"),
    }
    found: dict[str, tuple[str, np.ndarray]] = {}
    for name, (logged, motor, unit) in sought.items():
        if logged in file.variables:
            continue
        moved = _moves(file, motor)
        if moved is None:
            notes.append(f"{name} cannot be known: {logged} is not logged, and the events of the motor are incomplete.")
            continue
        when, counts = moved
        found[name] = (
            unit,
            (np.interp(time, when, counts) - _centre(file, motor, time)) * _log(file, f"{motor.upper()}_CNV"),
        )
        notes.append(f"{name} is rebuilt from the events gc_*, as {logged} is not logged.")
    neutral = neutral_volume(_number_of(file))
    if neutral is None:
        notes.append("The volume of the VBD counts from $C_VBD, since the file does not say where that is.")
    rebuilt = found.get("vbd_cm3", ("", None))[1]
    logged = file.variables.get("eng_vbdCC")
    about = rebuilt if logged is None else np.asarray(logged.numbers(), dtype=float)
    if about is not None:
        found["vbd_from_largest"] = ("cm3", about + (neutral or 0.0))
    return found


def neutral_volume(constants: Mapping[str, float]) -> float | None:
    """The volume of the VBD at the pilots' $C_VBD, cm3, relative to its largest one (so negative); None if unknown.

    constants: attributes of a dive's log.  The operators' own limits and counts (`sg_cal_`) take precedence over the
    glider's.
    """
    at, least = constants.get("log_C_VBD"), constants.get("sg_cal_vbd_min_cnts", constants.get("log_VBD_MIN"))
    counts = constants.get("sg_cal_vbd_cnts_per_cc")
    size = 1.0 / counts if counts else constants.get("log_VBD_CNV")
    return None if at is None or least is None or size is None else (at - least) * size


def _number_of(file: NetcdfFile) -> dict[str, float]:
    """The file's constants for the VBD's counts, as far as it has them."""
    names = ("log_C_VBD", "log_VBD_MIN", "log_VBD_MAX", "log_VBD_CNV", "sg_cal_vbd_min_cnts", "sg_cal_vbd_max_cnts")
    read = {name: _number(file, name) for name in (*names, "sg_cal_vbd_cnts_per_cc")}
    return {name: value for name, value in read.items() if np.isfinite(value)}


def _moves(file: NetcdfFile, motor: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Times and counts at the beginning and end of each event of a motor; between events it stands still."""

    def of(name: str) -> np.ndarray | None:
        variable = file.variables.get(name)
        return None if variable is None else np.asarray(variable.numbers(), dtype=float)

    begin, stop = of("gc_st_secs"), of(f"gc_{motor}_ad")
    seconds = {name: of(f"gc_{name}_secs") for name in _MOTORS}
    if begin is None or stop is None:
        return None
    before = of(f"gc_{motor}_ad_start")
    before = np.concatenate([stop[:1], stop[:-1]]) if before is None else before  # older logs have only the ends
    flags = of("gc_gcphase") if "gc_gcphase" in file.variables else of("gc_flags")
    flags = np.zeros(begin.size) if flags is None else np.nan_to_num(flags)
    if any(value is None or value.size != begin.size for value in (stop, before, flags, *seconds.values())):
        return None
    turning = (flags.astype(np.int64) & _TURNING) > 0
    lasting = {name: np.abs(value) for name, value in seconds.items() if value is not None}  # < 0: bled
    usual, other = (
        sum((lasting[name] for name in order[: order.index(motor)]), np.zeros(begin.size))
        for order in (_MOTORS, _WHEN_TURNING)
    )
    start = begin + np.where(turning, other, usual)
    when = np.ravel(np.column_stack([start, start + lasting[motor]]))
    counts = np.ravel(np.column_stack([before, stop]))
    known = np.isfinite(when) & np.isfinite(counts)
    order = np.argsort(when[known], kind="stable")
    return (when[known][order], counts[known][order]) if known.any() else None


def _centre(file: NetcdfFile, motor: str, when: np.ndarray) -> np.ndarray:
    """The counts from which positions are measured; those of roll differ between going down and going up."""
    if motor != "roll":
        return np.full(when.size, _log(file, f"C_{motor.upper()}"))
    states, at = file.variables.get("gc_state_state"), file.variables.get("gc_state_secs")
    ends = [] if states is None or at is None else at.numbers()[states.numbers() == _END_OF_DIVE]
    if len(ends):
        climb = float(ends[0])
    else:
        climb = float(file.attrs.get("start_time", np.nan)) + _number(file, "start_of_climb_time")
    return np.where(when > climb, _log(file, "C_ROLL_CLIMB"), _log(file, "C_ROLL_DIVE"))


def _log(file: NetcdfFile, name: str) -> float:
    return _number(file, f"log_{name}")


def _number(file: NetcdfFile, name: str) -> float:
    variable = file.variables.get(name)
    return np.nan if variable is None else variable.number()


def _attrs(file: NetcdfFile, notes: list[str]) -> Mapping[str, Any]:
    """Position, magnetic variation (positive east), current, and the operators' constants, as far as known.

    The constants are in the units of the operators' flight model (volmax and vbdbias in cm3, mass in kg), whatever the
    attribute `units` says: that of volmax is m^3.
    """
    attrs: dict[str, Any] = {
        "latitude_deg": _number(file, "avg_latitude"),
        "magnetic_variation_deg": _variation(file),
        "start_of_climb_s": _number(file, "start_of_climb_time"),
    }
    flag = file.variables.get("depth_avg_curr_qc")
    if flag is not None and flag.is_text and flag.text().isdecimal() and int(flag.text()) in _BAD:
        notes.append("The depth-averaged current is left out: depth_avg_curr_qc calls it bad.")
    else:
        attrs["current_north_mps"] = _number(file, "depth_avg_curr_north")
        attrs["current_east_mps"] = _number(file, "depth_avg_curr_east")
    for name, variable in file.variables.items():
        if name.startswith("sg_cal_") and not variable.is_text and not _OTHER_CONSTANTS.match(name):
            attrs[name] = variable.number()
    attrs |= _number_of(file)
    known = {name: value for name, value in attrs.items() if np.isfinite(value)}
    for name in ("platform_id", "project"):
        if isinstance(file.attrs.get(name), str):
            known[name] = file.attrs[name]
    fixes = [file.variables.get(f"log_gps_{name}") for name in ("time", "lat", "lon")]
    if all(fix is not None and fix.shape == (3,) for fix in fixes):
        # the last fix before the dive, and the first after it
        table = np.column_stack([fix.numbers() for fix in fixes if fix is not None])[1:]
        if np.isfinite(table).all():
            known[FIXES] = table.ravel().tolist()
        else:
            notes.append("The current cannot be known from GPS: the dive has no fix before it, or none after it.")
    else:
        notes.append(
            "The current cannot be known from GPS: the file does not have three fixes each in log_gps_time, "
            "log_gps_lat and log_gps_lon."
        )
    return known


def _variation(file: NetcdfFile) -> float:
    """Magnetic variation, deg, positive east: the file's own, or the last non-empty field of a GPS line."""
    variation = _number(file, "magnetic_variation")
    if np.isfinite(variation):
        return variation
    line = file.variables.get("log_GPS2")
    found = _POSITION.match(line.text()) if line is not None and line.is_text else None
    return float(found[1]) if found else np.nan


def _label(file: NetcdfFile) -> str:
    dive = file.attrs.get("dive_number", _log(file, "DIVE"))
    return f"dive {int(dive)}" if isinstance(dive, int | float) and np.isfinite(dive) else ""


FORMAT: Final = Format("Seaglider NetCDF", (".nc",), is_seaglider, _read)
