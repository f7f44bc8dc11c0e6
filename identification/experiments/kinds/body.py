"""Experiments with a vehicle in six degrees of freedom: steps of heading, depth and speed, with excited fins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import radians
from typing import Any

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.cruise import Cruise, command_limits, find_cruise
from auv_gym.records.record import Record
from identification.experiments.designs import (
    COMPASS,
    DEPTH_NOISE,
    TURN,
    Design,
    Tables,
    circle,
    hold_levels,
    mission,
    out_and_back_headings,
)
from identification.experiments.kinds import ExperimentKind, Mission
from identification.experiments.manoeuvres import NOISE, steer, steered

_ZIGZAG = radians(15.0)


@lru_cache(maxsize=4)
def _cruise(plant: Plant) -> Cruise:
    return find_cruise(plant)  # takes a tenth of a second


def _manoeuvres(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    return steer(plant, rng=rng, **settings)


def _mission(plant: Plant) -> Mission:
    title = "heading, depth and speed in steps, with excitation at rudder and stern plane"
    return Mission(title, ("duration", "compass_noise", "depth_noise"), _manoeuvres, sampled=True)


def _designs(plant: Plant) -> tuple[Design, ...]:
    def trip(
        heading: Callable[[float, float], list] = lambda t, lap: [[0.0, 0.0]],
        depth: Sequence[float] = (0.0,),
        speed: Sequence[float] = (1.0,),
        excitation: Callable[[Plant], Tables] | None = None,
    ):
        """The tables of a trip; heading: function of the duration and of the time to travel one length, s.

        depth: lengths.  speed: shares of cruise speed.
        """

        def tables(plant: Plant, duration: float) -> Tables:
            cruise, length = _cruise(plant), float(plant.hull.length)
            lap, start = length / cruise.speed, 15.0 * length
            targets = {
                "heading_rad": heading(duration, lap),
                "depth_m": hold_levels(duration, 40.0 * lap, [start + size * length for size in depth]),
                "u_mps": hold_levels(duration, 40.0 * lap, [share * cruise.speed for share in speed]),
            }
            experiment = {
                "kind": "env",
                "id": "Depth",
                "duration_s": duration,
                "actions": list(steered(plant)),
                "start": {"heading_rad": 0.0, "depth_m": start, "u_mps": cruise.speed},
                "targets": targets,
            }
            noise = {**NOISE, "compass": COMPASS, "depth": DEPTH_NOISE}
            sensors = {f"{name}.noise": float(value) for name, value in noise.items()}
            added = {"excitation": [excitation(plant)]} if excitation is not None else {}
            return {"experiment": experiment, "controller": {"kind": "pid"}, **added, "sensors": sensors}

        return tables

    def turns(duration: float, lap: float) -> list[list[float]]:
        return hold_levels(duration, 35.0 * lap, (0.0, TURN, -0.5 * TURN, 1.5 * TURN))

    def zigzag(plant: Plant) -> Tables:
        # the sign of the regulator's gain shows to which side a positive rudder turns
        side = 1.0 if _cruise(plant).rudder_gains[2] > 0.0 else -1.0
        amplitude = side * min(_ZIGZAG, 0.8 * float(command_limits(plant)[0]))
        return {"kind": "zigzag", "at": steered(plant)[0], "amplitude": amplitude}

    return (
        Design("mission", "heading, depth and speed in steps, fins excited", lambda p, t: mission(duration=t)),
        Design("straight", "a straight course there and back", trip(lambda t, lap: out_and_back_headings(t))),
        Design("turns", "heading steps", trip(turns)),
        Design("turns_slow", "heading steps, slow", trip(turns, speed=(0.7,))),
        Design("zigzag", "a zigzag", trip(excitation=zigzag)),
        Design("circle", "all around and back", trip(lambda t, lap: circle(t, 60.0 * lap))),
        Design("dives", "depth steps on a straight course", trip(depth=(-3.0, 3.0))),
        Design("dives_slow", "depth steps, slow", trip(depth=(-3.0, 3.0), speed=(0.7,))),
        Design("speeds", "speed steps on a straight course", trip(speed=(1.0, 0.7, 0.85))),
        Design("turns_and_speeds", "heading and speed steps", trip(turns, speed=(0.7, 1.0))),
    )


KIND = ExperimentKind(mission=_mission, designs=_designs, minutes=lambda plant: (1.0, 30.0))
