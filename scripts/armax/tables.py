"""Tables of the models of depth and pitch, and whether they are as good as was wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import isfinite

import numpy as np
from rich.markup import escape
from rich.table import Table

from auv_gym.cli.options.console import table
from identification.linear.uncertainty import PoleInterval, pole_intervals
from identification.pages.drawing import shown_values, unit_label
from scripts.armax.control import LEGS
from scripts.armax.models import DEPTH, LONGER, N_A, OUTPUTS, PUBLISHED, in_degrees, methods
from scripts.armax.study import BOTH, TAKEN, TARGETS, Row, Study, published_cell, reached, true_form

_DELAY = 1e-6  # size of a pole that only delays, and of rounding
_SHOWN = ("ARMAX", "ARMAX, pole at 1", TAKEN)  # with their coefficients


def verdict(found: Study) -> list[str]:
    """The targets, and what each method of the paper's orders reaches at the least on a seed that it has not seen."""
    lines = []
    for name in methods(found.n_c):
        fits = [row.fit for row in (*found.rows, *found.spread) if row.model == name and row.fresh]
        least = {what: min(getattr(fit, what) for fit in fits) for what in TARGETS}
        ends = " and ".join(f"{what} {value:.1f} %" for what, value in least.items())
        made = sum(reached([fit]) for fit in fits)
        lines.append(f"{name}: at least {ends}; both targets in {made} of {len(fits)} free runs.")
    wanted = " and ".join(f"{what} {value:g} %" for what, value in TARGETS.items())
    return [f"Wanted: {wanted}, over data of seeds that the model was not fitted to.", *lines]


def tables(found: Study) -> list[Table]:
    """Orders, coefficients, free runs, their spread and control."""
    shown = [_orders(found), _coefficients(found), _poles(found), _free_runs(found)]
    return [*shown, *([_spread(found)] if found.spread else []), _control(found)]


def _orders(found: Study) -> Table:
    columns = ("output!", "criterion!", "n_a>", "n_b>", "n_c>", "delay>", "parameters>", "error one step ahead>")
    shown = table(f"Orders ({found.search.method}, 600 s of one seed)", *columns, "of the variance, %>")
    for name in OUTPUTS:
        cells = {words: found.search.best(name, words) for words in found.search.criteria}
        for words, cell in (*cells.items(), ("the paper's orders", published_cell(found.search, name))):
            error = float(shown_values(name, np.sqrt(cell.loss)))
            numbers = (cell.n_a, cell.n_b[0], cell.n_c, cell.delay[0], cell.parameters)
            share = 100.0 * cell.loss / found.shares[name]
            shown.add_row(name, words, *map(str, numbers), f"{error:.3g} {unit_label(name)}", f"{share:.2g}")
        shown.add_section()
    return shown


def _coefficients(found: Study) -> Table:
    """Methods side by side, fitted to both records."""
    shown = table("Coefficients, fitted to both seeds, 95 % intervals; angles in degrees", "coefficient!", "table 2>")
    for name in _SHOWN:
        shown.add_column(name, justify="right", no_wrap=True)
    paths = dict.fromkeys(e.path for name in _SHOWN for e in found.fits[name, BOTH].estimates)
    for path in paths:
        if path.startswith("intercept"):
            continue
        row = [f"{PUBLISHED[path]:.3g}" if path in PUBLISHED else "-"]
        for name in _SHOWN:
            known = {e.path: e for e in found.fits[name, BOTH].estimates}
            if path not in known:
                row.append("-")
                continue
            value, (low, high), _ = in_degrees(known[path])
            row.append(f"{value:.3g} ± {0.5 * (high - low):.2g}")
        shown.add_row(escape(path), *row)
    return shown


def _poles(found: Study) -> Table:
    """Poles of each output's equation, with 95 % intervals of real ones."""
    shown = table("Poles at samples of 4 s, fitted to both seeds", "output!", "model!", "poles!")
    # states of the true linear form that only delay a command have poles at zero
    true = [z for z in true_form().poles() if z.imag >= 0.0 and abs(z) > _DELAY]
    for name in OUTPUTS:
        roots = np.roots([1.0, *(PUBLISHED[f"a{k + 1}[{name}]"] for k in range(N_A[name]))])
        shown.add_row(name, "table 2", ", ".join(_pole(z) for z in roots if z.imag >= 0.0))
        own = [z for z in true if name == DEPTH or abs(z - 1.0) > _DELAY]  # depth alone integrates
        shown.add_row(name, "true linear form", ", ".join(map(_pole, own)))
        for model in (*_SHOWN, LONGER):
            poles = [pole for pole in pole_intervals(found.fits[model, BOTH]) if name in pole.outputs]
            shown.add_row(name, model, ", ".join(map(_interval, poles)))
        shown.add_section()
    return shown


