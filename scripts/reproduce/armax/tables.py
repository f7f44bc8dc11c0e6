"""Tables of the models of depth and pitch, and whether they reach the targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import isfinite

import numpy as np

from identification.linear.poles import PoleInterval, pole_intervals
from identification.pages.drawing import shown_values, unit_label
from scripts.reproduce.armax.control import LEGS
from scripts.reproduce.armax.models import DEPTH, LONGER, N_A, OUTPUTS, PUBLISHED, in_degrees, methods
from scripts.reproduce.armax.study import BOTH, TAKEN, TARGETS, Row, Study, published_cell, reached, true_form
from scripts.studies.harness import Sheet

_DELAY = 1e-6  # largest pole of a pure delay, and largest rounding error
_SHOWN = ("ARMAX", "ARMAX, pole at 1", TAKEN)  # with their coefficients


def verdict(found: Study) -> list[str]:
    """The targets, and the least that each method of the paper's orders reaches on a held-out seed."""
    lines = []
    for name in methods(found.n_c):
        fits = [row.fit for row in (*found.rows, *found.spread) if row.model == name and row.fresh]
        least = {what: min(getattr(fit, what) for fit in fits) for what in TARGETS}
        ends = " and ".join(f"{what} {value:.1f} %" for what, value in least.items())
        made = sum(reached([fit]) for fit in fits)
        lines.append(f"{name}: at least {ends}; both targets in {made} of {len(fits)} free runs.")
    wanted = " and ".join(f"{what} {value:g} %" for what, value in TARGETS.items())
    return [f"Wanted: {wanted}, over data of seeds that the model was not fitted to.", *lines]


def sheets(found: Study) -> list[Sheet]:
    """Orders, coefficients, free runs, their spread and control."""
    shown = [_orders(found), _coefficients(found), _poles(found), _free_runs(found)]
    return [*shown, *([_spread(found)] if found.spread else []), _control(found)]


def _orders(found: Study) -> Sheet:
    columns = ("output!", "criterion!", "n_a>", "n_b>", "n_c>", "delay>", "parameters>", "error one step ahead>")
    rows: list[list[str]] = []
    for name in OUTPUTS:
        cells = {words: found.search.best(name, words) for words in found.search.criteria}
        for words, cell in (*cells.items(), ("the paper's orders", published_cell(found.search, name))):
            error = float(shown_values(name, np.sqrt(cell.loss)))
            numbers = (cell.n_a, cell.n_b[0], cell.n_c, cell.delay[0], cell.parameters)
            share = 100.0 * cell.loss / found.shares[name]
            rows.append([name, words, *map(str, numbers), f"{error:.3g} {unit_label(name)}", f"{share:.2g}"])
        rows.append([])
    title = f"Orders ({found.search.method}, 600 s of one seed)"
    return Sheet("orders", title, (*columns, "of the variance, %>"), rows)


def _coefficients(found: Study) -> Sheet:
    """Methods side by side, fitted to both records."""
    heads, rows = ("coefficient!", "table 2>", *(f"{name}>" for name in _SHOWN)), []
    paths = dict.fromkeys(e.path for name in _SHOWN for e in found.fits[name, BOTH].estimates)
    for path in paths:
        if path.startswith("intercept"):
            continue
        row = [path, f"{PUBLISHED[path]:.3g}" if path in PUBLISHED else "-"]
        for name in _SHOWN:
            known = {e.path: e for e in found.fits[name, BOTH].estimates}
            if path not in known:
                row.append("-")
                continue
            value, (low, high), _ = in_degrees(known[path])
            row.append(f"{value:.3g} ± {0.5 * (high - low):.2g}")
        rows.append(row)
    return Sheet("coefficients", "Coefficients, fitted to both seeds, 95 % intervals; angles in degrees", heads, rows)


def _poles(found: Study) -> Sheet:
    """Poles of each output's equation, with 95 % intervals of real ones."""
    rows: list[list[str]] = []
    # states of the true linear form that only delay a command have poles at zero
    true = [z for z in true_form().poles() if z.imag >= 0.0 and abs(z) > _DELAY]
    for name in OUTPUTS:
        roots = np.roots([1.0, *(PUBLISHED[f"a{k + 1}[{name}]"] for k in range(N_A[name]))])
        rows.append([name, "table 2", ", ".join(_pole(z) for z in roots if z.imag >= 0.0)])
        own = [z for z in true if name == DEPTH or abs(z - 1.0) > _DELAY]  # only depth integrates
        rows.append([name, "true linear form", ", ".join(map(_pole, own))])
        for model in (*_SHOWN, LONGER):
            poles = [pole for pole in pole_intervals(found.fits[model, BOTH]) if name in pole.outputs]
            rows.append([name, model, ", ".join(map(_interval, poles))])
        rows.append([])
    return Sheet("poles", "Poles at samples of 4 s, fitted to both seeds", ("output!", "model!", "poles!"), rows)


