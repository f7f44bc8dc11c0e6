"""Trim of a glider: its neutral engine volume, its steady flight, and the positions of its masses for it."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, pi
from typing import NamedTuple

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import value_at
from auv_gym.physics.buoyancy import GRAVITY
from auv_gym.plant import Plant
from auv_gym.vehicles.glide import GlideHull, flight, flight_at, net_buoyancy
from auv_gym.vehicles.glide_steered import GLIDE_STEERED

STEP = 30.0  # s between commands of a steered glider: a Seaglider's sample interval in deep water
_BEYOND = 0.05  # of the engine's range; tolerance for logged volumes outside it
NOMINAL_PITCH = 0.4  # rad; operators fly at 15 to 30 degrees


class Flight(NamedTuple):
    """Steady flight: speed through the water, m/s, path angle, rad, positive up, and angle of attack, rad."""

    speed: float
    path: float
    attack: float


def neutral_engine(plant: Plant, depth: float, density: float | None = None, temperature: float | None = None) -> float:
    """The engine's volume, m^3, at which a glider neither sinks nor rises at a depth, m.

    density: kg/m^3, and temperature: degC, of the water; by default those of the hull, as without measurements.
    Raises ValueError for a vehicle that does not fly by a polar.
    """
    _check_polar(plant)
    hull, p = plant.hull, plant.family.view(plant.derived)
    water = hull.density if density is None else density
    force = net_buoyancy(depth, 0.0, 0.0, hull.temperature if temperature is None else temperature, water, 0.0, p)
    return float(-force / (GRAVITY * water))


def steady_flight(plant: Plant, depth: float, **inputs: float) -> Flight:
    """Steady flight at a depth, m; inputs: by channel, those not named have their values for records without them.

    Raises ValueError for a vehicle that does not fly by a polar at a given attitude, and for inputs out of its range.
    """
    _check_polar(plant)
    unknown = sorted(set(inputs) - set(plant.inputs))
    if unknown:
        raise ValueError(f"{plant.name} has no input {unknown[0]!r}: it has {', '.join(plant.inputs)}.")
    if "pitch_rad" not in plant.inputs:
        raise ValueError(
            f"steady_flight needs a glider whose pitch is an input, and {plant.name!r} is steered by its masses: give "
            "the plant that `steered` was called with."
        )
    hull = plant.hull
    slack = _BEYOND * (hull.engine_high - hull.engine_low)
    limits = {
        "buoyancy_volume_m3": (hull.engine_low - slack, hull.engine_high + slack),
        "pitch_rad": (-0.5 * pi, 0.5 * pi),
    }
    for name, value in {"depth": depth, **inputs}.items():
        low, high = limits.get(name, (-inf, inf))
        if not (isfinite(value) and low <= value <= high):
            bounds = f" from {low:.3g} to {high:.3g} {channel(name).unit}" if name in limits else ""
            raise ValueError(f"steady_flight needs a finite {name}{bounds}, got {value!r}: check its unit and sign.")
    named = {name: value_at(plant, path) for name, path in plant.family.constants.items()} | inputs
    u = np.array([named.get(name, 0.0) for name in plant.inputs])
    actuators = u[: len(plant.family.actuators)].copy()
    return Flight(*map(float, flight(depth, 0.0, actuators, u, 0.0, plant.family.view(plant.derived))))


def nominal_flight(plant: Plant, depth: float, lift: float, pitch: float = NOMINAL_PITCH) -> Flight:
    """Steady flight at a depth, m, with the engine `lift`, m^3, off neutral; pitch: rad, bow up if that rises."""
    hull, engine = plant.hull, neutral_engine(plant, depth) + lift
    pitch = pitch if lift > 0.0 else -pitch
    p = plant.family.view(plant.derived)
    return Flight(*map(float, flight_at(depth, 0.0, engine, hull.temperature, pitch, hull.density, 0.0, p)))


def steered(plant: Plant, dt: float | None = STEP) -> Plant:
    """The glider with its masses as inputs instead of its attitude; raises if their effect is unknown.

    dt: s between commands, None for the vehicle's own.
    """
    _check_polar(plant)
    steering = plant.parameters.steering
    if not steering.pitch_mass or not (steering.turn_roll * steering.roll_mass or steering.turn_rudder):
        raise ValueError(
            f"{plant.name} cannot be steered: it needs steering.pitch_mass, and steering.turn_rudder or roll_mass and "
            "turn_roll, which are 0: give them in the table [steering] of its vehicle file."
        )
    return replace(plant, family=GLIDE_STEERED, dt=plant.dt if dt is None else dt)


def _check_polar(plant: Plant) -> None:
    """Raise ValueError for a vehicle that does not fly by a polar."""
    if not isinstance(plant.hull, GlideHull):
        raise ValueError(
            f"A glider that flies by a polar is needed, such as the presets slocum_flight and seaglider; got "
            f"{plant.name!r} of family {plant.family.name!r}."
        )


def battery_for(plant: Plant, pitch: float, engine: float) -> float:
    """The battery's position, m, for a pitch, rad, with the engine at a volume, m^3, within the battery's travel."""
    s = plant.parameters.steering
    position = (pitch - s.pitch - s.pitch_engine * engine) / s.pitch_mass
    return min(max(position, s.battery_low), s.battery_high)


def turning_input(plant: Plant) -> tuple[str, float]:
    """The input that turns a steered glider (its fin or its battery's roll angle) and its largest value, rad."""
    s = plant.parameters.steering
    return ("rudder_rad", s.rudder_limit) if s.turn_rudder else ("battery_roll_rad", s.roll_limit)
