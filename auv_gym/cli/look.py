"""`auv-gym look`: what a log contains, which vehicles it fits, and what to type next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.after_look import next_command, short
from auv_gym.cli.options.console import output, progress_bar, table
from auv_gym.cli.options.outputs import check_output, is_mapping

if TYPE_CHECKING:
    from auv_gym.cli.options.matching import Matches
    from auv_gym.records.first_look import FirstLook, SignalLook

_HINTED = 3  # vehicles for which columns are named that look like what is missing
_BRIEF = 60.0  # s; any vehicle's log should be longer, see docs/index.md
_MOST = 40  # rows of the table of signals, and lines of what was left out


@app.command(context_settings={"allow_extra_args": True})
def look(
    context: typer.Context,
    log: Annotated[str, typer.Argument(metavar="LOG", help=logs.ANY_LOG)],
    vehicle: Annotated[
        str | None,
        typer.Option(help="A preset or a vehicle file (.toml). Default: compare the log with all presets."),
    ] = None,
    mapping: logs.ColumnNames = None,
    mapping_out: Annotated[
        Path | None, typer.Option(help="Write an editable mapping (.toml) of the log's columns.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the recognised signals over time (.png, .svg or .pdf).")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Show all columns, including unused ones.")] = False,
    cache_dir: logs.CacheFolder = None,
) -> None:
    """Show what a log contains, which channels are recognised, what looks wrong, and which vehicles it fits."""
    from auv_gym.presets import find_vehicle

    if context.args:
        raise ValueError(
            f"look takes one log, got {1 + len(context.args)}: run it for each of them. diagnose takes several."
        )
    if vehicle is not None:
        find_vehicle(vehicle)
    with progress_bar() as progress:
        progress(0.0, "reading the log")
        from auv_gym.cli.options.matching import Matches
        from auv_gym.records.first_look import look_at, mapping_text
        from auv_gym.writing import write_text

        inputs = {"--vehicle": vehicle, "--mapping": mapping, "": log}
        for option, path, kind in (
            ("--mapping-out", mapping_out, ("a mapping", is_mapping)),
            ("--picture", picture, None),
        ):
            if path is not None:
                check_output(option, path, inputs, kind)
        found = look_at(log, mapping, cache_dir)
        progress(0.6, "comparing with vehicles")
        matches = Matches(found, logs.needs_of([vehicle] if vehicle else None))
        if picture is not None:
            from identification.pages.log_picture import draw_log

            progress(0.8, "drawing")
            draw_log(found, picture)
        if mapping_out is not None:
            wanted = [matches.needs[name] for name in matches.best]
            write_text(
                mapping_out, mapping_text(matches.own[matches.best[0]], wanted, matches.turned[matches.ranked[0]])
            )
        progress(1.0, "done")
    found = matches.own[matches.ranked[0]]
    _print_head(found)
    _print_signals(matches, every)
    notes = [*found.notes, *matches.unread(matches.ranked[0])]
    _print_list("Left out, repaired or cut", notes if every else logs.grouped(notes), every)
    refused = matches.refused
    told = [vehicle] if vehicle else list(refused) if all(refused.values()) else []
    wrong = dict.fromkeys(line for name in told for line in _wrong_for(name, matches))
    _print_list("Looks wrong", [*found.doubts, *wrong, *_brief(matches)], True)
    if found.unread:
        output.print("The log is compared with vehicles once it can be read.")
    else:
        _print_vehicles(matches)
    for path in (mapping_out, picture):
        if path is not None:
            output.print(f"Written to {path}", markup=False, soft_wrap=True)
    output.print()
    following = next_command(matches, log, vehicle is not None, mapping, mapping_out)
    output.print(f"Next: {following}", markup=False, soft_wrap=True)


def _brief(matches: Matches) -> Sequence[str]:
    """A line on a log that is very short, but not refused."""
    record = matches.own[matches.best[0]].record
    if record is None or matches.found.sampled is not None or all(matches.refused.values()):
        return ()
    lasts = record.duration_s
    if lasts >= _BRIEF:
        return ()
    return [f"The log is only {_duration(lasts)} long. Below one minute, a diagnosis finds large effects at most."]


def _wrong_for(vehicle: str, matches: Matches) -> Sequence[str]:
    """What is wrong with the log as one of a vehicle, where the whole log was read."""
    record = matches.record_of(vehicle)
    if record is None or matches.found.sampled is not None:
        return ()
    from auv_gym.plant.record_check import wrong_for

    return [*filter(None, [matches.refused.get(vehicle)]), *wrong_for(matches.plants[vehicle], record)]


def _print_head(found: FirstLook) -> None:
    from auv_gym.records.first_look import started

    began = f", from {started(found)}" if started(found) else ""
    extent = f"{found.rows:,} rows" if found.record is None else _duration(found.duration)
    output.print()
    output.print(f"[bold]{escape(found.path.name)}[/]: {escape(found.format)}, {extent}{began}")
    if found.sampled is not None:
        output.print(
            f"The file is large: only its index and the first {found.sampled:,} samples of each signal were read. "
            "Ranges and gaps refer to these samples."
        )
    if found.record is not None:
        record = found.record
        parts = len(record.segments)
        output.print(
            f"As a record: {len(record):,} samples every {short(record.sample_interval)} s in {parts} "
            f"segment{'s' * (parts != 1)}, {_duration(record.duration_s)}{', gaps not counted' * (parts != 1)}."
        )
        if record.attrs.get("derived"):
            output.print(f"Derived: {escape(str(record.attrs['derived']))}.", soft_wrap=True)
    if found.problem:
        what = "missing" if found.problem.startswith(("There is no", "No column")) else "wrong"
        output.print(f"[bold yellow]What is {what}:[/] {escape(found.problem)}", soft_wrap=True)


def _print_signals(matches: Matches, every: bool) -> None:
    from auv_gym.channels import unit_after
    from auv_gym.records.mapping import RULES

    signals, kept = matches.found.signals, matches.kept
    used = sorted((signal for signal in signals if signal.channel), key=lambda signal: signal.channel in kept)
    rest = [signal for signal in signals if not signal.channel]
    shown = table("Signals", "column", "channel!", "rule>", "samples>", "every>", "gaps>", "range")
    rows = [*used, *(rest if every else rest[: max(0, _MOST - len(used))])]
    for signal in rows:
        rule = str(RULES.get(signal.by, 2)) if signal.channel else ""
        shown.add_row(*(escape(cell) for cell in _cells(signal, rule, " *" * (signal.channel in kept))))
    output.print(shown)
    if len(rows) < len(signals):
        output.print(f"{len(signals) - len(rows)} more columns are not shown: use --all.")
    for way in sorted({signal.by for signal in used}, key=lambda way: (RULES.get(way, 2), way)):
        count = sum(signal.by == way for signal in used)
        said = escape(way if way in RULES else f"a shipped mapping, {way}")
        output.print(f"Rule {RULES.get(way, 2)}: {said} ({count} column{'s' * (count != 1)})")
    if matches.found.known is not None and matches.found.known.constants:
        stated = [f"{name} = {value:.6g}{unit_after(name)}" for name, value in matches.found.known.constants.items()]
        output.print(f"Constant, as a mapping or the file states: {', '.join(stated)}", soft_wrap=True)
    if kept:
        whose = next(iter(matches.needs)) if len(matches.needs) == 1 else "any preset"
        output.print(f"* Kept in the record, but not an input or output of {escape(whose)}.")
    output.print()


def _cells(signal: SignalLook, rule: str, mark: str) -> Sequence[str]:
    import numpy as np

    from identification.pages.drawing import shown_values, unit_label

    ends, unit = np.array([signal.low, signal.high]), signal.unit
    if signal.channel:
        ends, unit = shown_values(signal.channel, ends), unit_label(signal.channel)
    unit = "" if unit == "1" else unit
    every = f"{short(signal.interval)} s" if np.isfinite(signal.interval) else ""
    extent = f"{_extent(*ends)} {unit}" if np.isfinite(ends).all() else unit
    gaps = str(signal.gaps) if signal.gaps else ""
    plain = signal.factor == 1.0
    taken = "same name" if plain and signal.channel == signal.column else _multiplied(signal.factor, signal.channel)
    return signal.column, taken + mark, rule, f"{signal.samples:,}", every, gaps, extent.rstrip()


def _multiplied(factor: float, channel: str) -> str:
    """A channel as a mapping writes it, with a minus or another factor."""
    size = "" if abs(factor) == 1.0 else f"{abs(factor):.4g} x "
    return f"{'-' * (factor < 0.0)}{size}{channel}"


def _extent(low: float, high: float) -> str:
    """Two ends with four digits, or with as many more as tell them apart."""
    texts = [(f"{low:.{digits}g}", f"{high:.{digits}g}") for digits in range(4, 9)]
    return " to ".join(next((ends for ends in texts if ends[0] != ends[1]), texts[0]))


def _print_list(title: str, lines: Sequence[str], every: bool) -> None:
    if not lines:
        return
    output.print(f"[bold]{title}[/]")
    for line in lines if every else lines[:_MOST]:
        output.print(f"- {escape(line)}", soft_wrap=True)
    if not every and len(lines) > _MOST:
        output.print(f"- and {len(lines) - _MOST} more: use --all.")
    output.print()


def _print_vehicles(matches: Matches) -> None:
    from auv_gym.records.naming import looks_like

    shown = table("Vehicles, best match first", "vehicle!", "missing channels", "uses>")
    for rank, name in enumerate(matches.ranked):
        missing, turned = matches.missing(name), matches.turned[name]
        hints = f"In another unit: {', '.join(turned)}; --mapping-out converts them. " if turned else ""
        if rank < _HINTED:
            offers = matches.offers[name]
            hints += "".join(looks_like(one, [c for c in offers[one] if c != one]) for one in missing)  # left out above
        words = ". ".join(filter(None, [", ".join(missing) or "none", hints.strip()]))
        count = matches.used(name)
        shown.add_row(escape(name), escape(words), f"{count} channel{'s' * (count != 1)}")
    output.print(shown)


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
