"""What a single and a vector environment share: options checked, the plan made of them, and the numbers of a row.

See `layout` for plan and row, and `kernel` for what the compiled code does with them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, nan
from typing import Any

import gymnasium
import numpy as np

from auv_gym.envs import layout, tasks
from auv_gym.envs.cruise import command_limits, find_cruise
from auv_gym.envs.kernel import CHANGE_DRAWS, START_DRAWS, Kernel, bind_kernel
from auv_gym.envs.layout import GEOMETRY, SAMPLING, SENSORS, offset, plan_type, row_type, size
from auv_gym.envs.options import check_model_dt, check_model_inputs, check_number, vehicle_of
from auv_gym.envs.tasks import PROPULSION, Task
from auv_gym.model import Model
from auv_gym.param import check_value, did_you_mean, list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.rollout import scratch_for

START = ("north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad")
START_OPTIONS = (*START, "u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
_WAYPOINT = ("north_m", "east_m", "depth_m")
_REASONS = {
    layout.BROACHED: "broached: depth_m is {value:.3g}",
    layout.TOO_DEEP: "too deep: depth_m is {value:.4g}, the limit {limit:.4g}",
    layout.PITCHED: "out of its envelope: pitch_rad is {value:.3g}, the limit {limit:.3g}",
    layout.ROLLED: "out of its envelope: roll_rad is {value:.3g}, the limit {limit:.3g}",
    layout.TOO_FAST: "out of its envelope: the speed is {value:.3g} m/s, the limit {limit:.3g}",
    layout.SPINNING: "out of its envelope: the rate of turn is {value:.3g} rad/s, the limit {limit:.3g}",
    layout.ARRIVED: "arrived at the last waypoint",
}
_LIMITS = {
    layout.TOO_DEEP: "depth_limit",
    layout.PITCHED: "pitch_limit",
    layout.ROLLED: "roll_limit",
    layout.TOO_FAST: "speed_limit",
    layout.SPINNING: "rate_limit",
}


@dataclass(frozen=True, eq=False)
class Episodes:
    """The episodes of a task with a vehicle: everything about them that is the same for all.

    plant: the vehicle that scales and limits come from.  driver: what is simulated, the plant or a model in its place.
    actions: the inputs that an action commands, in order, and `limits` their largest commands.
    vector, derived: the driver's parameters before randomisation.  plan: see `layout`.
    """

    task: Task
    plant: Plant
    driver: Model
    kernel: Kernel
    actions: tuple[str, ...]
    limits: np.ndarray
    observations: tuple[str, ...]
    randomise: Mapping[str, tuple[float, float]]
    state_names: tuple[str, ...]
    vector: np.ndarray
    derived: np.ndarray
    plan: np.ndarray

    @property
    def by_model(self) -> bool:
        """Whether a model in Python drives the environment, not a plant in compiled code."""
        return bool(self.settings["by_model"])

    @property
    def settings(self) -> Any:
        """The plan as a record."""
        return _record(self.plan, plan_type(self.plant.family))

    @property
    def row_size(self) -> int:
        return int(self.settings["row_size"])

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-1.0, 1.0, (len(self.actions),), np.float32)

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-1.0, 1.0, (len(self.observations),), np.float32)

    @property
    def target_channels(self) -> tuple[str, ...]:
        return (self.task.channel,) if self.task.channel else _WAYPOINT

    def new_rows(self, count: int) -> np.ndarray:
        """Rows for environments that have not begun, shape (count, row_size)."""
        rows = np.zeros((count, self.row_size))
        for row in rows:
            record = self.record(row)
            record["over"], record["start"], record["first_target"] = 1.0, nan, nan
        return rows

    def new_buffer(self) -> np.ndarray:
        """The buffer of a single environment: [plan | derived parameters | row | scratch]."""
        return np.concatenate([self.plan, self.derived, self.new_rows(1)[0], scratch_for(self.plant.family)])

    def record(self, row: np.ndarray) -> Any:
        """The named part of a row."""
        return _record(row, row_type(self.plant.family))

    def draws(self, row: np.ndarray) -> np.ndarray:
        """The part of a row that an episode's drawn numbers go to, uniform in [0, 1)."""
        return row[int(self.settings["draws_at"]) :]

    def noise(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """The parts of a row for numbers from N(0, 1) and from [0, 1), for the next samples; None where none are."""
        at, rows = int(self.settings["noise_at"]), int(self.settings["noise_rows"])
        if not rows:
            return None
        normals = rows * len(self.plant.outputs)
        return row[at : at + normals], row[at + normals : at + normals + rows * len(SENSORS)]

    def randomised_values(self, row: np.ndarray) -> dict[str, float]:
        """The parameters of the present episode that were drawn."""
        shares = self.draws(row)[START_DRAWS : START_DRAWS + len(self.randomise)].tolist()
        return {
            path: min(max(low + (high - low) * share, low), high)
            for (path, (low, high)), share in zip(self.randomise.items(), shares, strict=True)
        }

    def set_start(self, record: Any, options: Mapping[str, Any] | None) -> None:
        """Put the options of a reset into a row's record; raises on what is unknown or no number."""
        record["start"], record["first_target"] = nan, nan
        known = "'start' and 'target'" if self.task.channel else "'start'"
        for name, value in (options or {}).items():
            if name == "start" and isinstance(value, Mapping):
                for channel, number in value.items():
                    if channel not in START_OPTIONS:
                        raise ValueError(f"reset option 'start' has {', '.join(START_OPTIONS)}, got {channel!r}.")
                    check_number(f"reset option start[{channel!r}]", number, "the channel's unit")
                    record["start"][self.plant.family.states.index(channel)] = number
            elif name == "target" and self.task.channel:
                check_number("reset option 'target'", value, "the channel's unit")
                record["first_target"] = value
            else:
                raise ValueError(
                    f"reset has the options {known}, start as a mapping such as {{'depth_m': 10.0}}, "
                    f"got {name!r}: {value!r}."
                )

    def reason(self, record: Any) -> str:
        """Why the episode of a row was terminated, in words, or nothing."""
        code, value, time = int(record["reason"]), float(record["reason_value"]), float(record["time"])
        if code == layout.NO_REASON:
            return ""
        if code == layout.DIVERGED:
            return f"diverged at {time:g} s: {self.state_names[int(value)]} is not finite or beyond 1e9"
        limit = float(self.settings[_LIMITS[code]]) if code in _LIMITS else 0.0
        return f"{_REASONS[code].format(value=value, limit=limit)} at {time:g} s"


def make_episodes(
    task: str | Task,
    vehicle: str | os.PathLike | Plant,
    *,
    effects: Mapping[str, float] | None,
    randomise: Mapping[str, tuple[float, float]] | None,
    model: Model | str | os.PathLike | None,
    dt: float | None,
    duration: float | None,
    target: float | None = None,
    waypoints: Sequence[Sequence[float]] | None = None,
) -> Episodes:
    """The episodes that an environment's options describe; raises on what does not fit together."""
    if isinstance(task, str):
        if task not in tasks.TASKS:
            raise ValueError(f"No task {task!r}. {did_you_mean(task, tasks.TASKS)}Tasks: {', '.join(tasks.TASKS)}.")
        task = tasks.TASKS[task]
    name = task.name
    if task.channel and waypoints is not None:
        raise ValueError(f"{name} has a target, not waypoints: give target= in the unit of {task.channel}.")
    if not task.channel and target is not None:
        raise ValueError(f"{name} has waypoints, not a target: give waypoints= as rows of north, east and depth in m.")
    plant = vehicle_of(vehicle, dt)
    if plant.family.kind != "torpedo":
        raise ValueError(
            f"{name} needs a vehicle in six degrees of freedom (families torpedo, torpedo_voltage, torpedo_speed), got "
            f"{plant.name!r} of family {plant.family.name!r}."
        )
    duration = task.duration if duration is None else duration
    check_number("duration", duration, "s", above=0.0)
    if target is not None:
        check_number("target", target, "the channel's unit")
    cruise = find_cruise(plant)
    units = {"": 1.0, "length": plant.hull.length, "speed": cruise.speed, "rate": cruise.speed / plant.hull.length}
    effects = dict(effects or {})
    if model is not None and any(not path.startswith("effects.sampling.") for path in (*effects, *(randomise or {}))):
        raise ValueError(
            "effects= and randomise= change the vehicle, which model= replaces: give one of them, or paths under "
            "effects.sampling, which act on what any of them measures."
        )
    driver = plant if model is None else _model(model, plant)
    compiled = isinstance(driver, Plant) and driver.family is plant.family
    owner = driver if isinstance(driver, Plant) and compiled else plant  # whose parameters the compiled code takes
    owner = replace_at(owner, effects)
    driver = owner if compiled else driver
    if randomise is None:
        largest = task.current * cruise.speed if model is None else 0.0
        currents = ("effects.current.north", "effects.current.east")
        randomise = {p: (-largest, largest) for p in currents if largest > 0.0 and p not in effects}
    ranges = {path: _range(owner, path, limits) for path, limits in randomise.items()}
    for corner in (0, 1):
        problem = owner.family.problem(
            replace_at(owner, {p: limits[corner] for p, limits in ranges.items()}).parameters
        )
        if problem:
            raise ValueError(f"randomise= reaches an impossible vehicle: {problem}.")

    actions = tuple(_input(a, plant) for a in task.actions if _moves(a, plant))
    held = tuple(_input(h, plant) for h in task.held)
    observed = [o for o in task.observed if not (o.source in task.actions and _input(o.source, plant) not in actions)]
    if not compiled:
        _check_model(driver, plant, task, actions, held)

    family, record = plant.family, np.zeros(1, plan_type(plant.family))
    plan: Any = record[0]
    tables: list[np.ndarray] = []

    def table(values: Any) -> int:
        at = size(plan_type(family)) + sum(t.size for t in tables)
        tables.append(np.asarray(values, dtype=np.float64).ravel())
        return at

    longest = {p: limits[1] for p, limits in ranges.items() if p.endswith(".dead_time")}
    sized = replace_at(owner, longest) if longest else owner
    state_names = sized.states
    plan["steps"] = max(round(duration / plant.dt), 1)
    plan["dt"], plan["longest_step"] = plant.dt, owner.longest_step
    plan["by_model"] = not compiled
    plan["actions"], plan["observations"] = len(actions), len(observed)
    plan["history"], plan["ages_at"] = sized.history, table(sized.ages)
    sources = {
        **{channel: i for i, channel in enumerate(family.outputs)},
        **{feature: len(family.outputs) + i for i, feature in enumerate(GEOMETRY)},
        **{channel: len(family.outputs) + len(GEOMETRY) + i for i, channel in enumerate(family.inputs)},
    }
    plan["observed_at"] = table(
        [(sources[_input(o.source, plant)], o.offset * units[o.unit], o.scale * units[o.unit]) for o in observed]
    )
    where = {path: index for index, path in enumerate(list_paths(owner))}
    plan["randomised"] = len(ranges)
    plan["randomised_at"] = table([(where[path], low, high) for path, (low, high) in ranges.items()])
    points = np.zeros((0, 3)) if waypoints is None else _waypoints(waypoints)
    plan["waypoints"], plan["waypoints_at"] = len(points), table(points)

    def most(effect: str, sensor: str) -> float:
        path = f"effects.sampling.{sensor}.{effect}"
        return max(value_at(owner, path), ranges.get(path, (0.0, 0.0))[1])

    sampling = [f"effects.sampling.{sensor}.{effect}" for sensor in SENSORS for effect in SAMPLING]
    plan["sampling_from"] = where[sampling[0]]
    assert [where[path] for path in sampling] == list(range(where[sampling[0]], where[sampling[0]] + len(sampling)))
    plan["sampled"] = any(most(effect, sensor) > 0.0 for sensor in SENSORS for effect in SAMPLING)
    drawn = any(most(effect, sensor) > 0.0 for sensor in SENSORS for effect in ("noise", "dropout"))
    plan["sensor_of"] = [next(i for i, c in enumerate(SENSORS.values()) if o in c) for o in family.outputs]
    plan["delayed"] = floor(max(most("delay", sensor) for sensor in SENSORS) / plant.dt + 0.5) + 1
    plan["noise_rows"] = layout.NOISE_ROWS if drawn else 0

    plan["start_depth"] = [k * plant.hull.length for k in tasks.START_DEPTH]
    plan["cruise_state"], plan["cruise_command"] = cruise.state, cruise.commands
    limits = command_limits(plant)
    plan["limit"] = limits
    plan["action_of"] = [actions.index(channel) if channel in actions else -1 for channel in family.inputs]
    if "rudder_rad" in held:
        plan["rudder_gains"] = cruise.rudder_gains
    if "stern_plane_rad" in held:
        plan["plane_gains"] = cruise.plane_gains
    plan["held_depth_error"] = tasks.HELD_PITCH * abs(cruise.plane_gains[2] / cruise.plane_gains[3])

    plan["follows_path"] = not task.channel
    if task.channel:
        plan["true_index"], plan["read_index"] = (
            family.states.index(task.channel),
            family.outputs.index(task.channel),
        )
        plan["is_angle"] = task.channel == "heading_rad"
    plan["error_scale"] = task.scale * units[task.unit]
    plan["weight"][: len(task.weights)] = list(task.weights.values())
    plan["target_step"] = [k * units[task.unit] for k in task.step]
    plan["target_hold"] = [k / units["rate"] for k in task.hold]
    plan["target_band"] = [k * units[task.unit] for k in task.band]
    plan["fixed_target"] = nan if target is None else target
    plan["leg"], plan["turn"], plan["slope"] = [k * units["length"] for k in tasks.LEG], tasks.TURN, tasks.SLOPE
    plan["path_speed"], plan["radius"] = tasks.PATH_SPEED * cruise.speed, tasks.RADIUS * units["length"]
    plan["depth_limit"] = tasks.DEPTH_LIMIT * units["length"]
    plan["pitch_limit"], plan["roll_limit"] = tasks.PITCH_LIMIT, tasks.ROLL_LIMIT
    plan["speed_limit"], plan["rate_limit"] = tasks.SPEED_LIMIT * cruise.speed, tasks.RATE_LIMIT * units["rate"]

    # the first changes within the shortest times or legs; where a vehicle needs more, they are used again
    shortest = plan["target_hold"][0] if task.channel else plan["leg"][0] / (2.0 * cruise.speed)
    plan["changes"] = ceil(duration / shortest) + 2
    plan["full_state"] = len(state_names)
    plan["state_at"] = at = size(row_type(family))
    plan["previous_at"] = at = at + len(state_names)
    plan["delayed_at"] = at = at + len(state_names)
    plan["noise_at"] = at = at + int(plan["sampled"]) * int(plan["delayed"]) * len(family.outputs)
    plan["draws_at"] = at = at + int(plan["noise_rows"]) * (len(family.outputs) + len(SENSORS))
    plan["row_size"] = at + START_DRAWS + len(ranges) + CHANGE_DRAWS * int(plan["changes"])
    plan["plan_size"] = size(plan_type(family)) + sum(t.size for t in tables)
    return Episodes(
        task=task,
        plant=plant,
        driver=driver,
        kernel=bind_kernel(family),
        actions=actions,
        limits=limits[[family.inputs.index(a) for a in actions]],
        observations=tuple(o.name for o in observed),
        randomise=ranges,
        state_names=state_names,
        vector=owner.vector.copy(),
        derived=owner.derived.copy(),
        plan=np.concatenate([record.view(np.float64), *tables]),
    )


@dataclass(frozen=True, eq=False)
class InfoIndex:
    """What of a row an info shows: the numbers from `first` to `last`, and each group's first place and its names."""

    first: int
    last: int
    time: int
    groups: Mapping[str, tuple[int, tuple[str, ...]]]

    @classmethod
    def of(cls, episodes: Episodes) -> InfoIndex:
        family, record = episodes.plant.family, row_type(episodes.plant.family)
        first, state_at = offset(record, "features"), int(episodes.settings["state_at"])
        places = {
            "target": (offset(record, "target"), episodes.target_channels),
            "reading": (first, family.outputs),
            "command": (offset(record, "command"), family.inputs),
            "state": (state_at, episodes.state_names),
            "reward_terms": (offset(record, "term"), tuple(episodes.task.weights)),
        }
        return cls(
            first=first,
            last=state_at + len(episodes.state_names),
            time=offset(record, "time") - first,
            groups={group: (at - first, names) for group, (at, names) in places.items()},
        )


def _record(numbers: np.ndarray, record: np.dtype) -> Any:
    return numbers[: size(record)].view(record)[0]


def _input(name: str, plant: Plant) -> str:
    return plant.inputs[3] if name == PROPULSION else name


def _moves(name: str, plant: Plant) -> bool:
    """Whether the vehicle has an input; only bow planes may lack."""
    bow = plant.hull.bow_plane
    return name != "bow_plane_rad" or (bow.limit > 0.0 and (bow.lift != 0.0 or bow.moment != 0.0))


def _range(plant: Plant, path: str, limits: Any) -> tuple[float, float]:
    spec = spec_at(plant, path)
    if not isinstance(limits, tuple | list) or len(limits) != 2:
        raise ValueError(f"randomise= needs a pair (low, high) in {spec.unit} for {path}, got {limits!r}.")
    low, high = (check_value(path, value, spec) for value in limits)
    if low > high:
        raise ValueError(f"randomise= needs low <= high for {path}, got ({low:g}, {high:g}).")
    return low, high


def _waypoints(waypoints: Sequence[Sequence[float]]) -> np.ndarray:
    points = np.asarray(waypoints, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise ValueError(f"waypoints needs one or more rows of north, east and depth in m, got shape {points.shape}.")
    if (points[:, 2] < 0.0).any() or not np.abs(np.diff(points, axis=0)).sum(axis=1).all():
        raise ValueError("waypoints needs depths of 0 m or more, and no waypoint twice in a row.")
    return points


def _model(model: Model | str | os.PathLike, plant: Plant) -> Model:
    driver = load_vehicle(model, dt=plant.dt) if isinstance(model, str | os.PathLike) else model
    check_model_dt(driver, plant)
    return driver


def _check_model(model: Model, plant: Plant, task: Task, actions: Sequence[str], held: Sequence[str]) -> None:
    """Raises if a model cannot drive the environment, with the channel that lacks."""
    name = type(model).__name__
    needed = [o.source for o in task.observed if o.source in plant.outputs]
    needed += [task.channel] if task.channel else ["north_m", "east_m", "depth_m", "heading_rad"]
    if "rudder_rad" in held and "rudder_rad" in model.inputs:
        needed += ["v_mps", "r_radps", "heading_rad"]
    if "stern_plane_rad" in held and "stern_plane_rad" in model.inputs:
        needed += ["w_mps", "q_radps", "pitch_rad", "depth_m"]
    for channel in dict.fromkeys(needed):
        if channel not in model.outputs:
            raise ValueError(
                f"model= needs {channel} among its outputs, got {name} with {', '.join(model.outputs) or 'none'}: "
                f"fit it to a record that has {channel}, or splice it into the plant."
            )
    for channel in actions:
        if channel not in model.inputs and channel != "bow_plane_rad":
            raise ValueError(
                f"model= needs {channel} among its inputs, got {name} with {', '.join(model.inputs) or 'none'}: "
                f"fit it to a record that has {channel}, or splice it into the plant."
            )
    check_model_inputs(model, plant)
