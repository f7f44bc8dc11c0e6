"""Scaling of a task to a glider in six degrees of freedom: a yo in steady glides gives the scales."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

from auv_gym.envs import tasks
from auv_gym.envs.kernel.body import START
from auv_gym.envs.kind import ScaledTask
from auv_gym.envs.options import check_waypoints
from auv_gym.envs.tasks import Task
from auv_gym.param import check_number
from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import command_limits, command_middles
from auv_gym.plant.gliding import engine_half, find_masses, usual_glide


def scale(
    task: Task,
    plant: Plant,
    *,
    duration: float | None,
    target: float | None,
    bottom: float = tasks.WATER,
    waypoints: Sequence[Sequence[float]] | None = None,
    hotel: float = tasks.HOTEL,
    pump_efficiency: float = tasks.PUMP_EFFICIENCY,
) -> ScaledTask:
    """Scale a task to a glider; raises for options that are not numbers, and if its engine cannot move it both ways.

    bottom: m, the depth of the water.  waypoints: rows of north, east and 0, m; by default they are drawn.  hotel: W,
    of everything except the pump.  pump_efficiency: share of the pump's power that does work against the pressure.
    """
    if target is not None:
        raise ValueError(f"{task.name} has waypoints, not a target: give waypoints= as rows of north, east and 0, m.")
    check_number("bottom", bottom, "m", at_least=tasks.SHALLOWEST)
    check_number("hotel", hotel, "W", at_least=0.0)
    check_number("pump_efficiency", pump_efficiency, "1", above=0.0)
    family, masses, middle = plant.family, find_masses(plant), 0.5 * bottom
    half, (down, up) = engine_half(plant, middle), (usual_glide(plant, side, middle) for side in (-1.0, 1.0))
    speed = 0.5 * (down.speed * cos(down.path) + up.speed * cos(up.path))
    yo = bottom / abs(down.speed * sin(down.path)) + bottom / abs(up.speed * sin(up.path))
    length, own = speed * yo, float(plant.hull.length)
    clean = without_effects(plant)
    _, _, slowness = family.hooks.actuator_times(masses.volume, family.view(clean.derived))
    pump = plant.hull.density * plant.hull.gravity / pump_efficiency
    duration = task.duration * yo if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    moved = [masses.volume, masses.slide, masses.turn]
    actions = tuple(family.inputs[k] for k in moved)
    middles, limits = command_middles(plant), command_limits(plant)
    largest = task.current * speed
    return ScaledTask(
        units={
            "length": length, "speed": speed, "rate": 1.0 / yo, "turn": tasks.TURN_RATE * speed / own,
            "deepest": bottom,
        },
        duration=duration,
        stands_for=dict(zip(tasks.INSIDE, actions, strict=True)),
        actions=actions,
        middles=middles[moved],
        limits=limits[moved],
        start=START,
        start_limits=tasks.start_limits(bottom, speed, speed / own),
        randomise=dict.fromkeys(("effects.current.north", "effects.current.east"), (-largest, largest)),
        read=(*(o.source for o in task.observed if o.source in plant.outputs), "north_m", "east_m", "heading_rad"),
        driven=actions,
        shortest=tasks.YOS[0] * length / (2.0 * speed),
        least_dt=plant.dt,
        plan={
            **tasks.legs_and_limits(own, speed, speed / own, 1.0),
            "kept_state": down.state,
            "kept_command": down.commands,
            "limit": limits,
            "middle": middles,
            "action_of": [actions.index(name) if name in actions else -1 for name in family.actuators],
            "start_depth": [k * bottom for k in tasks.DIVE_START],
            "depth_limit": bottom,
            **tasks.yo_plan(length, speed + largest, slowness, pump, pump * bottom * 2.0 * half / yo, hotel),
        },
        tables={"waypoints": check_waypoints(waypoints, 0.0)},
    )  # fmt: skip
