"""Vehicles that the data allow: drawn from the intervals of coefficients and effects, and at their ends."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant
from controllers.tuning.kinds import KINDS

Intervals = Mapping[str, tuple[float, float]]
CHANGE = 0.2  # of a coefficient to either side, where nothing is known of it
_NORMAL = 1.959964  # standard deviations from the middle to the end of a 95 % interval


def known_intervals(plant: Plant) -> dict[str, tuple[float, float]]:
    """The 95 % intervals of a vehicle's main coefficients: by the deviations in its file, else 20 % to either side."""
    paths = [*plant.family.coefficients, *(p for p in KINDS.of(plant.family).besides if p in list_paths(plant))]
    found = {}
    for path in dict.fromkeys((*paths, *plant.deviations)):
        value = value_at(plant, path)
        half = _NORMAL * plant.deviations[path] if path in plant.deviations else CHANGE * abs(value)
        if half > 0.0:
            found[path] = (value - half, value + half)
    return found


def read_uncertain(plant: Plant, file: str | os.PathLike) -> tuple[Plant, dict[str, tuple[float, float]]]:
    """The vehicle with the values of a diagnosis.json, or of a fit's JSON, and their 95 % intervals by path."""
    values: dict[str, Any] = {}
    intervals: dict[str, tuple[float, float]] = {}
    try:
        told = json.loads(Path(file).read_text(encoding="utf-8"))
        entries = [*told.get("coefficients", ()), *told.get("effects", ()), *told.get("parameters", ())]
        for entry in entries:
            path = entry.get("path") or entry["name"]
            values[path] = float(entry["value"])
            low, high = map(float, entry.get("ci95") or (nan, nan))
            if isfinite(low) and isfinite(high):
                intervals[path] = (min(low, values[path]), max(high, values[path]))
    except FileNotFoundError:
        raise ValueError(f"There is no file {file}: give the diagnosis.json of `auv-gym diagnose`.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{file} cannot be used ({error}): give the diagnosis.json of `auv-gym diagnose`, or the JSON of a fit in "
            "a campaign's folder of models."
        ) from None
    if not intervals:
        raise ValueError(
            f"{file} has no coefficient or effect with a 95 % interval: leave it out, and the vehicle's own deviations "
            "count."
        )
    known = list_paths(plant)
    for path in values:
        if path not in known:
            raise ValueError(f"{file} is of another vehicle than {plant.name!r}, which has no {path}: give its own.")
    return replace_at(plant, values), intervals


def drawn(plant: Plant, intervals: Intervals, rng: np.random.Generator) -> Plant:
    """A vehicle whose parameters are normal about the given ones, each side with its own spread."""
    found = {}
    for path, (low, high) in intervals.items():
        value, z = value_at(plant, path), float(rng.standard_normal())
        found[path] = value + z * ((high - value) if z > 0.0 else (value - low)) / _NORMAL
    return replace_at(plant, _allowed(plant, found))


def corner(plant: Plant, intervals: Intervals, rng: np.random.Generator) -> Plant:
    """A vehicle with every parameter at one end of its interval, drawn."""
    sides = rng.choice([-1.0, 1.0], len(intervals))
    found = {}
    for (path, (low, high)), side in zip(intervals.items(), sides.tolist(), strict=True):
        # the ends by size, so that a side means the same for coefficients of either sign
        near, far = sorted((low, high), key=abs)
        found[path] = far if side > 0.0 else near
    return replace_at(plant, _allowed(plant, found))


def _allowed(plant: Plant, values: Mapping[str, float]) -> dict[str, float]:
    """Values within the bounds of their parameters, and on the side of zero where the given ones are."""
    found = {}
    for path, value in values.items():
        low, high = spec_at(plant, path).bounds
        given = value_at(plant, path)
        if given > 0.0:
            low = max(low, 0.0)
        elif given < 0.0:
            high = min(high, 0.0)
        found[path] = float(min(max(value, low), high))
    return found
