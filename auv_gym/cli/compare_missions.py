"""`auv-gym compare-missions`: what changed in a vehicle between earlier and later missions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar
from auv_gym.cli.options.numbers import whole_number

if TYPE_CHECKING:
    from auv_gym.records.record import Record

_WITH = "--with"


class _Sides(TyperCommand):
    """A command whose option --with takes all that follows it, up to the next option."""

    def parse_args(self, ctx, args: list[str]) -> list[str]:
        return super().parse_args(ctx, spread(args))


def spread(args: Sequence[str]) -> list[str]:
    """`--with A B` as `--with A --with B`; raises ValueError where nothing follows --with."""
    found, after = [], False
    for arg, following in zip(args, [*args[1:], "--"], strict=True):
        if arg == _WITH and following.startswith("-"):
            raise ValueError(f"{_WITH} needs at least one later mission, got none: put the logs after it.")
        if arg.startswith("-"):
            after = arg == _WITH
        elif after:
            found += [arg] if found[-1] == _WITH else [_WITH, arg]
            continue
        found.append(arg)
    return found


@app.command(cls=_Sides)
def compare_missions(
    before: Annotated[list[str], typer.Argument(metavar="LOG", help=f"Logs of the earlier missions. {logs.ANY_LOG}")],
    vehicle: logs.Vehicle,
    out: Annotated[Path, typer.Option(help="Folder for changes.json and report.html; an existing series is resumed.")],
    after: Annotated[list[str] | None, typer.Option(_WITH, help="Logs of the later missions.")] = None,
    series: Annotated[
        bool,
        typer.Option("--series", help="Follow trends over consecutive missions, instead of comparing two groups."),
    ] = False,
    jobs: Annotated[int, whole_number("Worker processes for a series of missions.", 1, 1024)] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler that takes the missions of a series, such as tcp://host:8786."),
    ] = None,
    min_depth: logs.MinDepth = None,
    max_depth: logs.MaxDepth = None,
    resample: logs.Thinning = None,
    mapping: logs.ColumnNames = None,
    cut_gaps: logs.CutGaps = True,
    doubt: logs.Doubt = 0.1,
    most: Annotated[int, whole_number("Largest number of effects, and of changes, to name.", 1, 20)] = 3,
    trust: logs.Trust = False,
    cache_dir: logs.CacheFolder = None,
) -> None:
    """Find what changed in a vehicle between missions, when, and the smallest change that these logs would show."""
    if series and after:
        raise ValueError(f"--series takes all missions in order: leave {_WITH} out.")
    if not series and not after:
        raise ValueError(f"Give the later missions after {_WITH}, or add --series to follow trends over all of them.")
    for option, given in (("--scheduler", scheduler is not None), ("--jobs", jobs != 1)):
        if given and not series:
            raise ValueError(f"{option} is for a series of missions: add --series, or leave {option} out.")
    if twice := sorted(set(before) & set(after or [])):
        raise ValueError(f"A mission is either earlier or later, not both: leave out {', '.join(twice)} on one side.")
    if twice := sorted({log for side in (before, after or []) for log in side if side.count(log) > 1}):
        raise ValueError(f"Give each mission once; this one was given twice: {', '.join(twice)}.")
    with progress_bar() as progress:
        progress(0.0, "starting")
        logs.refuse_early(vehicle, out, [*before, *(after or [])])

        from auv_gym.records.joining import check_apart
        from identification.changes.missions import compare_missions as compare
        from identification.changes.page import write_comparison, write_series
        from identification.changes.series import follow_series
        from identification.changes.wording import series_summary, summary
        from identification.pages.drawing import require_render

        require_render()
        plant = logs.load_stated(vehicle, before[0])

        def read(files: list[str]) -> tuple[str, Record]:
            progress(0.0, "reading the logs")
            name = ", ".join(files)
            try:
                return name, logs.read_cut(files, plant, mapping, cache_dir, cut_gaps, min_depth, max_depth, resample)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None

        sides = [[file] for file in before] if series else [before, after or []]
        missions = [read(files) for files in sides]
        check_apart(missions)
        options: Any = {"most": most, "doubt": doubt, "trust": trust}
        options["progress"] = lambda f, text: progress(0.05 + 0.9 * f, text)
        if series:
            options |= {"jobs": jobs, "scheduler": scheduler}
            trends = follow_series(dict(missions), plant, out, **options)
            lines, written = series_summary(trends), write_series(trends, out)
        else:
            names = before, after or []
            found = compare(*(record for _, record in missions), plant, names=names, **options)
            lines, written = summary(found), write_comparison(found, out)
    output.print()
    for line in lines:
        output.print(line, markup=False, soft_wrap=True)
    for path in written.values():
        output.print(str(path), markup=False, soft_wrap=True)
