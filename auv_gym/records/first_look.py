"""A first look at a log: its content, recognised signals, suspicions, and a mapping to edit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np

from auv_gym.channels import CHANNELS, SEGMENT_COLUMNS, conversion, in_unit, known_suffixes
from auv_gym.records.completing import SOURCES
from auv_gym.records.formats import format_of
from auv_gym.records.log import Column, Empty, Group, Log, Scope, Untimed
from auv_gym.records.mapping import YOURS, Source, Target, guessed, is_known, load_mapping
from auv_gym.records.naming import candidates
from auv_gym.records.reading import assembled, command_for, find_log, open_log
from auv_gym.records.record import Record
from auv_gym.records.suspicions import suspicions
from auv_gym.records.time_axis import gap_limit
from auv_gym.records.understanding import Needs, Understood, understood

WHOLE = 8e6  # bytes; a file in a slow format is read whole below this size, and by its index and a sample above it
SAMPLE = 2000  # samples of each signal, if a file is too large to read completely


@dataclass(frozen=True)
class SignalLook:
    """The content of one column.

    channel: the channel that it becomes, '' if it is left out.  unit: of low and high.  samples: number with a value.
    interval: median time between them, s.  gaps: number of intervals that are gaps, see `time_axis.gap_limit`.
    by: how it was recognised.  factor: by which a mapping multiplies it, beside the conversion of its unit.
    """

    column: str
    channel: str
    unit: str
    samples: int
    interval: float
    gaps: int
    low: float
    high: float
    by: str
    factor: float = 1.0


@dataclass(frozen=True, eq=False)
class FirstLook:
    """The result of a first look at a log.

    rows: of the largest group.  start: s since 1970, if known.  sampled: samples read of each signal, None for all.
    notes: what was left out or mended.  doubts: what looks wrong, and what to do.
    record: the record that a vehicle would get; None if nothing was recognised; `problem` then says why.
    empty: whether no column has a value.  untimed: whether it has no time, or the same one in all rows.
    """

    path: Path
    format: str
    duration: float
    rows: int
    start: float | None
    sampled: int | None
    signals: tuple[SignalLook, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    known: Understood | None
    record: Record | None
    log: Log
    problem: str = ""
    empty: bool = False
    untimed: bool = False

    @property
    def unread(self) -> bool:
        """Whether it has columns for a record that could not be read, such as those without a time or a value."""
        known = self.known is not None and not self.known.by_channel and not self.empty
        return self.record is None and not self.is_profile and not known

    @property
    def channels(self) -> set[str]:
        """The channels that a record of the log has."""
        return set() if self.record is None else set(self.record.names)

    def for_needs(self, needs: Needs) -> FirstLook:
        """The look with the record that a vehicle gets: a channel that it requires costs the samples without it."""
        if self.known is None or self.record is None:
            return self
        logged = {name for stream in self.known.streams for name in stream.values}
        required = [name for name in needs.required if self.record.has(name) or name in logged]
        if all(map(self.record.has, required)):
            return self
        try:
            record = assembled(self.known, Needs(tuple(required)))
        except ValueError:  # it has no value where the others have one
            return self
        kept = [line for line in self.notes if line not in self.record.notes]
        return replace(self, record=record, notes=tuple(dict.fromkeys([*kept, *record.notes])))

    def as_read(self, needs: Needs) -> Record | None:
        """The record that a vehicle reads; None if it cannot, as where a channel is in another unit."""
        try:
            return None if self.known is None else assembled(self.known, needs)
        except ValueError:
            return None

    def uses(self, needs: Needs) -> set[str]:
        """The channels that a vehicle takes from the log, and those from which they are derived."""
        wanted = {*needs.required, *needs.wanted}
        measured = set(self.known.by_channel) if self.known else set()
        sources = {source for name, others in SOURCES.items() if name in wanted - measured for source in others}
        commands = {command_for(name) for name in set(needs.required) - measured}
        return (self.channels | measured) & (wanted | sources | commands)

    def offers(self, channel: str, needs: Needs) -> dict[str, Target]:
        """The columns that may be a channel that a vehicle is missing, the likeliest first, with their targets.

        Columns that the user's mapping names, that the vehicle uses, or that measure a motion are not offered.
        """
        uses = {*needs.required, *needs.wanted}
        taken = {
            signal.column
            for signal in self.signals
            if signal.by == YOURS
            or (signal.channel in CHANNELS and (signal.channel in uses or not _may_be(signal.channel, channel)))
        }
        clocks = {column for clock in self.known.clocks.values() for column in clock.columns} if self.known else set()
        columns = [column for column in self.log.by_name if column not in taken | clocks]
        found = candidates(channel, columns, len(columns))
        targets = {column: guessed(self.log.by_name[column], column, channel) for column in found}
        return {column: target for column, target in targets.items() if target is not None}

    @property
    def is_profile(self) -> bool:
        """Whether it is a table without times that holds the water's density over depth."""
        columns = {name for group in self.log.groups if group.time is None for name in group.columns}
        have = {conversion(name).channel.name for name in columns if is_known(name, None)}
        timeless = self.known is None and not candidates("time_s", columns)
        return timeless and "density_kgpm3" in have and bool(have & {"depth_m", "pressure_dbar"})

    def missing(self, needs: Needs) -> list[str]:
        """The channels that a vehicle still needs; a command can replace an input that was not measured."""
        have = self.channels
        return [name for name in needs.required if name not in have and command_for(name) not in have]


