"""Scaling of a task to a body with fins and a drive.

Its cruise gives the scales, the initial state and the gains of the held fins.
"""

from __future__ import annotations

from collections.abc import Sequence

from auv_gym.envs import tasks
from auv_gym.envs.kernel.body import START
from auv_gym.envs.kind import ScaledTask
from auv_gym.envs.options import check_actions, check_waypoints
from auv_gym.envs.tasks import PROPULSION, Task
from auv_gym.param import check_number
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits, command_middles, find_cruise, find_helm

_HELD = {  # readings used by the regulators of held fins
    "yaw": ("v_mps", "r_radps", "heading_rad"),
    "pitch": ("w_mps", "q_radps", "pitch_rad", "depth_m"),
}


def scale(
    task: Task,
    plant: Plant,
    *,
    duration: float | None,
    target: float | None,
    waypoints: Sequence[Sequence[float]] | None = None,
    actions: Sequence[str] | None = None,
) -> ScaledTask:
    """Scale a task to a body; raises for impossible waypoints or actions, and if level flight is impossible.

    waypoints: rows of north, east, depth, m; by default they are drawn.  actions: the inputs that an action commands,
    instead of the task's.
    """
    if task.channel and waypoints is not None:
        raise ValueError(f"{task.name} has a target, not waypoints: give target= in the unit of {task.channel}.")
    if not task.channel and target is not None:
        raise ValueError(
            f"{task.name} has waypoints, not a target: give waypoints= as rows of north, east and depth in m."
        )
    duration = task.duration if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    cruise, family = find_cruise(plant), plant.family
    length, speed = plant.hull.length, cruise.speed
    rate, deepest = speed / length, tasks.DEPTH_LIMIT * length
    largest = task.current * speed
    helm, limits = find_helm(plant), command_limits(plant)
    stands_for = _channels(plant)
    moved = (
        [stands_for[a] for a in task.actions if a in stands_for] if actions is None else check_actions(actions, plant)
    )
    first = {"yaw": plant.inputs[helm.rudder], "pitch": plant.inputs[helm.plane]}
    held = {role: name for role, name in first.items() if name not in moved}
    where = (task.channel,) if task.channel else ("north_m", "east_m", "depth_m", "heading_rad")
    return ScaledTask(
        units={"length": length, "speed": speed, "rate": rate},
        duration=duration,
        stands_for=stands_for,
        actions=tuple(moved),
        middles=command_middles(plant)[[family.inputs.index(a) for a in moved]],
        limits=limits[[family.inputs.index(a) for a in moved]],
        start=START,
        randomise=dict.fromkeys(("effects.current.north", "effects.current.east"), (-largest, largest))
        if largest > 0.0
        else {},
        read=(*(o.source for o in task.observed if o.source in plant.outputs), *where),
        driven=tuple(a for a in moved if a != stands_for.get("bow_plane_rad")),
        # if more changes are needed than these shortest times or legs imply, drawn numbers are reused
        shortest=task.hold[0] / rate if task.channel else tasks.LEG[0] * length / (2.0 * speed),
        least_dt=plant.dt,
        start_limits=tasks.start_limits(deepest, speed, rate),
        target_limits=tasks.target_limits(length, speed),
        plan={
            "kept_state": cruise.state,
            "kept_command": cruise.commands,
            "limit": limits,
            "middle": command_middles(plant),
            "action_of": [moved.index(channel) if channel in moved else -1 for channel in family.actuators],
            "rudder_gains": cruise.rudder_gains if "yaw" in held else 0.0,
            "plane_gains": cruise.plane_gains if "pitch" in held else 0.0,
            "held_depth_error": tasks.HELD_PITCH * abs(cruise.plane_gains[2] / cruise.plane_gains[3]),
            "follows_path": not task.channel,
            **tasks.legs_and_limits(length, speed, rate, tasks.PATH_SPEED),
        },
        tables={"waypoints": check_waypoints(waypoints, deepest)},
        read_for={name: _HELD[role] for role, name in held.items()},
    )


def _channels(plant: Plant) -> dict[str, str]:
    """The vehicle's own channels for a task's rudder, stern plane, bow plane and propulsion."""
    roles = plant.family.body.by_role()
    named = {"rudder_rad": roles["yaw"][0], "stern_plane_rad": roles["pitch"][0], PROPULSION: roles["surge"][0]}
    return {**named, **({"bow_plane_rad": roles["pitch"][1]} if len(roles["pitch"]) > 1 else {})}
