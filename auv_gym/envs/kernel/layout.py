"""Where each number of an environment is: the flat float64 arrays that its compiled step works on.

    plan    what all episodes of an environment have in common: sizes, task, envelope, gains; then tables
    row     one episode: command, target, reading, observation; then state of the vehicle and drawn numbers

An array handed from Python to compiled code costs a tenth of a microsecond, so a single environment has one buffer,
[plan | derived parameters | row | scratch], and a vector environment has one row for each of its environments.
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
NOISE_ROWS = 64  # samples for which noise is drawn at a time

START_DRAWS = 3  # uniform numbers of the first state
CHANGE_DRAWS = 3  # of a new target or leg

# What a step returns.
RUNNING, TRUNCATED, TERMINATED, REFUSED, OVER = range(5)
# Why an episode was terminated: nothing, a state that is no number or too large, and a kind's own reasons from OWN on.
NO_REASON, DIVERGED, OWN = range(3)


@dataclass(frozen=True, eq=False)
class Layout:
    """What a kind of vehicle has in its plans and rows besides what all have.

    geometry: what an observation can be made of besides readings and shares of the command limits.  sensors: those with
    sampling effects, and the readings of each.  plan, row, shown: fields and how many numbers each holds, or the name
    of what it has a number for; an info shows those in `shown`.  targets, first_targets: how many numbers a target has,
    and how many of the first one may be given.
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
    """The record at the start of a plan; names ending in `_at` are offsets of what has no fixed place."""
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
            # the sensor of each reading; -1 where the reading is what the vehicle makes of it
            "sensor_of": "outputs",
            **own.plan,
        },
    )  # fmt: skip


@lru_cache
def row_type(family: Family, own: Layout) -> np.dtype:
    """The record at the start of a row; `features` are what observations are made of."""
    features = len(family.outputs) + len(own.geometry) + len(family.inputs)
    return _record(
        family,
        {
            "step": 1, "over": 1, "action": "inputs", "reward": 1, "reason": 1, "reason_value": 1,
            "change": 1, "change_at": 1, "noise_used": 1, **own.row,
            "sampling": len(own.sensors) * len(SAMPLING), "start": "states", "first_target": own.first_targets,
            "raw": "outputs",
            "observation": MOST_OBSERVATIONS // 2,  # float32
            # what info shows, together with the state that follows
            "features": features, "command": "inputs", "time": 1, "target": own.targets, "term": len(TERMS),
            **own.shown,
        },
    )  # fmt: skip


def offset(record: np.dtype, name: str) -> int:
    """The index of a field's first number."""
    fields: Any = record.fields
    return fields[name][1] // 8


def size(record: np.dtype) -> int:
    """How many numbers a record holds."""
    return record.itemsize // 8


def _record(family: Family, sizes: Mapping[str, int | str]) -> np.dtype:
    counts = {name: len(getattr(family, size)) if isinstance(size, str) else size for name, size in sizes.items()}
    # a number for each input, say, is an array where there is one input, too
    fields = [(n, np.float64) if sizes[n] == 1 else (n, np.float64, (count,)) for n, count in counts.items()]
    return np.dtype((np.record, fields))
