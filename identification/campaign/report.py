"""The page of a campaign: what was run, what was identified, and how well models stand in for the vehicle."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.channels import channel, set_point_of
from auv_gym.record import Record
from auv_gym.writing import replacing
from identification.campaign import figures
from identification.campaign.fits import VEHICLE, read_fits
from identification.campaign.index import Row, read_index
from identification.campaign.plan import plan
from identification.campaign.rollouts import load_rollout, read_rollouts
from identification.campaign.settings import Campaign, EnvExperiment, RunSettings
from identification.drawing import require_render, shown_values, svg, unit_label
from identification.page import Drawing, amount, drawing, listed, number, page, span

DETAILED = 3  # runs shown one by one
SPECTRAL = 60  # runs in the spectra
MOST_MODELS = 6  # with parameters, lines in one figure
MOST_PARAMETERS = 40  # in one table
MOST_ROWS = 300  # of the table of runs
GLOSSARY = {
    "free run": "The model alone, driven by the inputs from one starting state, never looking at the outputs again.",
    "held out": "Runs that no fit has used. Errors there show what a model is worth on data that it has not seen.",
    "fit": "100 (1 - |error| / |output less its mean|) %: 100 % is perfect, 0 % no better than a constant.",
    "open loop": "The model gets the inputs that the vehicle got.",
    "closed loop": "The model stands in the vehicle's place, and the same controller steers it by its own outputs.",
    "step": "The largest change that the set point asks for in a run; without one, the range of the output.",
    "residual": "Measured minus model.",
    "white": "Without memory: knowing one sample of the residual says nothing about the next.",
    "95 % interval": "Where the parameter lies with 95 % confidence, if the model's form is right.",
}


def write_report(campaign: Campaign, folder: str | Path) -> Path:
    """`report.html` of a campaign's folder, one file that needs no other; fits and rollouts are in it if there are any.

    Raises ImportError, with the command to run, if the extra `render` is not installed.
    """
    require_render()
    folder = Path(folder)
    content = _content(campaign, folder, read_index(folder))
    path = folder / "report.html"
    with replacing(path) as new:
        new.write_text(page("campaign.html", content), encoding="utf-8")
    return path


def featured(rows: Sequence[Row], most: int = DETAILED) -> list[Row]:
    """A few runs that differ in their settings: the first of each cell of the grid, spread evenly over the cells."""
    firsts: dict[str, Row] = {}
    for row in rows:
        firsts.setdefault(_cell(row), row)
    cells = list(firsts.values())
    if len(cells) < most:
        cells += [row for row in rows if row not in cells][: most - len(cells)]
    return [cells[i] for i in np.unique(np.linspace(0, len(cells) - 1, min(most, len(cells))).astype(int))]


def _content(campaign: Campaign, folder: Path, rows: Sequence[Row]) -> dict[str, Any]:
    usable = [row for row in rows if row.finished and row.path(folder).is_file()]
    records = {row.id: Record.load(row.path(folder)) for row in usable}
    fits, rollouts = read_fits(folder), read_rollouts(folder)
    wanted = _outputs_in_question(fits, list(records.values()))
    fits = [_narrowed(fit, wanted) for fit in fits]
    made = [fit for fit in fits if fit["status"] == "done"]
    told = {kind: _rollouts(kind, rollouts[kind], rows, folder, wanted) for kind in ("open", "closed")}
    headings = {
        "experiment": _experiment_heading(rows),
        "spectra": "Spectra: where the power of inputs and outputs lies",
        "models": _models_heading(fits),
        "open": told["open"]["heading"] if told["open"] else "",
        "closed": told["closed"]["heading"] if told["closed"] else "",
        "residuals": "",
        "runs": _runs_heading(rows),
    }
    residuals = _residuals(made)
    headings["residuals"] = residuals["heading"] if residuals else ""
    found = [headings[key] for key in ("experiment", "models", "open", "closed", "residuals") if headings[key]]
    keys = {
        "experiment": "Experiment",
        "spectra": "Spectra",
        "models": "Models",
        "open-loop": "Open loop",
        "closed-loop": "Closed loop",
        "residuals": "Residuals",
        "runs": "All runs",
        "method": "How it was done",
    }
    there = {
        "spectra": bool(records),
        "models": bool(fits),
        "open-loop": bool(told["open"]),
        "closed-loop": bool(told["closed"]),
        "residuals": bool(residuals),
    }
    return {
        "name": campaign.name,
        "description": campaign.description,
        "summary": " ".join(f"{line}." for line in found),
        "found": found if len(found) > 1 else [headings["experiment"]],
        "failed_runs": sum(not row.usable for row in rows),
        "failed_fits": len(fits) - len(made),
        "cards": _cards(rows, records, fits, rollouts),
        "sections": [(key, title) for key, title in keys.items() if there.get(key, True)],
        "headings": headings,
        "setup": _setup(plan(campaign)[0].settings, rows, records),
        "tracking": _tracking(usable, records),
        "experiment": _experiment(usable, records, wanted),
        "spectra": _spectra(usable, records, wanted),
        "has_fits": bool(fits),
        "scores": _scores(made),
        "failures": [(fit["name"], fit["reason"]) for fit in fits if fit["status"] != "done"],
        "models": [_model(fit) for fit in made[:MOST_MODELS]],
        "models_left_out": _left_out(len(made) - MOST_MODELS, "further models: parameters in their JSON files."),
        "rollouts": told,
        "residuals": residuals,
        "runs": _runs(rows, records),
        "runs_left_out": _left_out(len(rows) - MOST_ROWS, "further runs: in index.csv."),
        "glossary": GLOSSARY,
        "versions": next((str(r.attrs["versions"]) for r in records.values() if r.attrs.get("versions")), ""),
        "settings": campaign.text,
    }


def _outputs_in_question(fits: Sequence[Mapping[str, Any]], records: Sequence[Record]) -> list[str]:
    """The outputs that have a set point or that a linear model gives; a vehicle has a dozen that nobody asked about."""
    if not records:
        return []
    aimed = [name for name in figures.outputs_of(records[0]) if records[0].has(set_point_of(name))]
    given = [name for fit in fits if fit["file"].endswith(".npz") for name in fit["outputs"]]
    return list(dict.fromkeys([*aimed, *given])) or figures.outputs_of(records[0])


def _narrowed(fit: Mapping[str, Any], wanted: Sequence[str]) -> dict[str, Any]:
    """What is told of a fit, about these outputs alone."""

    def kept(of: Mapping[str, Any]) -> dict[str, Any]:
        return {name: of[name] for name in wanted if name in of}

    return {
        **fit,
        "outputs": [name for name in wanted if name in fit["outputs"]],
        "scores": {run: kept(scores) for run, scores in fit["scores"].items()},
        "vehicle_scores": {run: kept(scores) for run, scores in fit["vehicle_scores"].items()},
        "residuals": kept(fit["residuals"]),
    }


def _left_out(count: int, words: str) -> str:
    return f"{count} {words}" if count > 0 else ""


def _table(heads: Sequence[str], rows: Sequence[Sequence[Any]], words: int = 1, caption: str = "", bad=()) -> dict:
    """A table for the template; of a cell that is a pair the second stands below.  words: columns without numbers."""
    return {
        "heads": heads,
        "right": list(range(words, len(heads))),
        "rows": [
            {"cells": [c if isinstance(c, tuple) else (c, "") for c in row], "failed": count in bad}
            for count, row in enumerate(rows)
        ],
        "caption": caption,
    }


def _experiment_heading(rows: Sequence[Row]) -> str:
    bad = [row for row in rows if not row.usable]
    count = f"{len(rows)} run{'s' * (len(rows) != 1)}"
    if not bad:
        return f"Experiment: {count}, all finished" if len(rows) > 1 else f"Experiment: {count}, finished"
    states = {status: sum(row.status == status for row in bad) for status in dict.fromkeys(r.status for r in bad)}
    return f"Experiment: {count}, of which " + ", ".join(f"{n} {status}" for status, n in states.items())


def _runs_heading(rows: Sequence[Row]) -> str:
    return f"All runs: {sum(row.usable for row in rows)} of {len(rows)} with a record"


def _models_heading(fits: Sequence[Mapping[str, Any]]) -> str:
    scored = [(fit, _medians(fit)) for fit in fits if fit["status"] == "done" and fit["scores"]]
    if not scored:
        return "Models: " + ("none was fitted" if all(f["status"] != "done" for f in fits) else f"{len(fits)} fitted")
    fit, scores = max(scored, key=lambda pair: np.mean([s["fit_percent"] for s in pair[1].values()]))
    parts = [f"{channel(name).label} to {number(s['fit_percent'], 3)} %" for name, s in scores.items()]
    return f"Models: {fit['name']} fits {listed(parts, 'and')} in runs that it has not seen"


def _medians(fit: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Median rmse and fit of a model over its held-out runs, by channel."""
    result = {}
    for name in fit["outputs"]:
        of = [scores[name] for scores in fit["scores"].values() if name in scores]
        if of:
            result[name] = {key: _median([s[key] for s in of]) for key in ("rmse", "fit_percent")}
    return result


