"""`auv-gym onset`: when an effect begins, ends or grows in a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar
from auv_gym.cli.options.numbers import whole_number


@app.command()
def onset(
    log: logs.Logs,
    vehicle: logs.Vehicle,
    out: Annotated[Path, typer.Option(help="Folder for onset.json and onset.html.")],
    min_depth: logs.MinDepth = None,
    max_depth: logs.MaxDepth = None,
    resample: logs.Thinning = None,
    mapping: logs.ColumnNames = None,
    cut_gaps: logs.CutGaps = True,
    doubt: logs.Doubt = 0.1,
    most: Annotated[int, whole_number("Largest number of effects to name.", 1, 20)] = 3,
    trust: logs.Trust = False,
    cache_dir: logs.CacheFolder = None,
) -> None:
    """Find the effects that a vehicle's model is missing, and when each began, ended or grew during the log."""
    with progress_bar() as progress:
        progress(0.0, "starting")
        logs.refuse_early(vehicle, out, log)

        from identification.changes.onset import find_onsets
        from identification.changes.page import write_timeline
        from identification.changes.wording import timeline_summary
        from identification.pages.drawing import require_render

        require_render()
        plant = logs.load_stated(vehicle, log[0])
        record = logs.read_cut(log, plant, mapping, cache_dir, cut_gaps, min_depth, max_depth, resample)
        logs.tell_remarks(record, plant)
        found = find_onsets(
            record, plant, most=most, doubt=doubt, trust=trust, progress=lambda f, text: progress(0.05 + 0.9 * f, text)
        )
        written = write_timeline(found, out)
    output.print()
    for line in timeline_summary(found):
        output.print(line, markup=False, soft_wrap=True)
    for path in written.values():
        output.print(str(path), markup=False, soft_wrap=True)
