"""`auv-gym simulate`: the standard experiment of a vehicle's family, as its sensors record it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, table
from auv_gym.cli.options.environment import effect_of
from auv_gym.cli.options.numbers import DEPTH, LENGTH, SEED, TIME_STEP, number, whole_number
from auv_gym.cli.options.outputs import check_output, is_simulated

if TYPE_CHECKING:
    from auv_gym.plant import Plant
    from auv_gym.records.record import Record


@app.command(
    help="Simulate a vehicle under control and record its sensor readings.\n\n"  # a docstring keeps its line ends
    "A glider follows a changing heading, with excitation added to its rudder. A torpedo changes heading, depth and "
    "speed, with excitation added to its fins. A float with a piston moves between depths. A float with an oil bladder "
    "dives with its pump and valve, and a glider in steady flight dives at several pitch angles. A vehicle with "
    "thrusters alone holds its place while its axes are excited."
)
def simulate(
    vehicle: logs.VehicleArgument,
    out: Annotated[Path | None, typer.Option(help="Write the record: .nc or .csv.")] = None,
    duration: Annotated[
        float | None, number("Length of the run, s. Default: 600; for a float, 600 for each depth.", *LENGTH)
    ] = None,
    dt: Annotated[float | None, number("Sample time, s. Default: the vehicle's.", *TIME_STEP)] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH=VALUE", help="An effect, such as effects.rudder.offset=0.05; may be repeated."),
    ] = None,
    compass_noise_deg: Annotated[
        float | None,
        number(
            "All but floats and gliders in steady flight: standard deviation of the compass noise, deg. Default: 0.5.",
            0,
            180,
        ),
    ] = None,
    track_noise_m: Annotated[
        float | None,
        number("Glider on a heading: standard deviation of the track noise, m. Default: 1; negative: none.", -1, 10000),
    ] = None,
    target_depth: Annotated[
        list[float] | None,
        number(
            "Float, or glider in steady flight (seaglider): target depth, m. May be repeated, for several depths or "
            "dives.",
            *DEPTH,
        ),
    ] = None,
    depth_noise_m: Annotated[
        float | None,
        number(
            "All but gliders on a heading (slocum): standard deviation of the depth noise, m. Default: 0.02; float "
            "with an oil bladder: 0.1; glider in steady flight (seaglider): 0.05.",
            0,
            1000,
        ),
    ] = None,
    seed: Annotated[int, whole_number("Random seed.", *SEED)] = 0,
) -> None:
    """Simulate a vehicle under control and record its sensor readings."""
    if out is not None:
        _check_name(out)
        check_output("--out", out, {"VEHICLE": vehicle}, ("a record as this command writes it", is_simulated))
    from auv_gym.presets import find_vehicle

    find_vehicle(vehicle)  # refused before what takes long to import

    from auv_gym.param import replace_at
    from auv_gym.plant import load_vehicle

    plant = load_vehicle(vehicle, dt=dt)
    changes = dict(effect_of(text) for text in effect or [])
    given = {
        "--duration": duration,
        "--dt": dt,
        "--compass-noise-deg": compass_noise_deg,
        "--track-noise-m": track_noise_m,
        "--target-depth": target_depth,
        "--depth-noise-m": depth_noise_m,
    }
    given = {flag: value for flag, value in given.items() if value is not None}
    record = _simulated(replace_at(plant, changes), given, seed)
    if out is not None:
        _write_record(record, out)
    output.print(_record_table(record, _title(plant.name, record)))
    if out is not None:
        output.print(f"Written to {out}", markup=False, soft_wrap=True)


_MOST_SAMPLES = 2_000_000  # of a torpedo some 4 kB each, 8 GB in all
_FLAGS = {
    "--duration": "duration",
    "--compass-noise-deg": "compass_noise",
    "--track-noise-m": "track_noise",
    "--target-depth": "target_depths",
    "--depth-noise-m": "depth_noise",
}


def _simulated(plant: Plant, given: Mapping[str, Any], seed: int) -> Record:
    """The record of the experiment that suits the vehicle's family, with the options given by flag."""
    from math import radians

    import numpy as np

    from identification.experiments.missions import mission_of, run_mission

    mission = mission_of(plant)
    takes = [flag for flag, name in _FLAGS.items() if name in mission.settings]
    if "--duration" in takes:
        takes.insert(1, "--dt")  # where the mission sets its own times, a sample time says nothing
    for flag in given:
        if flag not in takes:
            raise ValueError(
                f"{flag} does not apply to {plant.name}, a vehicle of family {plant.family.name}: leave it out. "
                f"Options for this family: {', '.join(('--effect', '--seed', '--out', *takes))}."
            )
    samples = given.get("--duration", 0.0) / plant.dt
    if samples > _MOST_SAMPLES:
        raise ValueError(
            f"--duration {given['--duration']:g} at a sample time of {plant.dt:g} s makes {samples:.3g} samples, but "
            f"memory allows for {_MOST_SAMPLES:.0f}: give a shorter --duration or a longer --dt."
        )
    settings = {_FLAGS[flag]: value for flag, value in given.items() if flag in _FLAGS}
    if "compass_noise" in settings:
        settings["compass_noise"] = radians(settings["compass_noise"])
    if settings.get("track_noise", 0.0) < 0.0:
        settings["track_noise"] = None
    try:
        return run_mission(plant, np.random.default_rng(seed), **settings)
    except ValueError as error:
        if str(error).startswith("duration "):
            raise ValueError(f"--{error}") from error
        raise


def _title(name: str, record: Record) -> str:
    parts, interval = len(record.segments), record.sample_interval
    about = "" if record.is_uniform() else "about "
    return f"{name}, {record.duration_s:g} s{f' in {parts} dives' * (parts > 1)} in samples of {about}{interval:g} s"


def _check_name(path: Path) -> None:
    """Raises ValueError if a record cannot have this name."""
    if path.suffix.lower() not in (".nc", ".csv"):
        raise ValueError(f"--out needs a name that ends in .nc or .csv, got {path.name!r}.")
    if path.is_dir():
        raise ValueError(f"--out needs a file, and {path} is a folder.")


def _write_record(record: Record, path: Path) -> None:
    """The record as NetCDF or as CSV, written aside and then renamed."""
    if path.suffix.lower() == ".nc":
        record.save(path)
        return
    from auv_gym.writing import replacing

    names = ("time_s", *record.names)
    rows = zip(*(record[name].tolist() for name in names))
    lines = [",".join(f"{value:.10g}" for value in row) for row in rows]
    heads = ",".join(names)
    if len(record.segments) > 1:
        heads = f"segment,{heads}"
        lines = [
            f"{label},{lines[k]}"
            for s, label in zip(record.segments, record.labels)
            for k in range(*s.indices(len(lines)))
        ]
    with replacing(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        file.writelines(line + "\n" for line in (heads, *lines))


def _record_table(record: Record, title: str) -> Table:
    from auv_gym.channels import channel

    shown = table(title, "channel!", "what", "lowest>", "mean>", "highest>")
    for name in record.names:
        values = record[name]
        numbers = (f"{value:.4g}" for value in (values.min(), values.mean(), values.max()))
        shown.add_row(name, channel(name).label, *numbers)
    return shown