def _median(values: Iterable[float | None]) -> float:
    """The median of those that are numbers."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else float("nan")


def _cards(rows, records: Mapping[str, Record], fits, rollouts) -> list[tuple[str, str, str]]:
    seconds = sum(record.duration_s for record in records.values())
    done = [fit for fit in fits if fit["status"] == "done"]
    cards = [
        ("runs with a record", f"{len(records)} / {len(rows)}", f"in {_cells(rows)}"),
        ("time at sea", _time(seconds), "simulated or logged, all runs"),
    ]
    if fits:
        held = sorted({run for fit in done for run in fit["scores"]})
        cards.append(("models fitted", f"{len(done)} / {len(fits)}", f"judged on {len(held)} held-out runs"))
    closed = [s["percent"] for r in rollouts["closed"] for m in r["models"].values() for s in m["scores"].values()]
    if closed:
        cards.append(
            (
                "closed loop, model for vehicle",
                f"{number(float(np.median(closed)), 2)} %",
                "of the step, median rms error",
            )
        )
    return cards


def _cells(rows: Sequence[Row]) -> str:
    count = len({_cell(row) for row in rows})
    return f"{count} cells of the grid" if count > 1 else "one setting"


def _time(seconds: float) -> str:
    size, unit = (3600.0, "h") if seconds > 2.0 * 3600.0 else (60.0, "min") if seconds > 300.0 else (1.0, "s")
    return f"{number(seconds / size, 3)} {unit}"


def _cell(row: Row) -> str:
    """The values of the grid in a run: `controller.kind pid, vehicle.dt_s 4`; empty without a grid."""
    return ", ".join(f"{key} {_value(value)}" for key, value in row.cell.items())


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _of(row: Row) -> str:
    """Words for a run: its id, cell and seed."""
    return ", ".join(part for part in (f"Run {row.id}", _cell(row), f"seed {row.seed}") if part)


def _setup(settings: RunSettings, rows: Sequence[Row], records: Mapping[str, Record]) -> list[tuple[str, str]]:
    """What was run, in words."""
    facts = _said(settings, {key for row in rows for key in row.cell})
    seeds = sorted({row.seed for row in rows})
    facts.append(("seeds", f"{len(seeds)}: {_compact(seeds)}"))
    for key in dict.fromkeys(key for row in rows for key in row.cell):
        values = dict.fromkeys(_value(row.cell[key]) for row in rows if key in row.cell)
        facts.append((f"grid, {key}", ", ".join(values)))
    if records:
        record = next(iter(records.values()))
        even = "" if record.is_uniform() else " in the median"
        facts.append(("first record", f"{len(record):,} samples, {record.sample_interval:.4g} s apart{even}"))
    return facts


def _said(settings: RunSettings, varied: Iterable[str]) -> list[tuple[str, str]]:
    """What the settings of a run say, apart from what the grid varies."""
    varied = set(varied)
    vehicle, experiment, envelope = settings.vehicle, settings.experiment, settings.envelope
    facts = []
    if vehicle is not None:
        text = vehicle.preset or str(vehicle.file)
        text += f", {vehicle.dt_s:g} s a sample" if vehicle.dt_s is not None else ""
        facts.append(("vehicle.preset", "vehicle", text))
        effects = [f"{path.removeprefix('effects.')} {value:g}" for path, value in vehicle.effects.items()]
        facts.append(("", "effects", ", ".join(effects)))
    if isinstance(experiment, EnvExperiment):
        text = f"{experiment.env_id}" + (f", {experiment.duration_s:g} s" if experiment.duration_s is not None else "")
        facts.append(("experiment.id", "environment", text))
        for name, steps in experiment.steps.items():
            text = ", ".join(f"{amount(value, channel(name).unit)} from {time:g} s" for time, value in steps[:8])
            facts.append(("", f"set point of {channel(name).label}", text + (", ..." if len(steps) > 8 else "")))
    else:
        facts.append(("", experiment.kind, getattr(experiment, "file", "") or "the standard experiment of the vehicle"))
    if settings.controller is not None:
        told = [settings.controller.kind, *(f"{k} {_value(v)}" for k, v in settings.controller.settings.items())]
        facts.append(("controller.kind", "controller", ", ".join(told)))
    for given in settings.excitation:
        told = [f"{given.kind} at {channel(given.at).label}", *(f"{k} {_value(v)}" for k, v in given.settings.items())]
        facts.append(("", "excitation", ", ".join(told)))
    if envelope is not None:
        told = [f"{channel(n).label} {span(limits, channel(n).unit)}" for n, limits in envelope.limits.items()]
        facts.append(("", "envelope", "; ".join(told)))
    facts.append(("", "sensors", ", ".join(f"{path} {value:g}" for path, value in settings.sensors.items())))
    return [(word, text) for key, word, text in facts if text and key not in varied]


def _compact(numbers: Sequence[int]) -> str:
    """`0 to 19`, or the numbers if they have gaps."""
    if len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(map(str, numbers))


def _spread(values: Sequence[float], name: str) -> tuple[str, str]:
    """`0.41 m` and `0.30 to 0.66`: median and range of amounts of a channel."""
    return _summed(list(map(float, shown_values(name, np.asarray(values, dtype=float)))), unit_label(name))


def _percents(given: Sequence[float | None]) -> tuple[str, str]:
    return _summed([value for value in given if value is not None], "%")


def _summed(values: Sequence[float], unit: str) -> tuple[str, str]:
    if not values:
        return "–", ""
    wide = f"{number(min(values))} to {number(max(values))}" if len(values) > 1 else ""
    return f"{number(float(np.median(values)))} {unit}", wide


def _tracking(rows: Sequence[Row], records: Mapping[str, Record]) -> dict[str, Any] | None:
    """Per cell of the grid: errors against the set points, work of the inputs, share of time that the guard acted."""
    if not rows:
        return None
    first = records[rows[0].id]
    aimed = [n for n in figures.outputs_of(first) if first.has(set_point_of(n))]
    driven = figures.inputs_of(first)
    if not aimed:
        return None
    guarded = any(record.has("envelope_flag") for record in records.values())
    heads = ["setting", "runs"]
    heads += [f"rms error of {channel(n).label}" for n in aimed]
    heads += [f"rms of {channel(n).label} about its mean" for n in driven]
    heads += ["guard acted"] if guarded else []
    lines = []
    for cell in dict.fromkeys(map(_cell, rows)):
        of = [records[row.id] for row in rows if _cell(row) == cell]
        line = [cell or "all runs", str(len(of))]
        line += [_spread_over(of, n, lambda r, n=n: _rms(r[n] - r[set_point_of(n)])) for n in aimed]
        line += [_spread_over(of, n, lambda r, n=n: float(np.std(r[n]))) for n in driven]
        if guarded:
            line.append(_percents([100.0 * float(np.mean(figures.guard_acted(r))) for r in of]))
        lines.append(line)
    caption = "Set point less reading, over whole runs, steps included: median over the seeds, and below it the range."
    return _table(heads, lines, 1, caption)


def _spread_over(records: Sequence[Record], name: str, measure: Callable[[Record], float]) -> tuple[str, str]:
    values = [
        measure(r) for r in records if r.has(name) and (channel(name).kind == "input" or r.has(set_point_of(name)))
    ]
    return _spread(values, name)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def _experiment(rows: Sequence[Row], records: Mapping[str, Record], wanted: Sequence[str]) -> list[Drawing]:
    if not rows:
        return []
    made = []
    of = [records[row.id] for row in rows]
    if len(rows) > DETAILED:
        shown = min(len(of), figures.MOST_LINES)
        which = f"all {len(of)} runs" if shown == len(of) else f"{shown} of the {len(of)} runs, evenly picked"
        caption = (
            f"Outputs of {which}, over one another. Look for runs that leave the bundle, and for a bundle that widens."
        )
        made.append(
            _drawn(lambda: figures.overlay_figure(of, wanted), "overlay", "Outputs of all runs over time.", caption)
        )
    for count, row in enumerate(featured(rows)):
        caption = f"{_of(row)}. Outputs in black with set points dashed, inputs in green"
        caption += ", of which the ochre part is excitation" if _excited(records[row.id]) else ""
        caption += (
            "; in the shaded times the envelope's guard acted." if figures.guard_acted(records[row.id]).any() else "."
        )
        label = f"Outputs, set points and inputs over time, {_of(row)}."
        record = records[row.id]
        made.append(_drawn(lambda r=record: figures.signals_figure(r, wanted), f"signals{count}", label, caption))
    return made


def _excited(record: Record) -> bool:
    return any(name.startswith("excitation_") for name in record.names)


def _spectra(rows: Sequence[Row], records: Mapping[str, Record], wanted: Sequence[str]) -> Drawing | None:
    of = [records[row.id] for row in rows][:SPECTRAL]
    names = [*figures.outputs_of(of[0], wanted), *figures.inputs_of(of[0])] if of else []
    if not any(figures.spectra(of, name)[0].size for name in names):
        return None
    number_ = max(len(figures.spectra(of, name)[1]) for name in names)
    caption = "Power spectra by Welch's method. " + (
        f"Lines: median over {number_} runs; bands: their range. " if number_ > 1 else ""
    )
    caption += (
        "Where an output's power falls to a flat floor, noise is all that is left, and no model can be "
        "identified; an input needs power where the vehicle responds."
    )
    label = "Power spectra of outputs and inputs against frequency."
    return _drawn(lambda: figures.spectra_figure(of, wanted), "spectra", label, caption)


def _drawn(draw: Callable[[], Any], name: str, label: str, caption: str) -> Drawing:
    return drawing(svg(draw, name, label), caption)


def _scores(fits: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Model by output: errors over the held-out runs."""
    lines = []
    for fit in fits:
        for name in fit["outputs"]:
            of = [scores[name] for scores in fit["scores"].values() if name in scores]
            if of:
                lines.append(
                    [
                        fit["name"], fit["method"], channel(name).label, str(len(fit["trained_on"])), str(len(of)),
                        _spread([s["rmse"] for s in of], name), _percents([s["fit_percent"] for s in of]),
                    ]
                )  # fmt: skip
    designed = {run: scores for fit in fits for run, scores in fit["vehicle_scores"].items()}
    for name in dict.fromkeys(name for fit in fits for name in fit["outputs"]):
        of = [scores[name] for scores in designed.values() if name in scores]
        if of:
            ends = [_spread([s["rmse"] for s in of], name), _percents([s["fit_percent"] for s in of])]
            lines.append([VEHICLE, "–", channel(name).label, "0", str(len(of)), *ends])
    heads = ["model", "method", "output", "runs fitted", "held out", "rms error", "fit"]
    caption = "Median over the held-out runs, and below it the range."
    return _table(heads, lines, 3, caption) if lines else None


