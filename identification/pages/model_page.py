"""The pages of `auv-gym identify` and `auv-gym compare`, and the tables shared with the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from auv_gym import __version__
from auv_gym.channels import channel
from auv_gym.model import Trained
from auv_gym.param import listed
from auv_gym.plant import Plant
from identification.compare.comparison import OpenLoop
from identification.compare.model_tests import is_white, strongest_input_correlation
from identification.diagnosis.wording import capital
from identification.estimate import Estimate
from identification.estimator import Fit, notes_of
from identification.identified import Identified
from identification.linear.fit import LinearFit, has_errors, is_linear
from identification.linear.poles import pole_intervals
from identification.linear.polynomials.orders import OrderSearch
from identification.linear.uncertainty import SimulatedBand
from identification.pages.drawing import quantity_label, shown_values
from identification.pages.drawn_channels import outputs_of
from identification.pages.linear_figures import bode_figure, pole_zero_figure
from identification.pages.linear_tables import full_pole_table, order_table, zero_table
from identification.pages.model_figures import horizon_figure, residual_drawings, rollout_figure
from identification.pages.order_figures import order_figure, singular_value_figure
from identification.pages.page import Drawing, Table, amount, chance, drawn, number, page, span

# model -> channel -> horizon in s -> RMS error
Sweeps = Mapping[str, Mapping[str, Mapping[float, float]]]
_RUNS = (
    "In a free run, the model sees only the inputs. Its initial state is fitted to the first {settle} of each window, "
    "which are not scored. All models are treated alike."
)
_BAND = (
    " Shaded: the 95 % band that follows from the uncertainty of the parameters. It includes neither disturbances nor "
    "effects that the model is missing."
)
_TESTS = (
    "p: p-value of the Ljung-Box test for whiteness; residuals with p above 0.01 count as white. Lag 1: correlation "
    "with the sample before. Strongest input: the input whose earlier samples correlate most with the residual, with "
    "the correlation relative to the 95 % noise bound."
)


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    title: str
    texts: Sequence[str] = ()
    tables: Sequence[Table] = ()
    drawings: Sequence[Drawing] = ()


def parameter_table(estimates: Sequence[Estimate]) -> Table:
    """Each parameter with its value and 95 % interval; the reason for a missing interval is given below."""
    problems = list(dict.fromkeys(e.problem for e in estimates if e.problem))
    rows = [(e.path, amount(e.value, e.unit), _interval(e, problems)) for e in estimates]
    caption = " ".join(f"({number}) {capital(problem)}." for number, problem in enumerate(problems, 1))
    return Table(("parameter", "value", "95 % interval"), tuple(rows), caption=caption)


def score_table(open_loop: OpenLoop) -> Table:
    """Free-run errors by output and model; with several models, for the outputs that more than one of them has."""
    rows = []
    for name in outputs_of_several_models(open_loop.scores):
        for model, of in open_loop.scores.items():
            if name in of:
                s, unit = of[name], channel(name).unit
                errors = amount(s.rmse, unit), amount(s.maximum, unit)
                rows.append((name, model, *errors, f"{s.fit_percent:.1f} %", number(s.r2, 4)))
    return Table(("output", "model", "RMS error", "largest", "fit", "R²"), tuple(rows), words=2)


def horizon_table(sweeps: Sweeps) -> Table:
    """RMS prediction errors by output and model, one column for each horizon in s."""
    horizons = sorted({k for of in sweeps.values() for errors in of.values() for k in errors})
    rows = []
    for name in outputs_of_several_models(sweeps):
        for model, of in sweeps.items():
            if name in of:
                found = [
                    number(float(shown_values(name, np.asarray(of[name][k])))) if k in of[name] else "–"
                    for k in horizons
                ]
                rows.append((quantity_label(name), model, *found))
    return Table(("output", "model", *(f"{k:g} s" for k in horizons)), tuple(rows), words=2)


def outputs_of_several_models(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The outputs that more than one model has, or all if there are none; found: model -> channel -> anything."""
    names = [name for of in found.values() for name in of]
    shared = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    return shared or list(dict.fromkeys(names))


