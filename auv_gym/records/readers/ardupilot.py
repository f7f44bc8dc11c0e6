"""Shared parts of the readers of the two kinds of ArduPilot logs: units, structures in a file, and outputs.

Messages are found and decoded here and in `dataflash` and `mavlink`, because the loops of pymavlink take about 40
microseconds per message and can run without limit on damaged files.  Numbers equal those of pymavlink.  A unit that
`auv_gym.channels` cannot spell (cdeg, hPa, mrad/s) is replaced by one that it can, and the numbers are converted.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from auv_gym.records.log import Log, Scope

_CHUNK = 1 << 17  # rows decoded at once, so that raw copies stay small compared with the columns
_MOST_TRIES = 1_000_000  # failed attempts to find a message before the rest of a file is given up: about a second
_STEP = 1 << 24  # bytes between two calls of progress

# Spellings of units in both formats: ours, and the factor to it.  Others stay as they are.
UNITS: Final[dict[str, tuple[str, float]]] = {
    "degheading": ("deg", 1.0), "deglatitude": ("deg", 1.0), "deglongitude": ("deg", 1.0), "cdeg": ("deg", 1e-2),
    "deg/2": ("deg", 2.0), "degE5": ("deg", 1e-5), "degE7": ("deg", 1e-7), "mrad": ("rad", 1e-3),
    "ddeg/s": ("deg/s", 1e-1), "cdeg/s": ("deg/s", 1e-2), "mrad/s": ("rad/s", 1e-3), "rad/s/s": ("rad/s2", 1.0),
    "m/s/s": ("m/s2", 1.0), "cm/s/s": ("m/s2", 1e-2), "mG": ("m/s2", 9.80665e-3), "dm/s": ("m/s", 1e-1),
    "m/s*5": ("m/s", 0.2), "dm": ("m", 1e-1), "dam": ("m", 10.0), "hPa": ("Pa", 100.0), "mbar": ("Pa", 100.0),
    "cdegC": ("degC", 1e-2), "cV": ("V", 1e-2), "cA": ("A", 1e-2), "d%": ("%", 1e-1), "c%": ("%", 1e-2),
    "ds": ("s", 1e-1), "cs": ("s", 1e-2), "ns": ("s", 1e-9), "hJ": ("J", 100.0), "g": ("kg", 1e-3), "l": ("L", 1.0),
    "cm^3": ("cm3", 1.0), "Watt": ("W", 1.0), "W.s": ("J", 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class Number:
    """A numeric field of a message: its place in the structure, and its conversion to a column."""

    name: str
    element: int | None = None  # of an array
    unit: str = ""
    divisor: float = 1.0
    factor: float = 1.0
    output: bool = False  # pulse length to a thruster or servo

    def of(self, rows: np.ndarray) -> np.ndarray:
        """Its values in structures of its message."""
        values = rows[self.name] if self.element is None else rows[self.name][:, self.element]
        values = values.astype(np.float64 if values.dtype.kind == "f" else values.dtype)
        if self.divisor != 1.0:  # divide like the library: a division by 1e7 is exact where a product is not
            values = values / self.divisor
        if self.factor != 1.0:
            values = values * self.factor
        if self.output:
            values = np.where(values == 0, np.nan, values)  # zero means that there are no pulses
        return values


class Search:
    """The search for messages in a file: what it skipped, and when it gives up."""

    def __init__(self, size: int, progress: Callable[[float, str], None]) -> None:
        self._size = size
        self._progress = progress
        self._misses = 0
        self._passed = 0

    def reached(self, at: int) -> int:
        """Report progress up to this byte; returns the byte at which to report again."""
        self._progress(0.5 * at / self._size, "finding messages")
        return at + _STEP

    def misses(self) -> bool:
        """Count a place where no message starts; returns whether the limit is exceeded."""
        self._misses += 1
        return self._misses > _MOST_TRIES

    def passes(self, at: int, following: int) -> None:
        """Count the skipped bytes from a place to the next possible start of a message."""
        self._passed += following - at

    def notes(self, at: int) -> list[str]:
        """Notes for a log whose search ended at this byte."""
        lines = []
        if at < self._size:
            lines.append("The file is cut short within its last message, which is left out.")
        if self._passed:
            lines.append(f"{self._passed} of {self._size} bytes are no messages (damage, or padding): left out.")
        return lines


def refusing(read: Callable[[Path, Scope], Log]) -> Callable[[Path, Scope], Log]:
    """The reader, with any error from a damaged definition turned into a sentence."""

    def guarded(path: Path, scope: Scope) -> Log:
        try:
            return read(path, scope)
        except ValueError:
            raise
        except Exception as error:  # for example a text in place of a number
            raise ValueError(f"{path} is damaged ({error!r}): copy it from the vehicle or computer again.") from error

    return guarded


def structures(data: np.ndarray, starts: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """The structures that start at these bytes, padded with zeros if the file ends within one."""
    size = dtype.itemsize
    rows = np.zeros((starts.size, size), np.uint8)
    inside = starts + size <= data.size
    if inside.any():
        rows[inside] = np.lib.stride_tricks.sliding_window_view(data, size)[starts[inside]]
    for row in np.flatnonzero(~inside):
        rest = data[starts[row] :]
        rows[row, : rest.size] = rest
    return rows.view(dtype)[:, 0]


def pieces_of(starts: np.ndarray) -> Iterator[np.ndarray]:
    """The starts of messages, in chunks that are decoded at once."""
    return (starts[first : first + _CHUNK] for first in range(0, starts.size, _CHUNK))


def text_of(cell: bytes) -> str:
    """The text in a field of fixed length."""
    return cell.split(b"\0")[0].decode("latin-1")


def servo_functions(parameters: Iterable[tuple[str, float]]) -> dict[str, Any]:
    """What outputs 1 to n drive, as an attribute; 33 to 40 are the motors 1 to 8 (SERVOn_FUNCTION of ArduPilot)."""
    functions: dict[int, int] = {}
    for name, value in parameters:
        named = re.fullmatch(r"SERVO(\d{1,2})_FUNCTION", name)
        if named and np.isfinite(value):
            functions[int(named[1])] = int(value)
    return {"servo_functions": [functions.get(n, 0) for n in range(1, max(functions) + 1)]} if functions else {}
