"""Vehicles with constants from a log: those of the operators' model, which are written with each dive."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant.plant import Plant
from auv_gym.plant.vehicle_files import load_vehicle
from auv_gym.records.reading import find_log, open_log


def vehicle_from_dive(path: str | os.PathLike, vehicle: str | os.PathLike = "seaglider") -> Plant:
    """The glider of a dive's file, with the constants that its operators state there (`sg_cal_`).

    vehicle: a preset or a vehicle file, for what the file does not state.  Raises ValueError if the file states
    nothing.
    """
    plant = load_vehicle(vehicle)
    found, changed = as_stated(plant, path)
    if not changed:
        raise ValueError(
            f"{Path(path).name} states no constant of {plant.name} (sg_cal_mass and others): give a dive as the "
            "operators' software writes it, or load_vehicle and a file of your own."
        )
    return found


def as_stated(plant: Plant, path: str | os.PathLike) -> tuple[Plant, tuple[str, ...]]:
    """The plant with the values that a log states instead of its own, and the paths of these.

    Only vehicles that represent a series are changed (`hull.as_logged`).  Raises ValueError for an impossible value.
    """
    if plant.family.stated is None:
        return plant, ()
    file = find_log(os.fspath(path))
    attrs = open_log(file).attrs
    values = plant.family.stated(plant.parameters, attrs)
    if not values:
        return plant, ()
    for name, value in values.items():
        low, high = spec_at(plant, name).bounds
        if not low <= value <= high:
            raise ValueError(
                f"{file.name} states {name} = {value:g} {spec_at(plant, name).unit}, which needs {low:g} to {high:g}: "
                "correct the constants of the file, or give a vehicle file of your own."
            )
    changed = replace_at(plant, values)
    problem = plant.family.problem(changed.parameters)
    if problem:
        raise ValueError(f"{file.name} states constants that cannot be of {plant.name}: {problem}.")
    notes = {**plant.notes, **dict.fromkeys(values, f"stated by {file.name}")}
    # the relative uncertainty of a coefficient stays the same
    scales = {name: abs(value_at(changed, name) / value_at(plant, name)) for name in values if name in plant.deviations}
    deviations = {name: scales.get(name, 1.0) * own for name, own in plant.deviations.items()}
    name = str(attrs.get("platform_id", plant.name)).lower()
    title = f"{plant.title}, {name.upper()}" if name != plant.name else plant.title
    return replace(changed, name=name, title=title, notes=notes, deviations=deviations), tuple(values)
