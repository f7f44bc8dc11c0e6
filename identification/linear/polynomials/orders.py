"""Orders of polynomial models: a grid of orders fitted to the same rows, and the choice of each criterion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from math import isfinite, log
from typing import Any

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import did_you_mean
from auv_gym.records.record import Record, concat, records_of
from identification.compare.comparison import compare_open
from identification.estimator import Estimator, Method, list_methods, make_estimator
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.nested import Nested
from identification.linear.polynomials.structure import Structure
from identification.linear.regressors import Series

CRITERIA = {"mdl": "MDL", "aic": "AIC", "bic": "BIC", "held_out": "held-out", "parsimony": "parsimony"}  # in words
# For pitch, Geng and Zhao 2012 choose orders with a residual error of 3e-4 % over MDL's with 2e-4 %, and see no
# substantial difference between them.
TOLERANCE = 0.5
# For data without noise: losses below this share of the output's mean square differ only by rounding.
_ROUNDING = 1e-24
# Gradient at which a cell may end its iteration, see Stopping: losses are then accurate to six digits, in half the
# time.
_NEAR = 1e-4


@dataclass(frozen=True)
class Cell:
    """A model of one output: its orders, and how well it fits.

    n_b, delay: by input.  parameters: n, all that are free in A, B and C.  loss: V_N = 1/N sum e^2 over the N rows that
    all cells of the output share, in its unit squared.  aic = V_N (1 + 2 n / N), mdl = V_N (1 + 2 n log N / N), both as
    in Geng and Zhao 2012; bic = N log V_N + n log N.  held_out: fit of free runs, %; NaN without validation records or
    if a run diverges.  problem: why there is no model; all numbers are then NaN.
    """

    output: str
    n_a: int
    n_b: tuple[int, ...]
    n_c: int
    delay: tuple[int, ...]
    parameters: int
    loss: float
    aic: float
    mdl: float
    bic: float
    held_out: float
    problem: str = ""


@dataclass(frozen=True)
class Orders:
    """Orders of all outputs as estimators take them: a number per output, or a row per output, one per input.

    n_c: None if the method has none.
    """

    n_a: tuple[int, ...]
    n_b: tuple[tuple[int, ...], ...]
    delay: tuple[tuple[int, ...], ...]
    n_c: tuple[int, ...] | None = None

    def settings(self) -> dict[str, Any]:
        """The orders as settings of an estimator."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True, eq=False)
class OrderSearch:
    """Every cell of a search, and the choices of the criteria, each output by itself.

    base: the estimator whose orders are searched.  rows: N by output.  criterion: the requested one.
    `mdl`, `aic` and `bic` take the smallest value, `held_out` the largest fit.  `parsimony` takes the fewest parameters
    with a loss of at most 1 + tolerance times that of MDL's choice, then the smallest delay, then the smallest n_a.
    Source of parsimony: Geng and Zhao 2012, sec. III; of bic: Ljung 1999, sec. 16.4.
    """

    method: str
    base: Any
    cells: tuple[Cell, ...]
    rows: Mapping[str, int]
    tolerance: float = TOLERANCE
    criterion: str = "mdl"

    @property
    def outputs(self) -> tuple[str, ...]:
        return tuple(self.base.outputs)

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(self.base.inputs)

    @property
    def criteria(self) -> tuple[str, ...]:
        """The criteria that can be used: `held_out` only with validation records."""
        judged = any(isfinite(cell.held_out) for cell in self.cells)
        return tuple(name for name in CRITERIA if judged or name != "held_out")

    def of(self, output: str) -> tuple[Cell, ...]:
        """The cells of an output."""
        return tuple(cell for cell in self.cells if cell.output == output)

    def best(self, output: str, criterion: str = "") -> Cell:
        """The cell that a criterion (default: the search's) chooses for an output; raises ValueError if it cannot."""
        criterion = criterion or self.criterion
        check_criterion(criterion)
        cells = [cell for cell in self.of(output) if not cell.problem]
        if not cells:
            why = self.of(output)[0].problem
            raise ValueError(f"No order could be fitted to {output}. The first: {why}")
        if criterion == "held_out":
            cells = [cell for cell in cells if isfinite(cell.held_out)]
            if not cells:
                raise ValueError(
                    f"The criterion held_out needs free runs of {output} over records that took no part in the search, "
                    "and there are none: search with records in `validate`."
                )
            return min(cells, key=lambda cell: (-cell.held_out, *_size(cell)))
        if criterion == "parsimony":
            most = (1.0 + self.tolerance) * self.best(output, "mdl").loss
            return min((cell for cell in cells if cell.loss <= most), key=lambda cell: (*_size(cell), cell.loss))
        return min(cells, key=lambda cell: (getattr(cell, criterion), *_size(cell)))

    def choice(self, criterion: str = "") -> Orders:
        """The orders that a criterion chooses (default: the search's)."""
        cells = [self.best(output, criterion) for output in self.outputs]
        return Orders(
            tuple(cell.n_a for cell in cells),
            tuple(cell.n_b for cell in cells),
            tuple(cell.delay for cell in cells),
            tuple(cell.n_c for cell in cells) if _has_noise(self.base) else None,
        )

    def estimator(self, criterion: str = "") -> Estimator:
        """The estimator with the orders that a criterion chooses; it fits on all rows that these orders allow."""
        return replace(self.base, **self.choice(criterion).settings())

    def as_dict(self) -> dict[str, Any]:
        """Cells and choices for JSON; None in place of NaN."""
        cells = [asdict(cell) for cell in self.cells]
        return {
            "method": self.method,
            "inputs": list(self.inputs),
            "outputs": list(self.outputs),
            "rows": dict(self.rows),
            "tolerance": self.tolerance,
            "criterion": self.criterion,
            "choices": {name: self.choice(name).settings() for name in self.criteria},
            "cells": [
                {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in c.items()} for c in cells
            ],
        }


