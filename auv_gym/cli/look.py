"""`auv-gym look`: what a log contains, which vehicles it fits, and what to type next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar, table

if TYPE_CHECKING:
    from auv_gym.records.first_look import FirstLook, SignalLook
    from auv_gym.records.mapping import Target
    from auv_gym.records.reading import Needs

_MANY_SAMPLES = 6000
_HINTED = 3  # vehicles for which columns are named that look like what is missing
_MOST = 40  # rows of the table of signals, and lines of what was left out


@app.command()
def look(
    log: Annotated[str, typer.Argument(help=logs.ANY_LOG)],
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

    if vehicle is not None:
        find_vehicle(vehicle)
    with progress_bar() as progress:
        progress(0.0, "reading the log")
        from auv_gym.records.first_look import look_at, mapping_text
        from auv_gym.writing import writable_folder, write_text

        for path in (mapping_out, picture):
            if path is not None:
                writable_folder(path.parent)
        found = look_at(log, mapping, cache_dir)
        progress(0.6, "comparing with vehicles")
        needs = logs.needs_of([vehicle] if vehicle else None)
        if picture is not None:
            from identification.pages.log_picture import draw_log

            progress(0.8, "drawing")
            draw_log(found, picture)
        if mapping_out is not None:
            best = _ranked(found, needs)[0]
            write_text(mapping_out, mapping_text(found, [needs[best]], _turned(best, found)))
        progress(1.0, "done")
    _print_head(found)
    _print_signals(found, every)
    _print_list("Left out, repaired or cut", found.notes if every else logs.grouped(found.notes), every)
    refused = _refused(found, needs)
    told = [vehicle] if vehicle else list(refused) if all(refused.values()) else []
    wrong = dict.fromkeys(line for name in told for line in _wrong_for(name, found))
    _print_list("Looks wrong", [*found.doubts, *wrong], True)
    _print_vehicles(found, needs)
    for path in (mapping_out, picture):
        if path is not None:
            output.print(f"Written to {path}", markup=False, soft_wrap=True)
    output.print()
    output.print(
        f"Next: {_next_command(found, needs, refused, log, mapping, mapping_out)}", markup=False, soft_wrap=True
    )


def _wrong_for(vehicle: str, found: FirstLook) -> Sequence[str]:
    """What is wrong with the log as one of a vehicle, where the whole log was read."""
    if found.record is None or found.sampled is not None:
        return ()
    from auv_gym.plant import load_vehicle
    from auv_gym.plant.record_check import wrong_for

    return wrong_for(load_vehicle(vehicle), found.record)


def _refused(found: FirstLook, needs: Mapping[str, Needs]) -> dict[str, str]:
    """Why a diagnosis with each of the vehicles that match best would refuse the log, '' where it would not."""
    alike = _as_good(found, needs)
    if found.record is None or found.missing(needs[alike[0]]):
        return {}
    if found.sampled is not None:
        return dict.fromkeys(alike, "")
    from auv_gym.plant import load_vehicle
    from auv_gym.plant.record_check import refusal

    return {name: refusal(load_vehicle(name), found.record) for name in alike}


def _turned(vehicle: str, found: FirstLook) -> dict[str, Target]:
    """What becomes of the log's commands of thrusters that a vehicle takes in another unit, by channel."""
    from auv_gym.plant import load_vehicle
    from auv_gym.plant.record_check import convertible_commands

    return convertible_commands(load_vehicle(vehicle), found.channels)


def _print_head(found: FirstLook) -> None:
    from auv_gym.records.first_look import started

    began = f", from {started(found)}" if started(found) else ""
    output.print()
    output.print(f"[bold]{escape(found.path.name)}[/]: {escape(found.format)}, {_duration(found.duration)}{began}")
    if found.sampled is not None:
        output.print(
            f"The file is large: only its index and the first {found.sampled:,} samples of each signal were read. "
            "Ranges and gaps refer to these samples."
        )
    if found.record is not None:
        record = found.record
        parts = len(record.segments)
        output.print(
            f"As a record: {len(record):,} samples every {_short(record.sample_interval)} s in {parts} "
            f"segment{'s' * (parts != 1)}, {_duration(record.duration_s)} without gaps."
        )
        if record.attrs.get("derived"):
            output.print(f"Derived: {escape(str(record.attrs['derived']))}.", soft_wrap=True)
    if found.problem:
        output.print(f"[bold yellow]The log cannot be read as a record yet:[/] {escape(found.problem)}", soft_wrap=True)


