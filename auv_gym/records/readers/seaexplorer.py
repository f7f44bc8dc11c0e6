"""Files of SeaExplorer gliders: text with `;` between cells, one file per yo, of vehicle (gli) or payload (pld1).

Names are `SEA035.10.gli.sub.36` (sent home) or `sea035.10.pld1.raw.36.gz` (from the glider after recovery): glider,
mission, computer, kind and number of the yo.  Source: ALSEAMAR, SeaExplorer user manual, as read by pyglider.  The
files state no units; those here are the manual's.  Times are UTC.  Latitudes and longitudes are written as degrees and
minutes (5138.149 is 51 degrees 38.149 minutes), and are converted to degrees.
"""

from __future__ import annotations

import gzip
import re
import zlib
from array import array
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from auv_gym.records.log import Format, Group, Log, Scope

_CLOCKS: Final = ("Timestamp", "PLD_REALTIMECLOCK")
_POSITIONS: Final = ("Lat", "Lon", "NAV_LATITUDE", "NAV_LONGITUDE")
_UNITS: Final = {
    "Heading": "deg", "Declination": "deg", "Pitch": "deg", "Roll": "deg", "Depth": "m", "Temperature": "degC",
    "Pa": "Pa", "Lat": "deg", "Lon": "deg", "DesiredH": "deg", "BallastCmd": "mL", "BallastPos": "mL", "LinCmd": "mm",
    "LinPos": "mm", "AngCmd": "deg", "AngPos": "deg", "Voltage": "V", "Altitude": "m", "NAV_LATITUDE": "deg",
    "NAV_LONGITUDE": "deg", "NAV_DEPTH": "m", "GPCTD_TEMPERATURE": "degC", "GPCTD_PRESSURE": "dbar",
    "LEGATO_TEMPERATURE": "degC", "LEGATO_PRESSURE": "dbar", "LEGATO_SALINITY": "psu",
}  # fmt: skip
# Codes for a missing value: no echo, no target
_NONE: Final = {"Altitude": -1.0, "DesiredH": -9999.0}
_NO_PAYLOAD_VALUE = 9999.0
_DATE = re.compile(rb"(\d\d)/(\d\d)/(\d{4}) (\d\d):(\d\d):(\d\d)(\.\d{1,6})?")
_NAME = re.compile(r"\.(?:gli|pld\d?)\.(?:sub|raw)(?:\.(\d+))?(?:\.gz)?$", re.IGNORECASE)
_LONGEST_LINE = 1 << 14  # bytes
_MOST_BAD = 10_000  # lines, or parts of a longer one; a file has a few thousand rows


def _is_seaexplorer(path: Path, head: bytes) -> bool:
    if head.startswith(b"\x1f\x8b"):
        try:
            head = zlib.decompressobj(31).decompress(head, 256)
        except zlib.error:
            return False
    return head.removeprefix(b"\xef\xbb\xbf").startswith((b"Timestamp;NavState;", b"PLD_REALTIMECLOCK;"))


def _read(path: Path, scope: Scope) -> Log:
    """One group, with a column for each name in the first line; the label is the number of the yo."""
    notes: list[str] = []
    lines = _lines(path, scope, notes)
    header = next(lines, b"").removeprefix(b"\xef\xbb\xbf").decode("latin-1").strip().split(";")
    if header[0] not in _CLOCKS or len(header) < 2:
        raise ValueError(
            f"{path} is no file of a SeaExplorer: its first line has to begin with Timestamp; or PLD_REALTIMECLOCK;, "
            f"got {';'.join(header)[:40]!r}. Give a file such as SEA035.10.gli.sub.36."
        )
    times, cells, rows, bad = array("d"), array("d"), 0, 0
    last = float("nan")
    for line in lines:
        row = _row(line, len(header))
        if row is None:
            bad += bool(line.strip())
            if bad > _MOST_BAD:
                notes.append("Left out the rest of the file: it is no text.")
                break
            continue
        rows, last = rows + 1, row[0]
        if scope.most is None or rows <= scope.most:
            times.append(row[0])
            cells.extend(row[1:])
    if not rows:
        raise ValueError(
            f"{path} has the header of a SeaExplorer file but no row with a time (dd/mm/yyyy HH:MM:SS) and "
            f"{len(header)} cells below it: copy it from the glider or its server again."
        )
    if bad:
        notes.append(f"Left out {bad} lines that are damaged or cut short.")
    label = _NAME.search(path.name)
    return Log(
        "SeaExplorer file",
        path.name,
        (_group(header, np.array(times), np.array(cells), rows, last),) if scope.wants("") else (),
        notes=tuple(notes),
        label=(label[1] or "") if label else "",
    )


def _lines(path: Path, scope: Scope, notes: list[str]) -> Iterator[bytes]:
    """The lines of a file, decompressed if necessary; adds a note if the compressed file is cut short."""
    try:
        with path.open("rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
            raw.seek(0)
            file = gzip.GzipFile(fileobj=raw) if packed else raw
            size = max(path.stat().st_size, 1)
            for count, line in enumerate(iter(lambda: file.readline(_LONGEST_LINE), b"")):
                yield line
                if count % 20_000 == 19_999:
                    scope.progress(min(raw.tell() / size, 1.0), "reading lines")
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        notes.append(f"The compressed file is cut short or damaged ({error}): read up to there.")
    except OSError as error:
        raise ValueError(f"Cannot read {path}: {error.strerror}.") from error


def _row(line: bytes, width: int) -> list[float] | None:
    """Time, s since 1970, and cells, NaN if empty; None if the line is damaged."""
    cells = line.rstrip(b"\r\n").split(b";")
    date = _DATE.fullmatch(cells[0])
    if len(cells) != width or date is None:
        return None
    day, month, year, hour, minute, second = map(int, date.groups()[:6])
    try:
        whole = datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp()
        return [whole + float(date[7] or 0), *(float(cell) if cell.strip() else float("nan") for cell in cells[1:])]
    except ValueError:
        return None


def _group(header: list[str], time: np.ndarray, cells: np.ndarray, rows: int, last: float) -> Group:
    table = cells.reshape(time.size, len(header) - 1).T
    columns: dict[str, np.ndarray] = {}
    for name, values in zip(header[1:], table, strict=True):
        if not name:  # each line ends in a delimiter
            continue
        none = _NO_PAYLOAD_VALUE if header[0] != "Timestamp" else _NONE.get(name)
        columns[name] = np.where(values == none, np.nan, values) if none is not None else values.copy()
    for name in _POSITIONS:
        if name in columns:
            columns[name] = _degrees(columns[name])
    for latitude, longitude in (_POSITIONS[:2], _POSITIONS[2:]):
        if latitude in columns and longitude in columns:  # 0, 0 means no fix yet
            unknown = (columns[latitude] == 0.0) & (columns[longitude] == 0.0)
            columns[latitude][unknown] = columns[longitude][unknown] = np.nan
    units = {name: _UNITS[name] for name in columns if name in _UNITS}
    span = (float(time[0]), last) if time.size < rows else None
    return Group("", columns, time, units, rows=rows, span=span)


def _degrees(written: np.ndarray) -> np.ndarray:
    """Degrees from degrees and minutes written as one number: -12820.536 is -(128 + 20.536 / 60)."""
    whole = np.trunc(written / 100.0)
    return whole + (written - 100.0 * whole) / 60.0


FORMAT = Format(
    "SeaExplorer file", (".gli.sub", ".gli.gz", ".gli.raw", ".pld1.sub", ".pld1.raw"), _is_seaexplorer, _read
)
