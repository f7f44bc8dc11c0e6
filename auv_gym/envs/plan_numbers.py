"""The plan of an environment's episodes as the numbers that its compiled step reads; see `kernel/layout.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, floor, nan
from typing import Any

import numpy as np

from auv_gym.envs.kernel.layout import CHANGE_DRAWS, NOISE_ROWS, SAMPLING, START_DRAWS, plan_type, row_type, size
from auv_gym.envs.kind import EnvKind, ScaledTask
from auv_gym.envs.tasks import Observed, Task
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import Plant

_LENGTHEN_MEMORY = (".dead_time", ".clock.delay", ".clock.rate")


class PlanNumbers:
    """Fills a plan, part by part.

    owner: the plant whose parameters compiled code uses.  scaled: the task in its vehicle's units.  ranges: of
    randomised parameters, by path.  by_model: whether the vehicle is stepped by something other than compiled code.
    """

    def __init__(
        self,
        kind: EnvKind,
        owner: Plant,
        scaled: ScaledTask,
        ranges: Mapping[str, tuple[float, float]],
        by_model: bool,
    ) -> None:
        self._owner, self._scaled, self._ranges = owner, scaled, ranges
        self._layout, self._family, self._by_model = kind.layout, owner.family, by_model
        self._record = np.zeros(1, plan_type(owner.family, kind.layout))
        self._plan: Any = self._record[0]
        self._tables: list[np.ndarray] = []
        self._place = {path: index for index, path in enumerate(list_paths(owner))}
        longest = {path: limits[1] for path, limits in ranges.items() if path.endswith(_LENGTHEN_MEMORY)}
        self._sized = replace(replace_at(owner, longest) if longest else owner, dt=scaled.least_dt)

    @property
    def state_names(self) -> tuple[str, ...]:
        """The states in a row, including delayed commands."""
        return self._sized.states

    def filled(self, task: Task, plant: Plant, observed: Sequence[Observed], target: Any) -> np.ndarray:
        """The plan, (n,), with its tables appended.

        plant: with the environment's time step.  target: see `make_episodes`.
        """
        self._say_sizes(plant, len(observed))
        self._say_what_is_observed(observed)
        self._say_what_is_drawn()
        self._say_how_sensors_sample(plant)
        self._say_what_is_pursued(task, plant, target)
        self._add_own_fields()
        self._lay_out_row()
        return np.concatenate([self._record.view(np.float64), *self._tables])

    def _put_table(self, values: Any) -> int:
        """Append numbers to the plan; returns the index of the first one."""
        at = self._size()
        self._tables.append(np.asarray(values, dtype=np.float64).ravel())
        return at

    def _size(self) -> int:
        return size(plan_type(self._family, self._layout)) + sum(t.size for t in self._tables)

    def _say_sizes(self, plant: Plant, observations: int) -> None:
        plan, owner = self._plan, self._owner
        plan["derived_size"] = owner.derived.size
        plan["dt"], plan["longest_step"] = plant.dt, owner.longest_step
        plan["by_model"] = self._by_model
        plan["actions"], plan["observations"] = len(self._scaled.actions), observations
        plan["history"] = self._sized.history

    def _say_what_is_observed(self, observed: Sequence[Observed]) -> None:
        family, scaled = self._family, self._scaled
        units = _unit_sizes(scaled)
        sources = {n: i for i, n in enumerate((*family.outputs, *self._layout.geometry, *family.inputs))}
        self._plan["observed_at"] = self._put_table(
            [(sources[source_of(o, scaled)], o.offset * units[o.unit], o.scale * units[o.unit]) for o in observed]
        )

    def _say_what_is_drawn(self) -> None:
        self._plan["randomised"] = len(self._ranges)
        rows = [(self._place[path], low, high) for path, (low, high) in self._ranges.items()]
        self._plan["randomised_at"] = self._put_table(rows)

    def _say_how_sensors_sample(self, plant: Plant) -> None:
        plan, sensors, place = self._plan, self._layout.sensors, self._place

        def most(effect: str, sensor: str) -> float:
            path = f"effects.sampling.{sensor}.{effect}"
            return max(value_at(self._owner, path), self._ranges.get(path, (0.0, 0.0))[1])

        sampling = [f"effects.sampling.{sensor}.{effect}" for sensor in sensors for effect in SAMPLING]
        plan["sampling_from"] = first = place[sampling[0]]
        assert [place[path] for path in sampling] == list(range(first, first + len(sampling)))
        plan["sampled"] = any(most(effect, sensor) > 0.0 for sensor in sensors for effect in SAMPLING)
        drawn = any(most(effect, sensor) > 0.0 for sensor in sensors for effect in ("noise", "dropout"))
        outputs = self._family.outputs
        plan["sensor_of"] = [next((i for i, c in enumerate(sensors.values()) if o in c), -1) for o in outputs]
        plan["delayed"] = floor(max(most("delay", sensor) for sensor in sensors) / plant.dt + 0.5) + 1
        plan["noise_rows"] = NOISE_ROWS if drawn else 0

    def _say_what_is_pursued(self, task: Task, plant: Plant, target: Any) -> None:
        plan, family, units = self._plan, self._family, _unit_sizes(self._scaled)
        if task.channel:
            plan["true_index"] = family.states.index(task.channel)
            plan["read_index"] = family.outputs.index(task.channel)
            plan["is_angle"] = task.channel == "heading_rad"
        plan["error_scale"] = task.scale * units[task.unit]
        plan["weight"][: len(task.weights)] = list(task.weights.values())
        plan["target_step"] = [k * units[task.unit] for k in task.step]
        plan["target_hold"] = [k / units["rate"] for k in task.hold]
        plan["target_band"] = [k * units[task.unit] for k in task.band]
        plan["fixed_target"] = target if target is not None and task.channel else nan
        plan["steps"] = max(round(self._scaled.duration / plant.dt), 1)
        plan["changes"] = ceil(self._scaled.duration / self._scaled.shortest) + 2

    def _add_own_fields(self) -> None:
        """Add the fields of the kind of vehicle."""
        plan, family = self._plan, self._family
        for field, value in self._scaled.plan.items():
            plan[field] = value
        constants = [(family.inputs.index(name), self._place[path]) for name, path in family.constants.items()]
        for field, rows in {"constants": constants, **self._scaled.tables}.items():
            plan[field], plan[f"{field}_at"] = len(rows), self._put_table(rows)

    def _lay_out_row(self) -> None:
        """Set the positions in a row of its state, ages, delayed readings, noise and draws."""
        plan, layout, outputs = self._plan, self._layout, len(self._family.outputs)
        plan["full_state"] = len(self.state_names)
        plan["state_at"] = at = size(row_type(self._family, layout))
        plan["previous_at"] = at = at + len(self.state_names)
        at += len(self.state_names)
        if self._scaled.own_ages:
            plan["ages_at"], at = at, at + self._sized.ages.size
        else:
            plan["ages_at"] = self._put_table(self._sized.ages)
        plan["delayed_at"] = at
        plan["noise_at"] = at = at + int(plan["sampled"]) * int(plan["delayed"]) * outputs
        plan["draws_at"] = at = at + int(plan["noise_rows"]) * (outputs + len(layout.sensors))
        plan["row_size"] = at + START_DRAWS + len(self._ranges) + CHANGE_DRAWS * int(plan["changes"])
        plan["plan_size"] = self._size()


def _unit_sizes(scaled: ScaledTask) -> Mapping[str, float]:
    """The vehicle's units, by name; "" for a number without a unit."""
    return {"": 1.0, **scaled.units}


def source_of(observed: Observed, scaled: ScaledTask) -> str:
    """The channel of the vehicle that is observed."""
    return scaled.stands_for.get(observed.source, observed.source)
