"""The time of the rows of a table, from the mapping, a column's name, or a column's content."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, time

import numpy as np

from auv_gym.channels import conversion
from auv_gym.records.log import Column, Group, Log, Untimed
from auv_gym.records.mapping import DATED, TIMES, Names, Target, fitting_mappings, list_of
from auv_gym.records.naming import looks_like

_CLOCKS = frozenset(
    {"time", "timestamp", "t", "seconds", "secs", "sec", "elapsed", "epoch", "unix", "unixtime", "datenum"}
)
_DATES = frozenset({"date", "date_utc", "utc_date"})  # names of columns beside one with the time of day
_STAMPED = frozenset({"time", "date", "datetime", "timestamp", "stamp", "utc", "gmt", "zulu", "clock"})
_SUFFIXES = {  # units of numeric times, s: timestamp_ms, Time [us] and the like
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "µs": 1e-6, "d": 86400.0, "days": 86400.0,
}  # fmt: skip
_DAY = 86400.0  # s
# numeric days: lowest and highest count of this century and the last, that of 1970, and who uses them
_DAYS = ((6.9e5, 7.7e5, 719529.0, "MATLAB"), (2e4, 7.4e4, 25569.0, "spreadsheets"))
_WITH_MONTH, _WITH_SLASHES = re.compile(r"\d{1,2}-[A-Za-z]{3}-\d{4} "), re.compile(r"\d{4}/\d{2}/\d{2}\b")
_DAY_OR_MONTH = re.compile(r"\s*\d{1,2}([./-])\d{1,2}\1\d{2,4}\b")  # first, as in 10/03/2024
YEAR_FIRST = "Write them with the year first, as in 2024-03-10T08:00:00."
ONE_ZONE = "Write all of them with their zone, or all without."
_QUICK = 1e-3  # between rows: too fast for seconds of any vehicle's log; in days, a minute and a half
_SECONDS = Target("time_s")
_EPOCHS = ((1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds"))


@dataclass(frozen=True, eq=False)
class Clock:
    """The column of a table that holds time.  times: s, (n,).  target: how a mapping converts the column's numbers.

    dates: the column of the dates of these times of day, if there is one.
    """

    column: str
    times: np.ndarray
    target: Target = _SECONDS
    dates: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that hold the time."""
        return (self.column, self.dates) if self.dates else (self.column,)


def clocks_of(log: Log, names: Names, notes: list[str]) -> dict[str, Clock]:
    """The clock of each group that comes without times.

    A group without a time is left out with a note; raises if no group has one.
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


def _clock(group: Group, names: Names, log: Log, notes: list[str]) -> Clock:
    """The column of a table that holds time, by the mapping, by its name, or by its content."""
    columns = group.columns
    stated = [theirs for theirs, target in names.targets.items() if theirs in columns and target.name in TIMES]
    if len(stated) > 1:
        raise ValueError(f"Two columns come in as 'time_s', {list_of(stated)}: map one of them to ''.")
    for mapping in (names, *fitting_mappings(log)):
        for theirs, target in mapping.targets.items():
            if theirs in columns and target.name in TIMES:
                return _as_clock(theirs, columns, target, notes)
    for name, column in columns.items():
        field = name.rpartition(".")[2]  # of a structure
        unit = _in_unit(group.units.get(name))
        if field in TIMES or (_plain(field) in DATED and (isinstance(column, list) or unit)):
            return _as_clock(name, columns, unit or Target(field if field in TIMES else "time_s"), notes)
    for name, column in columns.items():
        if isinstance(column, list) and _STAMPED & set(_plain(name).split("_")) and _are_stamps(column):
            return _as_clock(name, columns, _SECONDS, notes)
    words_first = sorted(columns.items(), key=lambda item: len(item[0]) == 1)  # a one-letter symbol only without a word
    for name, column in words_first:
        bare = re.split(r"[\s\[(]", name.strip().lower())[0].rpartition(".")[2]
        stem, _, suffix = bare.rpartition("_")
        own = suffix if stem in _CLOCKS and suffix in _SUFFIXES else ""
        if (bare in _CLOCKS or own) and isinstance(column, np.ndarray) and _mostly_rises(column):
            target, unit = _counted(bare, column, group.units.get(name) or own)
            notes.append(f"{name}: taken as the time, in {unit}.")
            return _as_clock(name, columns, target, notes)
    for name, column in columns.items():
        _check_order(name, next(filter(str.strip, column), "") if isinstance(column, list) else "")
    raise Untimed(
        "There is no column time_s (s; also time_ms, time_min, time_h, or dates in a column time); the columns are "
        f"{list_of(columns)}. {looks_like('time_s', columns)}"
        'Rename the one that holds time, or map it, as in "Time" = "time_s".'
    )


def _as_clock(name: str, columns: Mapping[str, Column], target: Target, notes: list[str]) -> Clock:
    """A column that holds time: text as dates or times of day, numbers as the target says."""
    column = columns[name]
    if isinstance(column, list):
        times = _of_day(column)
        if times is None:
            return Clock(name, _stamps(name, column))
        dates = next((d for d, of in columns.items() if _plain(d) in _DATES and isinstance(of, list)), "")
        return Clock(name, _with_dates(times, columns, notes, name, dates), dates=dates)
    return Clock(name, target.channel_and_values(column.astype(float))[1], target)


def _plain(name: str) -> str:
    """The words of a column's name in lower case: `time_utc` for `Time (UTC)`."""
    return "_".join(re.findall(r"[a-z0-9]+", name.lower()))