def residual_table(tests: Mapping[str, Mapping[str, Any]]) -> Table:
    """Whiteness of each output's residual, and the input that it correlates with most."""
    rows = []
    for name, test in tests.items():
        driver, size = strongest_input_correlation(test)
        tie = f"{driver} ({number(size, 2)})" if driver else "–"
        rms, first = amount(test["rms"], channel(name).unit), number(test["correlation"][0], 2)
        rows.append((name, tie, rms, first, chance(test["p_value"]), "yes" if is_white(test) else "no"))
    return Table(("output", "strongest input", "RMS", "lag 1", "p", "white"), tuple(rows), words=2, caption=_TESTS)


def identified_page(title: str, done: Identified, words: str) -> str:
    """The page of one fit: free runs over held-out data, parameters, residual tests; words: what was fitted.

    For a linear fit also predictions over the horizon, poles and zeros, frequency response, and the choice of orders.
    """
    found, sections = [*(f"Check the data: {doubt}" for doubt in done.doubts), words], []
    if done.open_loop is not None and done.open_loop.runs:
        scores = done.open_loop.scores["model"]
        told = [f"{s.fit_percent:.1f} % of {channel(name).label}" for name, s in scores.items()]
        found.append(f"Free runs over held-out data ({done.told}) fit {listed(told, 'and')}.")
        sections.append(_free_run_section(done.open_loop, f"Free runs over {done.told}", done.band))
    found += outside_words(done)
    if done.sweep:
        sections.append(_horizon_section({"model": done.sweep}))
    if done.problem:
        found.append(f"It could not be judged in full: {done.problem}")
    sections.append(_parameter_section(done.fit))
    if is_linear(done.fit):
        sections += [_pole_section(done.fit), _response_section(done.fit)]
    if done.tests:
        sections.append(_residual_section(done.tests))
    sections += _order_sections(done)
    return _page(title, "auv-gym identify", found, sections)


def outside_words(done: Identified) -> list[str]:
    """How much of the held-out data is unlike the training data, for models that know this."""
    model = done.fit.model
    trained = model.learned if isinstance(model, Plant) else model
    if not isinstance(trained, Trained) or done.open_loop is None:
        return []
    share = number(100.0 * trained.outside(done.held), 2)
    return [f"{share} % of the held-out samples are outside of what the model was trained on: there it is a guess."]


def compared_page(title: str, open_loop: OpenLoop, sweeps: Sweeps, words: str) -> str:
    """The page of several models over a record: free runs, and predictions over the horizon."""
    found = [words]
    for name in outputs_of_several_models(open_loop.scores):
        of = {model: scores[name] for model, scores in open_loop.scores.items() if name in scores}
        best = min(of, key=lambda model: of[model].rmse)
        found.append(f"{channel(name).label.capitalize()}: {best} fits best, {of[best].fit_percent:.1f} %.")
    found += [f"{model} has no free run: {reason}" for model, reason in open_loop.failed.items()]
    sections = [_free_run_section(open_loop, "Free runs")] if open_loop.runs else []
    if sweeps:
        names = outputs_of_several_models(sweeps)
        shared = {model: {n: errors for n, errors in of.items() if n in names} for model, of in sweeps.items()}
        sections.append(_horizon_section(shared))
    return _page(title, "auv-gym compare", found, sections)


def _page(title: str, eyebrow: str, found: Sequence[str], sections: Sequence[Section]) -> str:
    content = {"title": title, "eyebrow": eyebrow, "found": found, "sections": sections, "version": __version__}
    return page("models.html", content)


def _parameter_section(fit: Fit) -> Section:
    """The parameters, if there are any, and the remarks of the fit."""
    texts = [f"{capital(note)}." for note in notes_of(fit)]
    if texts and not fit.estimates:
        return Section("The fit", texts)
    return Section("Parameters", texts, [parameter_table(fit.estimates)])


