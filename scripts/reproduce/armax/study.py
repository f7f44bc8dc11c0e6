"""The study of the models of depth and pitch: orders, fits, free runs over other data, control."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from auv_gym.model import Model
from auv_gym.models.linear import StateSpace, linearise
from auv_gym.records.record import Record
from auv_gym.writing import finite
from identification.linear.polynomials.orders import Cell, OrderSearch, search_orders
from identification.linear.polynomials.polynomial_fit import PolynomialFit
from scripts.reproduce.armax import control, models
from scripts.reproduce.armax.control import Controlled, pilots
from scripts.reproduce.armax.models import INPUTS, OUTPUTS, Verified, methods, verify
from scripts.reproduce.armax.records import IDENTIFY, VERIFY

TARGETS = {"pitch": 95.0, "differences": 90.0}  # %, of free runs over held-out data
# the readings are rounded, so that C = A; and depth integrates the pitch
TAKEN = "output error, pole at 1"
CONTROLLING = ("ARMAX, pole at 1", TAKEN)
BOTH = "both"
_SEARCHED = {"n_a": range(1, 7), "n_b": range(1, 7), "delay": range(1, 6)}

Records = Mapping[tuple[int, float], Record]
Progress = Callable[[float, str], object]


@dataclass(frozen=True)
class Row:
    """The free run of a model over a record: its name, the data of its fit (a seed, both), the record's seed."""

    model: str
    fitted: str
    seed: int
    fit: Verified

    @property
    def fresh(self) -> bool:
        """Whether the seed of the record took no part in the fit."""
        return self.fitted not in ("", BOTH, str(self.seed))


@dataclass(frozen=True, eq=False)
class Study:
    """All that is printed.

    fits: by method and data of the fit, a seed or both.  rows: of the campaign's own seeds, including those known
    without a fit.  spread: of further pairs of seeds, each fitted to one and run over the other.
    """

    search: OrderSearch
    shares: dict[str, float]
    n_c: dict[str, int]
    fits: dict[tuple[str, str], PolynomialFit]
    rows: list[Row]
    spread: list[Row]
    controlled: list[Controlled]


def study(
    records: Records, further: Iterable[Records], searched: str, runs: Sequence[int], progress: Progress
) -> Study:
    """The study of a campaign's records.

    further: records of other seeds, in pairs.  searched: the method of the search of orders.  runs: seeds of control.
    """
    seeds = sorted({seed for seed, _ in records})
    first, train = records[seeds[0], IDENTIFY], [records[seed, IDENTIFY] for seed in seeds]
    grid: dict[str, Any] = {**_SEARCHED, **({"n_c": range(models.MOST_N_C + 1)} if searched == "armax" else {})}
    search = search_orders(
        searched, [first], INPUTS, OUTPUTS, **grid, progress=lambda share, text: progress(0.5 * share, text)
    )
    progress(0.5, "fitting")
    n_c = models.noise_orders(train)
    fits, rows = {}, []
    for fitted, given in (*((str(seed), [records[seed, IDENTIFY]]) for seed in seeds), (BOTH, train)):
        for name, method in methods(n_c).items():
            fit = fits[name, fitted] = method.fit(*given)
            rows += [Row(name, fitted, seed, verify(fit.model, records[seed, VERIFY])) for seed in seeds]
    rows += [row for seed in seeds for row in ceilings(records[seed, VERIFY], seed)]
    spread = [row for pair in further for row in crossed(pair, n_c)]
    controlled = control.study(
        pilots({name: fits[name, BOTH].model for name in CONTROLLING}),
        runs,
        lambda share: progress(0.8 + 0.2 * share, "control"),
    )
    shares = {name: float(np.var(first[name])) for name in OUTPUTS}
    return Study(search, shares, n_c, fits, rows, spread, controlled)


def fitted_to(found: Study) -> list[str]:
    """The data of the fits: each seed, and both."""
    return list(dict.fromkeys(fitted for _, fitted in found.fits))


def crossed(records: Records, n_c: Mapping[str, int]) -> list[Row]:
    """Each seed's 600 s fitted and run over the other seed's 800 s, and the ceilings there."""
    seeds, rows = sorted({seed for seed, _ in records}), []
    for seed, other in zip(seeds, reversed(seeds), strict=True):
        fresh = records[other, VERIFY]
        for name, method in methods(n_c).items():
            rows.append(Row(name, str(seed), other, verify(method.fit(records[seed, IDENTIFY]).model, fresh)))
        rows += ceilings(fresh, other)
    return rows


def true_form() -> StateSpace:
    """The vehicle linearised about its cruise."""
    return linearise(control.vehicle(), INPUTS, OUTPUTS)


def ceilings(record: Record, seed: int) -> list[Row]:
    """The best possible fits: by the true linear form, the vehicle itself, its motion before rounding, 7 parameters."""
    known: dict[str, Model] = {"true linear form": true_form(), "true vehicle": control.vehicle()}
    rows = [Row(name, "", seed, verify(model, record)) for name, model in known.items()]
    best = Row("7 parameters at their best", "", seed, models.form(record))
    return [*rows, Row("true motion, unrounded", "", seed, models.resolution(record)), best]


def reached(fits: Iterable[Verified]) -> bool:
    """Whether all reach the targets."""
    return all(getattr(fit, name) >= least for fit in fits for name, least in TARGETS.items())


def as_json(found: Study) -> dict[str, Any]:
    """All of it for JSON; numbers that are not finite become None."""
    content = {
        "targets": TARGETS,
        "taken": TAKEN,
        "orders": {
            **found.search.as_dict(),
            "variance": found.shares,
            "published": {name: asdict(published_cell(found.search, name)) for name in OUTPUTS},
        },
        "n_c": found.n_c,
        "coefficients": {
            name: {fitted: [asdict(e) for e in found.fits[name, fitted].estimates] for fitted in fitted_to(found)}
            for name in methods(found.n_c)
        },
        "free_runs": [asdict(row) for row in found.rows],
        "spread": [asdict(row) for row in found.spread],
        "control": [asdict(result) for result in found.controlled],
    }
    return finite(content)


def published_cell(search: OrderSearch, output: str) -> Cell:
    """The model of the paper's orders among the searched ones, with n_c by AIC."""
    wanted = (models.N_A[output], (models.N_B,) * len(INPUTS), (models.DELAY,) * len(INPUTS))
    return min((c for c in search.of(output) if (c.n_a, c.n_b, c.delay) == wanted), key=lambda cell: cell.aic)
