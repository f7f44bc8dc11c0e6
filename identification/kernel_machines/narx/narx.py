"""NARX by least-squares support vector machines: a black box for any record with nonlinear dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auv_gym.channels import channel
from auv_gym.models.lags import Lags
from auv_gym.models.narx import Narx
from auv_gym.records.record import Record
from identification.estimate import Estimate
from identification.kernel_machines.bordered import squared_distances
from identification.kernel_machines.cells import Cells
from identification.kernel_machines.narx.narx_rows import Rows, run_errors
from identification.kernel_machines.narx.narx_tuning import Bells, Choice, best_in_free_runs, narx
from identification.kernel_machines.regression import LsSvmRegression
from identification.kernel_machines.tuning.tuning import descend_each
from identification.linear.polynomials.structure import check_channels
from identification.linear.regressors import SAMPLES_PER_COEFFICIENT, Series
from identification.linear.scaled import Scaled

WITHOUT_LEVEL = ("heading_rad", "north_m", "east_m")  # the water is the same in all directions and places
WITHIN = 0.99  # share of the training rows within the reach of a centre
LEAST_REACH = 0.1  # in spreads; near enough, even if samples of a vehicle at rest are denser


@dataclass(frozen=True, eq=False)
class NarxFit:
    """A NARX model.  choices: C and sigma of each output, None if the linear part does better alone.

    estimates: empty; a machine has as many coefficients as samples, and none has a meaning or an interval of its own.
    notes: remarks for the reader of the fit.
    """

    model: Narx
    choices: tuple[Choice, ...]
    notes: tuple[str, ...]
    estimates: tuple[Estimate, ...] = ()


@dataclass(frozen=True)
class NarxLsSvm:
    """Nonlinear difference equations in lags: a linear part by least squares, and radial kernels for its residual.

    n_a, n_b: lags of each output and input, the inputs' from `delay` on.  integrating: outputs whose increments are
    modelled, and whose level is no regressor; by default heading, north and east.  trend: whether there is a linear
    part.
    penalty, sigma: C and the kernel width in spreads of the regressors, by default tuned.  tuning: by free runs over
    held-out parts, or leave_one_out, by one-step errors.  samples: number of cells to which more samples are joined.
    Noise on measured outputs biases it as it does Arx; more lags lessen the bias.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import NarxLsSvm, closed_loop, horizon_sweep
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = NarxLsSvm(["rudder_rad"], ["heading_rad"], penalty=10, sigma=3).fit(log)
        >>> errors = horizon_sweep(fit.model, log, [1, 5])["heading_rad"]
        >>> {n: round(error, 3) for n, error in errors.items()}
        {1: 0.018, 5: 0.053}
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    n_a: int = 2
    n_b: int = 2
    delay: int = 1
    integrating: Sequence[str] | None = None
    trend: bool = True
    penalty: float | None = None
    sigma: float | None = None
    tuning: Literal["free_run", "leave_one_out"] = "free_run"
    samples: int = 400

    def __post_init__(self) -> None:
        check_channels("NarxLsSvm", self.inputs, self.outputs)
        try:
            _ = self.lags
        except ValueError as error:
            raise ValueError(f"NarxLsSvm: {error}") from None
        for name in ("penalty", "sigma"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"NarxLsSvm needs {name} > 0, or none to have it tuned, got {value!r}.")
        if self.tuning not in ("free_run", "leave_one_out"):
            raise ValueError(f"NarxLsSvm needs tuning to be free_run or leave_one_out, got {self.tuning!r}.")
        if self.samples < 10:
            raise ValueError(f"NarxLsSvm needs samples of at least 10, got {self.samples!r}: some 1000 do for most.")

    @property
    def lags(self) -> Lags:
        """The regressors that follow from the settings."""
        level = [n for n in WITHOUT_LEVEL if n in self.outputs] if self.integrating is None else self.integrating
        return Lags(tuple(self.inputs), tuple(self.outputs), self.n_a, self.n_b, self.delay, tuple(level))

    def fit(self, *records: Record) -> NarxFit:
        """Fit over all segments of all records, each with its own lags; raises if the data are unsuitable."""
        series = Series.of(records, self.inputs, self.outputs, "NarxLsSvm")
        Scaled.of(series, True, "NarxLsSvm")  # raises if a channel does not move
        rows = Rows.of(series, self.lags)
        _check(rows)
        everything = np.arange(len(rows.z))
        slopes, bias = rows.linear(everything, self.trend)
        left = rows.left(slopes, bias)
        cells = Cells.of(rows.scaled, left, self.samples)
        choices = tuple(
            choice if left[:, output].any() else None for output, choice in enumerate(self._choices(rows, cells))
        )
        model = narx(rows, slopes, bias, _trained(cells, choices), _reach(rows, cells))
        return NarxFit(model, choices, _notes(model, choices, self, rows, len(cells.x)))

    def _choices(self, rows: Rows, cells: Cells) -> Sequence[Choice]:
        """C and sigma of each output."""
        if not cells.y.any():  # the data are linear and without noise
            return [None] * len(self.outputs)
        if self.penalty is not None and self.sigma is not None:
            return [(self.penalty, self.sigma)] * len(self.outputs)
        if self.tuning == "free_run":
            return best_in_free_runs(rows, self.trend, self.samples, self.penalty, self.sigma)
        if self.penalty is not None or self.sigma is not None:
            raise ValueError("NarxLsSvm tunes penalty and sigma together by leave_one_out: give both, or none.")
        found = descend_each(LsSvmRegression(scaled=False), cells.x, cells.y, weights=cells.weights)
        return [(one.settings.penalty, one.settings.sigma) for one in found]