def _are_stamps(cells: list[str]) -> bool:
    """Whether text holds times of day or dates with times, judged by its first cell."""
    first = next(filter(str.strip, cells), "").strip()
    try:
        return ":" in first and (_of_day([first]) is not None or _moment(first) is not None)
    except ValueError:
        return False


def _mostly_rises(column: np.ndarray) -> bool:
    known = column[np.isfinite(column)]
    return known.size > 1 and float(np.mean(np.diff(known) > 0.0)) > 0.5


def _in_unit(unit: str | None) -> Target | None:
    """The target for numeric times in a unit; None if the unit is not a known unit of time."""
    factor = _SUFFIXES.get(unit or "")
    if unit and factor is None:
        try:
            factor = float(conversion("time", unit).convert(np.ones(1))[0])
        except ValueError:
            return None
    if factor is None:
        return None
    return next((Target(name) for name in TIMES if _SUFFIXES[name[5:]] == factor), Target("time_s", factor))


def _counted(called: str, column: np.ndarray, unit: str) -> tuple[Target, str]:
    """The target for numeric times, and their unit: the stated one; if none, by their size; otherwise seconds.

    Counts of days, as used by MATLAB and spreadsheets, are recognised by their size together with their name or a row
    spacing too close for seconds.
    """
    if target := _in_unit(unit):
        return target, unit
    largest, least = float(np.nanmax(np.abs(column))), float(np.nanmin(column))
    for low, high, since, whose in _DAYS:
        quick = called == "datenum" or float(np.nanmedian(np.abs(np.diff(column)))) < _QUICK
        if low < least and largest < high and quick:
            return Target("time_s", _DAY, -_DAY * since), f"days as counted by {whose}"
    factor, words = next(((f, words) for least, f, words in _EPOCHS if largest > least), (1.0, "seconds"))
    return Target("time_ms") if factor == 1e-3 else Target("time_s", factor), words


def _moment(cell: str) -> datetime:
    """A date in ISO 8601 (slashes allowed) or in MATLAB's form, 31-May-2024 12:00:00; raises ValueError."""
    if _WITH_MONTH.match(cell):
        return datetime.strptime(cell, "%d-%b-%Y %H:%M:%S.%f" if "." in cell else "%d-%b-%Y %H:%M:%S")
    return datetime.fromisoformat(cell.replace("/", "-") if _WITH_SLASHES.match(cell) else cell)


def _check_order(name: str, cell: str) -> None:
    """Raise ValueError if a cell is a date that begins with a day or a month."""
    if _DAY_OR_MONTH.match(cell):
        raise ValueError(
            f"Column {name!r} has dates such as {cell.strip()!r}, and which number is the day and which the month is "
            f"not known. {YEAR_FIRST}"
        )


def _of_day(cells: list[str]) -> np.ndarray | None:
    """Seconds since midnight for cells such as 13:05:20.5, NaN if empty; None if they hold something else."""
    seconds = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if cell.strip():
            try:
                moment = time.fromisoformat(cell.strip())
            except ValueError:
                return None
            seconds[row] = 3600.0 * moment.hour + 60.0 * moment.minute + moment.second + 1e-6 * moment.microsecond
    return seconds if np.isfinite(seconds).any() else None


def _with_dates(
    times: np.ndarray, columns: Mapping[str, Column], notes: list[str], name: str, dates: str
) -> np.ndarray:
    """Times of day as s since 1970 if there is a column of dates, else since the first midnight, across later ones."""
    column = columns.get(dates)
    if isinstance(column, list):
        return _stamps(dates, column) + times
    known = np.flatnonzero(np.isfinite(times))
    midnights = np.r_[0, np.cumsum(np.diff(times[known]) < -0.5 * _DAY)]
    notes.append(f"{name}: taken as the time of day, without a date.")
    result = times.copy()
    result[known] += _DAY * midnights
    return result


def _stamps(name: str, cells: list[str]) -> np.ndarray:
    """Dates as s since 1970, NaN if empty; UTC if they do not state a zone."""
    seconds = np.full(len(cells), np.nan)
    first: dict[bool, str] = {}  # the first cell that states a zone, and the first that does not
    for row, cell in enumerate(cells):
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
        first.setdefault(moment.tzinfo is not None, cell.strip())
        seconds[row] = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if len(first) == 2:
        raise ValueError(
            f"Column {name!r} has times with a zone, such as {first[True]!r}, and without one, such as "
            f"{first[False]!r}. {ONE_ZONE}"
        )
    return seconds
