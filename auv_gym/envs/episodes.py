"""The episodes of a task, shared by single and vector environments, and the meaning of a row's numbers.

See `plans` for how the plan is made, and `kernel` for plan, row and the compiled code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

import gymnasium
import numpy as np

from auv_gym.envs.kernel.layout import DIVERGED, NO_REASON, START_DRAWS, plan_type, row_type, size
from auv_gym.envs.kernel.programs import Kernel
from auv_gym.envs.kind import EnvKind
from auv_gym.envs.options import check_limits, check_targets
from auv_gym.envs.tasks import Task
from auv_gym.model import Model
from auv_gym.param import check_number
from auv_gym.plant import Plant
from auv_gym.plant.rollout import scratch_for

_WAYPOINT = ("north_m", "east_m", "depth_m")


@dataclass(frozen=True, eq=False)
class Episodes:
    """Everything that all episodes of a task with a vehicle share.

    kind: of the vehicle.  plant: the vehicle that gives scales and limits.  driver: what is simulated, the plant or a
    model in its place.  actions: the inputs that an action commands, in order; an action goes from -1 at `middles` -
    `limits` to 1 at their sum.  start_options: channels of an initial state that a reset may give.  start_limits,
    target_limits: by channel, the range of initial values and targets that may be given.  vector, derived: the driver's
    parameters before randomisation.  plan: see `kernel.layout`.
    """

    task: Task
    kind: EnvKind
    plant: Plant
    driver: Model
    kernel: Kernel
    actions: tuple[str, ...]
    middles: np.ndarray
    limits: np.ndarray
    observations: tuple[str, ...]
    start_options: tuple[str, ...]
    start_limits: Mapping[str, tuple[float, float]]
    target_limits: Mapping[str, tuple[float, float]]
    randomise: Mapping[str, tuple[float, float]]
    state_names: tuple[str, ...]
    vector: np.ndarray
    derived: np.ndarray
    plan: np.ndarray

    @property
    def by_model(self) -> bool:
        """Whether a model in Python drives the environment, instead of a plant in compiled code."""
        return bool(self.settings["by_model"])

    @property
    def settings(self) -> Any:
        """The plan as a record with named fields."""
        return _record(self.plan, plan_type(self.plant.family, self.kind.layout))

    @property
    def row_type(self) -> np.dtype:
        """The record type of the beginning of a row."""
        return row_type(self.plant.family, self.kind.layout)

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
        return self.task.targets or ((self.task.channel,) if self.task.channel else _WAYPOINT)

    def action_for(self, command: Mapping[str, float]) -> np.ndarray:
        """The action for commands by channel, shape (len(actions),); raises ValueError if one is missing."""
        missing = [name for name in self.actions if name not in command]
        if missing:
            raise ValueError(
                f"action_for needs a command for each action, {', '.join(self.actions)}; missing: {', '.join(missing)}."
            )
        return (np.array([command[name] for name in self.actions]) - self.middles) / self.limits

    def new_rows(self, count: int) -> np.ndarray:
        """Rows for environments that have not started, shape (count, row_size)."""
        rows = np.zeros((count, self.row_size))
        for row in rows:
            record = self.record(row)
            record["over"], record["start"], record["first_target"] = 1.0, nan, nan
        return rows

    def new_buffer(self) -> np.ndarray:
        """The buffer of a single environment: [plan | derived parameters | row | scratch]."""
        return np.concatenate([self.plan, self.derived, self.new_rows(1)[0], scratch_for(self.plant.family)])

    def record(self, row: np.ndarray) -> Any:
        """The named beginning of a row."""
        return _record(row, self.row_type)

    def draws(self, row: np.ndarray) -> np.ndarray:
        """The part of a row for an episode's random numbers, uniform in [0, 1)."""
        return row[int(self.settings["draws_at"]) :]

    def noise(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """The parts of a row for the next samples' random numbers from N(0, 1) and from [0, 1); None if not needed."""
        at, rows = int(self.settings["noise_at"]), int(self.settings["noise_rows"])
        if not rows:
            return None
        split = at + rows * len(self.plant.outputs)
        return row[at:split], row[split : split + rows * len(self.kind.layout.sensors)]

    def randomised_values(self, row: np.ndarray) -> dict[str, float]:
        """The randomised parameters of the present episode."""
        shares = self.draws(row)[START_DRAWS : START_DRAWS + len(self.randomise)].tolist()
        return {
            path: min(max(low + (high - low) * share, low), high)
            for (path, (low, high)), share in zip(self.randomise.items(), shares, strict=True)
        }

    def set_start(self, record: Any, options: Mapping[str, Any] | None) -> None:
        """Put the options of a reset into a row's record; raises for unknown options and invalid values."""
        record["start"], record["first_target"] = nan, nan
        known = "'start' and 'target'" if self.task.channel or self.task.targets else "'start'"
        if not isinstance(options, Mapping | None):
            raise ValueError(f"reset needs its options by name, {known}, got {options!r}.")
        for name, value in (options or {}).items():
            if name == "start" and isinstance(value, Mapping):
                for channel, number in value.items():
                    if channel not in self.start_options:
                        has = ", ".join(self.start_options)
                        raise ValueError(f"reset option 'start' has {has}, got {channel!r}.")
                    check_number(f"reset option start[{channel!r}]", number, "the channel's unit")
                check_limits("reset option start", value, self.start_limits)
                for channel, number in value.items():
                    record["start"][self.plant.family.states.index(channel)] = number
            elif name == "target" and self.task.targets:
                targets = check_targets("reset option 'target'", value, self.task)
                check_limits("reset option target", value, self.target_limits)
                record["first_target"] = list(targets.values())
            elif name == "target" and self.task.channel:
                check_number("reset option 'target'", value, "the channel's unit")
                check_limits("reset option target", {self.task.channel: value}, self.target_limits)
                record["first_target"] = value
            else:
                raise ValueError(
                    f"reset has the options {known}, start as a mapping such as {{'depth_m': 10.0}}, "
                    f"got {name!r}: {value!r}."
                )

    def reason(self, record: Any) -> str:
        """The reason why a row's episode was terminated, in words, or nothing."""
        code, value, time = int(record["reason"]), float(record["reason_value"]), float(record["time"])
        if code == NO_REASON:
            return ""
        if code == DIVERGED:
            return f"diverged at {time:g} s: {self.state_names[int(value)]} is not finite or beyond 1e9"
        words, field = self.kind.reasons[code]
        limit = float(self.settings[field]) if field else 0.0
        return f"{words.format(value=value, limit=limit)} at {time:g} s"


def _record(numbers: np.ndarray, record: np.dtype) -> Any:
    return numbers[: size(record)].view(record)[0]
