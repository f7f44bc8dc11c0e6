"""Scaling of a task to a profiling float: its buoyancy engine gives the scales, its trim the initial state."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs import tasks
from auv_gym.envs.kind import ScaledTask
from auv_gym.envs.tasks import ENGINE, Task
from auv_gym.param import check_number
from auv_gym.plant import Plant
from auv_gym.plant.float_engine import find_engine


def scale(
    task: Task, plant: Plant, *, duration: float | None, target: float | None, near: Any = None, depths: Any = None
) -> ScaledTask:
    """Scale a task to a float; raises for options that are not pairs, and if the float cannot dive both ways.

    near: (m, s), length of a step while the error is smaller than the first.  depths: m, range of starts and drawn
    targets.
    """
    engine, family = find_engine(plant), plant.family
    speed, length, rate = engine.speed, engine.speed * engine.time, 1.0 / engine.time
    duration = task.duration / rate if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    if near is not None:
        _check_pair("near", near, "(m, s), the error within which steps are shorter, and their time")
        check_number("near[0]", near[0], "m", above=0.0)
        check_number("near[1]", near[1], "s", above=0.0)
        if not near[1] <= plant.dt:
            raise ValueError(
                f"near= needs a time of at most dt = {plant.dt:g} s, got {near[1]!r} s: give a larger dt=."
            )
    depths = tuple(k * length for k in tasks.DIVE_DEPTHS) if depths is None else depths
    _check_pair("depths", depths, "(shallowest, deepest) in m, for starts and drawn targets")
    check_number("depths[0]", depths[0], "m", at_least=0.0)
    check_number("depths[1]", depths[1], "m", above=depths[0])
    deepest, fastest = tasks.DIVE_LIMIT * max(depths[1], target or 0.0), tasks.SPEED_LIMIT * speed
    trim = tasks.DIVE_TRIM * engine.half * engine.volume
    return ScaledTask(
        units={"length": length, "speed": speed, "rate": rate, "deepest": depths[1]},
        duration=duration,
        stands_for={ENGINE: engine.channel},
        actions=(engine.channel,),
        middles=np.array([engine.middle]),
        limits=np.array([engine.half]),
        start=family.states,
        start_limits={"depth_m": (0.0, deepest), "depth_rate_mps": (-fastest, fastest)},
        target_limits={"depth_m": (0.0, min(deepest, tasks.SEA))},
        randomise={"effects.volume.offset": (-trim, trim)},
        read=(task.channel,),
        driven=(engine.channel,),
        shortest=task.hold[0] / rate,
        least_dt=plant.dt if near is None else near[1],
        plan={
            "duration": duration,
            "near": 0.0 if near is None else near[0],
            "near_dt": plant.dt if near is None else near[1],
            "start_depth": depths,
            "target_band": depths,
            "engine": family.inputs.index(engine.channel),
            "engine_middle": engine.middle,
            "engine_half": engine.half,
            "engine_rate": engine.rate / engine.half,
            "holds_back": engine.channel != "piston_m",
            "depth_limit": deepest,
            "speed_limit": fastest,
        },
        own_ages=True,
    )


def _check_pair(name: str, pair: Any, meaning: str) -> None:
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise ValueError(f"{name}= needs a pair {meaning}, got {pair!r}.")