def _free_run_section(open_loop: OpenLoop, title: str, band: SimulatedBand | None = None) -> Section:
    given = outputs_of_several_models(open_loop.scores)
    names = [name for name in outputs_of(open_loop.record, given) if name in given] or given[:1]
    records = {model: open_loop.shown(model) for model in open_loop.runs}
    bands = {} if band is None else {"model": dict(zip(band.channels, band.half.T, strict=True))}
    picture = drawn(
        lambda: rollout_figure(open_loop.shown(), records, names, "measured", bands),
        "free-runs",
        "Measured outputs and free runs of the models, with their errors below.",
        "Measured outputs and free runs; below each output, its error. An error that grows steadily is a drift; an "
        "error that follows the input points to a wrong gain or delay." + (_BAND if bands else ""),
    )
    windows = len(open_loop.windows)
    text = f"{windows} window{'s' * (windows != 1)}. " + _RUNS.format(settle=f"{open_loop.settle:g} s")
    return Section(title, [text], [score_table(open_loop)], [picture])


def _horizon_section(sweeps: Sweeps) -> Section:
    return Section(
        "Prediction error by horizon",
        ["Before each prediction, the state is corrected with all measurements so far; then the model runs free."],
        [horizon_table(sweeps)],
        [
            drawn(
                lambda: horizon_figure(sweeps),
                "horizon",
                "Root mean square error of predictions over the horizon.",
                "A good model of the vehicle keeps its error low far ahead. A model that only follows the "
                "measurements is good for a few samples.",
            )
        ],
    )


def _pole_section(fit: LinearFit) -> Section:
    tables = [full_pole_table(pole_intervals(fit)), zero_table(fit.model)]
    return Section(
        "Poles and zeros",
        tables=tables,
        drawings=[
            drawn(
                lambda: pole_zero_figure({"model": fit}),
                "poles",
                "Poles with their 95 % regions and zeros in the plane of discrete time.",
                "Grey lines: constant damping ratio ζ (solid) and constant natural frequency (dashed). A mode whose "
                "pole is outside the unit circle grows. A zero inside the region of a pole suggests an order too high.",
            )
        ],
    )


def _response_section(fit: LinearFit) -> Section:
    band = " Shaded: the 95 % band." if has_errors(fit) else ""
    return Section(
        "Frequency response",
        drawings=[
            drawn(
                lambda: bode_figure({"model": fit}),
                "response",
                "Gain and phase of every output by every input over the frequency.",
                f"Up to the Nyquist frequency, half the sampling rate.{band} A band is widest where the inputs did not "
                "move the vehicle.",
            )
        ],
    )


def _order_sections(done: Identified) -> list[Section]:
    sections = []
    if done.search is not None:
        sections.append(_search_section(done.search))
    if np.size(getattr(done.fit, "singular_values", ())) > 0:
        picture = drawn(
            lambda: singular_value_figure(done.fit),
            "singular-values",
            "Singular values of the subspace fit, those that were kept marked.",
            "Singular values well above the rest belong to states of the system; the rest is noise.",
        )
        sections.append(Section("Order", drawings=[picture]))
    return sections


def _search_section(search: OrderSearch) -> Section:
    picture = drawn(
        lambda: order_figure(search),
        "orders",
        "One-step error over the orders, and criteria over the number of parameters, with the choices.",
        "Left: the error of the best model for each n_a and n_b, over all n_c and delays. Right: the criteria, as "
        "errors: the square root of AIC and MDL, and the error equivalent to BIC.",
    )
    return Section("Orders", tables=[order_table(search)], drawings=[picture])


def _residual_section(tests: Mapping[str, Mapping[str, Any]]) -> Section:
    white = sum(map(is_white, tests.values()))
    title = f"Residual tests: {white} of {len(tests)} output{'s' * (len(tests) != 1)} white"
    return Section(title, tables=[residual_table(tests)], drawings=residual_drawings({"model": tests}))


def _interval(estimate: Estimate, problems: Sequence[str]) -> str:
    if estimate.problem:
        return f"none ({problems.index(estimate.problem) + 1})"
    return span(estimate.ci95, estimate.unit) if all(map(isfinite, estimate.ci95)) else "none"
