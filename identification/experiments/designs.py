"""Designs from which the next experiment is chosen, each in the form of a campaign file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, radians
from typing import Any

import numpy as np

from auv_gym.plant import Plant

Tables = dict[str, Any]
TURN = radians(50.0)
COMPASS = radians(0.5)  # rad, noise of a compass
DEPTH_NOISE = 0.02  # m


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment that a vehicle can run.

    tables: function of a vehicle and a length, s, that returns the tables of the campaign file except `[vehicle]`.
    """

    name: str
    title: str
    tables: Callable[[Plant, float], Tables]


def campaign_text(name: str, description: str, tables: Tables, vehicles: Sequence[str]) -> str:
    """The text of a campaign file with these tables, run with each of these vehicle files in the same folder."""
    grid = dict(tables.get("grid", {}))
    if len(vehicles) > 1:
        grid["vehicle.file"] = list(vehicles)
    lines = [
        f"name = {_value(name)}",
        f"description = {_value(description)}",
        "seeds = 1",
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


def mission(**settings: Any) -> Tables:
    return {"experiment": {"kind": "mission", **settings}}


def hold_levels(duration: float, hold: float, levels: Sequence[float]) -> list[list[float]]:
    """The levels in turn, each held for about `hold` s and used at least once within the duration."""
    count = max(ceil(duration / hold - 0.5), min(len(levels), 2))
    times = duration * np.arange(count) / count
    return [[round(float(time), 3), float(levels[k % len(levels)])] for k, time in enumerate(times)]


def out_and_back_headings(duration: float) -> list[list[float]]:
    return hold_levels(duration, 0.5 * duration, (0.0, np.pi))


def circle(duration: float, lap: float) -> list[list[float]]:
    """Headings once around and back again, in steps of 30 degrees."""
    laps = max(round(duration / lap), 2)
    count = 12 * laps
    turns = [radians(30.0) * (k if (k // 12) % 2 == 0 else 12 * (k // 12 + 1) - k) for k in range(count)]
    around = np.unwrap(turns)
    return [[round(duration * k / count, 3), float(around[k])] for k in range(count)]
