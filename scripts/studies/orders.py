"""Orders chosen by each criterion on a system of known orders: ARMAX(4, 4, 2) of the benchmark, over many seeds.

    python -m scripts.studies.orders --seeds 50 --samples 10000 --jobs 2

Each seed gives a new record with a coloured disturbance of 10 %. The search covers n_a from 3 to 6, n_b from 2 to 6 and
n_c from 0 to 3. A model of the chosen orders then runs free over new data without noise.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import numpy as np

from auv_gym.model import Diverged
from identification.linear.polynomials.orders import OrderSearch, search_orders
from scripts.benchmarks.systems import clean, fit_percent, measured, truth
from scripts.studies.harness import Found, Option, Sheet, Study

SYSTEM, RIGHT = "armax", (4, 4, 2)
OWN, INPUT, NOISE = range(3, 7), range(2, 7), range(4)  # n_a, n_b, n_c
CRITERIA = ("mdl", "bic", "aic", "parsimony")
FRESH = 2000  # samples of the data to judge by
SHOWN = 3  # number of orders in the table, the most frequent ones


def attempt(case: str, seed: int, samples: int) -> dict[str, Any]:
    """The orders (n_a, n_b, n_c) chosen on one record, by criterion, and the fit, %, over fresh data."""
    record, system = measured(case, samples, seed).record, truth(case)
    search = search_orders(case, [record], system.inputs, system.outputs, n_a=OWN, n_b=INPUT, n_c=NOISE)
    fits: dict[tuple[int, int, int], float] = {}
    picks = {}
    for criterion in CRITERIA:
        best = search.best(system.outputs[0], criterion)
        orders = (best.n_a, best.n_b[0], best.n_c)
        if orders not in fits:
            fits[orders] = _fresh_fit(search, criterion, record, seed)
        picks[criterion] = {"orders": orders, "fit": fits[orders]}
    return picks


def _fresh_fit(search: OrderSearch, criterion: str, record: Any, seed: int) -> float:
    """Fit, %, of a free run from rest over data without noise; -inf if it leaves the finite numbers."""
    model, fresh = search.estimator(criterion).fit(record).model, clean(SYSTEM, FRESH, seed)
    try:
        run = model.run(fresh.record, fresh.record.segments, np.zeros((1, len(model.states))))  # type: ignore[attr-defined]
    except Diverged:
        return -float("inf")
    return fit_percent(fresh.y, run)


def sheets(found: Found) -> list[Sheet]:
    """A row for each criterion."""
    picks, rows = found.of(SYSTEM), []
    for name in CRITERIA:
        chosen = [tuple(pick[name]["orders"]) for pick in picks]
        sizes = [sum(orders) for orders in chosen]
        rows.append(
            [
                name,
                f"{chosen.count(RIGHT)} of {len(picks)}",
                f"{np.median(sizes):g} ({min(sizes)} to {max(sizes)})",
                f"{np.median([pick[name]['fit'] for pick in picks]):.2f}",
                ", ".join(f"{orders} {count}" for orders, count in Counter(chosen).most_common(SHOWN)),
            ]
        )
    title = f"Orders (n_a, n_b, n_c) chosen on ARMAX{RIGHT}, {found.options['samples']} samples, {len(picks)} seeds"
    heads = ("criterion", "right>", "n, median (range)>", "fit on fresh data, median, %>", "most often chosen")
    return [Sheet("orders", title, heads, rows)]


STUDY = Study(
    __doc__ or "",
    attempt,
    (SYSTEM,),
    sheets,
    seeds=50,
    one_of="",
    options={"samples": Option(10_000, "of each record", least=1)},
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
