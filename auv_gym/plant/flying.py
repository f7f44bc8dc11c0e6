"""What a glider's plant flies by: its neutral engine volume, and speed and path of its steady flight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from auv_gym.param import value_at
from auv_gym.physics.buoyancy import GRAVITY
from auv_gym.plant import Plant
from auv_gym.vehicles.glide import flight, net_buoyancy


class Flight(NamedTuple):
    """Steady flight: speed through the water, m/s, path angle, rad, positive up, and angle of attack, rad."""

    speed: float
    path: float
    attack: float


def neutral_engine(plant: Plant, depth: float, density: float | None = None, temperature: float | None = None) -> float:
    """The engine's volume, m^3, at which a glider neither sinks nor rises at a depth, m.

    density: kg/m^3, and temperature: degC, of the water; by default those of the hull, as where nothing is measured.
    """
    hull, p = plant.hull, plant.family.view(plant.derived)
    water = hull.density if density is None else density
    force = net_buoyancy(depth, 0.0, 0.0, hull.temperature if temperature is None else temperature, water, 0.0, p)
    return float(-force / (GRAVITY * water))


def steady_flight(plant: Plant, depth: float, **inputs: float) -> Flight:
    """Steady flight at a depth, m; inputs: by channel, those that are not named as in a record without them."""
    unknown = sorted(set(inputs) - set(plant.inputs))
    if unknown:
        raise ValueError(f"{plant.name} has no input {unknown[0]!r}: it has {', '.join(plant.inputs)}.")
    named = {name: value_at(plant, path) for name, path in plant.family.constants.items()} | inputs
    u = np.array([named.get(name, 0.0) for name in plant.inputs])
    actuators = u[: len(plant.family.actuators)].copy()
    return Flight(*map(float, flight(depth, 0.0, actuators, u, 0.0, plant.family.view(plant.derived))))
