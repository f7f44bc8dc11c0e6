"""Experiments from which the next one is chosen, each in the form of a campaign file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, radians
from typing import Any

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.cruise import Cruise, command_limits, find_cruise
from identification.experiments.manoeuvres import NOISE, steered

Tables = dict[str, Any]
_TURN = radians(50.0)
_ZIGZAG = radians(15.0)
_COMPASS = radians(0.5)  # rad, noise of a compass
_DIVE_SPEED = 0.07  # m/s, about what a float with an oil bladder sinks and rises at
_DIVE_REST = 8000.0  # s, that such a dive spends parked and near the surface
_DEPTH_NOISE = 0.02  # m


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment that a vehicle may be sent on.

    tables: the tables of its campaign file but `[vehicle]`, for a vehicle and a length, s.
    """

    name: str
    title: str
    tables: Callable[[Plant, float], Tables]


def designs_of(plant: Plant) -> tuple[Design, ...]:
    """The experiments that there are for a vehicle of this family."""
    if plant.family.kind == "body":
        return _torpedo()
    if plant.family.kind == "glider":
        return _glider()
    return _piston() if "piston_m" in plant.family.required else _oil()


def campaign_text(name: str, description: str, tables: Tables, vehicles: Sequence[str], seeds: int = 1) -> str:
    """A campaign file: the tables, run with each of these vehicle files, which lie beside it."""
    grid = dict(tables.get("grid", {}))
    if len(vehicles) > 1:
        grid["vehicle.file"] = list(vehicles)
    lines = [
        f"name = {_value(name)}",
        f"description = {_value(description)}",
        f"seeds = {seeds}",
        *_table("vehicle", {"file": vehicles[0]}),
    ]
    for key, content in tables.items():
        if key == "grid":
            continue
        parts = content if isinstance(content, list) else [content]
        for part in parts:
            lines += _table(key, part, many=isinstance(content, list))
    if grid:
        lines += _table("grid", grid)
    return "\n".join(lines) + "\n"


def _table(name: str, content: Mapping[str, Any], many: bool = False) -> list[str]:
    head = f"[[{name}]]" if many else f"[{name}]"
    return ["", head, *(f"{_key(key)} = {_value(value)}" for key, value in content.items())]


@lru_cache(maxsize=4)
def _cruise(plant: Plant) -> Cruise:
    return find_cruise(plant)  # a tenth of a second


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, float):
        return repr(float(f"{value:.10g}"))
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else json.dumps(name)


def _mission(**settings: Any) -> Tables:
    return {"experiment": {"kind": "mission", **settings}}


def _steps(duration: float, hold: float, levels: Sequence[float]) -> list[list[float]]:
    """Levels by turns, each held for about `hold` s, each at least once in the time that there is."""
    count = max(ceil(duration / hold - 0.5), min(len(levels), 2))
    times = duration * np.arange(count) / count
    return [[round(float(time), 3), float(levels[k % len(levels)])] for k, time in enumerate(times)]


def _there_and_back(duration: float) -> list[list[float]]:
    return _steps(duration, 0.5 * duration, (0.0, np.pi))