def _print_signals(found: FirstLook, every: bool) -> None:
    used = [signal for signal in found.signals if signal.channel]
    rest = [signal for signal in found.signals if not signal.channel]
    ways = list(dict.fromkeys(signal.by for signal in used))
    shown = table("Signals", "column", "channel!", "rule>", "samples>", "every>", "gaps>", "range")
    rows = [*used, *(rest if every else rest[: max(0, _MOST - len(used))])]
    for signal in rows:
        by = str(ways.index(signal.by) + 1) if signal.channel else ""
        shown.add_row(*(escape(cell) for cell in _cells(signal, by)))
    output.print(shown)
    if len(rows) < len(found.signals):
        output.print(f"{len(found.signals) - len(rows)} more columns are not shown: use --all.")
    for number, way in enumerate(ways, 1):
        count = sum(signal.by == way for signal in used)
        output.print(f"Rule {number}: {escape(way)} ({count} column{'s' * (count != 1)})")
    output.print()


def _cells(signal: SignalLook, by: str) -> Sequence[str]:
    import numpy as np

    from identification.pages.drawing import shown_values, unit_label

    ends, unit = np.array([signal.low, signal.high]), signal.unit
    if signal.channel:
        ends, unit = shown_values(signal.channel, ends), unit_label(signal.channel)
    every = f"{_short(signal.interval)} s" if np.isfinite(signal.interval) else ""
    extent = f"{ends[0]:.4g} to {ends[1]:.4g} {unit}" if np.isfinite(ends).all() else unit
    gaps = str(signal.gaps) if signal.gaps else ""
    taken = "same name" if signal.channel == signal.column else signal.channel
    return signal.column, taken, by, f"{signal.samples:,}", every, gaps, extent.rstrip()


def _print_list(title: str, lines: Sequence[str], every: bool) -> None:
    if not lines:
        return
    output.print(f"[bold]{title}[/]")
    for line in lines if every else lines[:_MOST]:
        output.print(f"- {escape(line)}", soft_wrap=True)
    if not every and len(lines) > _MOST:
        output.print(f"- and {len(lines) - _MOST} more: use --all.")
    output.print()


def _print_vehicles(found: FirstLook, needs: Mapping[str, Needs]) -> None:
    from auv_gym.records.naming import looks_like

    columns = found.spare
    shown = table("Vehicles, best match first", "vehicle!", "missing channels", "uses>")
    for rank, name in enumerate(_ranked(found, needs)):
        missing = found.missing(needs[name])
        others = {one: [column for column in columns if column != one] for one in missing}  # left out: told above
        turned = _turned(name, found) if rank < _HINTED and missing else {}
        known = {target.name for target in turned.values()}
        hints = f"In another unit: {', '.join(turned)}; --mapping-out converts them. " if turned else ""
        if rank < _HINTED:
            hints += "".join(looks_like(one, others[one]) for one in missing if one not in known)
        hints = hints.strip()
        words = f"{', '.join(missing)}{'. ' * bool(hints)}{hints}" if missing else "none"
        shown.add_row(
            escape(name), escape(words), f"{(count := _used(found, needs[name]))} channel{'s' * (count != 1)}"
        )
    output.print(shown)


def _used(found: FirstLook, need: Needs) -> int:
    """How many channels of the log a vehicle uses."""
    return len(found.channels & {*need.required, *need.wanted})


def _ranked(found: FirstLook, needs: Mapping[str, Needs]) -> list[str]:
    """The vehicles, best match first.

    In order: fewest missing channels, most columns that look like these, that of the log's source, most channels used.
    """
    return sorted(needs, key=_places(found, needs).__getitem__)


def _as_good(found: FirstLook, needs: Mapping[str, Needs]) -> list[str]:
    """The vehicles that match as well as the best one."""
    places = _places(found, needs)
    return [name for name, place in places.items() if place == min(places.values())]


