"""Scaling of a task to a glider: its steady turn at full rudder and its nominal speed give the scales."""

from __future__ import annotations

from math import isfinite

import numpy as np

from auv_gym.envs import tasks
from auv_gym.envs.kind import ScaledTask
from auv_gym.envs.tasks import Task
from auv_gym.param import check_number
from auv_gym.plant import Plant, without_effects


def scale(
    task: Task,
    plant: Plant,
    *,
    duration: float | None,
    target: float | None,
    speed: float | tuple[float, float] | None = None,
    compass_noise: float | None = None,
) -> ScaledTask:
    """Scale a task to a glider; raises for options that are not numbers, and if the rudder does not turn the vehicle.

    speed: m/s, or a range from which each episode draws one; default the vehicle's nominal speed.  compass_noise:
    standard deviation, rad; short for effects.sampling.compass.noise.
    """
    duration = task.duration if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    low = high = 0.0
    if speed is not None:
        pair = speed if isinstance(speed, tuple | list) else (speed, speed)
        if len(pair) != 2:
            raise ValueError(f"speed needs a number or a pair (low, high) in m/s, got {speed!r}.")
        low, high = pair
        check_number("speed", low, "m/s", above=0.0)
        check_number("speed", high, "m/s", at_least=low)
    if compass_noise is not None:
        check_number("compass_noise", compass_noise, "rad", at_least=0.0)
    limit = plant.hull.rudder_limit
    return ScaledTask(
        units={"rate": 1.0, "speed": plant.hull.speed, "turn": _steady_turn(plant)},
        duration=duration,
        stands_for={},
        actions=("rudder_rad",),
        middles=np.zeros(1),
        limits=np.array([limit]),
        start=plant.family.states,
        target_limits={"heading_rad": tasks.HEADINGS},
        effects={} if compass_noise is None else {"effects.sampling.compass.noise": float(compass_noise)},
        read=("heading_rad",),
        driven=("rudder_rad",),
        shortest=task.hold[0],
        least_dt=plant.dt,
        plan={"rudder_limit": limit, "speed": (low, high)},
    )


def _steady_turn(plant: Plant) -> float:
    """Yaw rate after ten minutes of full rudder, rad/s, without effects, so that they do not rescale observations."""
    clean = without_effects(plant)
    u = np.array([clean.constants.get(name, 0.0) for name in clean.inputs])
    u[clean.inputs.index("rudder_rad")] = clean.hull.rudder_limit
    turned = clean.step_over(clean.initial(np.zeros(len(clean.outputs))), u, 600.0)
    rate = abs(float(clean.output(turned)[clean.outputs.index("r_radps")]))
    if not rate > 1e-9 or not isfinite(rate):
        raise ValueError(f"The rudder of {plant.name!r} does not turn the vehicle: check hull.n_delta and hull.n_r.")
    return rate
