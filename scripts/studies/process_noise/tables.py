"""The tables of the study, from the results of each log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from scripts.studies.harness import Found, Sheet
from scripts.studies.process_noise.attempts import METHODS, PARTS
from scripts.studies.process_noise.experiments import VEHICLES
from scripts.studies.process_noise.rates import NONE, mean, rate

FACTOR = 1.5  # largest ratio for a stated deviation to count as right
SHOWN = 0.1  # of the sensor's variance: least addition to free-run errors for an acceleration to be judged
EFFECT = "the effect"
Results = Sequence[Mapping[str, Any]]


def case_of(part: str, family: str, loop: str) -> str:
    """The name of a case."""
    return f"{part}: {family}, {loop}"


CASES = tuple(
    case_of(part, name, loop) for part in PARTS for name, vehicle in VEHICLES.items() for loop in vehicle.loops
)


def sheets(found: Found) -> list[Sheet]:
    """The tables of the parts that were run."""
    times = f"free runs of the true model err by {found.options['times']:g} times the sensor's noise"
    made = [
        Sheet(
            "parameters",
            f"Estimates, {times}: bias in standard errors, share of 95 % intervals with the truth, %",
            ("family", "loop", "of", *(f"{method},\n{what}>" for method in METHODS for what in _OF_ESTIMATES)),
            _by_case(found, "parameters", _estimates),
        ),
        Sheet(
            "noise",
            f"Stated deviation of process noise over the true one, {times}",
            (*_NOISE_OF, "logs>", "that show it>", f"within {FACTOR:g}, %>", "median>", "not stated>"),
            [[part, *row] for part in PARTS for row in _by_case(found, part, _noises)],
        ),
        Sheet(
            "clean",
            f"Diagnoses where nothing is missing, {times}",
            ("family", "loop", "logs>", "verdict none, %>", "no names, %>", "names a log>", "names"),
            _by_case(found, "clean", lambda family, results: [_cleans(results)]),
        ),
        Sheet(
            "names",
            f"Diagnoses where one effect is missing, {times}",
            ("family", "loop", "logs>", "right name, %>", "a false name, %>", "false names a log>", "missed"),
            _by_case(found, "names", lambda family, results: [_named(results)]),
        ),
    ]
    return [sheet for sheet in made if sheet.rows]


def missed_by(results: Results, method: str) -> dict[str, list[tuple[float, bool]]]:
    """Error over standard error, and whether the interval holds the truth, of each log, by coefficient or `EFFECT`."""
    found: dict[str, list[tuple[float, bool]]] = {}
    for result in results:
        for path, e in result["fits"][method].items():
            if not e["problem"] and isfinite(e["error"]) and e["error"] > 0.0:
                name = EFFECT if path == result["effect"] else path
                held = e["ci95"][0] <= e["truth"] <= e["ci95"][1]
                off = e["side"] * (e["value"] - e["truth"]) / e["error"]
                found.setdefault(name, []).append((off, bool(held)))
    return found


def noise_ratios(results: Results, axis: str) -> list[float]:
    """Stated over true deviation of an acceleration in the logs that show it, 0 where none is stated."""
    showing = [r for r in results if r["shown"][axis] > SHOWN]
    return [r["found"][axis][0] / r["process"][axis][0] if axis in r["found"] else 0.0 for r in showing]


_OF_ESTIMATES = ("logs", "bias", "coverage")
_NOISE_OF = ("part", "family", "loop", "acceleration of")


def _by_case(
    found: Found, part: str, rows_of: Callable[[str, Results], Sequence[Sequence[str]]]
) -> list[Sequence[str]]:
    """The rows of each family and loop."""
    rows = []
    for family, vehicle in VEHICLES.items():
        for loop in vehicle.loops:
            results = found.of(case_of(part, family, loop))
            if results:
                rows += [[family, loop, *row] for row in rows_of(family, results)]
    return rows


def _estimates(family: str, results: Results) -> list[list[str]]:
    by_method = {method: missed_by(results, method) for method in METHODS}
    names = dict.fromkeys((EFFECT, *(name for of in by_method.values() for name in of)))
    rows = []
    for name in names:
        row = [name]
        for of in by_method.values():
            pairs = of.get(name, [])
            row += [str(len(pairs)), mean([off for off, _ in pairs]), rate([held for _, held in pairs])]
        rows.append(row)
    coefficients = ["all coefficients"]
    for of in by_method.values():
        held = [hit for name, some in of.items() if name != EFFECT for _, hit in some]
        # without an interval, since those of one log are correlated
        coefficients += [str(len(held)), NONE, f"{100.0 * np.mean(held):.1f}" if held else NONE]
    return [rows[0], coefficients, *rows[1:]]


def _noises(family: str, results: Results) -> list[list[str]]:
    rows = []
    for axis in VEHICLES[family].judged:
        ratios = noise_ratios(results, axis)
        within = [1.0 / FACTOR <= ratio <= FACTOR for ratio in ratios]
        stated = [ratio for ratio in ratios if ratio > 0.0]
        median = f"{np.median(stated):.2f}" if stated else NONE
        rows.append([axis, str(len(results)), str(len(ratios)), rate(within), median, str(len(ratios) - len(stated))])
    return rows


def _cleans(results: Results) -> list[str]:
    said = [path for result in results for path in result["named"]]
    return [
        str(len(results)),
        rate([result["verdict"] == "none" for result in results]),
        rate([not result["named"] for result in results]),
        f"{len(said) / len(results):.2f}",
        _listed(said),
    ]


def _named(results: Results) -> list[str]:
    false = [path for result in results for path in result["false"]]
    return [
        str(len(results)),
        rate([result["right"] for result in results]),
        rate([bool(result["false"]) for result in results]),
        f"{len(false) / len(results):.2f}",
        _listed([result["effect"] for result in results if not result["right"]]),
    ]


def _listed(paths: Sequence[str]) -> str:
    """Paths with their counts."""
    counts = {path: paths.count(path) for path in sorted(set(paths))}
    return "; ".join(f"{path.removeprefix('effects.')} ({count})" for path, count in counts.items())
