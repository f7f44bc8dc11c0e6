"""`auv-gym monitor`: replay a log through a monitor that has learned from a clean one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar
from auv_gym.cli.options.numbers import number

_CLEAN = 0.25  # of a log, its first part, that counts as clean where no other log does


@app.command()
def monitor(
    log: logs.Logs,
    vehicle: logs.Vehicle,
    out: Annotated[Path, typer.Option(help="Folder for monitor.json and monitor.html.")],
    clean: Annotated[
        str | None,
        typer.Option(help=f"A log of the healthy vehicle. Default: the first quarter of the log. {logs.ANY_LOG}"),
    ] = None,
    rate: Annotated[float, number("Accepted false alarms per hour.", 1e-6, 1e4)] = 0.1,
    steady: Annotated[
        bool, typer.Option("--steady", help="Use constant filter gains: faster but less accurate.")
    ] = False,
    min_depth: logs.MinDepth = None,
    max_depth: logs.MaxDepth = None,
    resample: logs.Thinning = None,
    mapping: logs.ColumnNames = None,
    cut_gaps: logs.CutGaps = True,
    doubt: logs.Doubt = 0.1,
    trust: logs.Trust = False,
    cache_dir: logs.CacheFolder = None,
) -> None:
    """Raise alarms when a vehicle departs from its model, at a stated false-alarm rate, and name the cause."""
    with progress_bar() as progress:
        progress(0.0, "starting")
        logs.refuse_early(vehicle, out, [*log, *([clean] if clean else [])])

        import numpy as np

        from auv_gym.records.joining import check_apart
        from identification.monitor.monitor import Monitor
        from identification.monitor.report import watch, watched_summary, write_watched
        from identification.pages.drawing import require_render

        require_render()
        plant = logs.load_stated(vehicle, log[0])
        settings = (plant, mapping, cache_dir, cut_gaps, min_depth, max_depth, resample)
        record = logs.read_cut(log, *settings)
        if clean:
            known, learned_from = logs.read_cut(clean, *settings), Path(clean).name
            check_apart([(", ".join(log), record), (clean, known)])
        else:
            learned_from = "the first quarter of the log"
            early = np.arange(len(record)) < _CLEAN * len(record)
            known, record = record.select(early), record.select(~early)
        try:
            watcher = Monitor.learn(
                known, plant, false_alarms_per_hour=rate, steady=steady, doubt=doubt, trust=trust,
                progress=lambda f, text: progress(0.05 + 0.4 * f, text),
            )  # fmt: skip
        except ValueError as error:
            if clean:
                raise
            raise ValueError(f"{error} The clean log was {learned_from}; --clean LOG gives another.") from error
        progress(0.5, "replaying the log")
        found = watch(
            watcher, record, clean=learned_from, trust=trust, progress=lambda f, text: progress(0.5 + 0.45 * f, text)
        )
        written = write_watched(found, out)
    output.print()
    for line in watched_summary(found):
        output.print(line, markup=False, soft_wrap=True)
    for path in written.values():
        output.print(str(path), markup=False, soft_wrap=True)
