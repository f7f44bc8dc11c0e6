"""Slocum logs as text by dbd2asc: a header; names, units and sizes of the sensors; then one row per cycle.

dba_merge joins the texts of flight and science; each row then has one of the two clocks.
Source: Slocum Glider Operators Manual, Teledyne Webb Research, "dbd2asc" and "dba_merge".
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from auv_gym.records.log import Format, Group, Log, Scope
from auv_gym.records.readers.slocum import CLOCKS, current_cycles, unit_of_sensor

_LONGEST: Final = 1 << 20  # bytes of a line; several thousand sensors take a tenth of it
_BLOCK: Final = 2000  # lines at once


def _recognises(path: Path, head: bytes) -> bool:
    return head.startswith(b"dbd_label") and b"DBD_ASC" in head[:64]


def _read(path: Path, scope: Scope) -> Log:
    """The log in a text of dbd2asc; its sensors are one group, NaN if a sensor was not updated in a cycle."""
    size, notes = path.stat().st_size, []
    with path.open("rb") as file:
        fields, names, units = _header(file)
        clocks = [names.index(name) for name in CLOCKS if name in names]
        if not clocks:
            raise ValueError(f"The text of dbd2asc needs the sensor {' or '.join(CLOCKS)}: convert the log again.")
        blocks, rows, more = [np.zeros((0, len(names)))], 0, True
        while more and (scope.most is None or rows <= scope.most):
            lines = _lines(file)
            last = len(lines) < _BLOCK
            block, cut = _numbers(lines, len(names), rows, last)
            blocks.append(block)
            rows, more = rows + len(block), not last
            if cut:
                notes.append("The text is cut short within its last row, which is left out.")
            scope.progress(min(1.0, file.tell() / size), f"reading row {rows}")
        more_rows, end = _rest(file, size, len(names), clocks) if more else (0, None)
    table = np.concatenate(blocks)
    if len(table) < 3:
        raise ValueError(f"The text of dbd2asc needs 3 rows or more, got {len(table)}: convert the log again.")
    time = _time(table, clocks)
    counts = current_cycles(time) & np.isfinite(time)
    left = int(np.count_nonzero(~counts[1:]))
    if left:
        notes.append(f"{left} rows without a time later than the ones before are left out.")
    table, time = table[counts], time[counts]
    kept = {name: table[: scope.most, k].copy() for k, name in enumerate(names) if name not in CLOCKS}
    units_of = {name: found for name, said in zip(names, units, strict=True) if (found := unit_of_sensor(said))}
    span = None
    if time.size and scope.most is not None and len(time) + more_rows > scope.most:
        span = (float(time[0]), float(time[-1]) if end is None else max(float(time[-1]), end))
    group = Group(
        "",
        kept,
        time[: scope.most],
        {name: unit for name, unit in units_of.items() if name in kept},
        rows=len(time) + more_rows,
        span=span,
    )
    attrs = {"mission": fields["mission_name"]} if fields.get("mission_name") else {}
    return Log("Slocum log as text", path.name, (group,), attrs, tuple(notes), fields.get("filename", ""))


def _header(file: BinaryIO) -> tuple[dict[str, str], list[str], list[str]]:
    """The fields of the header, the names of the sensors, and their units."""
    fields: dict[str, str] = {}
    tags = 3
    while len(fields) < tags:
        name, _, value = _line(file).partition(":")
        if not value or name in fields or (name == "num_ascii_tags" and not re.fullmatch(r"\s*\d{1,4}\s*", value)):
            raise ValueError("The header of dbd2asc's text is cut short or damaged: convert the log again.")
        fields[name] = value.strip()
        if name == "num_ascii_tags":
            tags = int(value)
    names, units, sizes = (_line(file).split() for _ in range(3))
    if not names or not len(names) == len(units) == len(sizes):
        raise ValueError(
            "The text of dbd2asc needs a line each with names, units and sizes of the sensors, of one length, got "
            f"{len(names)}, {len(units)} and {len(sizes)}: convert the log again."
        )
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"The text of dbd2asc names the sensor {repeated!r} twice: convert the log again.")
    return fields, names, units


def _line(file: BinaryIO) -> str:
    line = file.readline(_LONGEST)
    if len(line) == _LONGEST:
        raise ValueError(f"A line of the text is longer than {_LONGEST} bytes: it is damaged, convert the log again.")
    return line.decode("ascii", "replace").rstrip("\r\n")


def _lines(file: BinaryIO) -> list[str]:
    lines = []
    while len(lines) < _BLOCK and (line := _line(file)):
        lines.append(line)
    return lines


def _numbers(lines: list[str], width: int, begin: int, last: bool) -> tuple[np.ndarray, bool]:
    """The rows of some lines, and whether the file's last line was cut short and left out."""
    if not lines:
        return np.zeros((0, width)), False
    try:
        return np.loadtxt(lines, ndmin=2, comments=None).reshape(len(lines), width), False
    except ValueError:
        pass
    rows = []
    for k, line in enumerate(lines):
        cells = line.split()
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = []
        if len(row) != width:
            if last and k == len(lines) - 1 and len(cells) <= width:
                return np.array(rows, dtype=float).reshape(-1, width), True
            what = f"{len(cells)} cells" if len(cells) != width else "a cell that is no number"
            raise ValueError(
                f"Row {begin + k + 1} of dbd2asc's text needs {width} numbers, a sensor each, but has {what}: convert "
                "the log again."
            )
        rows.append(row)
    return np.array(rows, dtype=float).reshape(-1, width), False


def _time(table: np.ndarray, clocks: list[int]) -> np.ndarray:
    time = table[:, clocks[0]]
    for other in clocks[1:]:
        time = np.where(np.isfinite(time), time, table[:, other])
    return time


def _rest(file: BinaryIO, size: int, width: int, clocks: list[int]) -> tuple[int, float | None]:
    """The number of rows that follow, and the time of the last, without parsing all of them."""
    rows, tail = 0, b""
    while chunk := file.read(1 << 20):
        rows += chunk.count(b"\n")
        tail = (tail + chunk)[-_LONGEST:]
    for line in reversed(tail.decode("ascii", "replace").splitlines()[1:]):
        try:
            found = _time(np.array([line.split()], dtype=float).reshape(1, width), clocks)[0]
        except ValueError:
            continue
        if np.isfinite(found):
            return rows, float(found)
    return rows, None


FORMAT: Final = Format("Slocum log as text", (".dbd_ascii", ".dba", ".asc"), _recognises, _read)
