"""Whether names depend on choices that should not matter.

    python -m scripts.studies.choices --data DIR --out choices
    python -m scripts.studies.choices --data DIR --case 'slocum:*' --out choices
    python -m scripts.studies.choices --case glider float --seeds 20 --seed 100 --out choices_simulated

Every log of `scripts.real_logs`, except those of the BlueROV2 Heavy, is diagnosed as a whole and then again: with other
lengths of free runs, without its first or last tenth, without its first few samples, by halves, and with less or more
doubt of the coefficients.  A name of the whole log counts as kept if the effect, or one tied with it, is named again.
All other names are new.

The same is done with simulated logs of the blind benchmark, by family: for each seed, the first one with one missing
effect that is at least four times as large as such a log would just show.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from auv_gym.param import spec_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.record_check import needs_of
from auv_gym.records.record import Record
from identification.diagnosis import Diagnosis, diagnose
from scripts.blind.cases import FAMILIES, Drawn, Undrawn, draw, sketch
from scripts.real.dives import diagnose_dives, diagnose_flight, read_dives, read_flight
from scripts.real.log import Log
from scripts.real.logs import LOGS
from scripts.studies.harness import Found, Option, Sheet, Study
from scripts.studies.process_noise.rates import rate

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


LEAST = 4.0  # size of a simulated effect, over what its log would just show


@dataclass(frozen=True, eq=False)
class Chosen:
    """A log with its vehicle; window, settle: of its free runs, s, None for the vehicle's own."""

    name: str
    record: Record
    plant: Plant
    window: float | None = None
    settle: float | None = None


def logs() -> list[Log]:
    """The measured logs that are one record, diagnosed as read, or gliders' dives that are fitted."""
    return [log for log in LOGS if not log.name.startswith("BlueROV2 Heavy")]


def attempt(case: str, seed: int, data: str) -> list[dict[str, Any]]:
    """The names given with each choice, for a measured log (seed: not used) or one of a simulated family."""
    chosen = _simulated(case, seed) if case in FAMILIES else _measured(case, Path(data))
    return [_named(chosen, choice) for choice in CHOICES]


def _measured(case: str, data: Path) -> Chosen:
    """A log as `scripts.real_logs` reads it."""
    log = next(log for log in logs() if log.name == case)
    if missing := log.missing(data):
        raise ValueError(f"{missing[0]} is not in {data}.")
    return Chosen(case, *_read(log, data), window=log.window)


def _simulated(family: str, seed: int) -> Chosen:
    """The first log of a seed whose one effect is large enough."""
    drawn = next(found for found in map(partial(_drawn, family, seed), count()) if found is not None and large(found))
    case = drawn.case
    return Chosen(f"{family} {case.number} of seed {seed}", drawn.record, drawn.believed, case.window, case.settle)


def _drawn(family: str, seed: int, number: int) -> Drawn | None:
    try:
        return draw(sketch(seed, number, family, "one"))
    except Undrawn:
        return None


def large(drawn: Drawn) -> bool:
    """Whether each effect is `LEAST` times as large as its log would just show."""
    sizes = {path: abs(value - spec_at(drawn.true, path).neutral) for path, value in drawn.effects.items()}
    return all(size >= LEAST * drawn.detectable[path] for path, size in sizes.items())


def _named(log: Chosen, choice: str) -> dict[str, Any]:
    began, record = perf_counter(), CUTS.get(choice, lambda whole: whole)(log.record)
    changed = dict(SETTINGS.get(choice, {}))
    if "window" in changed:
        changed["window"] *= log.window or log.plant.window
    settings = {"window": log.window, "settle": log.settle} | changed
    try:
        found = diagnose(record, log.plant, source=log.name, **settings)
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
    plant = load_vehicle(log.vehicle)
    return log.record(data, log.files, needs_of(plant)), plant


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
    """A table of measured logs, and one of simulated ones."""
    measured = {case: runs for case, runs in found.runs.items() if case not in FAMILIES}
    simulated = {case: runs for case, runs in found.runs.items() if case in FAMILIES}
    return [of(runs) for of, runs in ((_by_log, measured), (_by_family, simulated)) if runs]


def _by_log(logs: Mapping[str, Mapping[int, Any]]) -> Sheet:
    rows = []
    for case, runs in logs.items():
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
    return Sheet("choices", "Names of measured logs with choices that should not matter", heads, rows)


def _by_family(families: Mapping[str, Mapping[int, Any]]) -> Sheet:
    """The share of logs with the same names as the whole, of those whose whole is named or tied.

    A log that is too short for a choice, and is refused, has no names to compare.
    """
    rows = []
    for family, runs in families.items():
        by_choice = [{r["choice"]: r for r in run} for run in runs.values()]
        sure = [one for one in by_choice if one[WHOLE]["verdict"] in ("named", "tied")]
        every: list[bool] = []
        for choice in CHOICES[1:]:
            used = [one for one in sure if one[choice]["verdict"] != "refused"]
            hits = [is_same(one[WHOLE]["groups"], one[choice]["groups"]) for one in used]
            flagged = sum(one[choice]["verdict"] == "unexplained" for one in used)
            rows.append([family, choice, f"{len(hits)}", rate(hits), f"{flagged}", f"{len(sure) - len(used)}"])
            every += hits
        rows += [[family, "all", f"{len(every)}", rate(every), "", ""], []]
    heads = ["vehicles", "choice", "logs>", "same names, %>", "unexplained>", "refused>"]
    title = "Simulated logs whose one effect is named: the same names with choices that should not matter"
    return Sheet("simulated", title, heads, rows)


def is_same(whole: Sequence[Sequence[str]], other: Sequence[Sequence[str]]) -> bool:
    """Whether two diagnoses name the same: each group has a counterpart with a common member."""
    return kept(whole, other) == len(whole) == len(other)


MEASURED = tuple(log.name for log in logs())
STUDY = Study(
    about=__doc__ or "",
    attempt=attempt,
    cases=(*MEASURED, *FAMILIES),
    usual=MEASURED,
    sheets=sheets,
    seeds_of=lambda case, seeds: seeds if case in FAMILIES else seeds[:1],
    options={"data": Option("data", "folder of measured logs")},
)


if __name__ == "__main__":
    sys.exit(STUDY.main())