def _interval(pole: PoleInterval) -> str:
    if pole.pair or pole.fixed or pole.problem:
        return _pole(pole.value)
    low, high = pole.real.ci95
    return f"{pole.value.real:.3f} ({low:.3f} to {high:.3f})"


def _pole(value: complex) -> str:
    return f"{value.real:.3f}" + (f"±{value.imag:.3f}j" if value.imag > 0.0 else "")


def _free_runs(found: Study) -> Sheet:
    seeds = sorted({row.seed for row in found.rows})
    heads = [f"{what}\nseed {seed}>" for seed in seeds for what in ("pitch", "depth", "differences", "eq (15)")]
    rows: list[list[str]] = []
    by = {(row.model, row.fitted, row.seed): row.fit for row in found.rows}
    last = None
    for model, fitted in dict.fromkeys((row.model, row.fitted) for row in sorted(found.rows, key=_order(found))):
        if last is not None and last != model and fitted:
            rows.append([])
        last = model
        cells = [_percent(value) for seed in seeds for value in asdict(by[model, fitted, seed]).values()]
        rows.append([model, {"": "-", BOTH: "both seeds"}.get(fitted, f"seed {fitted}"), *cells])
    title = "Free runs over 800 s of other data, fit in %"
    return Sheet("free_runs", title, ("model!", "fitted to!", *heads), rows)


def _order(found: Study) -> Callable[[Row], int]:
    names = list(dict.fromkeys(row.model for row in found.rows))
    return lambda row: names.index(row.model)


def _spread(found: Study) -> Sheet:
    names = list(dict.fromkeys(row.model for row in found.spread))
    count = len({row.seed for row in found.spread})
    columns = ("model!", "pitch>", "depth>", "differences>", "eq (15)>", "both targets>")
    rows = []
    for name in names:
        fits = [row.fit for row in found.spread if row.model == name]
        values = np.array([list(asdict(fit).values()) for fit in fits], dtype=float)
        cells = [f"{_percent(float(np.median(v)))} ({_percent(float(v.min()))})" for v in values.T]
        whole = np.isfinite(values[:, [0, 2]]).any()
        rows.append([name, *cells, f"{sum(reached([fit]) for fit in fits)} of {len(fits)}" if whole else "-"])
    title = f"Free runs over {count} further seeds, each fitted to another: fit in %, median (worst)"
    return Sheet("further_seeds", title, columns, rows)


def _control(found: Study) -> Sheet:
    count, rows = len({result.seed for result in found.controlled}), []
    columns = ("controller!", "cost\nm2 s>", "settled\ndown, s>", "settled\nup, s>", "overshoot\nm>", "pitch\ndeg>")
    for name in dict.fromkeys(result.controller for result in found.controlled):
        own = [result for result in found.controlled if result.controller == name and not result.failed]
        cells = ["cut short"] * 6
        if own:
            cells = [
                _middle([one.cost for one in own], ".0f"),
                *(_middle([one.settling[leg] for one in own], ".0f") for leg in range(len(LEGS))),
                _middle([max(one.overshoot) for one in own], ".2f"),
                _middle([float(np.degrees(one.pitch)) for one in own], ".2f"),
                _middle([float(np.degrees(one.travel)) for one in own], ".0f"),
            ]
        rows.append([name, *cells])
    title = f"Depth by two lengths and back, seeds: {count}; median (worst)"
    return Sheet("control", title, (*columns, "planes' travel\ndeg>"), rows)


def _middle(values: Sequence[float], digits: str) -> str:
    """The least, median and largest value."""
    ordered = np.sort(np.array(values))
    shown = [f"{v:{digits}}" if isfinite(v) else "never" for v in (ordered[(len(ordered) - 1) // 2], ordered[-1])]
    return f"{shown[0]} ({shown[1]})"


def _percent(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "-"
