"""The command `auv-gym`: simulate, diagnose, list.

What a command needs is imported when it runs, so that the help is there at once. Set `AUV_GYM_DEBUG=1` for tracebacks.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from auv_gym import __version__

if TYPE_CHECKING:
    from auv_gym.plant import Plant
    from auv_gym.record import Record
    from identification.diagnosis import Diagnosis

app = typer.Typer(
    name="auv-gym",
    help="Simulate, identify and diagnose underwater vehicles.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_output = Console(highlight=False)
_errors = Console(stderr=True, highlight=False)


class Listing(StrEnum):
    """What `auv-gym list` can list."""

    vehicles = "vehicles"
    effects = "effects"
    methods = "methods"
    channels = "channels"


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 1 for an error in the data or settings, 2 for one in the usage."""
    try:
        app(args=None if arguments is None else list(arguments), prog_name="auv-gym")
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except Exception as error:
        if os.environ.get("AUV_GYM_DEBUG", "0") not in ("", "0") or not _is_ours(error):
            raise
        _errors.print("[bold red]Error:[/] ", end="")
        _errors.print(str(error), markup=False, soft_wrap=True)
        return 1
    return 0


def _is_ours(error: Exception) -> bool:
    """Whether the message alone says what is wrong and what to do."""
    return isinstance(error, ValueError | ImportError | OSError) or type(error).__name__ == "Diverged"


def _print_version(wanted: bool) -> None:
    if wanted:
        _output.print(f"auv-gym {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command()
def simulate(
    vehicle: Annotated[str, typer.Argument(help="A preset (see `auv-gym list vehicles`) or a vehicle file (.toml).")],
    out: Annotated[Path | None, typer.Option(help="Write the record: .nc or .csv.")] = None,
    duration: Annotated[
        float | None, typer.Option(help="Length of the run, s; default: 600, for a float 600 for each depth.")
    ] = None,
    dt: Annotated[float | None, typer.Option(help="Sample time, s; default: the vehicle's.")] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH=VALUE", help="An effect, such as effects.rudder.offset=0.05; may be repeated."),
    ] = None,
    compass_noise_deg: Annotated[
        float | None, typer.Option(help="Glider: noise of the compass, standard deviation, deg; default: 0.5.")
    ] = None,
    track_noise_m: Annotated[
        float | None,
        typer.Option(help="Glider: noise of the track, standard deviation, m; default: 1; negative: no track."),
    ] = None,
    target_depth: Annotated[
        list[float] | None,
        typer.Option(help="Float: depth to go to, m; may be repeated: one after the other, or a dive to each."),
    ] = None,
    depth_noise_m: Annotated[
        float | None, typer.Option(help="Float: noise of the depth, standard deviation, m; default: 0.02 or 0.1.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.")] = 0,
) -> None:
    """Simulate a vehicle under control, and record what its sensors give.

    A glider follows a changing heading with excitation at its rudder; a float with a piston goes from depth to depth;
    a float with an oil bladder makes dives with pump and valve.
    """
    if out is not None:
        _check_file_writable(out)
    from auv_gym.param import replace_at
    from auv_gym.plant import load_vehicle

    if seed < 0:
        raise ValueError(f"--seed needs a whole number from 0 on, got {seed}.")
    plant = load_vehicle(vehicle, dt=dt)
    changes = dict(_effect_of(text) for text in effect or [])
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
    _output.print(_record_table(record, _title(plant.name, record)))
    if out is not None:
        _output.print(f"Written to {out}", markup=False, soft_wrap=True)


