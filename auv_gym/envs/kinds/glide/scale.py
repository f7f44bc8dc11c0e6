"""Scaling of a task to a flying glider: a yo at a usual pitch to the bottom gives the scales."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from auv_gym.envs import tasks
from auv_gym.envs.kind import ScaledTask
from auv_gym.envs.options import check_waypoints
from auv_gym.envs.tasks import TURNING, Task
from auv_gym.param import check_number
from auv_gym.physics.buoyancy import GRAVITY
from auv_gym.plant import Plant, without_effects
from auv_gym.plant.flying import STEP, neutral_engine, nominal_flight, steered, turning_input


def prepare(plant: Plant, dt: float | None) -> Plant:
    """The glider with its masses as inputs; if its attitude was the input, the step is 30 s unless dt is given."""
    return plant if "battery_position_m" in plant.inputs else steered(plant, STEP if dt is None else dt)


def scale(
    task: Task,
    plant: Plant,
    *,
    duration: float | None,
    target: float | None,
    bottom: float = tasks.BOTTOM,
    waypoints: Sequence[Sequence[float]] | None = None,
) -> ScaledTask:
    """Scale a task to a glider; raises for options that are not numbers, and if its engine cannot move it both ways.

    bottom: m, the depth of the water.  waypoints: rows of north, east and 0, m; by default they are drawn.
    """
    if target is not None:
        raise ValueError(f"{task.name} has waypoints, not a target: give waypoints= as rows of north, east and 0, m.")
    check_number("bottom", bottom, "m", at_least=tasks.SHALLOWEST)
    hull, steering, family = plant.hull, plant.parameters.steering, plant.family
    clean = without_effects(plant)
    neutral = neutral_engine(clean, 0.5 * bottom)
    half = min(neutral - hull.engine_low, hull.engine_high - neutral)
    if not half > 0.0:
        raise ValueError(
            f"The engine of {plant.name!r} cannot take it down and up: it is neutral at {neutral:.4g} m^3, and goes "
            f"from {hull.engine_low:g} to {hull.engine_high:g}: check hull.mass and hull.volume."
        )
    down, up = nominal_flight(clean, 0.5 * bottom, -half), nominal_flight(clean, 0.5 * bottom, half)
    speed = 0.5 * (down.speed * cos(down.path) + up.speed * cos(up.path))
    yo = bottom / abs(down.speed * sin(down.path)) + bottom / abs(up.speed * sin(up.path))
    length = speed * yo
    slowness = hull.engine_slowness + steering.pump_slowness
    pump = hull.density * GRAVITY / steering.pump_efficiency
    duration = task.duration * yo if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    turning, turn = turning_input(plant)
    actions = ("buoyancy_volume_m3", "battery_position_m", turning)
    at = [family.inputs.index(name) for name in actions]
    low = np.array([hull.engine_low, steering.battery_low, -turn])
    high = np.array([hull.engine_high, steering.battery_high, turn])
    middles, limits = 0.5 * (low + high), 0.5 * (high - low)
    ranged = {name: np.zeros(len(family.actuators)) for name in ("middle", "limit")} | {
        "action_of": np.full(len(family.actuators), -1.0)
    }
    ranged["middle"][at], ranged["limit"][at], ranged["action_of"][at] = middles, limits, range(len(at))
    largest = task.current * speed
    return ScaledTask(
        units={"length": length, "speed": speed, "rate": 1.0 / yo, "deepest": bottom},
        duration=duration,
        stands_for={TURNING: turning},
        actions=actions,
        middles=middles,
        limits=limits,
        start=family.states,
        start_limits={"depth_m": (0.0, bottom)},
        randomise=dict.fromkeys(("effects.current.north", "effects.current.east"), (-largest, largest)),
        read=("depth_m", "north_m", "east_m", "roll_rad", "pitch_rad", "heading_rad"),
        driven=actions,
        shortest=tasks.YOS[0] * length / (2.0 * speed),
        least_dt=plant.dt,
        plan={
            **tasks.yo_plan(length, speed + largest, slowness, pump, pump * bottom * 2.0 * half / yo, steering.hotel),
            "bottom": bottom,
            "usual_attack": 0.5 * (abs(down.attack) + abs(up.attack)),
            **ranged,
        },
        tables={"waypoints": check_waypoints(waypoints, 0.0)},
    )