def _check(rows: Rows) -> None:
    needed = SAMPLES_PER_COEFFICIENT * (len(rows.lags.names) + 1)
    if len(rows.z) < needed:
        raise ValueError(
            f"NarxLsSvm needs at least {needed} samples for {len(rows.lags.names)} regressors, got {len(rows.z)} that "
            "have all their lags: record longer, or ask for fewer lags."
        )
    still = [name for name, spread in zip(rows.lags.names, rows.spread) if not spread > 0.0]
    if still:
        raise ValueError(
            f"NarxLsSvm needs regressors that vary, got constant ones, {', '.join(still)}: excite them, or ask for "
            "fewer lags."
        )


def _trained(cells: Cells, choices: tuple[Choice, ...]) -> Bells:
    """Kernels of each output around all cells; raises if a C or a sigma is impossible."""
    coefficients, bias = np.zeros(cells.y.shape), np.zeros(len(choices))
    for choice in {choice for choice in choices if choice is not None}:
        mine = [output for output, of in enumerate(choices) if of == choice]
        machine = LsSvmRegression(*choice, scaled=False).fit(cells.x, cells.y[:, mine], cells.weights)
        coefficients[:, mine], bias[mine] = machine.coefficients, machine.bias
    return Bells(cells.x, choices, coefficients, bias)


def _reach(rows: Rows, cells: Cells) -> float:
    """The distance from the nearest other centre within which nearly all training rows are."""
    square = squared_distances(cells.x)
    np.fill_diagonal(square, np.inf)
    apart = np.sqrt(square.min(axis=1))
    return max(float(np.quantile(np.repeat(apart, cells.weights.astype(int)), WITHIN)), LEAST_REACH)


def _notes(model: Narx, choices: Sequence[Choice], asked: NarxLsSvm, rows: Rows, centres: int) -> tuple[str, ...]:
    """The chosen settings, and the errors of free runs over the training data, in words."""
    by = "given" if asked.penalty and asked.sigma else f"chosen by {asked.tuning.replace('_', ' ')} errors"
    samples = f"{len(rows.z)} samples" + (f" in {centres} cells" if centres < len(rows.z) else "")
    words = [f"{len(rows.lags.names)} regressors, {samples}; no parameter has a meaning or an interval of its own"]
    for name, choice in zip(model.outputs, choices):
        label = channel(name).label
        if choice is None:
            words.append(f"{label}: the linear part alone, bells make its free runs no better")
        else:
            words.append(f"{label}: C {choice[0]:.3g}, sigma {choice[1]:.3g} spreads of the regressors, {by}")
    runs = rows.runs(0, len(rows.z))
    errors = run_errors(model, runs)
    if not np.isfinite(errors).all():
        return (*words, "its free run over the data that it was fitted to diverges: do not use it for simulation")
    rms, spread = np.sqrt(np.mean(errors**2, axis=0)), np.concatenate([run.y for run in runs]).std(axis=0)
    poor = [channel(n).label for n, e, s in zip(model.outputs, rms, spread) if e > s]
    if poor:
        words.append(f"free runs over the data that it was fitted to are worse than a constant for {', '.join(poor)}")
    return tuple(words)