@app.command()
def diagnose(
    log: Annotated[str, typer.Argument(help="A log: .csv, .nc, .mat, a Slocum file, or slocum:ammonite.")],
    vehicle: Annotated[str, typer.Option(help="A preset (see `auv-gym list vehicles`) or a vehicle file (.toml).")],
    out: Annotated[Path, typer.Option(help="Folder for diagnosis.json, vehicle.toml and report.html.")],
    min_depth: Annotated[float | None, typer.Option(help="Use the log below this depth only, m.")] = None,
    max_depth: Annotated[float | None, typer.Option(help="Use the log above this depth only, m.")] = None,
    window: Annotated[
        float | None,
        typer.Option(help="Length of the free runs, s; default: the vehicle's. Every other one, or dive, is held out."),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file of column names: theirs = ours, such as Hdg = 'heading_deg'.")
    ] = None,
    profile: Annotated[
        Path | None,
        typer.Option(
            help="CSV of the water's density: density_kgpm3 over depth_m or pressure_dbar, by dive_id if many."
        ),
    ] = None,
    cut_gaps: Annotated[
        bool, typer.Option("--cut-gaps", help="Where values are missing, cut the log instead of refusing it.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Kept with the result; the diagnosis itself draws nothing.")] = 0,
    cache_dir: Annotated[
        Path | None, typer.Option(help="Folder of a Slocum glider's cache files (.cac), if not beside the log.")
    ] = None,
) -> None:
    """Find the physical effect that a vehicle's model lacks to explain a measured log."""
    with _progress() as progress:
        progress(0.0, "starting")
        from auv_gym.density import read_profiles, with_density
        from auv_gym.plant import load_vehicle
        from identification.diagnosis import diagnose as diagnose_record
        from identification.diagnosis import write_diagnosis
        from identification.diagnosis.result_files import writable_folder
        from identification.figures import require_render

        require_render()

        plant = load_vehicle(vehicle)
        writable_folder(out)
        progress(0.0, "reading the log")
        record = _read_log(log, mapping, cache_dir, (plant.outputs[0], *plant.family.required), cut_gaps)
        record = _between_depths(record, min_depth, max_depth)
        if profile is not None:
            if "density_kgpm3" not in plant.inputs:
                raise ValueError(
                    f"--profile serves vehicles that feel the water's density; {plant.name} does not: drop it."
                )
            record = with_density(record, read_profiles(profile))
        diagnosis = diagnose_record(
            record,
            plant,
            window=window,
            seed=seed,
            source=Path(log).name,
            progress=lambda fraction, text: progress(0.05 + 0.85 * fraction, text),
        )
        progress(0.9, "writing the report")
        written = write_diagnosis(diagnosis, out)
        progress(1.0, "done")
    _output.print()
    _output.print(diagnosis.summary(), markup=False)
    _output.print()
    _output.print(_error_table(diagnosis))
    if diagnosis.effects:
        _output.print(_effect_table(diagnosis))
    for path in written.values():
        _output.print(str(path), markup=False, soft_wrap=True)


@app.command(name="list")
def list_things(
    what: Annotated[Listing | None, typer.Argument(help="Default: all of them.")] = None,
) -> None:
    """List vehicles, their effects, methods of identification, and channels with their units."""
    tables = {
        Listing.vehicles: _vehicles,
        Listing.effects: _effects,
        Listing.methods: _methods,
        Listing.channels: _channels,
    }
    for name, make in tables.items():
        if what in (None, name):
            _output.print(make())


_HEADING_OPTIONS = ("--duration", "--dt", "--compass-noise-deg", "--track-noise-m")
_SIMULATE_OPTIONS = {
    "float_piston": ("--duration", "--dt", "--target-depth", "--depth-noise-m"),
    "float_oil": ("--target-depth", "--depth-noise-m"),
}


