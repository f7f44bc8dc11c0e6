"""The rollout sections of the page: models driven by the vehicle's inputs, and steered in the vehicle's place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed
from identification.campaign.fits import VEHICLE
from identification.campaign.index import Row
from identification.campaign.report import figures
from identification.campaign.report.focus import representative_runs
from identification.campaign.report.wording import (
    counted,
    grid_cell_label,
    median,
    percents,
    run_of,
    spread,
    table_has_ranges,
)
from identification.campaign.rollouts import load_rollout
from identification.pages.drawn_channels import outputs_of
from identification.pages.model_figures import rollout_figure
from identification.pages.page import Drawing, Table, drawn

MOST_MODELS = 6  # lines in one figure
MOST_LINES = 60  # rows of the table; with more, cells of the grid are combined
MOST_COMPLAINTS = 8
_WORDS = {"open": "Open loop", "closed": "Closed loop"}
_TEXTS = {
    "open": "Each model got the inputs that the vehicle got, and ran free from the first samples on.",
    "closed": "Each model replaced the vehicle in the same environment, under the same controller with the same set "
    "points and seed. The controller reacts to the model's errors, and may hide or amplify them.",
}
_GROWTH = {
    "open": "In open loop they may grow; a flat line is a model that stays beside the vehicle.",
    "closed": "Feedback holds what open loop lets go; peaks after a step show wrong dynamics.",
}


def loop_content(
    kind: str, told: Sequence[Mapping[str, Any]], rows: Sequence[Row], folder: Path, wanted: Sequence[str]
) -> dict[str, Any] | None:
    """The section for one kind of rollouts: heading, words, table, complaints, figures; None without rollouts."""
    if not told:
        return None
    models = sorted(dict.fromkeys(name for r in told for name in r["models"]), key=lambda name: name == VEHICLE)
    names = [n for n in wanted if any(n in of["scores"] for r in told for of in r["models"].values())]
    table = _table(told, models, names)
    return {
        "heading": _heading(kind, told, models, names),
        "text": _TEXTS[kind],
        "table": table,
        "complaints": _complaints(told),
        "drawings": [*_growth(kind, told, names), *_pictures(kind, told, rows, folder, names)] if table else [],
    }


def _heading(kind: str, told: Sequence[Mapping[str, Any]], models: Sequence[str], names: Sequence[str]) -> str:
    """The error of the best model: the one with the fewest runs cut short, then with the smallest errors."""
    found = []
    for model in models:
        entries = [r["models"][model] for r in told if model in r["models"]]
        scores = {n: [e["scores"][n] for e in entries if n in e["scores"]] for n in names}
        scores = {n: of for n, of in scores.items() if of}
        if scores and model != VEHICLE:
            size = float(np.mean([median(s["percent"] for s in of) for of in scores.values()]))
            found.append((sum(bool(e["reason"]) for e in entries) / len(entries), size, model, scores))
    missing = sum(bool(of["reason"]) for r in told for of in r["models"].values())
    rest = f"; {counted(missing, 'rollout')} of models cut short" if missing else ""
    if not found:
        return f"{_WORDS[kind]}: no model could be run"
    _, _, model, scores = min(found, key=lambda entry: entry[:2])
    parts = []
    for name, of in scores.items():
        value, wide = spread([s["rmse"] for s in of], name)
        parts.append(f"{value}{f' ({wide})' if wide else ''} in {channel(name).label}")
    return f"{_WORDS[kind]}: {model} is off by {listed(parts, 'and')} (RMS){rest}"


def _table(told: Sequence[Mapping[str, Any]], models: Sequence[str], names: Sequence[str]) -> Table | None:
    """Errors by model, output and cell of the grid; cells are combined if there are too many."""
    cells: Sequence[str] = list(dict.fromkeys(grid_cell_label(r["cell"]) for r in told))
    apart = len(cells) > 1 and len(models) * len(names) * len(cells) <= MOST_LINES
    lines, marked = [], []
    for model in models:
        for cell in cells if apart else [""]:
            entries = [r["models"][model] for r in told if model in r["models"]]
            if apart:
                entries = [
                    r["models"][model] for r in told if model in r["models"] and grid_cell_label(r["cell"]) == cell
                ]
            short = sum(bool(entry["reason"]) for entry in entries)
            for name in names:
                of = [entry["scores"][name] for entry in entries if name in entry["scores"]]
                if of:
                    marked += [len(lines)] if short else []
                    words = [model, *([cell] if apart else []), channel(name).label]
                    count = (str(len(of)), f"{short} cut short" if short else "")
                    sizes = [spread([s[key] for s in of], name) for key in ("rmse", "maximum")]
                    step = spread([s["step"] for s in of], name)
                    lines.append([*words, count, *sizes, percents([s["percent"] for s in of]), step])
    if not lines:
        return None
    heads = ["model", *(["setting"] if apart else []), "output", "runs"]
    heads += ["RMS error", "largest error", "RMS error, of the step", "step"]
    caption = "Error: model minus vehicle" + (", as far as the model went" if marked else "")
    caption += "; median over the runs, and below it the range." if table_has_ranges(lines) else "."
    return Table(heads, lines, 3 if apart else 2, caption, marked)


def _complaints(told: Sequence[Mapping[str, Any]]) -> list[str]:
    """Why rollouts failed or ended early."""
    found = [f"Run {r['run']}, no model: {r['reason']}" for r in told if r["status"] != "done"]
    for r in told:
        for name, of in r["models"].items():
            if of["reason"]:
                how = "ended early" if of["status"] == "done" else "failed"
                found.append(f"{name} in run {r['run']} {how}: {of['reason']}")
    more = len(found) - MOST_COMPLAINTS
    return [*found[:MOST_COMPLAINTS], *([f"{more} more, in the JSON files"] if more > 0 else [])]


def _growth(kind: str, told: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[Drawing]:
    curves = _curves(told)
    if not curves or len(told) < 2:
        return []
    caption = f"How the models' errors develop over time, over {len(told)} runs (RMS). {_GROWTH[kind]}"
    label = "Error of each model over time, in percent of the step."
    return [drawn(lambda: figures.growth_figure(curves, names[:6]), f"{kind}-growth", label, caption)]


def _pictures(
    kind: str, told: Sequence[Mapping[str, Any]], rows: Sequence[Row], folder: Path, names: Sequence[str]
) -> list[Drawing]:
    """Outputs of the vehicle and of the models in one panel each, for two runs."""
    words = "measured" if kind == "open" else "vehicle"
    by_run = {r["run"]: r for r in told if r["status"] == "done"}
    made = []
    for count, row in enumerate(representative_runs([row for row in rows if row.id in by_run], 2)):
        entry = by_run[row.id]
        done = {n: m for n, m in entry["models"].items() if m["status"] == "done"}
        runs = {n: load_rollout(folder, m["file"]) for n, m in list(done.items())[:MOST_MODELS]}
        truth = load_rollout(folder, entry["file"])
        given = {name for n in runs for name in done[n]["scores"]}
        shown = [name for name in outputs_of(truth, names) if name in given][:4]
        if runs and shown:
            caption = f"{run_of(row)}: {words} in black, models in colour, and below each output their error."
            caption += "".join(f" {n} ended early: {done[n]['reason']}." for n in runs if done[n]["reason"])
            label = f"Outputs of vehicle and models over time, {kind} loop, {run_of(row)}."
            draw = lambda t=truth, r=runs, s=shown: rollout_figure(t, r, s, words)  # noqa: E731
            made.append(drawn(draw, f"{kind}{count}", label, caption))
    return made


def _curves(told: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Error over time of each model and output in percent of the step, RMS over the runs."""
    parts: dict[str, dict[str, list[Mapping[str, Any]]]] = {}
    for r in told:
        for name, of in r["models"].items():
            for output, curve in of["over_time"].items():
                parts.setdefault(name, {}).setdefault(output, []).append(curve)
    result: dict[str, dict[str, dict[str, list[float]]]] = {}
    for name, outputs in sorted(parts.items(), key=lambda item: item[0] == VEHICLE)[:MOST_MODELS]:
        for output, curves in outputs.items():
            longest = max(curves, key=lambda c: c["time_s"][-1])
            squares = [np.interp(longest["time_s"], c["time_s"], np.square(c["percent"]), right=np.nan) for c in curves]
            mean = np.sqrt(np.nanmean(squares, axis=0))
            result.setdefault(name, {})[output] = {"time_s": longest["time_s"], "percent": mean.tolist()}
    return result
