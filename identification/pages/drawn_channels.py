"""The channels of a record that are worth drawing, and their set points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.channels import channel, excitation_of, set_point_of
from auv_gym.records.record import Record

_FEW = 4  # in one figure, unless more have set points or are modelled
_STILL = {"rad": 1e-3, "rad/s": 1e-4, "m": 1e-2, "m/s": 1e-3}  # ranges below which a signal counts as still
_FIRST = ("depth_m", "pitch_rad", "heading_rad", "u_mps", "w_mps", "q_radps", "roll_rad", "north_m", "east_m")


def outputs_of(record: Record, wanted: Sequence[str] = ()) -> list[str]:
    """The moving channels worth drawing: first those with a set point, then the wanted, then the usual ones."""
    moving = [n for n in record.names if channel(n).kind == "motion" and _moves(record, n)]
    aimed = [n for n in (*_FIRST, *moving) if n in moving and record.has(set_point_of(n))]
    order = dict.fromkeys([*aimed, *(n for n in (*wanted, *_FIRST) if n in moving)])
    return list(order)[: max(_FEW, len({*aimed, *wanted} & set(moving)))]


def inputs_of(record: Record) -> list[str]:
    """The inputs that move."""
    return [n for n in record.names if channel(n).kind == "input" and _moves(record, n)]


def excited_set_point(record: Record, name: str) -> np.ndarray:
    """The set point of a channel as the controller received it, including an added excitation, (n,)."""
    asked = record[set_point_of(name)]
    return asked + record[excitation_of(name)] if record.has(excitation_of(name)) else asked


def _moves(record: Record, name: str) -> bool:
    return bool(np.ptp(record[name]) > _STILL.get(channel(name).unit, 0.0))