def _may_be(taken: str, wanted: str) -> bool:
    """Whether a column taken as one channel may be another: not if it is a measured motion or a set point."""
    return CHANNELS[taken].kind in ("input", "auxiliary") and "_cmd" not in wanted


def look_at(log: str | Path, mapping: object = None, beside: Path | None = None) -> FirstLook:
    """The content of a log; raises ValueError if it cannot be read at all, or if the mapping does not fit it.

    A file of more than 8 MB in a slow format is examined by its index and the first samples of each signal.
    """
    path = find_log(log)
    names = load_mapping(cast("Any", mapping))
    large = format_of(path).slow and _size(path) > WHOLE
    content = open_log(path, Scope(most=SAMPLE if large else None, beside=beside))
    known, record, problem, why = None, None, "", None
    try:
        known = understood(content, names, Needs())
        record = assembled(known, Needs())
    except ValueError as error:
        problem, why = str(error), error
    times = [_span(group, known) for group in content.groups]
    spans = [span for span in times if span is not None]
    duration = max((b for _, b in spans), default=0.0) - min((a for a, _ in spans), default=0.0)
    if known is not None and record is not None and any(stream.labels is not None for stream in known.streams):
        duration = record.duration_s  # each segment has its own clock
    notes = [*(known.notes if known else content.notes), *(record.notes if record else [])]
    return FirstLook(
        path=path,
        format=content.format,
        duration=duration,
        rows=max((group.rows for group in content.groups), default=0),
        start=None if known is None else known.epoch,
        sampled=SAMPLE if large else None,
        signals=tuple(_signals(content, known)),
        notes=tuple(dict.fromkeys(notes)),
        doubts=tuple(suspicions(known, record)) if known is not None else (),
        known=known,
        record=record,
        problem=problem,
        empty=isinstance(why, Empty),
        untimed=isinstance(why, Untimed),
        log=content,
    )


