"""What the study found, as numbers, as tables for a terminal, and as Markdown and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from auv_gym.cli.options.console import table
from auv_gym.writing import replacing
from scripts.rl.runs import done
from scripts.rl.settings import BELIEVED, CONTROLLERS, DIAGNOSED, SETTINGS, TRUE, WORDS
from scripts.rl.statistics import Estimate, compared, iqm, share_closed

Found = Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]  # results by setting, row, seed
BOTH = "both"


@dataclass(frozen=True)
class Line:
    """A row of a table: interquartile mean of the runs' mean returns, and what it is beside others.

    cost: over that of the true vehicle's policies.  closed: share of what the believed vehicle's policies lose that
    this row does not; None for these two, for controllers, and where nothing is lost for sure or rows are not done.
    cut: episodes ended early.
    """

    row: str
    runs: int
    episodes: int
    cut: int
    score: Estimate
    cost: Estimate | None
    closed: Estimate | None


def gathered(out: Path, seeds: Sequence[int]) -> Found:
    """The results that a folder has, by setting and row; rows without any are left out."""
    found: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for name, setting in SETTINGS.items():
        for row in WORDS:
            kept = [done(name, row, seed, out) for seed in seeds if row in setting.all_rows]
            of = [result for result in kept if result is not None]
            if of:
                found.setdefault(name, {})[row] = of
    return found


def scores_of(results: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """The score of each run: its mean return over the episodes."""
    return np.array([np.mean(result["returns"]) for result in results])


def gap_of(found: Found, name: str) -> Estimate:
    """What the believed vehicle's policies lose in return, beside those of the true one."""
    scores = [scores_of(found[name][row]) for row in (TRUE, BELIEVED)]
    return compared(scores, lambda true, believed: true - believed, np.random.default_rng(0))


def lines_of(found: Found, name: str) -> list[Line]:
    """The table of a setting."""
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


def costs_over_all(found: Found) -> dict[str, Estimate]:
    """By row, the interquartile mean over runs of all settings of the cost over that of the true vehicle's policies."""
    names = [name for name in found if TRUE in found[name]]
    costs = {}
    for row in WORDS:
        if len(names) > 1 and all(row in found[name] for name in names):
            true = [float(iqm([scores_of(found[n][TRUE])], np.random.default_rng(0)).value) for n in names]
            strata = [scores_of(found[n][row]) / unit for n, unit in zip(names, true, strict=True)]
            costs[row] = iqm(strata, np.random.default_rng(0))
    return costs


def as_json(found: Found) -> dict[str, Any]:
    """All numbers of the tables, and the mean return of each run."""
    told: dict[str, Any] = {}
    for name in found:
        rows = {}
        for line in lines_of(found, name):
            parts = {"return": line.score, "cost_over_true": line.cost, "share_of_gap_closed": line.closed}
            rows[line.row] = {
                "runs": line.runs,
                "episodes": line.episodes,
                "ended_early": line.cut,
                "mean_returns": scores_of(found[name][line.row]).tolist(),
                **{k: None if e is None else {"iqm": e.value, "ci95": [e.low, e.high]} for k, e in parts.items()},
            }
        told[name] = {"title": SETTINGS[name].title, "rows": rows}
        if {TRUE, BELIEVED} <= set(found[name]):
            gap = gap_of(found, name)
            told[name]["gap"] = {"iqm": gap.value, "ci95": [gap.low, gap.high]}
    over_all = costs_over_all(found)
    if over_all:
        told[BOTH] = {row: {"iqm": e.value, "ci95": [e.low, e.high]} for row, e in over_all.items()}
    return told


def console_tables(found: Found) -> list[Table]:
    """A table for each setting, and one over all."""
    shown = []
    for name in found:
        made = table(SETTINGS[name].title, *(f"{head}>" if i else head for i, head in enumerate(_HEADS)))
        for line in lines_of(found, name):
            made.add_row(*_cells(line))
        shown.append(made)
    over_all = costs_over_all(found)
    if over_all:
        made = table("Cost over that of policies trained on the true vehicle, both settings", "trained on", "cost>")
        for row, cost in over_all.items():
            made.add_row(WORDS[row], _with_interval(cost, 2))
        shown.append(made)
    return shown


def write_tables(found: Found, out: Path) -> list[Path]:
    """Write results.md, results.json and diagnoses.md into a folder; the files."""
    texts = {
        "results.md": "\n".join(_markdown(found)) + "\n",
        "results.json": json.dumps(as_json(found), indent=1) + "\n",
        "diagnoses.md": "\n".join(_diagnoses(found, out)) + "\n",
    }
    for name, text in texts.items():
        with replacing(out / name) as new:
            new.write_text(text, encoding="utf-8")
    return [out / name for name in texts]


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


def _markdown(found: Found) -> list[str]:
    lines: list[str] = []
    for name in found:
        lines += [f"**{SETTINGS[name].title}**", "", f"| {' | '.join(_HEADS)} |", f"|{' --- |' * len(_HEADS)}"]
        lines += [f"| {' | '.join(_cells(line))} |" for line in lines_of(found, name)]
        lines.append("")
    over_all = costs_over_all(found)
    if over_all:
        lines += ["**Cost over (a), both settings**", "", "| trained on | cost |", "| --- | --- |"]
        lines += [f"| {WORDS[row]} | {_with_interval(cost, 2)} |" for row, cost in over_all.items()]
    return lines


def _diagnoses(found: Found, out: Path) -> list[str]:
    """What the diagnosis of each log said."""
    lines = ["| setting | seed | verdict | named, 95 % interval | true |", "| --- | --- | --- | --- | --- |"]
    for name in found:
        path, size = SETTINGS[name].effect
        for result in found[name].get(DIAGNOSED, ()):
            file = out / name / "models" / f"{DIAGNOSED}_seed_{result['seed']}.json"
            said = json.loads(file.read_text(encoding="utf-8"))
            named = "; ".join(_named(effect) for effect in said["effects"]) or "nothing"
            lines.append(f"| {name} | {result['seed']} | {said['verdict']} | {named} | `{path}` {size:g} |")
    return lines


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
