"""Reading of logs that a command is given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from auv_gym.cli.options.console import errors
from auv_gym.cli.options.numbers import TIME_STEP, number

if TYPE_CHECKING:
    from auv_gym.records.reading import Needs
    from auv_gym.records.record import Record

ANY_LOG = (
    "A log: a table (.csv, .txt, .nc, .mat), a ROS bag or MCAP file, ArduPilot .bin or .tlog, PX4 .ulg, MOOS .alog, a "
    "file of a Slocum, Seaglider or SeaExplorer, or slocum:ammonite."
)
_SHOWN = 12  # lines on what was left out; more are for `auv-gym look`

ColumnNames = Annotated[
    Path | None,
    typer.Option(
        help="TOML file of column names: theirs = ours, such as Hdg = 'heading_deg'; a number, as in "
        "speed_cmd_mps = 1.5, is the value of a channel that was constant and not logged; '-rudder_rad' turns the "
        "sign. `auv-gym look --mapping-out` writes one."
    ),
]
CutGaps = Annotated[
    bool,
    typer.Option(
        "--cut-gaps/--refuse-gaps", help="Where values are missing, cut the log there, or refuse it. Default: cut."
    ),
]
CacheFolder = Annotated[
    Path | None, typer.Option(help="Folder of a Slocum glider's cache files (.cac), if not beside the log.")
]
Resample = Annotated[float | None, number("Bring the records to even samples of so many s.", *TIME_STEP)]


def check_log_files(logs: Sequence[str]) -> None:
    """Raises ValueError if one of them is no file that can be read."""
    from auv_gym.records.reading import find_log

    for log in logs:
        find_log(log)


def read_log(
    log: str | Sequence[str],
    mapping: Path | None,
    cache_dir: Path | None,
    required: Sequence[str] | Needs,
    cut_gaps: bool,
    progress: Callable[[float, str], None] | None = None,
) -> Record:
    """The record of one log, or of several; what was left out, mended or cut is said on stderr, a line each."""
    from auv_gym.records.reading import read_record

    record = read_record(
        log, mapping, required, long_runs="cut" if cut_gaps else "raise", beside=cache_dir, progress=progress
    )
    notes = record.notes
    for line in notes[:_SHOWN]:
        errors.print(f"Log: {escape(line)}", soft_wrap=True)
    if len(notes) > _SHOWN:
        first = log if isinstance(log, str) else log[0]
        errors.print(f"Log: and {len(notes) - _SHOWN} lines more; see auv-gym look {escape(first)}.", soft_wrap=True)
    return record


def needs_of(vehicles: Sequence[str] | None) -> dict[str, Needs]:
    """What vehicles take from a log, by name; None for all presets."""
    from auv_gym.plant import load_vehicle
    from auv_gym.plant.record_check import needs_of as needs_of_plant
    from auv_gym.presets import list_preset_headings

    return {name: needs_of_plant(load_vehicle(name)) for name in vehicles or list_preset_headings()}
