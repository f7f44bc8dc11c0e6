"""Tables in text: a header, rows of numbers, columns separated by comma, semicolon, tab or spaces."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Iterable
from contextlib import closing
from io import BytesIO
from pathlib import Path

import numpy as np

from auv_gym.records.log import Column, Format, Group, Log, Scope
from auv_gym.records.mapping import list_of
from auv_gym.records.readers.opening import mapped

_COMMENTS = (b"#", b"%")
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # the marks with which such a file begins
_FILLED_IN = (-99999.0, -9999.0, -999.0)  # common placeholders for a missing value; a column may have several of them
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_BRACKETED = re.compile(r".*\S\s*[\[(]\s*([^\[\]()]+?)\s*[\])]")  # Heading [deg], Depth (m)
_HEAD = 4096  # bytes
_COMMA = re.compile(r"\s*-?\d+,\d+(?:[eE][-+]?\d+)?\s*")


def _recognises(path: Path, head: bytes) -> bool:
    if head.startswith(_UTF_16):
        return True
    return bool(head) and b"\0" not in head and not head.startswith((b"%PDF", b"PK\x03\x04", b"\x1f\x8b"))


def _read(path: Path, scope: Scope) -> Log:
    """The table in a text file; lines with # or % are comments, and a row of units may follow the header."""
    scope.progress(0.0, f"reading {path.name}")
    with closing(mapped(path)) as file:
        wide = file[:2].startswith(_UTF_16)
        if not wide and file.find(b"\0") >= 0:
            raise ValueError("The file is binary, or has binary parts, not text: copy it again, or export it as CSV.")
        content = _from_utf_16(file[:]) if wide else file[:].removeprefix(b"\xef\xbb\xbf")
    if content.startswith(_COMMENTS) or any(b"\n" + mark in content for mark in _COMMENTS):
        content = b"\n".join(line for line in content.split(b"\n") if not line.startswith(_COMMENTS))
    lines, ends = _first_lines(content)
    if _is_spaced(lines):
        content = b"\n".join(b";".join(line.split()) for line in content.splitlines())
        lines, ends = _first_lines(content)
    if len(lines) < 3:
        raise ValueError(
            f"A header and at least 2 rows are needed, got {len(lines)} line{'s' * (len(lines) != 1)} in all: "
            "export the log again."
        )
    delimiter = max(",;\t", key=lines[0].count)
    if delimiter not in lines[0]:  # one column, or a title above the header
        delimiter = max(",;\t", key=_text(content[:_HEAD]).count)
    header = _header(lines[0], delimiter)
    units = {name: bracketed[1] for name in header if (bracketed := _BRACKETED.fullmatch(name))}
    units |= {name: "%" for name in header if name.endswith("%") and len(name) > 1}  # the one unit that is no word
    below = next(csv.reader(lines[1:2], delimiter=delimiter, skipinitialspace=True))
    with_units = _are_units(below, lines[2], delimiter)
    if with_units:
        units |= {name: unit.strip() for name, unit in zip(header, below) if unit.strip()}
    columns, notes = _columns(content[ends[1 if with_units else 0] :], header, delimiter)
    return Log("a table in text", path.name, (Group("", columns, units=units),), notes=tuple(notes))


CSV = Format("CSV or another table in text", (".csv", ".txt", ".tsv", ".dat", ".asc"), _recognises, _read, general=True)


def _from_utf_16(content: bytes) -> bytes:
    try:
        return content.decode("utf-16").encode()
    except UnicodeDecodeError as error:
        raise ValueError(f"The file begins as UTF-16 but is not ({error.reason}): save it as UTF-8.") from None


def numbers_or_text(cells: Iterable[str]) -> Column:
    """The numbers in some cells, NaN for an empty cell; the cells themselves if one is neither."""
    cells = list(cells)
    try:
        return np.array(list(map(float, cells)))
    except ValueError:
        pass
    try:
        return np.array([_number(cell) for cell in cells])
    except ValueError:
        return cells


def _number(cell: str) -> float:
    return float("nan" if cell.strip().lower() in _MISSING else cell)


