"""Autopilots of a glider: its rudder controls its heading."""

from __future__ import annotations

from typing import Any

from auv_gym.models.linear import linearise
from auv_gym.plant import Plant
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.kinds import ANGLE_ERROR, ControlKind, Ranges
from controllers.pid import Pid, heading_pid
from controllers.predictive.gpc import Gpc


def _pid(plant: Plant, targets: tuple[str, ...], gains: Gains, pitch_limit: float | None) -> Pid:
    return Pid(**gains.law("pid", "heading"), limit=plant.hull.rudder_limit)


def _plan(plant: Plant, settings: dict[str, Any]) -> Gpc:
    return Gpc(
        linearise(plant, outputs=("heading_rad",)),
        weights={"heading_rad": 1.0 / ANGLE_ERROR},
        input_limits=_ranges(plant),
        **settings,
    )


def _ranges(plant: Plant) -> Ranges:
    return {"rudder_rad": (-plant.hull.rudder_limit, plant.hull.rudder_limit)}


def _on_board(plant: Plant, targets: tuple[str, ...]) -> Controller:
    return heading_pid(plant)


KIND = ControlKind(
    targets=("heading_rad",),
    plans={"heading_rad": _plan},
    pid=_pid,
    on_board=_on_board,
    ranges=_ranges,
)
