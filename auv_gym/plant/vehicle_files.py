"""Vehicle files: reading them into a `Plant`, and writing them so that reading gives the same plant, bit for bit."""

from __future__ import annotations

import os
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym import __version__
from auv_gym.param import check_value, did_you_mean, list_paths, replace_at, spec_at, value_at
from auv_gym.plant.plant import Plant, check_deviation
from auv_gym.presets import find_vehicle, list_preset_headings
from auv_gym.vehicles import FAMILIES, FAMILY_NAMES
from auv_gym.vehicles.body.files import parse_part_tables, parts_text
from auv_gym.vehicles.former import convert_former_vehicle
from auv_gym.writing import check_ending, quoted, write_text

_FILE_KEYS = (
    "family", "name", "title", "description", "fitted_to", "dt_s", "longest_step_s", "window_s", "settle_s",
    "written_by",
)  # fmt: skip
_TABLES = ("hull", "steering", "parts", "effects")
_ENTRY_KEYS = {"value", "unit", "deviation", "source"}
_ANY = (-np.inf, np.inf)


def list_vehicles() -> dict[str, str]:
    """Names and titles of the presets.

    Example:

        >>> from auv_gym import list_vehicles
        >>> list_vehicles()["remus100"]
        'REMUS 100, torpedo of 1.33 m'
    """
    return {name: heading.title for name, heading in list_preset_headings().items()}


def load_vehicle(name: str | os.PathLike, dt: float | None = None) -> Plant:
    """The plant of a preset name or a vehicle file (TOML); raises an error that says what is wrong, by key.

    Example:

        >>> from auv_gym import load_vehicle
        >>> load_vehicle("slocum").title
        'Slocum glider, first-order yaw'
    """
    plant = _parse(*find_vehicle(name))
    return plant if dt is None else replace(plant, dt=dt)


def save_vehicle(plant: Plant, path: str | os.PathLike, notes: Mapping[str, str] | None = None) -> None:
    """Write a vehicle file that `load_vehicle` reads back bit for bit; written aside, then renamed.

    Raises on a learned hull, which `save_model` writes.

    Example:

        >>> from auv_gym import load_vehicle, replace_at, save_vehicle
        >>> save_vehicle(replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.03), "bent.toml")
        >>> load_vehicle("bent.toml").effects.rudder.offset
        0.03
    """
    if plant.learned is not None:
        raise ValueError(f"A vehicle file has no room for the learned hull of {plant.name}: use save_model, to .npz.")
    check_ending(path, ".toml", "A vehicle file")
    write_text(path, vehicle_text(plant, notes))


def vehicle_text(plant: Plant, notes: Mapping[str, str] | None = None) -> str:
    """The text of a vehicle file; a learned hull is not included."""
    notes = {**plant.notes, **(notes or {})}
    lines = [
        f'family = "{plant.family.name}"',
        f"name = {quoted(plant.name)}",
        f"title = {quoted(plant.title)}",
        f"description = {quoted(plant.description)}",
        *([f"fitted_to = {quoted(plant.fitted_to)}"] if plant.fitted_to else []),
        f"dt_s = {float(plant.dt)!r}",
        f"longest_step_s = {float(plant.longest_step)!r}",
        f"window_s = {float(plant.window)!r}",
        f"settle_s = {float(plant.settle)!r}",
        f'written_by = "auv-gym {__version__}"',
    ]
    table = ""
    said = parts_text(plant.family.body)
    for parameter in list_paths(plant):
        spec, value = spec_at(plant, parameter), value_at(plant, parameter)
        stated = parameter in plant.deviations
        if parameter.startswith("effects.") and value == spec.neutral and not stated:
            continue
        head, _, key = parameter.rpartition(".")
        if head != table:
            table = head
            lines += ["", f"[{table}]", *said.pop(table, ())]
        more = f", deviation = {float(plant.deviations[parameter])!r}" if stated else ""
        more += f", source = {quoted(notes[parameter])}" if parameter in notes else ""
        lines.append(f'{key} = {{ value = {value!r}, unit = "{spec.unit}"{more} }}')
    return "\n".join(lines) + "\n"


def vehicle_of_text(text: str, origin: str) -> Plant:
    """The plant of a vehicle file's text; raises an error that says what is wrong, by key."""
    return _parse(text, origin)


