"""Dives of MERMAID profiling floats, from tables of pressure, temperature and actions of pump and valves.

A row is an event or a reading. A row without a temperature may repeat the previous pressure. The amount of oil that the
bypass lets in before a dive is unknown, so the volume of a dive counts from its first row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from auv_gym.records.record import Record

COLUMNS = (
    "depth_m", "temperature_C", "pumped_cum_m3", "valved_cum_m3", "oil_volume_rel_m3", "bypass_open_cum_s",
    "surface_pump_cum_s",
)  # fmt: skip
_DERIVED = "oil_volume_m3: oil that pump and valves moved since the first row of each dive (oil_volume_rel_m3)"
_UNDER = 2.0  # m; above this depth the float may be at the surface
_LEAST_ROWS = 8


def is_mermaid(names: Iterable[str]) -> bool:
    """Whether a table has the columns of such a log."""
    return set(COLUMNS) <= set(names)


def mermaid_dives(time: np.ndarray, columns: Mapping[str, np.ndarray], dives: np.ndarray, source: str) -> Record:
    """A record with one segment per dive, from below the surface down and back, ready for a `float_oil` vehicle.

    columns: by the names in `COLUMNS`, (n,) each.  dives: a label per row.  Rows that only repeat the previous pressure
    are dropped; if oil moved at such a row, its depth is interpolated. Channels: depth_m, temperature_C (interpolated
    in time), oil_volume_m3, pumped_volume_m3, valved_volume_m3, valved_depth_m4.  Raises if no dive can be used.
    """
    labels = np.asarray(dives).astype(str)
    parts, left_out = [], {}
    for label in dict.fromkeys(labels.tolist()):
        rows = np.flatnonzero(labels == label)
        rows = rows[np.argsort(time[rows], kind="stable")]
        part, problem = _dive(time[rows], {name: np.asarray(columns[name], float)[rows] for name in COLUMNS})
        if problem:
            left_out[label] = problem
        else:
            parts.append((label, part))
    if not parts:
        raise ValueError(
            f"{source} has no dive that can be used: "
            + "; ".join(f"{label}: {problem}" for label, problem in left_out.items())
            + ". A dive needs readings below the surface and buoyancy actions."
        )
    names = [name for name in parts[0][1] if name != "time_s"]
    joined = {name: np.concatenate([part[name] for _, part in parts]) for name in ("time_s", *names)}
    segment = np.concatenate([np.full(part["time_s"].size, label) for label, part in parts])
    notes = [f"dive {label}: left out, {problem}." for label, problem in left_out.items()]
    attrs = {"source": source, "derived": _DERIVED}
    return Record.from_arrays(joined.pop("time_s"), joined, segment=segment, attrs=attrs, notes=notes)


def _dive(time: np.ndarray, log: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """The channels of one dive, or the reason why it cannot be used."""
    depth, oil = log["depth_m"], log["oil_volume_rel_m3"]
    diving = (log["bypass_open_cum_s"] >= log["bypass_open_cum_s"].max()) & (log["surface_pump_cum_s"] <= 0.0)
    under = np.flatnonzero(diving & (depth > _UNDER))
    if under.size < _LEAST_ROWS:
        return {}, f"{under.size} readings below {_UNDER:g} m"
    kept = np.arange(under[0], under[-1] + 1)
    moved = np.r_[False, np.diff(oil) != 0.0]
    repeated = np.r_[False, np.diff(depth) == 0.0] & ~np.isfinite(log["temperature_C"])
    rows = kept[~repeated[kept] | moved[kept]]
    rows = rows[np.r_[True, np.diff(time[rows]) > 0.0]]
    if not moved[rows].any():
        return {}, "no buoyancy action, so its drag and volume cannot be told apart"
    fresh = rows[~repeated[rows]]
    read = np.interp(time[rows], time[fresh], depth[fresh])
    warm = rows[np.isfinite(log["temperature_C"][rows])]
    if warm.size == 0:
        return {}, "no temperature"
    valved = -log["valved_cum_m3"]
    let_in = np.diff(valved[rows], prepend=valved[rows[0]])
    return {
        "time_s": time[rows],
        "depth_m": read,
        "temperature_C": np.interp(time[rows], time[warm], log["temperature_C"][warm]),
        "oil_volume_m3": oil[rows],
        "pumped_volume_m3": log["pumped_cum_m3"][rows],
        "valved_volume_m3": valved[rows],
        "valved_depth_m4": np.cumsum(let_in * read),
    }, ""