def _circle(duration: float, lap: float) -> list[list[float]]:
    """Headings once around and back again, in steps of 30 degrees."""
    laps = max(round(duration / lap), 2)
    count = 12 * laps
    turns = [radians(30.0) * (k if (k // 12) % 2 == 0 else 12 * (k // 12 + 1) - k) for k in range(count)]
    around = np.unwrap(turns)
    return [[round(duration * k / count, 3), float(around[k])] for k in range(count)]


def _glider() -> tuple[Design, ...]:
    def heading(targets: Callable[[float], list], share: float = 1.0, excitation: Callable | None = None):
        def tables(plant: Plant, duration: float) -> Tables:
            experiment = {
                "kind": "env",
                "id": "GliderHeading",
                "duration_s": duration,
                "compass_noise_rad": _COMPASS,
                "speed_mps": share * float(plant.hull.speed),
                "start": {"heading_rad": 0.0},
                "targets": {"heading_rad": targets(duration)},
            }
            added = {"excitation": [excitation(plant)]} if excitation is not None else {}
            return {"experiment": experiment, "controller": {"kind": "pid"}, **added}

        return tables

    def turns(duration: float) -> list[list[float]]:
        return _steps(duration, 90.0, (0.0, _TURN, -0.5 * _TURN, 1.5 * _TURN))

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
        Design("mission", "a mission: heading steps, changing speed and roll", lambda p, t: _mission(duration=t)),
        Design("turns_slow", "heading steps, slow", heading(turns, 0.6)),
        Design("turns", "heading steps", heading(turns)),
        Design("turns_fast", "heading steps, fast", heading(turns, 1.5)),
        Design("turns_three_speeds", "heading steps at three speeds, one run each", three_speeds),
        Design("rudder_full", "full rudder to either side", heading(_there_and_back, 1.0, full_rudder)),
        Design("rudder_prbs", "small rudder movements on a held heading", heading(_there_and_back, 1.0, small_rudder)),
        Design("circle", "all around and back", heading(lambda t: _circle(t, 300.0))),
        Design("straight", "a straight course there and back", heading(_there_and_back)),
    )


def _piston() -> tuple[Design, ...]:
    def dives(hold: float, *depths: float):
        def tables(plant: Plant, duration: float) -> Tables:
            targets = [level for _, level in _steps(duration, hold, depths)]
            return _mission(target_depths=targets, duration=duration, depth_noise=_DEPTH_NOISE)

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
            return _mission(target_depths=targets)

        return tables

    return (
        Design("shallow", "shallow dives", dives(250.0, 350.0)),
        Design("middle", "dives to middle depths", dives(700.0, 900.0)),
        Design("deep", "deep dives", dives(1500.0, 1300.0)),
        Design("mixed", "shallow and deep dives by turns", dives(300.0, 1500.0, 800.0)),
    )


def _torpedo() -> tuple[Design, ...]:
    def trip(
        heading: Callable[[float, float], list] = lambda t, lap: [[0.0, 0.0]],
        depth: Sequence[float] = (0.0,),
        speed: Sequence[float] = (1.0,),
        excitation: Callable[[Plant], Tables] | None = None,
    ):
        """heading: from the length and the time of a length travelled, s.  depth: lengths.  speed: of cruise."""

        def tables(plant: Plant, duration: float) -> Tables:
            cruise, length = _cruise(plant), float(plant.hull.length)
            lap, start = length / cruise.speed, 15.0 * length
            targets = {
                "heading_rad": heading(duration, lap),
                "depth_m": _steps(duration, 40.0 * lap, [start + size * length for size in depth]),
                "u_mps": _steps(duration, 40.0 * lap, [share * cruise.speed for share in speed]),
            }
            experiment = {
                "kind": "env",
                "id": "Depth",
                "duration_s": duration,
                "actions": list(steered(plant)),
                "start": {"heading_rad": 0.0, "depth_m": start, "u_mps": cruise.speed},
                "targets": targets,
            }
            noise = {**NOISE, "compass": _COMPASS, "depth": _DEPTH_NOISE}
            sensors = {f"{name}.noise": float(value) for name, value in noise.items()}
            added = {"excitation": [excitation(plant)]} if excitation is not None else {}
            return {"experiment": experiment, "controller": {"kind": "pid"}, **added, "sensors": sensors}

        return tables

    def turns(duration: float, lap: float) -> list[list[float]]:
        return _steps(duration, 35.0 * lap, (0.0, _TURN, -0.5 * _TURN, 1.5 * _TURN))

    def zigzag(plant: Plant) -> Tables:
        # the regulator's gain takes rudder off where the heading is too far to starboard
        side = 1.0 if _cruise(plant).rudder_gains[2] > 0.0 else -1.0
        amplitude = side * min(_ZIGZAG, 0.8 * float(command_limits(plant)[0]))
        return {"kind": "zigzag", "at": steered(plant)[0], "amplitude": amplitude}

    return (
        Design("mission", "heading, depth and speed in steps, fins excited", lambda p, t: _mission(duration=t)),
        Design("straight", "a straight course there and back", trip(lambda t, lap: _there_and_back(t))),
        Design("turns", "heading steps", trip(turns)),
        Design("turns_slow", "heading steps, slow", trip(turns, speed=(0.7,))),
        Design("zigzag", "a zigzag", trip(excitation=zigzag)),
        Design("circle", "all around and back", trip(lambda t, lap: _circle(t, 60.0 * lap))),
        Design("dives", "depth steps on a straight course", trip(depth=(-3.0, 3.0))),
        Design("dives_slow", "depth steps, slow", trip(depth=(-3.0, 3.0), speed=(0.7,))),
        Design("speeds", "speed steps on a straight course", trip(speed=(1.0, 0.7, 0.85))),
        Design("turns_and_speeds", "heading and speed steps", trip(turns, speed=(0.7, 1.0))),
    )
