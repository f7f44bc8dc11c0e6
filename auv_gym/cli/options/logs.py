"""Reading of logs that a command is given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from auv_gym.cli.options.console import errors
from auv_gym.cli.options.numbers import DEPTH, TIME_STEP, number

if TYPE_CHECKING:
    from auv_gym.plant import Plant
    from auv_gym.records.reading import Needs
    from auv_gym.records.record import Record

ANY_LOG = (
    "A log: a table (.csv, .txt, .nc, .mat), a ROS bag or MCAP file, ArduPilot .bin or .tlog, PX4 .ulg, MOOS .alog, a "
    "file of a Slocum, Seaglider or SeaExplorer, or slocum:ammonite."
)
FINER = 4  # times, beyond which a log is brought to the vehicle's step: filters take as long as a log has rows
_SHOWN = 12  # lines on what was left out; more are for `auv-gym look`

Logs = Annotated[list[str], typer.Argument(help=f"{ANY_LOG} Several files are one record, in segments.")]
_VEHICLE = "A preset (see `auv-gym list vehicles`) or a vehicle file (.toml)."
Vehicle = Annotated[str, typer.Option(help=_VEHICLE)]
VehicleArgument = Annotated[str, typer.Argument(help=_VEHICLE)]
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
MinDepth = Annotated[float | None, number("Use the log below this depth only, m.", *DEPTH)]
MaxDepth = Annotated[float | None, number("Use the log above this depth only, m.", *DEPTH)]
Thinning = Annotated[
    float | None,
    number(
        "Sample time, s, to thin a log to that is finer than the vehicle moves; default: the vehicle's, where the "
        f"log is over {FINER} times as fine.",
        *TIME_STEP,
    ),
]
Doubt = Annotated[
    float,
    number(
        "Standard deviation of the vehicle's own coefficients, relative; they are refitted. 0 holds them fixed.", 0, 10
    ),
]
Trust = Annotated[bool, typer.Option("--trust", help="Go on where the log itself looks mislabelled.")]


def refuse_early(vehicle: str, out: Path, logs: Sequence[str]) -> None:
    """Raises ValueError of a vehicle, a folder or a log that cannot be used, before what takes long to import."""
    from auv_gym.presets import find_vehicle
    from auv_gym.writing import writable_folder

    find_vehicle(vehicle)
    writable_folder(out)
    check_log_files(logs)


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


def between_depths(record: Record, shallowest: float | None, deepest: float | None) -> Record:
    """The samples of a record between two depths, m, of which either may be missing."""
    import numpy as np

    low = -np.inf if shallowest is None else shallowest
    high = np.inf if deepest is None else deepest
    if low >= high:
        raise ValueError(f"--min-depth needs to be less than --max-depth, got {low:g} and {high:g} m.")
    if shallowest is None and deepest is None:
        return record
    depth = record["depth_m"]
    kept = (depth >= low) & (depth <= high)
    if not kept.any():
        raise ValueError(
            f"No sample of the log lies between {low:g} and {high:g} m: its depth goes from {np.nanmin(depth):.1f} to "
            f"{np.nanmax(depth):.1f} m. Change --min-depth or --max-depth."
        )
    return record.select(kept)


def thinned(record: Record, step: float) -> Record:
    """The record at the vehicle's own step, s, where its samples are much finer, with a note that says so."""
    if not record.sample_interval * FINER < step:
        return record
    note = (
        f"Thinned from samples {record.sample_interval:.2g} s apart to the vehicle's step of {step:g} s, which is all "
        "that it moves in; --resample sets another."
    )
    return record.resample(step).with_notes([*record.notes, note])


def load_stated(vehicle: str, log: str) -> Plant:
    """A vehicle with the constants that a log states of it, which is said on stderr."""
    from auv_gym.plant import load_vehicle
    from auv_gym.plant.stated import as_stated

    plant, stated = as_stated(load_vehicle(vehicle), log)
    if stated:
        names = ", ".join(path.removeprefix("hull.") for path in stated)
        errors.print(f"Log: constants of the vehicle that {escape(log)} states: {names}.", soft_wrap=True)
    return plant


def read_cut(
    log: str | Sequence[str],
    plant: Plant,
    mapping: Path | None,
    cache_dir: Path | None,
    cut_gaps: bool,
    shallowest: float | None,
    deepest: float | None,
    resample: float | None,
    progress: Callable[[float, str], None] | None = None,
) -> Record:
    """The record of logs for a vehicle, between two depths, at the samples that were asked for or its own step."""
    from auv_gym.plant.record_check import needs_of as needs_of_plant

    record = read_log(log, mapping, cache_dir, needs_of_plant(plant), cut_gaps, progress)
    record = between_depths(record, shallowest, deepest)
    return thinned(record, plant.dt) if resample is None else record.resample(resample)
