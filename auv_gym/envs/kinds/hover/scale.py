"""Scaling of a task to a vehicle moved by thrusters: its length and attainable speeds are the scales."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan

import numpy as np

from auv_gym.envs import tasks
from auv_gym.envs.kernel.body import START
from auv_gym.envs.kind import ScaledTask
from auv_gym.envs.kinds.hover.hooks import LAST
from auv_gym.envs.options import check_actions, check_targets, check_waypoints
from auv_gym.envs.tasks import Observed, Task
from auv_gym.param import check_number
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits, command_middles
from auv_gym.plant.hover import Hover, find_hover

THRUSTERS, WRENCH = "thrusters", "wrench"  # values of actions= other than channels
_CONTROLLED_BY = {"roll_rad": "roll", "pitch_rad": "pitch"}  # the axis needed for a pose with such an angle


def scale(
    task: Task,
    plant: Plant,
    *,
    duration: float | None,
    target: Mapping[str, float] | None,
    waypoints: Sequence[Sequence[float]] | None = None,
    actions: str | Sequence[str] | None = None,
) -> ScaledTask:
    """Scale a task to a vehicle; raises for impossible targets, waypoints or actions, and if it cannot hold itself.

    target: parts of the pose, by channel, that are not drawn.  waypoints: rows of north, east, depth, m; by default
    they are drawn.  actions: "thrusters", their commands, by default; "wrench", forces and moments; axes of it, such as
    ("surge", "yaw"); or channels.
    """
    if task.targets and waypoints is not None:
        raise ValueError(f"{task.name} has a pose, not waypoints: give target= with values by channel.")
    if not task.targets and target is not None:
        raise ValueError(
            f"{task.name} has waypoints, not a target: give waypoints= as rows of north, east and depth in m."
        )
    duration = task.duration if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    fixed = (
        check_targets("target", {} if target is None else target, task)
        if task.targets
        else dict.fromkeys(tasks.POSE, nan)
    )
    if np.isnan(fixed["roll_rad"]):
        fixed["roll_rad"] = 0.0
    if np.isnan(fixed["pitch_rad"]):
        fixed["pitch_rad"] = 0.0
    hover, family = find_hover(plant), plant.family
    length, speed = plant.hull.length, hover.speed
    rate, deepest = speed / length, tasks.DEPTH_LIMIT * length
    largest = task.current * speed
    middles, limits = command_middles(plant), command_limits(plant)
    chosen = _chosen(actions, plant, hover)
    by_wrench = set(chosen) <= set(hover.axes)
    axes = [hover.axes.index(name) for name in chosen] if by_wrench else []
    largest_wrench = np.array(list(hover.largest.values()))[axes]
    moved = [family.inputs.index(name) for name in chosen] if not by_wrench else []
    where = task.targets or ("north_m", "east_m", "depth_m", "heading_rad")
    per_action = hover.allocation[:, axes] * largest_wrench
    idle = hover.thrusters.idle
    rows = [[at, i, held, *push] for at, i, held, push in zip(hover.thrusters.at, idle, hover.thrusts, per_action)]
    return ScaledTask(
        units={"length": length, "speed": speed, "rate": rate, "turn": hover.speeds.get("yaw", rate)},
        duration=duration,
        stands_for={},
        actions=chosen,
        middles=hover.wrench[axes] if by_wrench else middles[moved],
        limits=largest_wrench if by_wrench else limits[moved],
        start=START,
        randomise=dict.fromkeys(("effects.current.north", "effects.current.east"), (-largest, largest))
        if largest > 0.0
        else {},
        read=(*(o.source for o in task.observed if o.source in plant.outputs), *where),
        driven=hover.thrusters.channels if by_wrench else chosen,
        # two changes per pose, since a pose has more numbers than one change has draws
        shortest=task.hold[0] / rate / 2.0 if task.targets else tasks.LEG[0] * length / (2.0 * speed),
        least_dt=plant.dt,
        start_limits=tasks.start_limits(deepest, speed, rate),
        target_limits={
            name: span if _CONTROLLED_BY.get(name, "") in ("", *hover.axes) else (0.0, 0.0)
            for name, span in tasks.target_limits(length, speed).items()
        },
        observed=tuple(
            Observed(f"last_{name}", LAST[k]) if by_wrench else Observed(name, name) for k, name in enumerate(chosen)
        ),
        plan={
            "kept_state": hover.state,
            "kept_command": hover.commands,
            "limit": limits,
            "middle": middles,
            "action_of": [chosen.index(name) if name in chosen else -1 for name in family.actuators],
            "by_wrench": by_wrench,
            "redrawn": task.step[1] > 0.0,
            "fixed": list(fixed.values()),
            "size": length,
            "attitude_scale": tasks.ATTITUDE_SCALE,
            "sum_rate": rate * plant.dt,
            "sum_limit": tasks.SUM_LIMIT,
            "follows_path": not task.targets,
            **tasks.legs_and_limits(length, speed, rate, tasks.THRUST_PATH_SPEED),
        },
        tables={
            "waypoints": check_waypoints(waypoints, deepest),
            "thrusters": rows,
            "curves": hover.thrusters.curves.reshape(-1, 2),
        },
    )


def _chosen(actions: str | Sequence[str] | None, plant: Plant, hover: Hover) -> tuple[str, ...]:
    """The inputs or axes of the actions; raises for those that the vehicle does not have."""
    if actions is None or (isinstance(actions, str) and actions == THRUSTERS):
        return hover.thrusters.channels
    if isinstance(actions, str):
        if actions == WRENCH:
            return hover.axes
        raise ValueError(
            f"actions= is {THRUSTERS!r}, {WRENCH!r} or a list of axes ({', '.join(hover.axes)}) or of inputs of "
            f"{plant.name}, got {actions!r}."
        )
    return tuple(check_actions(actions, plant, hover.axes))
