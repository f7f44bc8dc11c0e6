"""Experiments with a float: depth steps by a piston, or dives with pump and valve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.designs import DEPTH_NOISE, Design, Tables, hold_levels, mission
from identification.experiments.float_dives import depth_control, oil_mission, summer_lake
from identification.experiments.kinds import ExperimentKind, Mission

_LAKE_TARGETS, _LAKE_HOLD = (40.0, 0.0), 600.0  # m, s
_DIVE_SPEED = 0.07  # m/s, typical sinking and rising speed of a float with an oil bladder
_DIVE_REST = 8000.0  # s, that a dive spends parked and near the surface


def _by_piston(plant: Plant) -> bool:
    return "piston_m" in plant.family.required


def _lake(
    plant: Plant,
    rng: np.random.Generator,
    *,
    target_depths: Sequence[float] = _LAKE_TARGETS,
    duration: float | None = None,
    depth_noise: float = 0.02,
) -> Record:
    """Depth control in a lake; duration: s, divided equally among the targets."""
    hold = _LAKE_HOLD if duration is None else duration / len(target_depths)
    return depth_control(plant, target_depths, rng=rng, hold=hold, noise=depth_noise, temperature_profile=summer_lake)


def _dives(plant: Plant, rng: np.random.Generator, *, depth_noise: float = 0.1, **settings: Any) -> Record:
    named = {"depths": settings["target_depths"]} if "target_depths" in settings else {}
    return oil_mission(plant, rng=rng, noise=depth_noise, **named)


def _mission(plant: Plant) -> Mission:
    if _by_piston(plant):
        return Mission("from depth to depth in a stratified lake", ("duration", "target_depths", "depth_noise"), _lake)
    return Mission("dives with pump and valve", ("target_depths", "depth_noise"), _dives)


def _designs(plant: Plant) -> tuple[Design, ...]:
    return _piston() if _by_piston(plant) else _oil()


def _minutes(plant: Plant) -> tuple[float, float]:
    return (5.0, 240.0) if _by_piston(plant) else (600.0, 40000.0)


def _piston() -> tuple[Design, ...]:
    def dives(hold: float, *depths: float):
        def tables(plant: Plant, duration: float) -> Tables:
            targets = [level for _, level in hold_levels(duration, hold, depths)]
            return mission(target_depths=targets, duration=duration, depth_noise=DEPTH_NOISE)

        return tables

    return (
        Design("deep", "from the surface layer to the deep and back", dives(600.0, 50.0, 3.0)),
        Design("steps_shallow", "small steps near the surface", dives(180.0, 8.0, 12.0, 10.0, 14.0)),
        Design("steps_deep", "small steps in the deep", dives(180.0, 50.0, 46.0, 52.0, 48.0)),
        Design("stairs", "stairs down and up", dives(240.0, 10.0, 20.0, 30.0, 40.0, 50.0, 40.0, 30.0, 20.0)),
        Design("quick", "quick reversals, down and up", dives(120.0, 30.0, 15.0)),
        Design("hold", "two depths held for long", dives(1800.0, 12.0, 40.0)),
    )


def _oil() -> tuple[Design, ...]:
    def dives(*depths: float):
        def tables(plant: Plant, duration: float) -> Tables:
            targets, spent = [], 0.0
            while len(targets) < 2 or spent < duration:
                targets.append(float(depths[len(targets) % len(depths)]))
                spent += 2.0 * targets[-1] / _DIVE_SPEED + _DIVE_REST
            return mission(target_depths=targets)

        return tables

    return (
        Design("shallow", "shallow dives", dives(250.0, 350.0)),
        Design("middle", "dives to middle depths", dives(700.0, 900.0)),
        Design("deep", "deep dives", dives(1500.0, 1300.0)),
        Design("mixed", "shallow and deep dives by turns", dives(300.0, 1500.0, 800.0)),
    )


KIND = ExperimentKind(mission=_mission, designs=_designs, minutes=_minutes, environment="auv_gym/FloatDepth-v0")