def _parse(text: str, origin: str) -> Plant:
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"Vehicle file {origin} is not valid TOML: {error}.") from None
    try:
        content = convert_former_vehicle(content)
    except ValueError as error:
        raise ValueError(f"Vehicle file {origin}: {error}.") from None
    named = content.get("family")
    if not isinstance(named, str) or named not in FAMILY_NAMES:
        got = "none" if named is None else repr(named)
        raise ValueError(f"Vehicle file {origin} needs family = one of {', '.join(FAMILY_NAMES)}, got {got}.")
    for key, value in content.items():
        if key not in _FILE_KEYS and key not in _TABLES:
            hint = did_you_mean(key, (*_FILE_KEYS, *_TABLES))
            known = ", ".join((*_FILE_KEYS, *_TABLES))
            raise ValueError(f"Vehicle file {origin} has an unknown key {key!r}. {hint}Known: {known}.")
        kind, wanted = (dict, "a table") if key in _TABLES else (str, "text in quotes")
        if key.endswith("_s"):
            kind, wanted = (int | float, "a number of seconds")
        if not isinstance(value, kind) or isinstance(value, bool):
            raise ValueError(f"Vehicle file {origin}: {key} needs {wanted}, got {value!r}.")
    try:
        if named in FAMILIES:
            family = FAMILIES[named]
        else:
            family, content = parse_part_tables(content)
    except ValueError as error:
        raise ValueError(f"Vehicle file {origin}: {str(error).rstrip('.')}.") from None
    tables = {key: content[key] for key in _TABLES if key in content}
    parameters = family.parameters()
    values, notes, primes, deviations = {}, {}, [], {}
    for path, entry in _leaves(tables, ""):
        try:
            spec = spec_at(parameters, path)
        except ValueError as error:
            raise ValueError(f"Vehicle file {origin}: {error}") from None
        entry = entry if isinstance(entry, dict) else {"value": entry}
        for key in entry.keys() - _ENTRY_KEYS:
            raise ValueError(
                f"Vehicle file {origin}: {path} has an unknown key {key!r}. Known: {', '.join(sorted(_ENTRY_KEYS))}."
            )
        value, unit = entry.get("value"), entry.get("unit", spec.unit)
        if unit == "prime":
            primes.append(path)
            unit = spec.unit
        if unit != spec.unit:
            raise ValueError(f"Vehicle file {origin}: {path} is in {spec.unit}, got unit {unit!r}: convert the value.")
        try:
            values[path] = check_value(path, value, spec._replace(bounds=_ANY) if path in primes else spec)
            if "deviation" in entry:
                check_deviation(parameters, path, entry["deviation"])
                deviations[path] = float(entry["deviation"])
        except ValueError as error:
            raise ValueError(f"Vehicle file {origin}: {error}") from None
        if "source" in entry:
            notes[path] = str(entry["source"])
    for path in primes:
        spec = spec_at(parameters, path)
        try:
            scale = _prime_scale(
                replace_at(parameters, _given(values, ("hull.density", "hull.length"))), path, spec.unit
            )
            values[path] = check_value(path, values[path] * scale, spec)
            if path in deviations:
                deviations[path] *= abs(scale)
        except ValueError as error:
            raise ValueError(f"Vehicle file {origin}: {error}") from None
    given = {field: content.get(f"{field}_s") for field in ("dt", "longest_step", "window", "settle")}
    times: dict[str, Any] = {field: float(value) for field, value in given.items() if value is not None}
    plant = Plant(
        name=content.get("name", Path(origin).stem),
        family=family,
        parameters=replace_at(parameters, values),
        **times,
        title=content.get("title", ""),
        description=content.get("description", ""),
        notes=notes,
        deviations=deviations,
        fitted_to=content.get("fitted_to", ""),
    )
    problem = family.problem(plant.parameters)
    if problem:
        raise ValueError(f"Vehicle file {origin}: {problem}.")
    for doubt in family.doubts(plant.parameters):
        warnings.warn(f"Vehicle file {origin}: {doubt}.", stacklevel=4)
    return plant


def _given(values: Mapping[str, float], paths: Sequence[str]) -> dict[str, float]:
    return {path: values[path] for path in paths if path in values}


def _prime_scale(parameters: Any, path: str, unit: str) -> float:
    """The factor that makes a coefficient of the prime system dimensional: rho L^n / 2 for the unit kg m^(n - 3)."""
    powers = {"kg/m": 2, "kg": 3, "kg m": 4, "kg m^2": 5, "kg m^3": 6}
    if unit not in powers or not hasattr(parameters.hull, "length"):
        raise ValueError(f"{path} is in {unit}, which has no prime form: give the value in {unit}.")
    return 0.5 * parameters.hull.density * parameters.hull.length ** powers[unit]


def _leaves(table: Mapping[str, Any], prefix: str):
    for key, entry in table.items():
        path = f"{prefix}{key}"
        if isinstance(entry, dict) and not _ENTRY_KEYS & entry.keys():
            yield from _leaves(entry, f"{path}.")
        else:
            yield path, entry
