"""Checks of the options that all environments share."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, nan
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.envs.tasks import Task
from auv_gym.model import Model, check_model, model_constant_inputs
from auv_gym.models.files import load_model
from auv_gym.param import check_number, did_you_mean
from auv_gym.plant import Plant, load_vehicle


def resolve_plant(vehicle: str | os.PathLike | Plant, dt: float | None) -> Plant:
    """The plant of a preset, a vehicle file or a plant; dt: its sample time, s, or its own."""
    if isinstance(vehicle, Plant):
        return vehicle if dt is None else replace(vehicle, dt=dt)
    return load_vehicle(vehicle, dt=dt)


def model_of(model: Model | str | os.PathLike, plant: Plant) -> Model:
    """A model, possibly from a model or vehicle file, at the plant's sample time if that can be chosen."""
    if isinstance(model, str | os.PathLike):
        return load_model(model, dt=plant.dt)
    check_model("model=", model)
    return model


def check_model_inputs(model: Model, plant: Plant) -> None:
    """Raise if a model needs an input that an environment with this vehicle does not have."""
    for name in model.inputs:
        if name not in plant.inputs and name not in model_constant_inputs(model):
            raise ValueError(
                f"model= needs an input {name} that the environment does not have; it has "
                f"{', '.join(plant.inputs)}: fit the model without it."
            )


def check_model_dt(model: Model, plant: Plant) -> None:
    """Raise if a model's time step differs from that of an environment with this vehicle."""
    if abs(model.dt - plant.dt) > 1e-9 * plant.dt:
        raise ValueError(
            f"model= steps {model.dt:g} s and the environment {plant.dt:g} s: make the environment with "
            f"dt={model.dt:g}, or fit the model to record.resample({plant.dt:g})."
        )


def check_targets(name: str, given: Any, task: Task) -> dict[str, float]:
    """All targets of a task by channel, NaN if not given; raises for other channels and non-numeric values."""
    if not isinstance(given, Mapping):
        example = f"{{{task.targets[0]!r}: 3.0}}"
        raise ValueError(
            f"{name} needs values by channel, such as {example}, of {', '.join(task.targets)}; got {given!r}."
        )
    for target, value in given.items():
        if target not in task.targets:
            raise ValueError(f"{name} has {', '.join(task.targets)}, got {target!r}.")
        check_number(f"{name}[{target!r}]", value, "the channel's unit")
    return {target: float(given.get(target, nan)) for target in task.targets}


def check_limits(name: str, given: Mapping[str, float], limits: Mapping[str, tuple[float, float]]) -> None:
    """Raise for targets or initial values, by channel, beyond the limits of the vehicle or the environment."""
    for target, value in given.items():
        low, high = limits.get(target, (-inf, inf))
        if not low <= value <= high:
            unit = channel(target).unit
            needed = (
                f"has to stay at {low:g} {unit}, since the vehicle cannot control it"
                if low == high
                else f"needs a value from {low:.3g} to {high:.3g} {unit}, the limits of the environment"
            )
            raise ValueError(f"{name}[{target!r}] {needed}; got {value:g}.")


def check_actions(actions: Sequence[str], plant: Plant, axes: Sequence[str] = ()) -> list[str]:
    """The inputs, or the axes of a wrench, requested as actions; raises for those that the vehicle does not have."""
    inputs = list(plant.family.actuators)
    can = [*axes, *inputs]
    if isinstance(actions, str) or not actions or len(set(actions)) < len(actions):
        raise ValueError(f"actions= needs one or more names, each once, of {', '.join(can)}; got {actions!r}.")
    for name in actions:
        if name not in can:
            has = f"It has the axes {', '.join(axes)}, and the inputs " if axes else "It has "
            raise ValueError(
                f"actions= has {name!r}, which does not move {plant.name}. {did_you_mean(name, can)}"
                f"{has}{', '.join(inputs)}."
            )
    if 0 < len({*actions} & {*axes}) < len(actions):
        raise ValueError(f"actions= needs axes alone or inputs alone, got both: {', '.join(actions)}.")
    return list(actions)


def check_by_path(name: str, given: Any) -> None:
    """Raise if an option has no values by parameter path."""
    if given is not None and not isinstance(given, Mapping):
        raise ValueError(
            f"{name} needs values by parameter path, got {given!r}: `auv-gym list effects VEHICLE` lists the paths."
        )


def check_waypoints(waypoints: Sequence[Sequence[float]] | None, deepest: float) -> np.ndarray:
    """Waypoints as rows of north, east and depth in m, (k, 3), empty if they are drawn; raises for invalid ones."""
    if waypoints is None:
        return np.zeros((0, 3))
    try:
        points = np.asarray(waypoints, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty((0, 3))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise ValueError(
            f"waypoints needs one or more rows of north, east and depth, finite numbers in m, got {waypoints!r}."
        )
    if not ((points[:, 2] >= 0.0) & (points[:, 2] <= deepest)).all():
        needed = f"from 0 to {deepest:.3g} m" if deepest > 0.0 else "of 0 m, as they are at the surface"
        raise ValueError(f"waypoints needs depths {needed}, got {', '.join(f'{depth:g}' for depth in points[:, 2])}.")
    if not np.abs(np.diff(points, axis=0)).sum(axis=1).all():
        raise ValueError(f"waypoints needs no waypoint twice in a row, got {waypoints!r}.")
    return points