def _model(fit: Mapping[str, Any]) -> dict[str, Any]:
    text = f"{fit['method']}, from {listed([channel(n).label for n in fit['inputs']], 'and')} to "
    text += f"{listed([channel(n).label for n in fit['outputs']], 'and')}, {fit['dt']:g} s a sample; "
    settings = ", ".join(f"{key} {_value(value)}" for key, value in fit["settings"].items())
    text += f"{settings}; " if settings else ""
    text += f"fitted in {number(fit['seconds'], 2)} s to {len(fit['trained_on'])} "
    text += f"run{'s' * (len(fit['trained_on']) != 1)}; models/{fit['file']}."
    shown = fit["parameters"][:MOST_PARAMETERS]
    caption = _left_out(len(fit["parameters"]) - len(shown), "further parameters: in the JSON file.")
    lines = [[p["name"], amount(p["value"], p["unit"]), _interval(p)] for p in shown]
    return {
        "title": fit["name"],
        "text": text,
        "parameters": _table(["parameter", "value", "95 % interval"], lines, 1, caption) if lines else None,
        "poles": _poles(fit["poles"]),
    }


def _interval(parameter: Mapping[str, Any]) -> str:
    low, high = parameter["ci95"] or (float("nan"), float("nan"))
    if isfinite(low) and isfinite(high):
        return span((low, high), parameter["unit"])
    return parameter["problem"] or "none"


