"""The layout of an environment's numbers in the flat float64 arrays that its compiled step works on.

    plan    what all episodes of an environment have in common: sizes, task, envelope, gains; then tables
    row     one episode: command, target, reading, observation; then state of the vehicle and drawn numbers

Passing an array from Python to compiled code costs a tenth of a microsecond.  A single environment therefore has one
buffer, [plan | derived parameters | row | scratch], and a vector environment has one row for each environment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from auv_gym.vehicles.family import Family

SAMPLING = ("delay", "noise", "quantisation", "dropout")
TERMS = ("tracking", "command_travel", "progress")
MOST_OBSERVATIONS = 32
NOISE_ROWS = 64  # samples for which noise is drawn at once

START_DRAWS = 3  # uniform numbers for the initial state
CHANGE_DRAWS = 3  # for a new target or leg

# Return values of a step.
RUNNING, TRUNCATED, TERMINATED, REFUSED, OVER = range(5)
# Reasons for termination: none, a state that is NaN or too large, and a kind's own reasons from OWN on.
NO_REASON, DIVERGED, OWN = range(3)


@dataclass(frozen=True, eq=False)
class Layout:
    """The numbers that a kind of vehicle adds to the common ones in plans and rows.

    geometry: sources of observations other than readings and shares of the command limits.  sensors: those with
    sampling effects, and the readings of each.  plan, row, shown: fields, each with its number of values, or the name
    of what has one value each; an info shows those in `shown`.  targets, first_targets: number of values of a target,
    and of those of the first target that may be given.
    """

    geometry: tuple[str, ...]
    sensors: Mapping[str, tuple[str, ...]]
    plan: Mapping[str, int | str] = field(default_factory=dict)
    row: Mapping[str, int | str] = field(default_factory=dict)
    shown: Mapping[str, int | str] = field(default_factory=dict)
    targets: int = 3
    first_targets: int = 1


@lru_cache
def plan_type(family: Family, own: Layout) -> np.dtype:
    """The record at the start of a plan; names ending in `_at` are offsets of parts without a fixed position."""
    return _record(
        family,
        {
            "plan_size": 1, "row_size": 1, "derived_size": 1, "actions": 1, "observations": 1,
            "dt": 1, "longest_step": 1, "by_model": 1, "sampled": 1,
            # tables of the plan
            "ages_at": 1, "history": 1, "observed_at": 1, "randomised_at": 1, "randomised": 1, "sampling_from": 1,
            "constants_at": 1, "constants": 1,
            # parts of the row
            "state_at": 1, "full_state": 1, "previous_at": 1, "delayed_at": 1, "delayed": 1, "noise_at": 1,
            "noise_rows": 1, "draws_at": 1, "changes": 1,
            # task
            "steps": 1, "true_index": 1, "read_index": 1, "is_angle": 1, "error_scale": 1,
            "weight": len(TERMS), "target_step": 2, "target_hold": 2, "target_band": 2, "fixed_target": 1,
            # the sensor of each reading; -1 if the reading is the vehicle's output itself
            "sensor_of": "outputs",
            **own.plan,
        },
    )  # fmt: skip


@lru_cache
def row_type(family: Family, own: Layout) -> np.dtype:
    """The record at the start of a row; observations are computed from its `features`."""
    features = len(family.outputs) + len(own.geometry) + len(family.inputs)
    return _record(
        family,
        {
            "step": 1, "over": 1, "action": "inputs", "reward": 1, "reason": 1, "reason_value": 1,
            "change": 1, "change_at": 1, "noise_used": 1, **own.row,
            "sampling": len(own.sensors) * len(SAMPLING), "start": "states", "first_target": own.first_targets,
            "raw": "outputs",
            "observation": MOST_OBSERVATIONS // 2,  # float32
            # shown in infos, together with the state that follows
            "features": features, "command": "inputs", "time": 1, "target": own.targets, "term": len(TERMS),
            **own.shown,
        },
    )  # fmt: skip


def offset(record: np.dtype, name: str) -> int:
    """The index of a field's first number."""
    fields: Any = record.fields
    return fields[name][1] // 8


def size(record: np.dtype) -> int:
    """The number of values in a record."""
    return record.itemsize // 8


def _record(family: Family, sizes: Mapping[str, int | str]) -> np.dtype:
    counts = {name: len(getattr(family, size)) if isinstance(size, str) else size for name, size in sizes.items()}
    # a field with one value per input, for example, is an array even for a single input
    fields = [(n, np.float64) if sizes[n] == 1 else (n, np.float64, (count,)) for n, count in counts.items()]
    return np.dtype((np.record, fields))
