"""A model fitted to records and judged on others: free runs, and residual tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import Diverged
from auv_gym.records.record import Record, concat, records_of
from identification.compare.comparison import OpenLoop, compare_open
from identification.compare.model_tests import predicts, residual_tests, sweep_horizons
from identification.estimator import Estimator, Fit
from identification.linear.causality import check_causality
from identification.linear.fit import has_errors, is_linear
from identification.linear.polynomials.orders import OrderSearch
from identification.linear.uncertainty import SimulatedBand, simulated_band

HELD_SHARE = 1.0 / 3.0


@dataclass(frozen=True, eq=False, repr=False)
class Identified:
    """A fit, and the errors of its model on held-out data.

    held: the held-out data as one record.  told: a description of that data.  open_loop, tests: free runs and residual
    tests over it, None if `problem` says why there are none; for tests see `residual_tests`.  search: the search of the
    fitted orders, None if they were given.
    """

    fit: Fit
    fitted: Record
    held: Record
    told: str
    open_loop: OpenLoop | None
    tests: dict[str, dict[str, Any]] | None
    problem: str = ""
    search: OrderSearch | None = None
    sweep: dict[str, dict[float, float]] | None = None
    band: SimulatedBand | None = None
    doubts: tuple[str, ...] = ()

    def __repr__(self) -> str:
        runs = {} if self.open_loop is None else self.open_loop.scores
        errors = [f"{name} {score.rmse:.3g} (RMS)" for scores in runs.values() for name, score in scores.items()]
        found = f"free runs over {self.told} err by {', '.join(errors)}" if errors else self.problem
        return f"Identified({type(self.fit.model).__name__}: {found})"


def identify(
    estimator: Estimator,
    records: Sequence[Record],
    validate: Sequence[Record] = (),
    *,
    window: float | None = None,
    settle: float | None = None,
    search: OrderSearch | None = None,
    progress: Callable[[float, str], Any] = lambda fraction, text: None,
) -> Identified:
    """Fit a model to records and test it on the records in `validate`, or else on the last third of the data.

    The model is then that of the first two thirds: the one that was judged.  window, settle: see `compare_open`.
    search: the source of the estimator's orders, stored with the result; see `identification.order_search`.
    Raises what the fit raises; a model that cannot be judged is returned with the problem.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Arx, closed_loop, identify
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> found = identify(Arx(["rudder_rad"], ["heading_rad"]), [log])
        >>> found.told, round(found.open_loop.scores["model"]["heading_rad"].rmse, 2)
        ('the last third', 0.08)
    """
    train = list(records_of("identify", records))
    held = list(records_of("validate", validate)) if validate else []
    told = f"{len(held)} record{'s' * (len(held) != 1)} to validate on"
    if not held:
        train, held, told = split(train)
    progress(0.1, "fitting")
    fit = estimator.fit(*train)
    progress(0.7, "free runs over held-out data")
    fitted, apart = joined(train), joined(held)
    open_loop, tests = None, None
    problems = []
    try:
        open_loop = compare_open({"model": fit.model}, apart, window=window, settle=settle)
        problems += open_loop.failed.values()
    except ValueError as error:
        problems.append(str(error))
    progress(0.85, "residual tests")
    if not problems:
        try:
            tests = residual_tests(fit.model, [apart], open_loop)
        except ValueError as error:
            problems.append(str(error))
    sweep, band, doubts = None, None, ()
    if is_linear(fit) or predicts(fit.model):
        progress(0.9, "errors over the horizon")
        with suppress(ValueError):  # some records suit the method but not the check
            doubts = check_causality(train, fit.model.inputs, fit.model.outputs)
        if open_loop is not None and open_loop.runs:
            try:
                sweep = sweep_horizons(fit.model, apart, open_loop.settle) or None
                if is_linear(fit) and has_errors(fit):
                    band = simulated_band(fit, apart, windows=open_loop.windows, settle=open_loop.settle)
            except (Diverged, ValueError) as error:
                problems.append(str(error))
    return Identified(fit, fitted, apart, told, open_loop, tests, " ".join(problems), search, sweep, band, doubts)


def split(records: Sequence[Record]) -> tuple[list[Record], list[Record], str]:
    """Records to fit and records to judge by, and a description of the latter: the last third of the segments.

    With fewer than three segments, it is the last third of each.
    """
    parts = [record.select(_rows(record, s)) for record in records for s in record.segments]
    if len(parts) >= 3:
        held = max(round(HELD_SHARE * len(parts)), 1)
        return parts[:-held], parts[-held:], f"the last {held} of {len(parts)} segments"
    cuts = [p.time[0] + (1.0 - HELD_SHARE) * (p.time[-1] - p.time[0]) for p in parts]
    for part, cut in zip(parts, cuts):
        if min(np.sum(part.time < cut), np.sum(part.time >= cut)) < 2:
            raise ValueError(
                f"A segment of {len(part)} samples is too short to hold out its last third: validate on other records."
            )
    fitted = [p.select(p.time < cut) for p, cut in zip(parts, cuts)]
    told = "the last third" if len(parts) == 1 else "the last third of each segment"
    return fitted, [p.select(p.time >= cut) for p, cut in zip(parts, cuts)], told


def joined(records: Sequence[Record]) -> Record:
    """Several records as one, with the channels that all of them have."""
    shared = [name for name in records[0].names if all(record.has(name) for record in records)]
    if not any(channel(name).kind in ("motion", "input") for name in shared):
        raise ValueError("The records share no motion and no input: name their columns alike by a mapping.")
    return concat([record.without([n for n in record.names if n not in shared]) for record in records])


def _rows(record: Record, part: slice) -> np.ndarray:
    mask = np.zeros(len(record), dtype=bool)
    mask[part] = True
    return mask
