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
    from auv_gym.records.record import Record
    from auv_gym.records.understanding import Needs

ANY_LOG = (
    "Log file: a table (.csv, .txt, .nc, .mat), ROS bag, MCAP, ArduPilot .bin or .tlog, PX4 .ulg, MOOS .alog, a "
    "Slocum, Seaglider or SeaExplorer file, or the example log slocum:ammonite."
)
FINER = 4  # times, beyond which a log is brought to the vehicle's step: filters take as long as a log has rows
MOST_ADDED = 2  # times as many samples as the log has; the least interval of its signals may be this much shorter
_NO_UNIT = ": left out, since its unit is not known."  # as `auv_gym.records.mapping` says it
_FEW = 4  # columns without a unit that are named one by one
_SHOWN = 12  # lines on what was left out; more are for `auv-gym look`

Logs = Annotated[list[str], typer.Argument(metavar="LOG", help=f"{ANY_LOG} Several files are joined into one record.")]
_VEHICLE = "A preset (see `auv-gym list vehicles`) or a vehicle file (.toml)."
Vehicle = Annotated[str, typer.Option(help=_VEHICLE)]
VehicleArgument = Annotated[str, typer.Argument(metavar="VEHICLE", help=_VEHICLE)]
ColumnNames = Annotated[
    Path | None,
    typer.Option(
        help="TOML file that maps the log's columns to channels, such as Hdg = 'heading_deg'. A minus, as in "
        "'-rudder_rad', changes the sign. A number, as in speed_cmd_mps = 1.5, sets a channel that was constant and "
        "not logged. `auv-gym look --mapping-out` writes such a file."
    ),
]
CutGaps = Annotated[
    bool,
    typer.Option("--cut-gaps/--refuse-gaps", help="Cut the log where values are missing, or refuse such a log."),
]
CacheFolder = Annotated[
    Path | None, typer.Option(help="Folder with a Slocum glider's cache files (.cac), if they are not next to the log.")
]
Resample = Annotated[float | None, number("Resample the records evenly at this interval, s.", *TIME_STEP)]
MinDepth = Annotated[float | None, number("Use only samples deeper than this, m.", *DEPTH)]
MaxDepth = Annotated[float | None, number("Use only samples shallower than this, m.", *DEPTH)]
Thinning = Annotated[
    float | None,
    number(
        "Resample the log at this interval, s. Default: the vehicle's time step, if the log is sampled over "
        f"{FINER} times as fast.",
        *TIME_STEP,
    ),
]
Doubt = Annotated[
    float,
    number(
        "Relative uncertainty (standard deviation) of the vehicle's coefficients in the fit; 0 holds them fixed.", 0, 10
    ),
]
Trust = Annotated[bool, typer.Option("--trust", help="Continue even if the log itself looks mislabelled.")]


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
    """The record of one log, or of several; prints to stderr what was left out, repaired or cut, one line each."""
    from auv_gym.records.reading import read_record

    record = read_record(
        log, mapping, required, long_runs="cut" if cut_gaps else "raise", beside=cache_dir, progress=progress
    )
    notes = grouped(record.notes)
    _tell(notes[:_SHOWN])
    if len(notes) > _SHOWN:
        first = log if isinstance(log, str) else log[0]
        _tell([f"and {len(notes) - _SHOWN} more notes; see auv-gym look {first}."])
    return record


def grouped(notes: Sequence[str]) -> list[str]:
    """Notes with those on columns without a unit in one line, where there are more than a few."""
    columns = [line.removesuffix(_NO_UNIT) for line in notes if line.endswith(_NO_UNIT)]
    if len(columns) <= _FEW:
        return list(notes)
    shown = f"{', '.join(columns[:_FEW])}, ..."
    others = [line for line in notes if not line.endswith(_NO_UNIT)]
    return [*others, f"{len(columns)} columns left out, since their units are not known: {shown}"]


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
        where = f"between {low:g} and {high:g} m"
        if shallowest is None or deepest is None:
            where = f"deeper than {low:g} m" if deepest is None else f"shallower than {high:g} m"
        raise ValueError(
            f"The log has no sample {where}; its depth ranges from {np.nanmin(depth):.1f} to "
            f"{np.nanmax(depth):.1f} m. Change --min-depth or --max-depth."
        )
    return record.select(kept)


def interval_used(interval: float, step: float) -> float:
    """The interval, s, at which a log is used without --resample: the vehicle's step if it is much finer."""
    return step if interval * FINER < step else interval


def thinned(record: Record, step: float) -> Record:
    """The record at the vehicle's own step, s, where its samples are much finer, with a note that says so."""
    if interval_used(record.sample_interval, step) == record.sample_interval:
        return record
    note = (
        f"Resampled from an interval of {record.sample_interval:.2g} s to the vehicle's time step of {step:g} s; "
        "--resample sets another."
    )
    return record.resample(step).with_notes([*record.notes, note])


def load_stated(vehicle: str, log: str) -> Plant:
    """A vehicle with the constants that a log states of it, which is said on stderr."""
    from auv_gym.plant import load_vehicle
    from auv_gym.plant.record_check import check_commanded
    from auv_gym.plant.stated import as_stated

    plant, stated = as_stated(load_vehicle(vehicle), log)
    check_commanded(plant, vehicle)
    if stated:
        names = ", ".join(path.removeprefix("hull.") for path in stated)
        _tell([f"vehicle constants taken from {log}: {names}."])
    elif plant.family.stated is not None and plant.hull.as_logged:
        _tell([f"{log} states no constants of its vehicle (sg_cal_mass and others): those of {plant.name} are used."])
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
    if resample is not None:
        own = record.sample_interval
        if resample < own / MOST_ADDED:
            raise ValueError(
                f"--resample {resample:g} is far below the log's own interval of {own:.3g} s, and resampling adds no "
                "information: give a longer interval, or leave it out."
            )
        return record.resample(resample)
    found = thinned(record, plant.dt)
    _tell([line for line in found.notes if line not in record.notes])
    return found


def tell_remarks(record: Record, plant: Plant) -> list[str]:
    """Print to stderr what is remarkable in a record as one of this vehicle; the lines.

    Raises ValueError where it cannot be of it, so that both come before what takes long.
    """
    from auv_gym.plant.record_check import FEW, check_ranges, described

    check_ranges(plant, record, FEW)
    lines = [line for line in described(plant, record).notes if line not in record.notes]
    _tell(lines)
    return lines


def _tell(lines: Sequence[str]) -> None:
    for line in lines:
        errors.print(f"Log: {escape(line)}", soft_wrap=True)