def search_orders(
    method: str,
    records: Sequence[Record],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    n_a: Iterable[int] = range(1, 7),
    n_b: Iterable[int] | Mapping[str, Iterable[int]] = range(1, 5),
    n_c: Iterable[int] | None = None,
    delay: Iterable[int] | Mapping[str, Iterable[int]] = (1,),
    validate: Sequence[Record] = (),
    criterion: str = "mdl",
    tolerance: float = TOLERANCE,
    progress: Callable[[float, str], Any] = lambda fraction, text: None,
    **settings: Any,
) -> OrderSearch:
    """Fit every order of the grid to the records, each output separately; raises ValueError for invalid settings.

    method: arx, els, armax, output_error.  n_b, delay: the same for all inputs, or by input name.  n_c: if the method
    has it, default 0 to 3.  validate: records for `held_out`; use others for the final test of the model.  settings:
    others of the method, such as integrating.  Orders that cannot be fitted are cells with a problem.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import closed_loop, search_orders
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> search = search_orders("arx", [log], ["rudder_rad"], ["heading_rad"], n_a=(1, 2, 3), n_b=(1, 2))
        >>> best = search.best("heading_rad")
        >>> best.n_a, best.n_b[0]
        (3, 2)
    """
    records = records_of("An order search", records)
    validate = records_of("validate", validate) if validate else ()
    if not 0.0 <= tolerance < float("inf"):
        raise ValueError(f"An order search needs a tolerance from 0, such as {TOLERANCE}, got {tolerance!r}.")
    check_criterion(criterion)
    if criterion == "held_out" and not validate:
        raise ValueError("The criterion held_out needs records to validate on, got none: give some in `validate`.")
    base = _base(method, inputs, outputs, settings)
    own, noise = _range("n_a", n_a, 1 if base.integrating else 0), _noise_range(method, base, n_c)
    counts, delays = _by_input("n_b", n_b, base.inputs, 0), _by_input("delay", delay, base.inputs, 1)
    lags = [max(c[i] for c in counts) + max(d[i] for d in delays) - 1 for i in range(len(base.inputs))]
    skip = max([max(own), max(noise), *lags])
    series = Series.of(records, base.inputs, base.outputs, type(base).__name__)
    grid = [orders for orders in product(own, counts, noise, delays) if any(orders[1])]
    if not grid:
        raise ValueError("An order search needs n_b of at least 1 for one input, got 0 alone.")
    cells, rows = [], {}
    for i, output in enumerate(base.outputs):
        alone = replace(_hasty(base), outputs=(output,), skip=skip, integrating=tuple({output} & set(base.integrating)))
        nested = None
        if isinstance(alone, Arx):
            largest = Structure.of("Arx", base.inputs, (output,), max(own), [lags], integrating=alone.integrating)
            single = replace(series, outputs=(output,), y=tuple(y[:, [i]] for y in series.y))
            nested = Nested.of(single, largest.rows[0], skip, alone.offset)
        rows[output] = sum(max(len(y) - skip, 0) for y in series.y)
        least = _ROUNDING * float(np.mean(np.concatenate(series.y)[:, i] ** 2))
        for orders in grid:
            progress(len(cells) / (len(grid) * len(base.outputs)), f"orders of {output}")
            cells.append(_cell(alone, nested, orders, records, validate, rows[output], least))
    progress(1.0, "orders searched")
    return OrderSearch(method, base, tuple(cells), rows, tolerance, criterion)


def check_criterion(name: str) -> None:
    """Raise ValueError if there is no such criterion."""
    if name not in CRITERIA:
        raise ValueError(f"No criterion {name!r}. {did_you_mean(name, CRITERIA)}Criteria: {', '.join(CRITERIA)}.")


