"""Experiments with a glider that flies by its polar: dives and climbs."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.designs import DEPTH_NOISE, Design, Tables, mission
from identification.experiments.glider_dives import yo_mission
from identification.experiments.kinds import ExperimentKind, Mission

_SINKS = 0.12  # m/s, typical vertical speed of a glider


def _dives(plant: Plant, rng: np.random.Generator, *, depth_noise: float = 0.05, **settings: Any) -> Record:
    named = {"depths": settings["target_depths"]} if "target_depths" in settings else {}
    return yo_mission(plant, rng=rng, noise=depth_noise, **named)


def _mission(plant: Plant) -> Mission:
    return Mission("dives and climbs at several pitch angles", ("target_depths", "depth_noise"), _dives)


def _designs(plant: Plant) -> tuple[Design, ...]:
    def dives(*depths: float):
        def tables(plant: Plant, duration: float) -> Tables:
            targets, spent = [], 0.0
            while len(targets) < 2 or spent < duration:
                targets.append(float(depths[len(targets) % len(depths)]))
                spent += 2.0 * targets[-1] / _SINKS
            return mission(target_depths=targets, depth_noise=DEPTH_NOISE)

        return tables

    return (
        Design("shallow", "shallow dives", dives(60.0, 80.0)),
        Design("middle", "dives to middle depths", dives(200.0, 300.0)),
        Design("deep", "deep dives", dives(800.0, 600.0)),
        Design("mixed", "shallow and deep dives by turns", dives(100.0, 600.0, 300.0)),
    )


KIND = ExperimentKind(mission=_mission, designs=_designs, minutes=lambda plant: (60.0, 6000.0))
