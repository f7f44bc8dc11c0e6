"""The time of the rows of a table: by the mapping, by a column's name, or by what a column holds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, time

import numpy as np

from auv_gym.channels import conversion
from auv_gym.records.log import Column, Group, Log
from auv_gym.records.mapping import DATED, TIMES, Names, fitting_mappings, list_of
from auv_gym.records.naming import looks_like

_CLOCKS = frozenset(
    {"time", "timestamp", "t", "seconds", "secs", "sec", "elapsed", "epoch", "unix", "unixtime", "datenum"}
)
_SUFFIXES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}  # timestamp_ms and the like
_DAY = 86400.0  # s
# of counts of days: the least and the largest of this century and the last, that of 1970, and whose they are
_DAYS = ((6.9e5, 7.7e5, 719529.0, "MATLAB"), (2e4, 7.4e4, 25569.0, "spreadsheets"))
_WITH_MONTH, _WITH_SLASHES = re.compile(r"\d{1,2}-[A-Za-z]{3}-\d{4} "), re.compile(r"\d{4}/\d{2}/\d{2}\b")
_DAY_OR_MONTH = re.compile(r"\s*\d{1,2}([./-])\d{1,2}\1\d{2,4}\b")  # first, as in 10/03/2024
YEAR_FIRST = "Write them with the year first, as in 2024-03-10T08:00:00."
_QUICK = 1e-3  # between rows: as seconds no vehicle is sampled so fast, as days a minute and a half
_EPOCHS = ((1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds"))


def clocks_of(log: Log, names: Names, notes: list[str]) -> dict[str, tuple[str, np.ndarray]]:
    """The column that holds time and the times, s, of each group that does not come with them.

    A group without a time is left out with a note; raises where no group has one.
    """
    found, problems = {}, []
    for group in log.groups:
        if group.time is None:
            try:
                found[group.name] = _clock(group, names, log, notes)
            except ValueError as error:
                problems.append((group.name, error))
    if problems and not found and all(group.time is None for group in log.groups):
        raise problems[0][1]
    notes += [f"{name}: left out, since nothing along it holds time." for name, _ in problems]
    return found


def _clock(group: Group, names: Names, log: Log, notes: list[str]) -> tuple[str, np.ndarray]:
    """The column of a table that holds time, and the times, s: by the mapping, by its name, or by what it holds."""
    columns = group.columns
    stated = [theirs for theirs, target in names.targets.items() if theirs in columns and target.name in TIMES]
    if len(stated) > 1:
        raise ValueError(f"Two columns come in as 'time_s', {list_of(stated)}: map one of them to ''.")
    for mapping in (names, *fitting_mappings(log)):
        for theirs, target in mapping.targets.items():
            if theirs in columns and target.name in TIMES:
                return theirs, _seconds(theirs, columns[theirs], target.name)
    for name, column in columns.items():
        field = name.rpartition(".")[2]  # of a structure
        dated = field.lower().replace(" ", "_") in DATED and (isinstance(column, list) or name in group.units)
        if dated and isinstance(column, list) and (times := _of_day(column)) is not None:
            return name, _with_dates(times, columns, notes, name)
        if dated or field in TIMES:
            return name, _seconds(name, column, field, group.units.get(name))
    for name, column in columns.items():
        bare = re.split(r"[\s\[(]", name.strip().lower())[0].rpartition(".")[2]
        stem, _, suffix = bare.rpartition("_")
        own = suffix if stem in _CLOCKS and suffix in _SUFFIXES else ""
        if (bare in _CLOCKS or own) and isinstance(column, np.ndarray) and _mostly_rises(column):
            stated = group.units.get(name)
            seconds, unit = (
                (_SUFFIXES[own] * column, own) if own and not stated else _scaled_epoch(bare, column, stated)
            )
            notes.append(f"{name}: taken as the time, in {unit}.")
            return name, seconds
    for name, column in columns.items():
        _check_order(name, next(filter(str.strip, column), "") if isinstance(column, list) else "")
    raise ValueError(
        "There is no column time_s (s; also time_ms, time_min, time_h, or dates in a column time); the columns are "
        f"{list_of(columns)}. {looks_like('time_s', columns)}"
        'Rename the one that holds time, or map it, as in "Time" = "time_s".'
    )


def _mostly_rises(column: np.ndarray) -> bool:
    known = column[np.isfinite(column)]
    return known.size > 1 and float(np.mean(np.diff(known) > 0.0)) > 0.5


def _scaled_epoch(called: str, column: np.ndarray, unit: str | None) -> tuple[np.ndarray, str]:
    """Times in s: in the unit that the file states, else by their size, for counts since 1970; else taken as s.

    Counts of days, as MATLAB and spreadsheets have them, are told by their size, and by their name or by rows that are
    closer than any in seconds.
    """
    if unit:
        try:
            return conversion("time", unit).convert(column), unit
        except ValueError:
            pass
    largest, least = float(np.nanmax(np.abs(column))), float(np.nanmin(column))
    for low, high, since, whose in _DAYS:
        quick = called == "datenum" or float(np.nanmedian(np.abs(np.diff(column)))) < _QUICK
        if low < least and largest < high and quick:
            return _DAY * (column - since), f"days as counted by {whose}"
    factor, words = next(((f, words) for least, f, words in _EPOCHS if largest > least), (1.0, "seconds"))
    return factor * column, words


def _moment(cell: str) -> datetime:
    """A date, of ISO 8601 also with slashes, or as MATLAB writes it, 31-May-2024 12:00:00; raises ValueError."""
    if _WITH_MONTH.match(cell):
        return datetime.strptime(cell, "%d-%b-%Y %H:%M:%S.%f" if "." in cell else "%d-%b-%Y %H:%M:%S")
    return datetime.fromisoformat(cell.replace("/", "-") if _WITH_SLASHES.match(cell) else cell)


def _check_order(name: str, cell: str) -> None:
    """Raises ValueError if a cell is a date that begins with a day or a month."""
    if _DAY_OR_MONTH.match(cell):
        raise ValueError(
            f"Column {name!r} has dates such as {cell.strip()!r}, and which number is the day and which the month is "
            f"not known. {YEAR_FIRST}"
        )


def _of_day(cells: list[str]) -> np.ndarray | None:
    """Seconds since midnight of cells such as 13:05:20.5, NaN where empty; None if they are something else."""
    seconds = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if cell.strip():
            try:
                moment = time.fromisoformat(cell.strip())
            except ValueError:
                return None
            seconds[row] = 3600.0 * moment.hour + 60.0 * moment.minute + moment.second + 1e-6 * moment.microsecond
    return seconds if np.isfinite(seconds).any() else None


def _with_dates(times: np.ndarray, columns: Mapping[str, Column], notes: list[str], name: str) -> np.ndarray:
    """Times of day in s since 1970 by a column of dates, else since the first midnight, on through the next ones."""
    dates = next((column for other, column in columns.items() if other.strip().lower() == "date"), None)
    if isinstance(dates, list):
        return _seconds("date", dates, "time") + times
    known = np.flatnonzero(np.isfinite(times))
    midnights = np.r_[0, np.cumsum(np.diff(times[known]) < -0.5 * _DAY)]
    notes.append(f"{name}: taken as the time of day, without a date.")
    result = times.copy()
    result[known] += _DAY * midnights
    return result


def _seconds(name: str, column: Column, target: str, unit: str | None = None) -> np.ndarray:
    """Time in s; dates count from 1970, and are UTC where they do not say."""
    if isinstance(column, np.ndarray):
        return conversion(target, unit).convert(column.astype(float))
    seconds = np.full(len(column), np.nan)
    for row, cell in enumerate(column):
        if not cell.strip():
            continue
        try:
            moment = _moment(cell.strip())
        except ValueError as error:
            _check_order(name, cell)
            raise ValueError(
                f"Column {name!r} needs numbers or dates such as 2024-05-31T12:00:00, got {cell!r} at row {row + 1} "
                "below the header: correct the cell or leave it empty."
            ) from error
        seconds[row] = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return seconds
