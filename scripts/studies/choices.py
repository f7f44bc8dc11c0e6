"""Whether the names in measured logs depend on choices that should not matter.

    python -m scripts.studies.choices --data DIR --out choices
    python -m scripts.studies.choices --data DIR --case 'slocum:*' --out choices

Every log of `scripts.real_logs`, except those of the BlueROV2 Heavy, is diagnosed as a whole and then again: with other
lengths of free runs, without its first or last tenth, without its first few samples, by halves, and with less or more
doubt of the coefficients.  A name of the whole log counts as kept if the effect, or one tied with it, is named again.
All other names are new.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import Diagnosis, diagnose
from scripts.real.dives import diagnose_dives, diagnose_flight, read_dives, read_flight
from scripts.real.log import Log
from scripts.real.logs import LOGS
from scripts.studies.harness import Found, Option, Sheet, Study

WHOLE = "whole log"
_FEW = 7  # samples left out, so that windows and averaged rows fall elsewhere


def _share(begin: float, end: float) -> Callable[[Record], Record]:
    """The rows between two shares of a record."""

    def cut(record: Record) -> Record:
        place = np.arange(len(record)) / len(record)
        return record.select((place >= begin) & (place < end))

    return cut


CUTS: Mapping[str, Callable[[Record], Record]] = {
    f"without the first {_FEW} samples": lambda record: record.select(np.arange(len(record)) >= _FEW),
    "without the first tenth": _share(0.1, 1.0),
    "without the last tenth": _share(0.0, 0.9),
    "first half": _share(0.0, 0.5),
    "second half": _share(0.5, 1.0),
}
SETTINGS: Mapping[str, Mapping[str, float]] = {
    **{f"free runs {times:g} times as long": {"window": times} for times in (0.6, 0.8, 1.25, 1.5)},
    "coefficients doubted by 5 %": {"doubt": 0.05},
    "coefficients doubted by 20 %": {"doubt": 0.2},
}
CHOICES = (WHOLE, *SETTINGS, *CUTS)


def logs() -> list[Log]:
    """The logs that are one record, diagnosed as read, or gliders' dives that are fitted."""
    return [log for log in LOGS if not log.name.startswith("BlueROV2 Heavy")]


def attempt(case: str, seed: int, data: str) -> list[dict[str, Any]]:
    """The names given with each choice; seed: not used."""
    log, folder = next(log for log in logs() if log.name == case), Path(data)
    if missing := log.missing(folder):
        raise ValueError(f"{missing[0]} is not in {data}.")
    return [_named(log, folder, choice) for choice in CHOICES]


def _named(log: Log, data: Path, choice: str) -> dict[str, Any]:
    began, (record, plant) = perf_counter(), _read(log, data)
    record = CUTS.get(choice, lambda whole: whole)(record)
    settings = dict(SETTINGS.get(choice, {}))
    if "window" in settings:
        settings["window"] *= log.window or plant.window
    elif log.window is not None:
        settings["window"] = log.window
    try:
        found = diagnose(record, plant, source=log.name, **settings)
    except ValueError as error:
        return {"choice": choice, "verdict": "refused", "why": str(error), "groups": []}
    return {
        "choice": choice,
        "verdict": found.verdict,
        "groups": groups_of(found),
        "sizes": {e.path: [e.value, *e.ci95] for e in (*found.effects, *found.alike)},
        "seconds": perf_counter() - began,
    }


def _read(log: Log, data: Path) -> tuple[Record, Plant]:
    """A log as `scripts.real_logs` reads it, and its vehicle."""
    if log.run is diagnose_dives:
        return read_dives(log, data)
    if log.run is diagnose_flight:
        return read_flight(log, data)
    plant = load_vehicle(log.vehicle)  # registers its channels
    return log.record(data, log.files), plant


def groups_of(found: Diagnosis) -> list[list[str]]:
    """Each effect that is named or that the log acts like, with its ties; only the former are names."""
    ties = {group[0]: list(group) for group in found.tied}
    return [ties.get(e.path, [e.path]) for e in (*found.effects, *found.alike)]


def kept(whole: Sequence[Sequence[str]], other: Sequence[Sequence[str]]) -> int:
    """The largest number of groups of the whole that can be paired with one of the others by a common member."""
    shared = np.array([[bool(set(a) & set(b)) for b in other] for a in whole], dtype=int).reshape(
        len(whole), len(other)
    )
    return int(shared[linear_sum_assignment(shared, maximize=True)].sum())


def sheets(found: Found) -> list[Sheet]:
    rows = []
    for case, runs in found.runs.items():
        for result in (r for run in runs.values() for r in run):
            whole = next(r for run in runs.values() for r in run if r["choice"] == WHOLE)["groups"]
            same, named = kept(whole, result["groups"]), len(result["groups"])
            rows.append(
                [
                    case if result["choice"] == WHOLE else "",
                    result["choice"],
                    result["verdict"],
                    f"{same} of {len(whole)}",
                    f"{named - same}",
                    "; ".join(
                        " or ".join(group[:3]) + (" or more" if len(group) > 3 else "") for group in result["groups"]
                    ),
                ]
            )
        rows.append([])
    heads = ["log", "choice", "verdict", "kept>", "new>", "effects"]
    return [Sheet("choices", "Names of measured logs with choices that should not matter", heads, rows)]


STUDY = Study(
    about=__doc__ or "",
    attempt=attempt,
    cases=tuple(log.name for log in logs()),
    sheets=sheets,
    seeds=None,
    options={"data": Option("data", "folder of measured logs")},
)


if __name__ == "__main__":
    sys.exit(STUDY.main())