def _poles(poles: Sequence[tuple[float, float]]) -> dict[str, Any] | None:
    """Poles of the linear form in continuous time, with damping ratio and time constant."""
    lines = []
    for real, imaginary in poles:
        if imaginary < 0.0:
            continue
        size = float(np.hypot(real, imaginary))
        still = size < 1e-9
        pole = f"{number(real)}" + (f" ± {number(imaginary)} i" if imaginary > 0.0 else "")
        kind = "integrator" if still else "unstable" if real > 0.0 else "oscillates" if imaginary > 0.0 else "settles"
        constant = "–" if still or real == 0.0 else f"{number(1.0 / abs(real))} s"
        lines.append([pole, kind, number(-real / size, 2) if not still else "–", constant])
    return _table(["pole, 1/s", "", "damping", "time constant"], lines, 2) if lines else None


def _rollouts(
    kind: str,
    told: Sequence[Mapping[str, Any]],
    rows: Sequence[Row],
    folder: Path,
    wanted: Sequence[str],
) -> dict[str, Any] | None:
    """What one kind of rollouts shows: heading, words, table, figures; None where there are none."""
    if not told:
        return None
    models = sorted(dict.fromkeys(name for r in told for name in r["models"]), key=lambda name: name == VEHICLE)
    by_model: dict[str, dict[str, list[Mapping[str, float]]]] = {name: {} for name in models}
    failed = [("no model", r["run"], r["reason"]) for r in told if r["status"] != "done"]
    for r in told:
        for name, of in r["models"].items():
            if of["status"] != "done":
                failed.append((name, r["run"], of["reason"]))
            for output, score in of["scores"].items():
                by_model[name].setdefault(output, []).append(score)
    lines, best = [], []
    for name, outputs in by_model.items():
        outputs = {output: outputs[output] for output in wanted if output in outputs}
        for output, scores in outputs.items():
            percents = [s["percent"] for s in scores]
            rmse, most = _spread([s["rmse"] for s in scores], output), _spread([s["maximum"] for s in scores], output)
            lines.append([name, channel(output).label, str(len(scores)), rmse, most, _percents(percents)])
            if output == next(iter(outputs)) and name != VEHICLE:
                best.append((float(np.median(percents)), name, channel(output).label))
    heads = ["model", "output", "runs", "rms error", "largest error", "rms error, of the step"]
    caption = "Model less vehicle: median over the runs, and below it the range."
    words = "Open loop" if kind == "open" else "Closed loop"
    heading = f"{words}: no model could be run"
    if best:
        size, name, label = min(best)
        heading = f"{words}: {name} keeps {label} within {number(size, 2)} % of the step (rms) of the vehicle"
    text = (
        "Each model got the inputs that the vehicle got, and ran free from the first samples on."
        if kind == "open"
        else "Each model stood in the vehicle's place in the same environment, steered by the same controller with the "
        "same set points and seed. Its errors come back to it through the controller, which may hide or amplify them."
    )
    if failed:
        text += (
            f" {len(failed)} rollouts failed: " + "; ".join(f"{n} in run {r}: {why}" for n, r, why in failed[:5]) + "."
        )
    return {
        "heading": heading,
        "text": text,
        "table": _table(heads, lines, 2, caption) if lines else None,
        "drawings": _rollout_drawings(kind, told, by_model, rows, folder, wanted) if lines else [],
    }


