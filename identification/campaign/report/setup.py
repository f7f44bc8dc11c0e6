"""The setup of a campaign in words: the settings that all runs share, and what the grid varies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from auv_gym.channels import channel
from auv_gym.param import spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.campaign.file.settings import EnvExperiment, RunSettings
from identification.campaign.index import Row
from identification.campaign.report.wording import counted, setting_text
from identification.campaign.running.staging import make_campaign_vehicle
from identification.pages.page import amount, span

_STEPS = 8  # of a set point that are listed
_OF_CHANNEL = "channel's"  # unit of a sensor error in the unit of its channel


def setup(
    settings: RunSettings, folder: Path, rows: Sequence[Row], records: Mapping[str, Record]
) -> list[tuple[str, str]]:
    """Pairs of a name and a text; what the grid varies comes last.

    settings: of any run.  folder: that file names in them are relative to.
    """
    grid = dict.fromkeys(key for row in rows for key in row.cell)
    plant = None
    if settings.vehicle is not None:
        with suppress(ValueError):  # the file may no longer exist; the page then has no units
            plant = make_campaign_vehicle(settings.vehicle, folder, effects=False)
    facts = [*_vehicle(settings, plant, grid), *_experiment(settings), *_steering(settings), *_sensors(settings, plant)]
    facts = [(word, text) for key, word, text in facts if text and key not in grid]
    seeds = sorted({row.seed for row in rows})
    facts.append(("seeds" if len(seeds) > 1 else "seed", _compact(seeds)))
    for key in grid:
        values = dict.fromkeys(setting_text(row.cell[key]) for row in rows if key in row.cell)
        facts.append(
            (f"grid, {key}", " ".join([", ".join(values), _unit(plant, key.removeprefix("vehicle."))]).strip())
        )
    if records:
        record = next(iter(records.values()))
        even = "" if record.is_uniform() else " in the median"
        facts.append(("first record", f"{len(record):,} samples, {record.sample_interval:.4g} s apart{even}"))
    return facts


def _vehicle(settings: RunSettings, plant: Plant | None, grid: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    vehicle = settings.vehicle
    if vehicle is not None:
        text = vehicle.preset or str(vehicle.file)
        text += f", {vehicle.dt_s:g} s a sample" if vehicle.dt_s is not None else ""
        yield "vehicle.preset", "vehicle", text
        fixed = {path: value for path, value in vehicle.effects.items() if f"vehicle.{path}" not in grid}
        told = [f"{path.removeprefix('effects.')} {_of_parameter(plant, path, v)}" for path, v in fixed.items()]
        yield "", "effects", ", ".join(told)


def _experiment(settings: RunSettings) -> Iterator[tuple[str, str, str]]:
    experiment = settings.experiment
    if isinstance(experiment, EnvExperiment):
        length = f", {experiment.duration_s:g} s" if experiment.duration_s is not None else ""
        yield "experiment.id", "environment", experiment.env_id + length
        for name, steps in experiment.steps.items():
            told = [f"{amount(value, channel(name).unit)} from {time:g} s" for time, value in steps[:_STEPS]]
            yield "", f"set point of {channel(name).label}", ", ".join([*told, *["..."] * (len(steps) > _STEPS)])
    elif experiment.kind == "mission":
        told = [_setting(key, value, "s" if key == "duration" else "") for key, value in experiment.settings.items()]
        yield "", "mission", ", ".join(["the standard experiment of the vehicle", *told])
    else:
        yield "", "log", experiment.file


def _steering(settings: RunSettings) -> Iterator[tuple[str, str, str]]:
    if settings.controller is not None:
        given = settings.controller.settings
        told = [settings.controller.kind, *(_setting(key, value, "") for key, value in given.items())]
        note = " (SI, radians)" if any(isinstance(value, float) for value in given.values()) else ""
        yield "controller.kind", "controller", ", ".join(told) + note
    for given in settings.excitation:
        told = [_setting(key, value, channel(given.at).unit) for key, value in given.settings.items()]
        yield "", "excitation", ", ".join([f"{given.kind} at {channel(given.at).label}", *told])
    if settings.envelope is not None:
        told = [f"{channel(n).label} {span(limits, channel(n).unit)}" for n, limits in settings.envelope.limits.items()]
        yield "", "envelope", "; ".join(told)


def _sensors(settings: RunSettings, plant: Plant | None) -> Iterator[tuple[str, str, str]]:
    told = [f"{path} {_of_parameter(plant, f'effects.sampling.{path}', v)}" for path, v in settings.sensors.items()]
    yield "", "sensors", ", ".join(told) + (" (SI, radians)" if any(t[-1].isdigit() for t in told) else "")


def _setting(key: str, value: Any, unit: str) -> str:
    """A setting in words; unit: the amplitude's unit."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        if key.endswith("_s"):
            return f"{key.removesuffix('_s')} {value:g} s"
        if key in ("amplitude", "duration") and unit:
            return f"{key} {amount(value, unit)}"
    return f"{key} {setting_text(value)}"


def _of_parameter(plant: Plant | None, path: str, value: float) -> str:
    unit = _unit(plant, path)
    return amount(value, unit) if unit and unit != _OF_CHANNEL else f"{value:g}"


def _unit(plant: Plant | None, path: str) -> str:
    """The unit of a vehicle's parameter; empty if unknown."""
    with suppress(ValueError):
        return spec_at(plant, path).unit if plant is not None else ""
    return ""


def _compact(numbers: Sequence[int]) -> str:
    """`0 to 19 (20 seeds)`, or the numbers if they are few or have gaps."""
    if len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{numbers[0]} to {numbers[-1]} ({counted(len(numbers), 'seed')})"
    return ", ".join(map(str, numbers))
