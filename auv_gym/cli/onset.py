"""`auv-gym onset`: when an effect begins, ends or grows in a log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar
from auv_gym.cli.options.numbers import whole_number

_FILE = "onset.json"


@app.command()
def onset(
    log: logs.Logs,
    vehicle: logs.Vehicle,
    out: Annotated[Path, typer.Option(help=f"Folder for {_FILE}.")],
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

        from auv_gym.writing import write_text
        from identification.changes.onset import find_onsets
        from identification.changes.wording import timeline_json, timeline_summary

        plant = logs.load_stated(vehicle, log[0])
        record = logs.read_cut(log, plant, mapping, cache_dir, cut_gaps, min_depth, max_depth, resample)
        found = find_onsets(
            record, plant, most=most, doubt=doubt, trust=trust, progress=lambda f, text: progress(0.05 + 0.9 * f, text)
        )
        write_text(out / _FILE, json.dumps(timeline_json(found), indent=2) + "\n")
    output.print()
    for line in timeline_summary(found):
        output.print(line, markup=False, soft_wrap=True)
    output.print(str(out / _FILE), markup=False, soft_wrap=True)