def _rollout_drawings(kind, told, by_model, rows, folder: Path, wanted: Sequence[str]) -> list[Drawing]:
    made = []
    curves = _curves(told)
    names = list(dict.fromkeys(name for of in curves.values() for name in of))[:6]
    if curves and len(told) > 1:
        caption = f"How the models' errors develop over time, over {len(told)} runs (root mean square). "
        caption += (
            "In open loop they may grow; a flat line is a model that stays beside the vehicle."
            if (kind == "open")
            else "Feedback holds what open loop lets go; peaks after a step show wrong dynamics."
        )
        label = "Error of each model over time, in percent of the step."
        made.append(_drawn(lambda: figures.growth_figure(curves, names), f"{kind}-growth", label, caption))
    words = "measured" if kind == "open" else "true vehicle"
    by_id = {row.id: row for row in rows}
    there = [by_id[r["run"]] for r in told if r["run"] in by_id and r["status"] == "done"]
    for count, row in enumerate(featured(there, 2)):
        entry = next(r for r in told if r["run"] == row.id)
        runs = {n: load_rollout(folder, m["file"]) for n, m in entry["models"].items() if m["status"] == "done"}
        runs = dict(list(runs.items())[:MOST_MODELS])
        truth = load_rollout(folder, entry["file"])
        shown = [n for n in figures.outputs_of(truth, wanted) if any(n in by_model[m] for m in runs)][:4]
        if not runs or not shown:
            continue
        caption = f"{_of(row)}: {words} in black, models in colour, and below each output their error."
        label = f"Outputs of vehicle and models over time, {kind} loop, {_of(row)}."
        made.append(
            _drawn(
                lambda t=truth, r=runs, s=shown: figures.rollout_figure(t, r, s, words),
                f"{kind}{count}", label, caption,
            )
        )  # fmt: skip
    return made