def _cell(
    alone: Any,
    nested: Nested | None,
    orders: tuple[int, tuple[int, ...], int, tuple[int, ...]],
    records: Sequence[Record],
    validate: Sequence[Record],
    rows: int,
    least: float,
) -> Cell:
    """One model of one output."""
    (output,), (n_a, n_b, n_c, delay) = alone.outputs, orders
    own = n_a - len(alone.integrating)
    count = own + sum(n_b) + n_c
    nothing = float("nan")
    failed = Cell(output, n_a, n_b, n_c, delay, count, nothing, nothing, nothing, nothing, nothing)
    loss, held_out = nothing if nested is None else nested.loss(own, n_b, delay), nothing
    if validate or not isfinite(loss):
        # fit even an undetermined regression: the fit says why it fails
        found = Orders((n_a,), (n_b,), (delay,), (n_c,) if _has_noise(alone) else None)
        try:
            fit = replace(alone, **found.settings()).fit(*records)
            loss = float(fit.loss[0])
            if not isfinite(loss):
                raise ValueError("The fit ended at errors that are not finite.")
            held_out = _held_out(fit.model, validate) if validate else nothing
        except (ValueError, Diverged) as error:
            return replace(failed, problem=str(error))
    loss = max(loss, least)
    level = log(loss) if loss > 0.0 else -float("inf")
    return replace(
        failed,
        loss=loss,
        aic=loss * (1.0 + 2.0 * count / rows),
        mdl=loss * (1.0 + 2.0 * count * log(rows) / rows),
        bic=rows * level + count * log(rows),
        held_out=held_out,
    )


def _held_out(model: Any, validate: Sequence[Record]) -> float:
    """Fit of a model's free runs over records, %; NaN if they diverge."""
    needed = {*model.inputs, *model.outputs}
    apart = concat([record.without([name for name in record.names if name not in needed]) for record in validate])
    compared = compare_open({"model": model}, apart)
    if "model" not in compared.scores:
        return float("nan")
    return compared.scores["model"][model.outputs[0]].fit_percent


def _base(method: str, inputs: Sequence[str], outputs: Sequence[str], settings: Mapping[str, Any]) -> Any:
    """The estimator whose orders are searched, with default orders."""
    if "skip" in settings:
        raise ValueError("An order search sets skip itself, for all orders alike: leave it out of the settings.")
    known, method = list_methods(), method.strip().replace("-", "_")
    if method not in known or not _is_polynomial(known[method]):
        able = [name for name, offered in known.items() if _is_polynomial(offered)]
        raise ValueError(f"No order search for {method!r}. {did_you_mean(method, able)}Methods: {', '.join(able)}.")
    if settings.get("structure", "diagonal") != "diagonal":
        raise ValueError(
            f"An order search is of diagonal models, each output by itself, got structure {settings['structure']!r}."
        )
    return make_estimator(method, settings, inputs=inputs, outputs=outputs)


def _is_polynomial(method: Method) -> bool:
    """Whether a method is available and has the settings of a polynomial method."""
    needed = {"n_a", "n_b", "delay", "skip", "integrating"}
    return not method.problem and needed <= {field.name for field in fields(method.load())}


def _hasty(estimator: Any) -> Any:
    """The estimator with an iteration that ends as soon as the loss is accurate enough to compare."""
    stopping = getattr(estimator, "stopping", None)
    if stopping is None:
        return estimator
    return replace(estimator, stopping=replace(stopping, gradient=max(stopping.gradient, _NEAR)))


def _has_noise(estimator: Any) -> bool:
    return hasattr(estimator, "n_c")


def _noise_range(method: str, base: Any, n_c: Iterable[int] | None) -> tuple[int, ...]:
    if _has_noise(base):
        return _range("n_c", range(4) if n_c is None else n_c, 0)
    if n_c is not None:
        raise ValueError(f"Method {method} has no n_c: leave it out of the search, or take els or armax.")
    return (0,)


def _by_input(
    name: str, given: Iterable[int] | Mapping[str, Iterable[int]], inputs: Sequence[str], least: int
) -> list[tuple[int, ...]]:
    """The combinations to try, each with one value per input."""
    if isinstance(given, Mapping):
        by_name = {str(channel): values for channel, values in given.items()}
        if set(by_name) != set(inputs):
            raise ValueError(
                f"An order search needs {name} by input for {', '.join(inputs)}, got {', '.join(by_name)}."
            )
        return list(product(*(_range(f"{name} of {channel}", by_name[channel], least) for channel in inputs)))
    return [(value,) * len(inputs) for value in _range(name, given, least)]


def _range(name: str, given: Iterable[int], least: int) -> tuple[int, ...]:
    """The given whole numbers, each once and in rising order."""
    values = tuple(given) if isinstance(given, Iterable) else (given,)
    if not values or any(isinstance(k, bool) or not isinstance(k, int) or k < least for k in values):
        raise ValueError(f"An order search needs {name} as whole numbers from {least}, such as 1 to 4, got {given!r}.")
    return tuple(sorted(set(values)))


def _size(cell: Cell) -> tuple[int, int, int]:
    """The tie-breaker: fewer parameters, smaller delay, smaller n_a."""
    return cell.parameters, sum(cell.delay), cell.n_a
