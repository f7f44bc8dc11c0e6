"""The results of the study: interquartile means of returns, costs over the true vehicle's policies, gaps closed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scripts.studies.harness import Found, Sheet
from scripts.studies.rl.scenarios import (
    BELIEVED,
    CONTROLLERS,
    DIAGNOSED,
    SCENARIOS,
    TRUE,
    WORDS,
    case_of,
    split_case,
)
from scripts.studies.rl.statistics import Estimate, compared, iqm, share_closed
from scripts.studies.runs import read_json

Results = Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]  # by scenario, row, seed


@dataclass(frozen=True)
class Line:
    """A row of a table: interquartile mean of the runs' mean returns, and its comparison with others.

    cost: over that of the true vehicle's policies.  closed: share of the loss of the believed vehicle's policies that
    this row avoids; None for these two, for controllers, and if no loss is certain or rows are missing.
    cut: episodes that ended early.
    """

    row: str
    runs: int
    episodes: int
    cut: int
    score: Estimate
    cost: Estimate | None
    closed: Estimate | None


def by_scenario(found: Found) -> Results:
    """The results by scenario and row, in the order of WORDS; rows without any are left out."""
    return {
        name: {row: found.of(case_of(name, row)) for row in WORDS if found.of(case_of(name, row))}
        for name in dict.fromkeys(split_case(case)[0] for case in found.runs)
    }


def scores_of(results: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """The score of each run: its mean return over the episodes."""
    return np.array([np.mean(result["returns"]) for result in results])


def gap_of(found: Results, name: str) -> Estimate:
    """The loss of the believed vehicle's policies in return, against those of the true one."""
    scores = [scores_of(found[name][row]) for row in (TRUE, BELIEVED)]
    return compared(scores, lambda true, believed: true - believed, np.random.default_rng(0))


def lines_of(found: Results, name: str) -> list[Line]:
    """The table of a scenario."""
    scores = {row: scores_of(results) for row, results in found[name].items()}
    lines = []
    for row, results in found[name].items():
        rng = np.random.default_rng(0)
        cost = closed = None
        if TRUE in scores and row != TRUE:
            cost = compared([scores[row], scores[TRUE]], lambda own, true: own / true, rng)
            if BELIEVED in scores and row not in (BELIEVED, *CONTROLLERS) and gap_of(found, name).low > 0.0:
                closed = compared([scores[TRUE], scores[BELIEVED], scores[row]], share_closed, rng)
        episodes = sum(len(result["returns"]) for result in results)
        cut = sum(result["cut"] for result in results)
        lines.append(Line(row, len(results), episodes, cut, iqm([scores[row]], rng), cost, closed))
    return lines


def costs_over_all(found: Results) -> dict[str, Estimate]:
    """The interquartile mean over all scenarios of the cost over that of the true vehicle's policies, by row."""
    names = [name for name in found if TRUE in found[name]]
    costs = {}
    for row in WORDS:
        if len(names) > 1 and all(row in found[name] for name in names):
            true = [float(iqm([scores_of(found[n][TRUE])], np.random.default_rng(0)).value) for n in names]
            strata = [scores_of(found[n][row]) / unit for n, unit in zip(names, true, strict=True)]
            costs[row] = iqm(strata, np.random.default_rng(0))
    return costs


def sheets(found: Found) -> list[Sheet]:
    """A table for each scenario, one over all, the diagnosis of each log, and in a file the numbers."""
    results = by_scenario(found)
    shown, numbers = [], []
    heads = tuple(f"{head}>" if i else head for i, head in enumerate(_HEADS))
    for name in results:
        lines = lines_of(results, name)
        shown.append(Sheet(name, SCENARIOS[name].title, heads, [_cells(line) for line in lines]))
        for line in lines:
            parts = {"return": line.score, "cost over true": line.cost, "share of gap closed": line.closed}
            for part, e in parts.items():
                if e is not None:
                    numbers.append([name, line.row, part, *(f"{value:.6g}" for value in (e.value, e.low, e.high))])
    rows = [[WORDS[row], _with_interval(cost, 2)] for row, cost in costs_over_all(results).items()]
    if rows:
        title = "Cost over that of policies trained on the true vehicle, all scenarios"
        shown.append(Sheet("all", title, ("trained on", "cost>"), rows))
    said = [row for name in results for row in _diagnoses(results, name, found.folder)]
    if said:
        heads = ("scenario", "seed", "verdict", "named, 95 % interval", "true")
        shown.append(Sheet("diagnoses", "What the diagnosis of each log said", heads, said))
    heads = ("scenario", "trained on", "what", "interquartile mean", "low", "high")
    return [*shown, Sheet("numbers", "Interquartile means with 95 % intervals", heads, numbers, printed=False)]


_HEADS = (
    "trained on",
    "runs",
    "return, IQM (95 % interval)",
    "cost over (a)",
    "share of the gap (a) - (c) closed",
    "ended early",
)


def _cells(line: Line) -> list[str]:
    cost = "1" if line.row == TRUE else _with_interval(line.cost, 2)
    runs = "" if line.row in CONTROLLERS else f"{line.runs}"
    early = f"{line.cut} of {line.episodes}" if line.cut else "0"
    return [WORDS[line.row], runs, _with_interval(line.score, 2), cost, _share(line.closed), early]


def _diagnoses(found: Results, name: str, out: Path | None) -> Iterator[list[str]]:
    path, size = SCENARIOS[name].effect
    for result in found[name].get(DIAGNOSED, ()) if out is not None else ():
        said = read_json(out / name / "models" / f"{DIAGNOSED}_seed_{result['seed']}.json")
        named = "; ".join(map(_named, said["effects"])) or "nothing"
        yield [name, str(result["seed"]), said["verdict"], named, f"`{path}` {size:g}"]


def _named(effect: Mapping[str, Any]) -> str:
    low, high = effect["ci95"]
    tied = f", not told from {', '.join(effect['tied_with'])}" if effect["tied_with"] else ""
    return f"`{effect['path']}` {effect['value']:.3g} ({low:.3g} to {high:.3g}){tied}"


def _with_interval(estimate: Estimate | None, digits: int) -> str:
    if estimate is None:
        return ""
    value = f"{estimate.value:.{digits}f}"
    if estimate.low == estimate.high:
        return value
    return f"{value} ({estimate.low:.{digits}f} to {estimate.high:.{digits}f})"


def _share(estimate: Estimate | None) -> str:
    if estimate is None:
        return ""
    percent = Estimate(*(100.0 * value for value in (estimate.value, estimate.low, estimate.high)))
    return f"{_with_interval(percent, 0)} %"