def _simulated(plant: Plant, given: Mapping[str, Any], seed: int) -> Record:
    """The record of the experiment that suits the vehicle's family, with the options given by flag."""
    import numpy as np

    family = plant.family.name
    takes = _SIMULATE_OPTIONS.get(family, _HEADING_OPTIONS)
    for flag in given:
        if flag not in takes:
            raise ValueError(
                f"{flag} says nothing about {plant.name}, a vehicle of family {family}: leave it out. Options for this "
                f"family: {', '.join(('--effect', '--seed', '--out', *takes))}."
            )
    for flag in ("--compass-noise-deg", "--depth-noise-m"):
        if not given.get(flag, 0.0) >= 0.0:
            raise ValueError(f"{flag} needs a number from 0 on, got {given[flag]:g}.")
    rng = np.random.default_rng(seed)
    if family == "float_piston":
        from identification.float_experiment import depth_control, summer_lake

        targets = given.get("--target-depth") or [40.0, 0.0]
        hold = given["--duration"] / len(targets) if "--duration" in given else 600.0
        noise = given.get("--depth-noise-m", 0.02)
        return depth_control(plant, targets, rng=rng, hold=hold, noise=noise, temperature_profile=summer_lake)
    if family == "float_oil":
        from identification.float_experiment import oil_mission

        settings = {"depths": given["--target-depth"]} if "--target-depth" in given else {}
        return oil_mission(plant, rng=rng, noise=given.get("--depth-noise-m", 0.1), **settings)
    from identification.experiment import closed_loop

    track_noise = given.get("--track-noise-m", 1.0)
    return closed_loop(
        plant,
        rng=rng,
        duration=given.get("--duration", 600.0),
        compass_noise=float(np.radians(given.get("--compass-noise-deg", 0.5))),
        track_noise=None if track_noise < 0.0 else track_noise,
    )


def _title(name: str, record: Record) -> str:
    parts, interval = len(record.segments), record.sample_interval
    about = "" if record.is_uniform() else "about "
    return f"{name}, {record.duration_s:g} s{f' in {parts} dives' * (parts > 1)} in samples of {about}{interval:g} s"


def _effect_of(text: str) -> tuple[str, float]:
    path, separator, value = text.partition("=")
    try:
        return path.strip(), float(value)
    except ValueError:
        got = "no '='" if not separator else f"the value {value!r}"
        raise ValueError(
            f"--effect needs PATH=VALUE, such as effects.rudder.offset=0.05, got {got} in {text!r}."
        ) from None


def _check_file_writable(path: Path) -> None:
    """Raises ValueError, before any work is done, if a record cannot be written there."""
    import tempfile

    if path.suffix.lower() not in (".nc", ".csv"):
        raise ValueError(f"--out needs a name that ends in .nc or .csv, got {path.name!r}.")
    if path.is_dir():
        raise ValueError(f"--out needs a file, and {path} is a folder.")
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise ValueError(f"Cannot write {path}: {error.strerror or error}. Choose a folder that is writable.") from None


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


def _read_log(
    log: str, mapping: Path | None, cache_dir: Path | None, required: Sequence[str], cut_gaps: bool
) -> Record:
    from auv_gym.reading import read_record

    if cache_dir is None:
        return read_record(log, mapping, required, long_runs="cut" if cut_gaps else "raise")
    from auv_gym.slocum import read_slocum

    if mapping is not None:
        raise ValueError(
            "--mapping renames the columns of a table and --cache-dir serves Slocum files: give one of them."
        )
    record = read_slocum(log, cache_dir)
    for name in required:
        record[name]
    return record


def _between_depths(record: Record, shallowest: float | None, deepest: float | None) -> Record:
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


