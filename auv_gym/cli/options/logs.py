"""Reading of logs that a command is given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auv_gym.cli.options.numbers import TIME_STEP, number

if TYPE_CHECKING:
    from auv_gym.records.record import Record

ColumnNames = Annotated[
    Path | None,
    typer.Option(
        help="TOML file of column names: theirs = ours, such as Hdg = 'heading_deg'; a number, as in "
        "speed_cmd_mps = 1.5, is the value of a channel that was constant and not logged; '-rudder_rad' turns the sign."
    ),
]
CutGaps = Annotated[
    bool, typer.Option("--cut-gaps", help="Where values are missing, cut the log instead of refusing it.")
]
Resample = Annotated[float | None, number("Bring the records to even samples of so many s.", *TIME_STEP)]


def check_log_files(logs: Sequence[str]) -> None:
    """Raises ValueError if one of them is no file that can be read."""
    from auv_gym.records.reading import find_log

    for log in logs:
        find_log(log)


def read_log(log: str, mapping: Path | None, cache_dir: Path | None, required: Sequence[str], cut_gaps: bool) -> Record:
    from auv_gym.records.reading import read_record

    if cache_dir is None:
        return read_record(log, mapping, required, long_runs="cut" if cut_gaps else "raise")
    from auv_gym.records.slocum import read_slocum

    if mapping is not None:
        raise ValueError(
            "--mapping renames the columns of a table and --cache-dir serves Slocum files: give one of them."
        )
    record = read_slocum(log, cache_dir)
    for name in required:
        record[name]
    return record
