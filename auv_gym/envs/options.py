"""Checks of what environments are made from, the same for all of them."""

from __future__ import annotations

import os
from dataclasses import replace
from math import inf, isfinite
from typing import Any

import numpy as np

from auv_gym.model import Model, model_constant_inputs
from auv_gym.models.files import load_model
from auv_gym.plant import Plant, load_vehicle


def resolve_plant(vehicle: str | os.PathLike | Plant, dt: float | None) -> Plant:
    """The plant of a preset, a vehicle file or a plant, at a sample time in s or at its own."""
    if isinstance(vehicle, Plant):
        return vehicle if dt is None else replace(vehicle, dt=dt)
    return load_vehicle(vehicle, dt=dt)


def model_of(model: Model | str | os.PathLike, plant: Plant) -> Model:
    """A model, or that of a model or vehicle file, at the plant's sample time where it can choose."""
    return load_model(model, dt=plant.dt) if isinstance(model, str | os.PathLike) else model


def check_number(name: str, value: Any, unit: str, *, above: float = -inf, at_least: float = -inf) -> None:
    """Raises if an option's value is not a finite number within its bound."""
    number = isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool)
    if not number or not isfinite(value) or not value > above or not value >= at_least:
        bound = f" above {above:g}" if above > -inf else f" of at least {at_least:g}" if at_least > -inf else ""
        raise ValueError(f"{name} needs a number{bound} in {unit}, got {value!r}.")


def check_model_inputs(model: Model, plant: Plant) -> None:
    """Raises if a model asks for an input that an environment with this vehicle does not have."""
    for channel in model.inputs:
        if channel not in plant.inputs and channel not in model_constant_inputs(model):
            raise ValueError(
                f"model= needs an input {channel} that the environment does not have; it has "
                f"{', '.join(plant.inputs)}: fit the model without it."
            )


def check_model_dt(model: Model, plant: Plant) -> None:
    """Raises if a model steps another time than an environment with this vehicle."""
    if abs(model.dt - plant.dt) > 1e-9 * plant.dt:
        raise ValueError(
            f"model= steps {model.dt:g} s and the environment {plant.dt:g} s: make the environment with "
            f"dt={model.dt:g}, or fit the model to record.resample({plant.dt:g})."
        )
