"""NetCDF files from any source: the variables along each dimension with a time, as one group per dimension.

Source: CF conventions 1.11, sections 4.4 (time) and 9 (trajectories and profiles).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from auv_gym.channels import conversion
from auv_gym.records.log import MOST_ELEMENTS, Column, Format, Group, Log, Scope
from auv_gym.records.mapping import DATED, TIMES
from auv_gym.records.readers.netcdf_variables import NetcdfFile, Variable, is_netcdf, open_netcdf, span_of
from auv_gym.records.readers.seaglider import is_seaglider

_CLOCKS: Final = ("m_present_time", "sci_m_present_time")  # of a Slocum, s since 1970, as dbd2netcdf writes them
_NO_UNIT: Final = frozenset({"", "1", "nodim", "enum", "bool", "byte", "lat", "lon", "timestamp"})
_SALINITY_UNITS: Final = frozenset({"1", "1e-3", "1e-03", "0.001", "psu", "g/kg"})  # of practical salinity in CF
_ABBREVIATED: Final = {"s": "seconds", "sec": "seconds", "min": "minutes", "h": "hours", "hr": "hours", "d": "days"}
_KEPT: Final = ("title", "id", "platform_id", "platform", "wmo_id", "wmo_platform_code", "dive_number")


def _recognises(path: Path, head: bytes) -> bool:
    return is_netcdf(head) and not is_seaglider(path, head)


def _read(path: Path, scope: Scope) -> Log:
    """The log in a NetCDF file; if no dimension has a time, each is a group without one, so that a mapping can name it.

    A variable of two dimensions becomes columns name[0], name[1], ... if the second is short, or text if it holds
    characters.
    """
    with open_netcdf(path) as file:
        along: dict[str, list[Variable]] = {}
        for variable in file.variables.values():
            if _is_signal(variable):
                along.setdefault(variable.dims[0], []).append(variable)
        along = {dim: found for dim, found in along.items() if not all(v.is_text for v in found)}
        if not along:
            raise ValueError(
                "There is no variable time_s or time along one dimension; the variables are "
                f"{', '.join(map(repr, file.variables)) or 'none'}. "
                'Map the one that holds time, as in "JULD" = "time_s".'
            )
        clocks = {dim: _clock(dim, found) for dim, found in along.items()}
        timed = {dim for dim in along if clocks[dim] or any(_is_date(variable) for variable in along[dim])}
        chosen = [dim for dim in along if (dim in timed or not timed) and scope.wants(dim)]
        groups = []
        for k, dim in enumerate(chosen):
            scope.progress(k / len(chosen), f"reading the variables along {dim}")
            groups.append(_group(dim, along[dim], clocks[dim], scope.most))
        left = [f"{dim} ({', '.join(v.name for v in along[dim])})" for dim in along if timed and dim not in timed]
        notes = (f"Left out, as there is no time along their dimension: {'; '.join(left)}.",) if left else ()
        return Log("NetCDF", path.name, tuple(groups), _attrs(file), notes)


def _is_signal(variable: Variable) -> bool:
    if len(variable.shape) == 1:
        return variable.shape[0] > 0
    return (
        len(variable.shape) == 2 and variable.shape[0] > 0 and (variable.is_text or variable.shape[1] <= MOST_ELEMENTS)
    )


def _clock(dim: str, variables: list[Variable]) -> list[Variable]:
    """The variable that holds the time along a dimension, or the two clocks of a Slocum; empty if there is none."""
    found = {variable.name: variable for variable in variables if len(variable.shape) == 1 and not variable.is_text}
    slocum = [found[name] for name in _CLOCKS if name in found and " since " not in found[name].unit()]
    since = [variable for variable in found.values() if " since " in variable.unit()]
    since.sort(key=lambda variable: (variable.name != dim, variable.attrs.get("standard_name") != "time"))
    named = [variable for variable in found.values() if _is_named_time(variable)]
    candidates = [
        *(found[name] for name in TIMES if name in found),
        *named,
        *(variable for variable in since if variable.name == dim or variable.attrs.get("standard_name") == "time"),
    ]
    if candidates:
        return candidates[:1]
    return slocum or [variable for variable in since if _is_understood(variable)][:1]


def _is_understood(variable: Variable) -> bool:
    try:
        _since_1970(variable)
    except ValueError:
        return False
    return True


def _is_named_time(variable: Variable) -> bool:
    """Whether it is named time and states its unit."""
    if variable.name.lower() not in DATED:
        return False
    if " since " in variable.unit():
        return True
    try:
        return bool(variable.unit()) and conversion("time", variable.unit()).channel.name == "time_s"
    except ValueError:
        return False


def _is_date(variable: Variable) -> bool:
    return variable.is_text and variable.name.lower() in DATED


def _group(dim: str, variables: list[Variable], clock: list[Variable], most: int | None) -> Group:
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for variable in variables:
        if variable in clock:
            continue
        for name, column in _columns(variable, most).items():
            columns[name] = column
            unit = _unit(variable)
            if unit:
                units[name] = unit
    rows = variables[0].shape[0]
    if not clock:
        return Group(dim, columns, None, units, rows=rows)
    time = _seconds(clock[0])
    for other in clock[1:]:
        time = np.where(np.isfinite(time), time, _seconds(other))
    if most is None or rows <= most:
        return Group(dim, columns, time, units, rows=rows)
    return Group(dim, columns, time[:most], units, rows=rows, span=span_of(time))


def _columns(variable: Variable, most: int | None) -> dict[str, Column]:
    if variable.is_text:
        return {variable.name: variable.lines(most)}
    if " since " in variable.unit():
        try:
            return {variable.name: _since_1970(variable)[:most]}
        except ValueError:  # harmless, as it is not the group's clock
            return {}
    values = variable.numbers(most)
    if values.ndim == 1:
        return {variable.name: values}
    return {f"{variable.name}[{k}]": values[:, k].copy() for k in range(values.shape[1])}


def _unit(variable: Variable) -> str | None:
    """The unit that the file states, if it is a unit."""
    unit = variable.unit()
    if " since " in unit:
        return "s"
    if "salinity" in str(variable.attrs.get("standard_name", "")) and unit.lower() in _SALINITY_UNITS:
        return "psu" if variable.attrs["standard_name"] != "sea_water_absolute_salinity" else unit
    return None if unit in _NO_UNIT else unit


def _seconds(variable: Variable) -> np.ndarray:
    if " since " in variable.unit():
        return _since_1970(variable)
    if variable.name in _CLOCKS:
        return np.asarray(variable.numbers(), dtype=float)
    name = "time" if variable.name.lower() in DATED else variable.name
    unit = variable.unit()
    return conversion(name, None if unit in _NO_UNIT else unit).convert(np.asarray(variable.numbers(), dtype=float))


def _since_1970(variable: Variable) -> np.ndarray:
    import xarray as xr  # handles calendars; takes half a second to import

    unit, _, origin = variable.unit().partition(" since ")
    attrs = {"units": f"{_ABBREVIATED.get(unit.strip().lower(), unit)} since {origin}"}
    if "calendar" in variable.attrs:
        attrs["calendar"] = variable.attrs["calendar"]
    try:
        moment = xr.Variable(("row",), np.asarray(variable.numbers(), dtype=float), attrs)
        decoded = xr.decode_cf(xr.Dataset({"moment": moment}))["moment"].values
        return (decoded.astype("datetime64[ns]") - np.datetime64(0, "ns")) / np.timedelta64(1, "s")
    except Exception as error:  # the exception depends on the calendar
        raise ValueError(
            f"The times in {variable.name!r} cannot be read ({error}): give seconds, as time_s."
        ) from error


def _attrs(file: NetcdfFile) -> Mapping[str, Any]:
    attrs = {name: file.attrs[name] for name in _KEPT if isinstance(file.attrs.get(name), str | int | float)}
    for variable in file.variables.values():
        if variable.name.lower() in ("latitude", "lat") and not variable.is_text and len(variable.shape) < 2:
            known = np.asarray(variable.numbers(), dtype=float)
            known = known[np.abs(known) <= 90.0]
            if known.size:
                attrs["latitude_deg"] = float(known.mean())
    return attrs


FORMAT: Final = Format("NetCDF", (".nc", ".cdf", ".nc4"), _recognises, _read)
