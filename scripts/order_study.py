"""Which orders each criterion chooses on a system of known orders: ARMAX(4, 4, 2) of the benchmark, over many seeds.

    python -m scripts.order_study --seeds 50 --samples 10000

Every seed is a record of its own, with a coloured disturbance of 10 %, searched over n_a from 3 to 6, n_b from 2
to 6 and n_c from 0 to 3. The model of the chosen orders then runs free over fresh data without noise.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from auv_gym.cli.options.console import table
from auv_gym.model import Diverged
from identification.linear.polynomials.orders import OrderSearch, search_orders
from scripts.identification_systems import clean, fit_percent, measured, truth
from scripts.over_seeds import all_of

RIGHT = (4, 4, 2)
OWN, INPUT, NOISE = range(3, 7), range(2, 7), range(4)  # n_a, n_b, n_c
CRITERIA = ("mdl", "bic", "aic", "parsimony")
FRESH = 2000  # samples of the data to judge by
SHOWN = 3  # orders in the table, the most frequent


@dataclass(frozen=True)
class Pick:
    """What a criterion chose on a seed: (n_a, n_b, n_c), and the fit, %, of its free run over fresh data."""

    orders: tuple[int, int, int]
    fit: float


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print its table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50, help="records (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="the first of them (default %(default)s)")
    parser.add_argument("--samples", type=int, default=10_000, help="of each record (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    given = parser.parse_args(argv)
    try:
        picks = study(range(given.seed, given.seed + given.seeds), given.samples, given.jobs)
    except ValueError as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps(as_json(picks, given.samples), indent=1))
    else:
        Console(highlight=False, width=max(Console().width, 120)).print(_table(picks, given.samples))
    return 0


def study(seeds: Sequence[int], samples: int, jobs: int = 1) -> list[dict[str, Pick]]:
    """What each criterion chooses, one a seed."""
    if not seeds or samples < 1 or jobs < 1:
        raise ValueError(f"Needed --seeds, --samples and --jobs of at least 1, got {len(seeds)}, {samples} and {jobs}.")
    return all_of(attempt, [(seed, samples) for seed in seeds], jobs, "searching orders", "records")


def attempt(seed: int, samples: int) -> dict[str, Pick]:
    """What each criterion chooses on one record."""
    record, system = measured("armax", samples, seed).record, truth("armax")
    search = search_orders("armax", [record], system.inputs, system.outputs, n_a=OWN, n_b=INPUT, n_c=NOISE)
    fits: dict[tuple[int, int, int], float] = {}
    picks = {}
    for criterion in CRITERIA:
        best = search.best(system.outputs[0], criterion)
        orders = (best.n_a, best.n_b[0], best.n_c)
        if orders not in fits:
            fits[orders] = _fresh_fit(search, criterion, record, seed)
        picks[criterion] = Pick(orders, fits[orders])
    return picks


def as_json(picks: Sequence[dict[str, Pick]], samples: int) -> dict[str, Any]:
    """Counts of what was chosen, and the median fit, by criterion."""
    return {
        "right": list(RIGHT),
        "seeds": len(picks),
        "samples": samples,
        "criteria": {
            name: {
                "right": sum(p[name].orders == RIGHT for p in picks),
                "median_fit_percent": float(np.median([p[name].fit for p in picks])),
                "picked": [{"orders": list(orders), "seeds": count} for orders, count in _counts(picks, name)],
            }
            for name in CRITERIA
        },
    }


def _fresh_fit(search: OrderSearch, criterion: str, record: Any, seed: int) -> float:
    """Fit, %, of a free run from rest over data without noise; -inf where it leaves the finite numbers."""
    model, fresh = search.estimator(criterion).fit(record).model, clean("armax", FRESH, seed)
    try:
        run = model.run(fresh.record, fresh.record.segments, np.zeros((1, len(model.states))))  # type: ignore[attr-defined]
    except Diverged:
        return -float("inf")
    return fit_percent(fresh.y, run)


def _counts(picks: Sequence[dict[str, Pick]], criterion: str) -> list[tuple[tuple[int, int, int], int]]:
    """Orders that were chosen, with how often, the most frequent first."""
    return Counter(p[criterion].orders for p in picks).most_common()


def _table(picks: Sequence[dict[str, Pick]], samples: int) -> Table:
    shown = table(
        f"Orders (n_a, n_b, n_c) chosen on ARMAX{RIGHT}, {samples} samples, {len(picks)} seeds",
        "criterion",
        "right>",
        "n, median (range)>",
        "fit on fresh data, median, %>",
        "most often chosen",
    )
    for name in CRITERIA:
        sizes = [sum(p[name].orders) for p in picks]
        most = ", ".join(f"{orders} {count}" for orders, count in _counts(picks, name)[:SHOWN])
        shown.add_row(
            name,
            f"{sum(p[name].orders == RIGHT for p in picks)} of {len(picks)}",
            f"{np.median(sizes):g} ({min(sizes)} to {max(sizes)})",
            f"{np.median([p[name].fit for p in picks]):.2f}",
            most,
        )
    return shown


if __name__ == "__main__":
    sys.exit(main())
