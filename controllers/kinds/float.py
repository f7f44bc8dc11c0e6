"""Autopilots of a float: its piston or its oil bladder controls its depth."""

from __future__ import annotations

from math import inf
from typing import Any

from auv_gym.models.linear import linearise
from auv_gym.plant import Plant
from auv_gym.plant.float_engine import find_engine
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.kinds import ControlKind, Ranges
from controllers.pid import Pid, float_depth_pid
from controllers.predictive.gpc import Gpc

_PLANS = 15.0  # per time of a float's engine, which is half the horizon


def _pid(plant: Plant, targets: tuple[str, ...], gains: Gains, pitch_limit: float | None) -> Pid:
    engine = find_engine(plant)
    return Pid(
        **gains.law("pid", "depth"),
        measured="depth_m",
        command=engine.channel,
        limit=engine.half,
        rate_limit=engine.rate,
        middle=engine.middle,
        neutral=float(plant.hull.piston_neutral) if engine.channel == "piston_m" else 0.0,
    )


def _plan(plant: Plant, settings: dict[str, Any]) -> Gpc:
    engine = find_engine(plant)
    low, high = engine.middle - engine.half, engine.middle + engine.half
    return Gpc(
        linearise(plant, outputs=("depth_m",)),
        weights={"depth_m": 1.0 / (engine.speed * engine.time / 3.0)},
        input_limits={engine.channel: (low, high)},
        rate_limits={engine.channel: engine.rate} if engine.rate < inf else {},
        **settings,
    )


def _every(plant: Plant) -> float:
    return find_engine(plant).time / _PLANS


def _ranges(plant: Plant) -> Ranges:
    engine = find_engine(plant)
    return {engine.channel: (engine.middle - engine.half, engine.middle + engine.half)}


def _on_board(plant: Plant, targets: tuple[str, ...]) -> Controller:
    return float_depth_pid(plant)


def _logged(plant: Plant) -> tuple[str, ...]:
    """No targets for an oil bladder: its on-board actions are not a control loop under which its log could be run."""
    return KIND.targets if "piston_m" in plant.family.required else ()


KIND = ControlKind(
    targets=("depth_m",),
    plans={"depth_m": _plan},
    pid=_pid,
    on_board=_on_board,
    logged=_logged,
    ranges=_ranges,
    every=_every,
)