def _places(found: FirstLook, needs: Mapping[str, Needs]) -> dict[str, tuple[int, int, bool, int]]:
    """What the vehicles are ranked by, the least first."""
    from auv_gym.records.mapping import fitting_mappings
    from auv_gym.records.naming import candidates

    own = {fitting.vehicle for fitting in fitting_mappings(found.log)}
    columns = found.spare
    missing = {name: found.missing(need) for name, need in needs.items()}
    return {
        name: (
            len(missing[name]),
            sum(not candidates(one, columns) for one in missing[name]),
            name not in own,
            -_used(found, need),
        )
        for name, need in needs.items()
    }


def _next_command(
    found: FirstLook,
    needs: Mapping[str, Needs],
    refused: Mapping[str, str],
    log: str,
    mapping: Path | None,
    written: Path | None,
) -> str:
    """What to type next: a diagnosis if some vehicle has all its channels, otherwise a mapping to edit."""
    from auv_gym.records.naming import candidates

    used, nearest = written or mapping, _ranked(found, needs)[0]
    if refused:
        return _next_diagnosis(found, refused, log, used)
    turned, columns = _turned(nearest, found), found.spare
    unknown = {*found.missing(needs[nearest])} - {target.name for target in turned.values()}
    guessed = any(candidates(name, columns) for name in unknown)
    if not turned and not guessed and found.record is not None:
        return (
            "auv-gym list parts (no preset has this log's inputs: write a vehicle file, see "
            "docs/guides/add_a_vehicle.md, then run look again with --vehicle FILE; if the log has only joystick axes, "
            "see docs/logs.md)"
        )
    if written is not None:
        edited = f"edit {quote(str(written))}"
        if not unknown:
            edited = (
                f"check in {quote(str(written))} that each output drives the thruster of its number, in its direction"
            )
        return f"{edited}, then auv-gym look {quote(log)} --vehicle {quote(nearest)} --mapping {quote(str(written))}"
    options = f" --mapping {quote(str(mapping))}" if mapping else ""
    return f"auv-gym look {quote(log)} --vehicle {quote(nearest)}{options} --mapping-out names.toml"


def _next_diagnosis(found: FirstLook, refused: Mapping[str, str], log: str, used: Path | None) -> str:
    """The diagnosis to type next, or what to correct before it; refused: by the vehicles that match the log."""
    names = quote(str(used or "names.toml"))
    edited = f"correct in {names} what looks wrong"
    if used is None:
        edited = f"auv-gym look {quote(log)} --mapping-out {names}, correct in it what looks wrong"
    fitting = [name for name, why in refused.items() if not why]
    if not fitting:
        alone = next(iter(refused)) if len(refused) == 1 else "NAME"
        return (
            "first correct what looks wrong, since a diagnosis would refuse this log. If a mapping can correct it: "
            f"{edited}, then auv-gym look {quote(log)} --vehicle {quote(alone)} --mapping {names}. "
            "Otherwise change the file, or use another log or vehicle."
        )
    firm = any(("map it to" in doubt or "in a mapping" in doubt) and "unless" not in doubt for doubt in found.doubts)
    first = f"{edited}, then " if firm else ""
    options = f" --mapping {names}" if used or firm else ""
    record = found.record
    usual = logs.interval_used(record.sample_interval, _time_step(fitting[0])) if record else 0.0
    steps = round(record.duration_s / usual) if record else 0
    thinned = _thinned(steps, usual)
    options += f" --resample {thinned:g}" if thinned else ""
    why = f" (without --resample its {steps + 1:,} samples every {_short(usual)} s take long)" if thinned else ""
    named = quote(fitting[0]) if len(fitting) == 1 else "NAME"
    why += f", where NAME is your vehicle: {' or '.join(fitting)}" if len(fitting) > 1 else ""
    return f"{first}auv-gym diagnose {quote(log)} --vehicle {named}{options} --out diagnosis{why}"


def _short(seconds: float) -> str:
    """Seconds to three digits, without an exponent."""
    return f"{seconds:.0f}" if seconds >= 1000.0 else f"{seconds:.3g}"


def _time_step(vehicle: str) -> float:
    from auv_gym.plant import load_vehicle

    return load_vehicle(vehicle).dt


def _thinned(steps: int, interval: float) -> float | None:
    """A round sample time, s, longer than the interval, with which many steps become no more than take minutes."""
    if steps <= _MANY_SAMPLES:
        return None
    rounded = (step * 10.0**power for power in range(-3, 6) for step in (1.0, 2.0, 5.0))
    return next((s for s in rounded if s > interval and steps * interval / s <= _MANY_SAMPLES), None)


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
