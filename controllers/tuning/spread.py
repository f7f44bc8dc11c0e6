"""Vehicles that the data allow: random ones from the intervals of coefficients and effects, and corners of these.

A nonzero coefficient keeps its sign, since no gains can steer with a rudder that has no effect.  Towards zero it is
drawn by factors, and an interval that reaches zero ends as far below the value, by factor, as above it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from math import isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant
from controllers.tuning.kinds import KINDS

Intervals = Mapping[str, tuple[float, float]]
CHANGE = 0.2  # of a coefficient to either side, if nothing is known about it
_NORMAL = 1.959964  # standard deviations in half a 95 % interval
_LISTED = 3  # channels in a warning
_UNSTABLE = 1e-3  # 1/s; with a slower pole, free runs over some minutes stay close
_WIDE = 0.5  # of a coefficient: if its deviation gives a wider half interval, it is lognormal


def known_intervals(plant: Plant) -> dict[str, tuple[float, float]]:
    """The 95 % intervals of a vehicle's main coefficients: from the deviations in its file, or 20 % to either side."""
    paths = [*plant.family.coefficients, *(p for p in KINDS.of(plant.family).besides if p in list_paths(plant))]
    found = {}
    for path in dict.fromkeys((*paths, *plant.deviations)):
        value = value_at(plant, path)
        half = _NORMAL * plant.deviations[path] if path in plant.deviations else CHANGE * abs(value)
        if half > 0.0:
            found[path] = _possible(plant, path, (value - half, value + half), 1.0 - _WIDE)
    return found


class Uncertain(NamedTuple):
    """A vehicle with fitted values, their 95 % intervals by path, and doubts about these, in sentences."""

    plant: Plant
    intervals: dict[str, tuple[float, float]]
    warnings: tuple[str, ...]


def read_uncertain(plant: Plant, file: str | os.PathLike) -> Uncertain:
    """The vehicle with the values and 95 % intervals of a diagnosis.json, or of a fit's JSON.

    If several logs have effects of their own, it is the vehicle of the last log.
    """
    values: dict[str, Any] = {}
    intervals: dict[str, tuple[float, float]] = {}
    try:
        told = json.loads(Path(file).read_text(encoding="utf-8"))
        effects = told.get("effects", ())
        entries = [*told.get("coefficients", ()), *(e for e in effects if "in_last_log" not in e)]
        entries += [e["in_last_log"] for e in effects if e.get("in_last_log")]  # of some logs only: as in the last log
        for entry in [*entries, *told.get("parameters", ())]:
            path = entry.get("path") or entry["name"]
            values[path] = float(entry["value"])
            low, high = map(float, entry.get("ci95") or (nan, nan))
            if isfinite(low) and isfinite(high):
                intervals[path] = (min(low, values[path]), max(high, values[path]))
        warnings = _doubts(told)
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
    plant = replace_at(plant, values)
    return Uncertain(plant, {path: _possible(plant, path, of) for path, of in intervals.items()}, warnings)


def drawn(plant: Plant, intervals: Intervals, rng: np.random.Generator) -> Plant:
    """A random vehicle with parameters normal about the given ones, with a separate spread on each side.

    Parameters that keep their sign are lognormal on the side of zero.
    """
    found = {}
    for path, limits in intervals.items():
        value, z = value_at(plant, path), float(rng.standard_normal())
        end, size = limits[int(z > 0.0)], abs(z) / _NORMAL
        if _keeps_sign(plant, path) and 0.0 < end / value < 1.0:
            new = value * (end / value) ** size
        else:
            new = value + size * (end - value)
        low, high = spec_at(plant, path).bounds
        found[path] = min(max(new, low), high)
    return replace_at(plant, found)


def corner(plant: Plant, intervals: Intervals, rng: np.random.Generator) -> Plant:
    """A vehicle with every parameter at a randomly chosen end of its interval."""
    sides = rng.choice([-1.0, 1.0], len(intervals))
    found = {}
    for (path, limits), side in zip(intervals.items(), sides.tolist(), strict=True):
        # the ends by magnitude, so that a side means the same for coefficients of either sign
        near, far = sorted(limits, key=abs)
        found[path] = far if side > 0.0 else near
    return replace_at(plant, found)


def _possible(plant: Plant, path: str, limits: tuple[float, float], least: float = 0.0) -> tuple[float, float]:
    """An interval within the bounds of its parameter, and on its side of zero if it keeps its sign.

    least: the smallest share of the value for the end on the side of zero.
    """
    value, (low, high) = value_at(plant, path), limits
    if _keeps_sign(plant, path):
        far = high if value > 0.0 else low
        near = low if value > 0.0 else high
        if near / value <= least and far != value:
            near = value * value / far
        low, high = sorted((near, far))
    least_value, most_value = spec_at(plant, path).bounds
    return max(low, least_value), min(high, most_value)


def _keeps_sign(plant: Plant, path: str) -> bool:
    """Whether a parameter's sign is physical: that of a coefficient, or of an effect whose neutral value is not 0."""
    effect = path.startswith("effects.")
    return value_at(plant, path) != 0.0 and not (effect and spec_at(plant, path).neutral == 0.0)


def _doubts(told: Mapping[str, Any]) -> tuple[str, ...]:
    """The doubts that a diagnosis or a fit reports about itself."""
    found = []
    if told.get("verdict") == "unexplained":
        found.append(
            "The diagnosis did not explain its log (verdict: unexplained): the true vehicle may lie outside the "
            "intervals from which vehicles are drawn. Read its page before you use these gains."
        )
    percents: dict[str, list[float]] = {}
    for scores in told.get("scores", {}).values():
        for name, score in scores.items():
            if score["fit_percent"] is not None:
                percents.setdefault(name, []).append(float(score["fit_percent"]))
    poor = {name: value for name, of in percents.items() if (value := float(np.median(of))) < 0.0}
    if poor:
        lowest = sorted(poor, key=lambda name: poor[name])[:_LISTED]
        listed = ", ".join(f"{channel(name).label} {poor[name]:.0f} %" for name in lowest)
        rate = max((float(real) for real, _ in told.get("poles", ())), default=0.0)
        found.append(
            f"On held-out data the fitted model is worse than a constant (fit below 0 %: {listed}"
            f"{f' and {len(poor) - _LISTED} more' if len(poor) > _LISTED else ''}). "
            + (
                f"It is unstable (pole at {rate:.2g} 1/s), so its free runs drift away from any log: test these gains "
                "on the vehicle with care, or fit a vehicle that is stable."
                if rate > _UNSTABLE
                else "Its gains may not suit the vehicle: free the coefficients that differ, or fit a longer log."
            )
        )
    return tuple(found)