def _interval(pole: PoleInterval) -> str:
    if pole.pair or pole.fixed or pole.problem:
        return _pole(pole.value)
    low, high = pole.real.ci95
    return f"{pole.value.real:.3f} ({low:.3f} to {high:.3f})"


def _pole(value: complex) -> str:
    return f"{value.real:.3f}" + (f"±{value.imag:.3f}j" if value.imag > 0.0 else "")


def _free_runs(found: Study) -> Table:
    seeds = sorted({row.seed for row in found.rows})
    heads = [f"{what}\nseed {seed}>" for seed in seeds for what in ("pitch", "depth", "differences", "eq (15)")]
    shown = table("Free runs over 800 s of other data, fit in %", "model!", "fitted to!", *heads)
    by = {(row.model, row.fitted, row.seed): row.fit for row in found.rows}
    last = None
    for model, fitted in dict.fromkeys((row.model, row.fitted) for row in sorted(found.rows, key=_order(found))):
        if last is not None and last != model and fitted:
            shown.add_section()
        last = model
        cells = [_percent(value) for seed in seeds for value in asdict(by[model, fitted, seed]).values()]
        shown.add_row(model, {"": "-", BOTH: "both seeds"}.get(fitted, f"seed {fitted}"), *cells)
    return shown


def _order(found: Study) -> Callable[[Row], int]:
    names = list(dict.fromkeys(row.model for row in found.rows))
    return lambda row: names.index(row.model)


def _spread(found: Study) -> Table:
    names = list(dict.fromkeys(row.model for row in found.spread))
    count = len({row.seed for row in found.spread})
    columns = ("model!", "pitch>", "depth>", "differences>", "eq (15)>", "both targets>")
    shown = table(f"Free runs over {count} further seeds, each fitted to another: fit in %, median (worst)", *columns)
    for name in names:
        fits = [row.fit for row in found.spread if row.model == name]
        values = np.array([list(asdict(fit).values()) for fit in fits], dtype=float)
        cells = [f"{_percent(float(np.median(v)))} ({_percent(float(v.min()))})" for v in values.T]
        whole = np.isfinite(values[:, [0, 2]]).any()
        shown.add_row(name, *cells, f"{sum(reached([fit]) for fit in fits)} of {len(fits)}" if whole else "-")
    return shown


def _control(found: Study) -> Table:
    count = len({flown.seed for flown in found.flights})
    columns = ("controller!", "cost\nm2 s>", "settled\ndown, s>", "settled\nup, s>", "overshoot\nm>", "pitch\ndeg>")
    shown = table(f"Depth by two lengths and back, seeds: {count}; median (worst)", *columns, "planes' travel\ndeg>")
    for name in dict.fromkeys(flown.controller for flown in found.flights):
        own = [flown for flown in found.flights if flown.controller == name and not flown.failed]
        if not own:
            shown.add_row(name, *["cut short"] * 6)
            continue
        shown.add_row(
            name,
            _middle([flown.cost for flown in own], ".0f"),
            *(_middle([flown.settling[leg] for flown in own], ".0f") for leg in range(len(LEGS))),
            _middle([max(flown.overshoot) for flown in own], ".2f"),
            _middle([float(np.degrees(flown.pitch)) for flown in own], ".2f"),
            _middle([float(np.degrees(flown.travel)) for flown in own], ".0f"),
        )
    return shown


def _middle(values: Sequence[float], digits: str) -> str:
    """The median, one of the values, and the largest."""
    ordered = np.sort(np.array(values))
    shown = [f"{v:{digits}}" if isfinite(v) else "never" for v in (ordered[(len(ordered) - 1) // 2], ordered[-1])]
    return f"{shown[0]} ({shown[1]})"


def _percent(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "-"