def _curves(told: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Error over time of each model and output in percent of the step, root mean square over the runs."""
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


def _residuals(fits: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    tests = {fit["name"]: fit["residuals"] for fit in fits if fit["residuals"]}
    if not tests:
        return None
    lines, white, total = [], 0, 0
    for model, of in tests.items():
        for name, test in of.items():
            total, passed = total + 1, test["p_value"] > 0.01
            white += passed
            strongest = max(test["inputs"].items(), key=lambda item: _beyond(item[1]), default=None)
            tie = "–"
            if strongest:
                tie = f"{channel(strongest[0]).label}: {number(_beyond(strongest[1]), 2)} bounds"
            first, p = number(test["correlation"][0], 2, sign=True), test["p_value"]
            of_what = "one sample ahead" if test["ahead"] else "free run"
            chance = f"{p:.2g}" if p >= 1e-4 else "< 0.0001"
            line = [model, channel(name).label, of_what, _spread([test["rms"]], name), first, chance]
            lines.append([*line, "yes" if passed else "no", tie])
    heads = ["model", "output", "residual", "rms", "lag-1 correlation", "p (Ljung-Box)", "white", "tie to an input"]
    text = (
        "What models leave of held-out runs: errors one sample ahead where a model predicts, of free runs otherwise. A "
        "model that tells all that inputs and the past can tell leaves white residuals that follow no input; errors of "
        "free runs are hardly ever white."
    )
    few = dict(list(tests.items())[:MOST_MODELS])
    drawings = [
        _drawn(
            lambda: figures.autocorrelation_figure(few), "autocorrelation", "Autocorrelation of residuals, per output.",
            "Whether the residual remembers its past. Inside the grey band: no more than noise.",
        )
    ]  # fmt: skip
    if any(test["inputs"] for of in few.values() for test in of.values()):
        drawings.append(
            _drawn(
                lambda: figures.input_correlation_figure(few), "input-correlation",
                "Correlation of residuals with inputs at lags of either sign.",
                "Whether the residual follows an input. Beyond the band right of zero: a response that is lacking; "
                "left of zero: feedback, which moves the input after the output has gone astray.",
            )
        )  # fmt: skip
    heading = f"Residual tests: white in {white} of {total} outputs of models"
    return {"heading": heading, "text": text, "table": _table(heads, lines, 3), "drawings": drawings}


def _beyond(test: Mapping[str, Any]) -> float:
    """Largest correlation at lags above zero, in 95 % bounds; at zero an input cannot have acted yet."""
    lags, values = np.asarray(test["lags_s"]), np.abs(test["correlation"])
    return float(np.max(values[lags > 0.0]) / test["bound"])


def _runs(rows: Sequence[Row], records: Mapping[str, Record]) -> dict[str, Any]:
    heads = ["run", "status", "setting", "seed", "samples", "length"]
    lines, bad = [], []
    for count, row in enumerate(rows[:MOST_ROWS]):
        record = records.get(row.id)
        if not row.usable:
            bad.append(count)
        status = f"{row.status}: {row.reason}" if row.reason else row.status
        length = _time(record.duration_s) if record else "–"
        lines.append([row.id, status, _cell(row) or "–", str(row.seed), f"{len(record):,}" if record else "–", length])
    return _table(heads, lines, 3, bad=bad)