def started(look: FirstLook) -> str:
    """The time at which the log began, as text; '' if unknown."""
    if look.start is None:
        return ""
    try:
        return datetime.fromtimestamp(look.start, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (OverflowError, ValueError, OSError):
        return ""


def mapping_text(look: FirstLook, needs: Sequence[Needs] = (), turned: Mapping[str, Target] | None = None) -> str:
    """A mapping in TOML to edit: what was recognised, what was guessed, and what is left out.

    turned: targets of channels that a vehicle takes under another name or in another unit.
    """
    lines = [
        f"# Mapping of {look.path.name} ({look.format}).",
        "# Column of the log = channel; the channel's name ends in the unit of the column.",
        '# A minus changes the sign, "" leaves a column out; { to = "depth_m", factor = 0.1, offset = -10.0 } scales',
        "# and shifts; a number is the value of a channel that was constant and not logged.",
        "",
    ]
    known = {target.name for target in (turned or {}).values()}
    guesses: dict[str, Target] = {}
    for one in needs:
        others = [name for name in one.wanted if name not in look.channels and name not in one.required]
        for wanted in (*look.missing(one), *others):
            offers = look.offers(wanted, one) if wanted not in known else {}
            column = next((column for column in offers if column not in guesses), None)
            if column is not None:
                guesses[column] = offers[column]
                known.add(wanted)
    used = set(guesses)  # each column has only one line; otherwise the file would not be valid TOML

    def add(column: str, target: str) -> None:
        if column not in used:
            used.add(column)
            lines.append(f"{_quoted(column)} = {target}")

    if look.known is not None:
        for clock in look.known.clocks.values():
            add(clock.column, _in_toml(clock.target))
            used |= {*clock.columns}
        for name, sources in look.known.by_channel.items():
            for number, source in enumerate(sources):
                add(source.column, _target(source, (turned or {}).get(name)) if number == 0 else _quoted(""))
        lines += [f"{name} = {value!r}" for name, value in look.known.constants.items()]
    columns = dict.fromkeys(name for group in look.log.groups for name in group.columns)
    if guesses:
        lines += ["", "# Guessed from their names: check unit and sign, then remove the # in front."]
        lines += [f"# {_quoted(column)} = {_in_toml(target)}" for column, target in guesses.items()]
    rest = [name for name in columns if name not in used and name not in SEGMENT_COLUMNS]
    if rest:
        lines += ["", "# Not recognised: write a channel, and remove the # in front."]
        lines += [f'# {_quoted(name)} = ""' for name in rest]
    return "\n".join([*lines, ""])


def corrected(source: Source, channel: str, factor: float = 1.0, offset: float = 0.0) -> str:
    """The line of a mapping that turns a column into factor times its present channel's values plus an offset.

    factor, offset: in SI.  channel: of the same quantity, for example if two columns are exchanged.
    """
    target = source.target
    size = _scale(target.name, source.unit)
    whole, shift = factor * target.factor * size, factor * target.offset * size + offset
    own = in_unit(target.name, source.unit).rpartition("_")[2]
    names = [f"{channel.rpartition('_')[0]}_{suffix}" for suffix in (own, *known_suffixes())]
    names = [name for name in names if is_known(name, None) and conversion(name).channel.name == channel]
    plain = next((name for name in names if np.isclose(_scale(name), abs(whole), rtol=1e-9)), None)
    if plain is not None and shift == 0.0:
        return f"{_quoted(source.column)} = {_quoted('-' * (whole < 0.0) + plain)}"
    name = names[0] if names else channel
    unit = _scale(name)
    return (
        f'{_quoted(source.column)} = {{ to = "{name}", factor = {float(f"{whole / unit:.12g}")!r}, '
        f"offset = {float(f'{shift / unit:.12g}')!r} }}"
    )


def _scale(name: str, unit: str | None = None) -> float:
    """The size of a column's unit in SI."""
    return float(np.diff(conversion(name, unit).convert(np.array([0.0, 1.0])))[0])


def _target(source: Source, turned: Target | None) -> str:
    target = replace(source.target, name=in_unit(source.target.name, source.unit))
    if turned is not None:
        factor, offset = turned.factor * target.factor, turned.factor * target.offset + turned.offset
        target = Target(turned.name, factor, offset)
    return _in_toml(target)


def _in_toml(target: Target) -> str:
    if target.offset == 0.0 and target.factor in (1.0, -1.0):
        return _quoted(f"{'-' if target.factor < 0 else ''}{target.name}")
    offset = f", offset = {target.offset!r}" if target.offset else ""
    return f'{{ to = "{target.name}", factor = {target.factor!r}{offset} }}'


def _quoted(text: str) -> str:
    escaped = "".join(
        c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" if ord(c) < 65536 else "?" for c in text
    )
    return f'"{escaped}"'


def _signals(log: Log, known: Understood | None) -> list[SignalLook]:
    taken: dict[str, tuple[Source, bool]] = {}
    for sources in known.by_channel.values() if known else ():
        for number, source in enumerate(sources):
            taken[source.column] = (source, number == 0)
    found = []
    for group in log.groups:
        sampling = _sampling(_times(group, known))
        for name, column in group.columns.items():
            if known is not None and any(name in clock.columns for clock in known.clocks.values()):
                continue
            source, used = taken.get(name, (None, False))
            found.append(_signal(group, name, column, sampling, source if used else None))
    return found


def _sampling(time: np.ndarray | None) -> Callable[[np.ndarray], tuple[float, int]]:
    """A function that maps the rows with a value to their median interval, s, and the number of gaps."""

    def of(there: np.ndarray) -> tuple[float, int]:
        if time is None or there.sum() < 3:
            return np.nan, 0
        steps = np.diff(time[there & np.isfinite(time)])
        steps = steps[steps > 0.0]  # a step back is a late row, or the start of another segment
        return (float(np.median(steps)), int(np.sum(steps > gap_limit(steps)))) if steps.size else (np.nan, 0)

    whole: list[tuple[float, int]] = []  # cache for columns with a value in every row, which most have

    def remembered(there: np.ndarray) -> tuple[float, int]:
        if not there.all():
            return of(there)
        if not whole:
            whole.append(of(there))
        return whole[0]

    return remembered


def _signal(
    group: Group, name: str, column: Column, sampling: Callable[[np.ndarray], tuple[float, int]], source: Source | None
) -> SignalLook:
    if isinstance(column, list):
        return SignalLook(name, "", "text", sum(bool(cell.strip()) for cell in column), np.nan, 0, np.nan, np.nan, "")
    values, unit, of, by, factor = column.astype(float), group.units.get(name, ""), "", "", 1.0
    if source is not None:
        target, values = source.target.channel_and_values(values, source.unit)
        of, unit = target.name, target.unit
        by, factor = source.by, source.target.factor
    there = np.isfinite(values)
    interval, gaps = sampling(there)
    low, high = (float(np.min(values[there])), float(np.max(values[there]))) if there.any() else (np.nan, np.nan)
    samples = int(there.sum()) if group.rows <= there.size else round(group.rows * float(there.mean()))
    return SignalLook(name, of, unit, samples, interval, gaps, low, high, by, factor)


def _times(group: Group, known: Understood | None) -> np.ndarray | None:
    if group.time is not None:
        return np.asarray(group.time, dtype=float)
    if known is not None:
        return next((stream.time for stream in known.streams if stream.name == group.name), None)
    return None


def _span(group: Group, known: Understood | None) -> tuple[float, float] | None:
    if group.span is not None:
        return group.span
    time = _times(group, known)
    if time is None or not np.isfinite(time).any():
        return None
    return float(np.nanmin(time)), float(np.nanmax(time))


def _size(path: Path) -> int:
    return (
        path.stat().st_size
        if path.is_file()
        else sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    )
