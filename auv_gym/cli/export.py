"""`auv-gym export`: a vehicle, or logs of it, in the form of another tool."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.choices import choice
from auv_gym.cli.options.console import output
from auv_gym.cli.options.outputs import begins_with, check_output

if TYPE_CHECKING:
    from auv_gym.plant import Plant


class Form(StrEnum):
    """What a vehicle can be exported to."""

    sdf = "sdf"
    casadi = "casadi"
    control = "control"
    minari = "minari"


@app.command()
def export(
    vehicle: logs.VehicleArgument,
    to: Annotated[
        Form,
        choice(
            Form,
            "sdf: a Gazebo world. casadi: the equations of motion as a CasADi function. control: the model linearised "
            "at its trim, as a MAT file. minari: a data set of the logs.",
        ),
    ],
    out: Annotated[
        str | None,
        typer.Option(
            help="File to write; without an ending, .sdf, .casadi or .mat is added. Default: the vehicle's name. With "
            "minari: the data set's name, such as auv/dives-v0."
        ),
    ] = None,
    log: Annotated[list[str] | None, typer.Option(help=f"With minari: a log, may be repeated. {logs.ANY_LOG}")] = None,
    mapping: logs.ColumnNames = None,
    cache_dir: logs.CacheFolder = None,
    continuous: Annotated[bool, typer.Option("--continuous", help="With control: use continuous time.")] = False,
) -> None:
    """Export a vehicle to Gazebo, CasADi or python-control, or its logs to a Minari data set."""
    if (to is Form.minari) != bool(log):
        raise ValueError("Give --log with --to minari, and only then: a data set is made of the vehicle's logs.")
    only = {"--continuous": (continuous, Form.control), "--mapping": (mapping is not None, Form.minari)}
    only["--cache-dir"] = (cache_dir is not None, Form.minari)
    for option, (given, form) in only.items():
        if given and to is not form:
            raise ValueError(f"{option} does not apply to {to.value}: leave it out.")
    from auv_gym.plant import load_vehicle
    from auv_gym.writing import check_ending

    plant = load_vehicle(vehicle)
    if to is Form.minari:
        _to_minari(plant, out or f"{plant.name}/logs-v0", log or [], mapping, cache_dir)
        return
    file = Path(out) if out else Path(f"{plant.name}{_ENDINGS[to]}")
    file = file if file.suffix else file.with_name(f"{file.name}{_ENDINGS[to]}")
    if file.suffix.lower() in _ENDINGS.values():
        check_ending(file, _ENDINGS[to], f"--out with --to {to.value}")
    check_output("--out", file, {"VEHICLE": vehicle}, _KINDS[to])
    for line in _WRITERS[to](plant, file, continuous):
        output.print(line, soft_wrap=True, markup=False)
    beside = f" and {file}.json" if to is Form.casadi else ""
    output.print(f"Written to {file}{beside}", soft_wrap=True, markup=False)


def _to_sdf(plant: Plant, file: Path, continuous: bool) -> list[str]:
    from auv_gym.exports.for_gazebo import gazebo_world

    world = gazebo_world(plant)
    world.save(file)
    return [f"Not representable in SDF: {line}" for line in world.left_out]


def _to_casadi(plant: Plant, file: Path, continuous: bool) -> list[str]:
    from auv_gym.exports.for_casadi import casadi_model

    model = casadi_model(plant)
    model.save(file)
    units = model.units
    defaults = ", ".join(f"{name} = {value:g} {units[name]}" for name, value in model.defaults.items() if value)
    lines = [f"states x: {', '.join(model.states)}", f"inputs u: {', '.join(model.inputs)}"]
    return [*lines, f"defaults of u, where not 0: {defaults}"] if defaults else lines


def _to_control(plant: Plant, file: Path, continuous: bool) -> list[str]:
    from auv_gym.exports.for_control import control_system, save_system

    system = control_system(plant, continuous=continuous)
    save_system(system, file)
    labels = {"states": system.state_labels, "inputs": system.input_labels, "outputs": system.output_labels}
    return [f"{key}: {', '.join(names)}" for key, names in labels.items()]


def _to_minari(plant: Plant, dataset: str, names: list[str], mapping: Path | None, cache_dir: Path | None) -> None:
    import warnings

    from auv_gym.exports.for_minari import check_dataset_name, dataset_of_records
    from auv_gym.plant.record_check import needs_of

    check_dataset_name(dataset)
    complete = replace(needs_of(plant), spare=frozenset())  # no observation is made up
    record = logs.read_log(names, mapping, cache_dir, complete, True)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="minari")  # on an author, a link and an environment that a log lacks
        made = dataset_of_records(dataset, record, plant)
    steps = f"{made.total_episodes} episode{'s' * (made.total_episodes != 1)}, {made.total_steps} steps"
    output.print(f"{steps}: minari.load_dataset({dataset!r})", soft_wrap=True, markup=False)


_ENDINGS = {Form.sdf: ".sdf", Form.casadi: ".casadi", Form.control: ".mat"}
_KINDS = {
    Form.sdf: ("an SDF file", begins_with(b"<sdf", b"<?xml")),
    Form.casadi: ("a function that CasADi saved", begins_with(b"jhpnnagiieahaaaa")),  # its mark, as casadi 3 writes it
    Form.control: ("a MAT file", begins_with(b"MATLAB 5.0 MAT-file")),
}
_WRITERS = {Form.sdf: _to_sdf, Form.casadi: _to_casadi, Form.control: _to_control}
