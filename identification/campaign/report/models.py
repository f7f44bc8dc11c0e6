"""The fitted models on the page: errors in held-out runs, parameters, poles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, isfinite
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed
from identification.campaign.fits import VEHICLE
from identification.campaign.report.wording import (
    counted,
    left_out,
    median,
    percents,
    setting_text,
    spread,
    table_has_ranges,
)
from identification.pages.page import Table, amount, number, percent, span

MOST_PARAMETERS = 40  # in one table


def models_heading(fits: Sequence[Mapping[str, Any]]) -> str:
    """The best model, and the number of models that could not be fitted."""
    made = [fit for fit in fits if fit["status"] == "done"]
    scored = [(fit, median_fit_percents(fit)) for fit in made if fit["scores"]]
    missing = f"; {len(fits) - len(made)} of {counted(len(fits), 'fit')} failed" if len(made) < len(fits) else ""
    if not made:
        return f"Models: none, as {'the fit' if len(fits) == 1 else f'all {len(fits)} fits'} failed"
    if not any(scores for _, scores in scored):
        return f"Models: {len(made)} fitted, judged on no other run{missing}"
    fit, scores = max(scored, key=lambda pair: np.mean(list(pair[1].values()) or [-np.inf]))
    parts = [f"{channel(name).label} {percent(value)}" for name, value in scores.items()]
    worse = " (below 0 %: worse than a constant)" if min(scores.values()) < 0.0 else ""
    return f"Models: fit of {fit['name']} in free runs over held-out data: {listed(parts, 'and')}{worse}{missing}"


def median_fit_percents(fit: Mapping[str, Any]) -> dict[str, float]:
    """The median over the held-out runs of a model's fit in percent, by output."""
    of = {name: [s[name]["fit_percent"] for s in fit["scores"].values() if name in s] for name in fit["outputs"]}
    return {name: median(values) for name, values in of.items() if values}


def score_table(fits: Sequence[Mapping[str, Any]]) -> Table | None:
    """Errors in the held-out runs by model and output; the vehicle as designed comes last."""
    lines = []
    for fit in fits:
        for name in fit["outputs"]:
            of = [scores[name] for scores in fit["scores"].values() if name in scores]
            if of:
                words = [fit["name"], fit["method"], channel(name).label]
                lines.append([*words, str(len(fit["trained_on"])), str(len(of)), *_errors(of, name)])
    designed = {run: scores for fit in fits for run, scores in fit["vehicle_scores"].items()}
    for name in dict.fromkeys(name for fit in fits for name in fit["outputs"]):
        of = [scores[name] for scores in designed.values() if name in scores]
        if of:
            lines.append([VEHICLE, "–", channel(name).label, "–", str(len(of)), *_errors(of, name)])
    heads = ["model", "method", "output", "runs fitted", "runs held out", "RMS error", "fit"]
    caption = "Median over the held-out runs, and below it the range." if table_has_ranges(lines) else ""
    return Table(heads, lines, 3, caption) if lines else None


def model_content(fit: Mapping[str, Any]) -> dict[str, Any]:
    """Title, text and tables of one model."""
    inputs, outputs = ([channel(name).label for name in fit[key]] for key in ("inputs", "outputs"))
    parts = [f"{fit['method']}, from {listed(inputs, 'and')} to {listed(outputs, 'and')}, {fit['dt']:g} s a sample"]
    parts += [", ".join(f"{key} {setting_text(value)}" for key, value in fit["settings"].items())]
    parts += [f"fitted in {number(fit['seconds'], 2)} s to {counted(len(fit['trained_on']), 'run')}"]
    shown = fit["parameters"][:MOST_PARAMETERS]
    more = left_out(len(fit["parameters"]) - len(shown), "further parameters: in the JSON file.")
    lines = [(_parameter(p), amount(p["value"], p["unit"]), _interval(p)) for p in shown]
    return {
        "title": fit["name"],
        "text": "; ".join([*filter(None, parts), f"models/{fit['file']}."]),
        "parameters": Table(("parameter", "value", "95 % interval"), lines, 1, more) if lines else None,
        "poles": pole_table(fit["poles"]),
    }


def _parameter(parameter: Mapping[str, Any]) -> str | tuple[str, str]:
    """The title of a vehicle's parameter with its path below; parameters of other models have only names."""
    title = parameter.get("title", "")  # fits by earlier versions have no titles
    return (title, parameter["name"]) if title else parameter["name"]


def pole_table(poles: Sequence[tuple[float, float]]) -> Table | None:
    """Poles of the linear form in continuous time, with damping ratio and time constant."""
    lines = []
    for real, imaginary in poles:
        if imaginary < 0.0:
            continue
        size = hypot(real, imaginary)
        still = size < 1e-9
        pole = f"{number(real)}" + (f" ± {number(imaginary)} i" if imaginary > 0.0 else "")
        kind = "integrator" if still else "unstable" if real > 0.0 else "oscillates" if imaginary > 0.0 else "settles"
        constant = "–" if still or real == 0.0 else f"{number(1.0 / abs(real))} s"
        lines.append((pole, kind, number(-real / size, 2) if not still else "–", constant))
    return Table(("pole, 1/s", "kind", "damping", "time constant"), lines, 2) if lines else None


def _errors(scores: Sequence[Mapping[str, Any]], name: str) -> list[tuple[str, str]]:
    return [spread([s["rmse"] for s in scores], name), percents([s["fit_percent"] for s in scores])]


def _interval(parameter: Mapping[str, Any]) -> str:
    low, high = parameter["ci95"] or (float("nan"), float("nan"))
    if isfinite(low) and isfinite(high):
        return span((low, high), parameter["unit"])
    return parameter["problem"] or "none"
