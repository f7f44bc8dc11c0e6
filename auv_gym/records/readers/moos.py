"""Logs of MOOS (.alog): text with one publication per line, `time VARIABLE SOURCE value`, after a LOGSTART comment.

Source: pLogger of MOOS (CMOOSLogger::DoBanner) and logutils of MOOS-IvP.  MOOS states no units.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from auv_gym.records.log import Format, Group, Log, Scope

_MOST_BAD = 100_000  # lines
_FIRST = b"0123456789+-.nNiID"  # first characters of numbers; `float` is slow to refuse a text
_BLOCK = 1 << 20  # bytes read at once
_LONGEST_LINE = 1 << 16  # bytes kept of a line longer than a block: such lines are grids, images or damage
_ABSOLUTE = 1000.0  # s before LOGSTART; a time further back counts from 1970 itself, as in MOOS-IvP


@dataclass
class _Variable:
    """The publications under a name: times and numbers, as many as needed, their count, and the count of texts."""

    wanted: float
    times: array = field(default_factory=lambda: array("d"))
    values: array = field(default_factory=lambda: array("d"))
    numbers: int = 0
    texts: int = 0
    last: bytes = b"nan"


def _is_alog(path: Path, head: bytes) -> bool:
    lines = head.split(b"\n")
    return head.startswith(b"%") and any(line.startswith(b"%") and b"LOGSTART" in line for line in lines)


def _read(path: Path, scope: Scope) -> Log:
    """One group and column for each variable with numbers; time since 1970, or since the start without LOGSTART."""
    variables: dict[bytes, _Variable] = {}
    start, bad = 0.0, 0
    most = math.inf if scope.most is None else max(scope.most, 1)
    notes: list[str] = []
    for line in _lines(path, scope, notes):
        cells = line.split(None, 3)
        if len(cells) == 4 and (variable := variables.get(cells[1])) and variable.numbers >= variable.wanted:
            variable.numbers += 1  # enough samples: only count
            variable.last = cells[0]
        elif line.startswith(b"%"):
            start = _log_start(line) or start
        elif len(cells) < 3 or (time := _number(cells[0])) is None:
            bad += bool(cells)
            if bad > _MOST_BAD:
                notes.append("Left out the rest of the file, which is no log.")
                break
        else:
            variable = variables.get(cells[1])
            if variable is None:
                variable = variables[cells[1]] = _Variable(most if scope.wants(cells[1].decode("latin-1")) else 1)
            value = _number(cells[3]) if len(cells) == 4 and cells[3][0] in _FIRST else None
            if value is None:
                variable.texts += 1
                continue
            variable.numbers += 1
            variable.last = cells[0]
            variable.times.append(time)
            variable.values.append(value)
    named = {name.decode("latin-1"): variables[name] for name in sorted(variables)}
    if not any(variable.numbers for variable in named.values()):
        raise ValueError(
            f"{path} is no MOOS log with numbers: lines `time VARIABLE SOURCE value` are needed, such as "
            "`12.50 NAV_DEPTH uSimMarine 3.1`. Give the .alog of a community, or copy it again."
        )
    groups = [
        _group(name, variable, start)
        for name, variable in named.items()
        if variable.numbers >= variable.texts and variable.numbers and scope.wants(name)
    ]
    return Log("MOOS log", path.name, tuple(groups), notes=(*notes, *_notes(named, start, bad)))


def _lines(path: Path, scope: Scope, notes: list[str]) -> Iterator[bytes]:
    """The whole lines of a file; of a line longer than a block, only the first and last part."""
    rest, done = b"", 0
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                lines = (rest + block).split(b"\n")
                rest = lines.pop()[:_LONGEST_LINE]
                yield from lines
                done += len(block)
                scope.progress(done / size, "reading lines")
    except OSError as error:
        raise ValueError(f"Cannot read {path}: {error.strerror}.") from error
    if rest:
        notes.append("The file ends within a line, which is left out: it may be cut short.")


def _log_start(comment: bytes) -> float:
    """The time in `%% LOGSTART 1699999999.5`, s; 0 if a comment holds none."""
    _, found, rest = comment.partition(b"LOGSTART")
    return (_number(rest.strip()) if found else None) or 0.0


def _number(cell: bytes) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        if not cell.startswith(b"D:"):  # prefix of numbers if pLogger marks types
            return None
        return _number(cell[2:])
    return value if b"_" not in cell else None  # Python accepts grouped digits as numbers, MOOS does not


def _group(name: str, variable: _Variable, start: float) -> Group:
    ends = _since_1970(np.array([variable.times[0], _number(variable.last) or 0.0]), start)
    return Group(
        name,
        {name: np.array(variable.values)},
        _since_1970(np.array(variable.times), start),
        rows=variable.numbers,
        span=(float(ends[0]), float(ends[1])) if len(variable.times) < variable.numbers else None,
    )


def _since_1970(time: np.ndarray, start: float) -> np.ndarray:
    return np.where(time + _ABSOLUTE > start, time, time + start) if start else time


def _notes(variables: dict[str, _Variable], start: float, bad: int) -> Iterator[str]:
    texts = sorted(name for name, variable in variables.items() if variable.texts > variable.numbers)
    mixed = sorted(name for name, variable in variables.items() if 0 < variable.texts <= variable.numbers)
    if texts:
        shown = ", ".join(texts[:8]) + (f" and {len(texts) - 8} more" if len(texts) > 8 else "")
        yield f"Left out {len(texts)} variables that hold text: {shown}."
    if mixed:
        yield f"Left out the texts among the numbers of {', '.join(mixed)}."
    if bad:
        yield f"Left out {bad} lines that are not `time VARIABLE SOURCE value`."
    if not start:
        yield "There is no LOGSTART: times count from the beginning of the log."


FORMAT = Format("MOOS log", (".alog",), _is_alog, _read, slow=True)
