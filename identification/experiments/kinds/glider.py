"""Experiments with a glider: heading steps, with an excited rudder."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.designs import (
    COMPASS,
    TURN,
    Design,
    Tables,
    circle,
    hold_levels,
    mission,
    out_and_back_headings,
)
from identification.experiments.heading_control import closed_loop
from identification.experiments.kinds import ExperimentKind, Mission


def _heading(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    return closed_loop(plant, rng=rng, **settings)


def _mission(plant: Plant) -> Mission:
    title = "a changing heading, with excitation at the rudder"
    return Mission(title, ("duration", "compass_noise", "track_noise"), _heading)


def _designs(plant: Plant) -> tuple[Design, ...]:
    def heading(targets: Callable[[float], list], share: float = 1.0, excitation: Callable | None = None):
        def tables(plant: Plant, duration: float) -> Tables:
            experiment = {
                "kind": "env",
                "id": "GliderHeading",
                "duration_s": duration,
                "compass_noise_rad": COMPASS,
                "speed_mps": share * float(plant.hull.speed),
                "start": {"heading_rad": 0.0},
                "targets": {"heading_rad": targets(duration)},
            }
            added = {"excitation": [excitation(plant)]} if excitation is not None else {}
            return {"experiment": experiment, "controller": {"kind": "pid"}, **added}

        return tables

    def turns(duration: float) -> list[list[float]]:
        return hold_levels(duration, 90.0, (0.0, TURN, -0.5 * TURN, 1.5 * TURN))

    def full_rudder(plant: Plant) -> Tables:
        amplitude, hold = float(plant.hull.rudder_limit), 2.0 * plant.dt
        return {"kind": "bang_bang", "at": "rudder_rad", "amplitude": amplitude, "hold_s": [5.0 * hold, 10.0 * hold]}

    def small_rudder(plant: Plant) -> Tables:
        clock = max(round(8.0 / plant.dt), 2) * plant.dt
        amplitude = 0.3 * float(plant.hull.rudder_limit)
        return {"kind": "prbs", "at": "rudder_rad", "amplitude": amplitude, "clock_s": clock}

    def three_speeds(plant: Plant, duration: float) -> Tables:
        tables = heading(turns)(plant, max(duration / 3.0, 10.0 * plant.dt))
        speeds = [share * float(plant.hull.speed) for share in (0.6, 1.0, 1.5)]
        return {**tables, "grid": {"experiment.speed_mps": speeds}}

    return (
        Design("mission", "a mission: heading steps, changing speed and roll", lambda p, t: mission(duration=t)),
        Design("turns_slow", "heading steps, slow", heading(turns, 0.6)),
        Design("turns", "heading steps", heading(turns)),
        Design("turns_fast", "heading steps, fast", heading(turns, 1.5)),
        Design("turns_three_speeds", "heading steps at three speeds, one run each", three_speeds),
        Design("rudder_full", "full rudder to either side", heading(out_and_back_headings, 1.0, full_rudder)),
        Design(
            "rudder_prbs", "small rudder movements on a held heading", heading(out_and_back_headings, 1.0, small_rudder)
        ),
        Design("circle", "all around and back", heading(lambda t: circle(t, 300.0))),
        Design("straight", "a straight course there and back", heading(out_and_back_headings)),
    )


KIND = ExperimentKind(
    mission=_mission, designs=_designs, minutes=lambda plant: (2.0, 60.0), environment="auv_gym/GliderHeading-v0"
)