def _header(line: str, delimiter: str) -> list[str]:
    header = [name.strip() for name in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    if all(isinstance(numbers_or_text([name]), np.ndarray) for name in header):
        raise ValueError(
            f"The first line holds numbers ({line[:60]!r}): put a header above it that names the columns, such as "
            "time_s,heading_deg,rudder_deg."
        )
    if header[-1] == "" and len(header) > 1:  # each line ends with a delimiter
        header[-1] = _END
    repeated = {name for name in header if header.count(name) > 1}
    if repeated or "" in header:
        what = (
            f"names {', '.join(map(repr, sorted(repeated)))} twice"
            if repeated - {""}
            else "has a column without a name"
        )
        raise ValueError(f"The header {what}: give each column a name of its own.")
    return header


_END = "\0"  # name of the empty column after a delimiter that ends each line


def _is_spaced(lines: list[str]) -> bool:
    """Whether spaces separate the columns: the header has no other separator, and the rows have as many words."""
    words = [len(line.split()) for line in lines]
    return len(lines) == 3 and words[0] > 1 and not set(lines[0]) & set(",;\t") and len(set(words)) == 1


def _are_units(below: list[str], following: str, delimiter: str) -> bool:
    """Whether the row below the header holds units: only text, in columns where the next row has numbers."""
    given = [k for k, cell in enumerate(below) if cell.strip()]
    values = next(csv.reader([following], delimiter=delimiter, skipinitialspace=True))
    if not given or len(values) != len(below):
        return False
    text = all(not _is_number(below[k]) and len(below[k]) < 24 for k in given)
    return text and 2 * sum(_is_number(values[k]) for k in given) > len(given)


def _is_number(cell: str) -> bool:
    """Whether a cell is empty or holds a number, with a decimal comma or point."""
    return _COMMA.fullmatch(cell) is not None or isinstance(numbers_or_text([cell]), np.ndarray)


def _first_lines(content: bytes) -> tuple[list[str], list[int]]:
    """The first three lines that are not blank, and the end of each, in bytes."""
    lines, ends, at = [], [], 0
    while at < len(content) and len(lines) < 3:
        stop = content.find(b"\n", at)
        stop = len(content) if stop < 0 else stop + 1
        if content[at:stop].strip():
            lines.append(_text(content[at:stop]).rstrip("\r\n"))
            ends.append(stop)
        at = stop
    return lines, ends


def _text(content: bytes) -> str:
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _columns(rows: bytes, header: list[str], delimiter: str) -> tuple[dict[str, Column], list[str]]:
    """The columns by name, and a line for everything that was left out or changed."""
    rows, notes = _whole_rows(rows, delimiter.join(header), len(header), delimiter)
    columns: dict[str, Column] = {}
    commas: list[str] = []
    for name, column in zip(header, _parsed(rows, len(header), delimiter), strict=True):
        points = None if isinstance(column, np.ndarray) or delimiter == "," else _with_points(column)
        if points is not None:
            columns[name] = points
            commas.append(name)
            continue
        columns[name], note = (column, []) if isinstance(column, np.ndarray) else _column(name, column)
        notes += note
    columns.pop(_END, None)
    for clean in (_without_infinite, _without_filled_in):
        columns, said = clean(columns)
        notes += said
    if commas:
        notes.append(f"Decimal commas are read as points in {list_of(commas, most=3)}.")
    return columns, notes


def _whole_rows(rows: bytes, header: str, cells: int, delimiter: str) -> tuple[bytes, list[str]]:
    """The rows without an incomplete last one; raises if another row has too few or too many cells."""
    lines = rows.count(b"\n") + (not rows.endswith(b"\n"))
    if b'"' not in rows and b"\n\n" not in rows and rows.count(delimiter.encode()) == lines * (cells - 1):
        return rows, []
    kept = [line for line in rows.splitlines() if line.strip()]
    counts = [len(row) for row in csv.reader(map(_text, kept), delimiter=delimiter, skipinitialspace=True)]
    notes = []
    if len(counts) == len(kept) > 1 and counts[-1] < cells:
        notes.append(f"The last row has {counts[-1]} of {cells} cells and is left out: the file is cut short.")
        del counts[-1], kept[-1]
    if len(counts) == len(kept) and 2 * sum(count > cells for count in counts) > len(counts):
        raise ValueError(
            f"The first line, {header[:60]!r}, was taken as the header, but most rows have more cells: delete the "
            "lines above the header, or begin them with #."
        )
    for number, count in enumerate(counts):
        if count != cells:
            row = next(csv.reader([_text(kept[number])], delimiter=delimiter, skipinitialspace=True))
            no_table = "" if any(map(_is_number, row)) else " Is this file a log, a table of numbers below a header?"
            raise ValueError(
                f"Row {number + 1} below the header has {count} cells, the header has {cells}.{no_table} Correct the "
                f"line{', if it is' * bool(no_table)}."
            )
    return b"\n".join(kept), notes


def _parsed(rows: bytes, cells: int, delimiter: str) -> list[np.ndarray | list[str]]:
    """The columns of rows with a fixed number of cells: numbers, with NaN for an empty cell, or text."""
    import pandas as pd  # not at the top: it takes as long to import as everything else an environment needs

    missing = [form for word in _MISSING for form in {word, word.upper(), word.title()}]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # newer versions always parse to the last digit, and warn about it
        frame = pd.read_csv(
            BytesIO(rows),
            sep=delimiter,
            header=None,
            names=range(cells),
            index_col=False,
            skipinitialspace=True,
            keep_default_na=False,
            na_values=missing,
            float_precision="round_trip",
            low_memory=False,
            encoding="utf-8" if _is_utf8(rows) else "latin-1",
        )
    columns: list[np.ndarray | list[str]] = []
    for _, series in frame.items():
        if series.dtype.kind in "fiub":
            columns.append(series.to_numpy(dtype=float, na_value=np.nan))
        else:
            cell_texts = ["" if cell is None or cell != cell else str(cell) for cell in series.tolist()]
            columns.append(numbers_or_text(cell_texts))
    return columns


def _is_utf8(content: bytes) -> bool:
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _with_points(cells: list[str]) -> np.ndarray | None:
    """The numbers of a column that is mostly written with decimal commas; None if it is not."""
    if sum(_COMMA.fullmatch(cell) is not None for cell in cells) <= 0.5 * len(_filled(cells)):
        return None
    column = numbers_or_text(cell.replace(",", ".") for cell in cells)
    return column if isinstance(column, np.ndarray) else None


def _without_infinite(columns: dict[str, Column]) -> tuple[dict[str, Column], list[str]]:
    """The columns with infinite values as missing; a line for each."""
    result, notes = dict(columns), []
    for name, column in columns.items():
        here = np.isinf(column) if isinstance(column, np.ndarray) else np.zeros(0, dtype=bool)
        if here.any():
            result[name] = np.where(here, np.nan, column)
            counted = f"{int(here.sum()):,} of {here.size:,} cells {'is' if here.sum() == 1 else 'are'} infinite"
            notes.append(f"{name}: {counted} and {'counts' if here.sum() == 1 else 'count'} as missing.")
    return result, notes


def _without_filled_in(columns: dict[str, Column]) -> tuple[dict[str, Column], list[str]]:
    """The columns with placeholders such as -999 as missing, if all other values are far above; a line for each."""
    result, notes = dict(columns), []
    for name, column in columns.items():
        if not isinstance(column, np.ndarray):
            continue
        for mark in _FILLED_IN:
            here = column == mark
            if here.any() and not (column[~here] < 0.5 * mark).any():
                column = result[name] = np.where(here, np.nan, column)
                notes.append(
                    f"{name}: {mark:g} stands for a missing value in {int(here.sum()):,} of {here.size:,} rows."
                )
    return result, notes


def _filled(cells: list[str]) -> list[str]:
    return [cell for cell in cells if cell.strip().lower() not in _MISSING]


def _column(name: str, cells: list[str]) -> tuple[Column, list[str]]:
    """A column in which a few cells that are not numbers count as missing."""
    column = numbers_or_text(cells)
    if isinstance(column, np.ndarray):
        return column, []
    filled = _filled(cells)
    values, odd = np.full(len(cells), np.nan), []
    for row, cell in enumerate(cells):
        try:
            values[row] = _number(cell)
        except ValueError:
            odd.append(row)
            if 2 * len(odd) >= len(filled):
                return column, []
    text = f"{len(odd)} of {len(cells)} cells are not numbers"
    return values, [f"{name}: {text} ({cells[odd[0]]!r} in row {odd[0] + 1}) and count as missing."]