@contextmanager
def _progress() -> Iterator[Any]:
    """A callable of fraction and text that draws a bar on stderr, where that is a terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(bar_width=30), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=_errors, transient=True, disable=not _errors.is_terminal) as bars:
        task = bars.add_task("", total=1.0)
        yield lambda fraction, text: bars.update(task, completed=fraction, description=text)


def _record_table(record: Record, title: str) -> Table:
    from auv_gym.channels import channel

    table = _table(title, "channel!", "what", "unit", "lowest>", "mean>", "highest>")
    for name in record.names:
        known, values = channel(name), record[name]
        numbers = (f"{value:.4g}" for value in (values.min(), values.mean(), values.max()))
        table.add_row(name, known.label, known.unit, *numbers)
    return table


def _error_table(diagnosis: Diagnosis) -> Table:
    from auv_gym.channels import channel
    from identification.diagnosis.verdict import quantity

    stages = [diagnosis.given, diagnosis.before, *([diagnosis.after] if diagnosis.effects else [])]
    heads = ["as given>", "before>" if diagnosis.effects else "refitted>", "after>"][: len(stages)]
    table = _table(f"Root mean square error of free runs {diagnosis.reach}, held out", "channel", *heads)
    for name in diagnosis.before.scores:
        unit = channel(name).unit
        table.add_row(name, *(quantity(stage.scores[name].rmse, unit) for stage in stages))
    return table


def _effect_table(diagnosis: Diagnosis) -> Table:
    from auv_gym.param import spec_at
    from identification.diagnosis.verdict import interval, quantity

    table = _table("Effects", "effect", "value>", "95 % interval>", "not told apart from")
    for effect in diagnosis.effects:
        size, limits = quantity(effect.value, effect.unit), interval(effect.ci95, effect.unit)
        alike = ", ".join(spec_at(diagnosis.given.plant, path).title for path in effect.tied_with)
        table.add_row(effect.title, size, limits, alike)
    return table


def _vehicles() -> Table:
    from auv_gym.plant import list_vehicles, load_vehicle

    table = _table("Vehicles", "name!", "family", "dt, s>", "what")
    for name, title in list_vehicles().items():
        plant = load_vehicle(name)
        table.add_row(name, plant.family.name, f"{plant.dt:g}", title)
    return table


def _effects() -> Table:
    from auv_gym.param import list_paths, spec_at
    from auv_gym.vehicles import FAMILIES

    table = _table("Effects, by family", "path", "neutral>", "bounds>", "probe>")
    for kind in dict.fromkeys(family.kind for family in FAMILIES.values()):
        families = [family for family in FAMILIES.values() if family.kind == kind]
        table.add_row(f"[bold]{', '.join(family.name for family in families)}[/]")
        tree = families[0].parameters()
        for path in list_paths(tree):
            if path.startswith("effects.") and not path.startswith("effects.discovered."):
                spec = spec_at(tree, path)
                low, high = spec.bounds
                numbers = (f"{spec.neutral:g}", f"{low:.3g} to {high:.3g}", f"{spec.probe:g}")
                unit = "" if spec.unit == "1" else f", {spec.unit}"
                table.add_row(f"{path}\n  [dim]{spec.title}{unit}[/]", *numbers)
        discovered = [path.split(".") for path in list_paths(tree) if path.startswith("effects.discovered.")]
        if discovered:  # hundreds of them: every axis has the same terms
            axes, terms = (", ".join(dict.fromkeys(names[i] for names in discovered)) for i in (2, 3))
            text = f"terms found in data; axes: {axes}; terms: {terms}"
            table.add_row(f"effects.discovered.AXIS.TERM\n  [dim]{text}[/]", "0", "any", "0")
        table.add_section()
    return table


def _methods() -> Table:
    table = _table("Methods", "name", "what")
    table.add_row(
        "grey-box", "Frees parameters of a vehicle: output error over windows with initial states of their own."
    )
    table.add_row("diagnosis", "Names the effect that a vehicle lacks, decided on held-out windows.")
    for name, what in {
        "rwls": "Recursive weighted least squares for a float's diving model; biased by depth noise.",
        "ivls": "Instrumental variables for the diving model as published; fails with noise, there to be compared.",
        "corrected ivls": "The same with a bounded instrument and integrated rows; sample by sample or over records.",
        "refined iv": "The diving model over whole records, without bias and as accurate as white noise allows.",
        "ls-svm": "The diving model by a support vector machine with a linear kernel; biased by depth noise.",
    }.items():
        table.add_row(name, what)
    return table


def _channels() -> Table:
    from auv_gym.channels import CHANNELS

    table = _table("Channels", "name!", "unit", "kind", "what")
    for channel in CHANNELS.values():
        table.add_row(channel.name, channel.unit, channel.kind, channel.label)
    return table


def _table(title: str, *columns: str) -> Table:
    """A table with these columns; a name that ends in '>' is set to the right, one in '>' or '!' is never wrapped."""
    table = Table(title=title, title_justify="left", title_style="bold", header_style="bold", box=SIMPLE_HEAD)
    for column in columns:
        name, right, whole = column.rstrip(">!"), column.endswith(">"), column.endswith((">", "!"))
        table.add_column(name, justify="right" if right else "left", overflow="fold", no_wrap=whole)
    return table


if __name__ == "__main__":
    sys.exit(main())
