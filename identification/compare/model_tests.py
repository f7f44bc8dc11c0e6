"""Tests of a fitted model: free runs over unseen records, residual tests, poles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from auv_gym.model import Model, predict
from auv_gym.models.linear import Polynomial, StateSpace, linearise
from auv_gym.models.narx import Narx
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.compare.comparison import (
    OpenLoop,
    compare_open,
    horizon_sweep,
    prediction_starts,
    start_fit_seconds,
)
from identification.fit.validation import input_correlation, whiteness

BINS = 60  # spans of time for an error over time
LAGS = 20  # samples
HORIZONS = (1, 3, 10, 30, 100)  # samples
WHITE = 0.01  # p-value above which a residual passes as white
_DEAD_BEAT = 1e-6  # magnitude of a discrete pole below which it is a pure delay


def open_loop(models: Mapping[str, Model], record: Record) -> OpenLoop:
    """Free runs of models over whole segments of a record, or over a vehicle's windows if there are several segments.

    Raises ValueError if a model does not fit the record.
    """
    whole = len(record.segments) == 1 and any(isinstance(model, Plant) for model in models.values())
    return compare_open(models, record, window=record.duration_s + record.sample_interval if whole else None)


def predicts(model: Model) -> bool:
    """Whether a model includes a noise model, so that its predictions differ from free runs."""
    return isinstance(model, Polynomial | Narx) or (isinstance(model, StateSpace) and bool(model.k.any()))


def residuals(
    model: Model, record: Record, run: OpenLoop | None = None
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """The residual of a model by output, the rows it belongs to, and each row's number of segment or window.

    For models that predict: one-step prediction errors, without the samples that depend on the start.  For others:
    errors of free runs, without the samples to which their starts are fitted.  run: free runs of this model, if
    available.
    """
    if predicts(model):
        settle = start_fit_seconds([model], record, record.segments)
        ahead = predict(model, record, starts=prediction_starts(model, record, settle))
        skip = len(model.states)
        parts = [np.arange(s.start + skip, s.stop) for s in record.segments if s.stop - s.start > skip + 2]
        rows = np.concatenate(parts)
        number = np.repeat(np.arange(len(parts)), [part.size for part in parts])
        names = [name for name in model.outputs if record.has(name)]
        return {name: record[name][rows] - ahead[name][rows] for name in names}, rows, number
    done = open_loop({"model": model}, record) if run is None else run
    if done.failed:
        raise ValueError(done.failed["model"])
    free = done.runs["model"]
    kept = free.scored
    return {n: free.residual[kept, c] for c, n in enumerate(free.channels)}, free.rows[kept], free.window[kept]


def residual_tests(model: Model, records: Sequence[Record], run: OpenLoop | None = None) -> dict[str, dict[str, Any]]:
    """Whiteness of a model's `residuals` over records, and their correlation with each of its inputs, by output.

    run: the model's free runs over a single record, if available.
    """
    parts: dict[str, list[np.ndarray]] = {}
    drivers: dict[str, list[np.ndarray]] = {}
    numbers, count = [], 0
    for record in records:
        left, rows, number = residuals(model, record, run)
        for name, values in left.items():
            parts.setdefault(name, []).append(values)
        for name in model.inputs:
            if record.has(name):
                drivers.setdefault(name, []).append(record[name][rows])
        numbers.append(number + count)
        count = int(numbers[-1].max()) + 1
    window, dt = np.concatenate(numbers), records[0].sample_interval
    inputs = {name: np.concatenate(values) for name, values in drivers.items()}
    inputs = {name: values for name, values in inputs.items() if values.size == window.size and np.ptp(values) > 0.0}
    result = {}
    for name, pieces in parts.items():
        e = np.concatenate(pieces)
        if e.size != window.size:
            continue
        white = whiteness(e, window, LAGS)
        ties = {}
        for driver, signal in inputs.items():
            lags, values, bound = input_correlation(e, signal, window, LAGS)
            ties[driver] = {"lags_s": (lags * dt).tolist(), "correlation": values.tolist(), "bound": bound}
        result[name] = {
            "ahead": predicts(model),
            "rms": float(np.sqrt(np.nanmean(e**2))),
            "lags_s": (white.lags * dt).tolist(),
            "correlation": white.correlation.tolist(),
            "bound": white.bound,
            "p_value": white.p_value,
            "inputs": ties,
        }
    return result


def sweep_horizons(
    model: Model, record: Record, settle: float, horizons: Sequence[int] = ()
) -> dict[str, dict[float, float]]:
    """RMS prediction error by output and horizon in s; see `horizon_sweep`.

    horizons: samples; default: those of `HORIZONS` that are at most half of the shortest segment.  Raises Diverged.
    """
    shortest = min(s.stop - s.start for s in record.segments) - int(settle / record.sample_interval)
    wanted = list(horizons) or [k for k in HORIZONS if 2 * k <= shortest]
    swept = horizon_sweep(model, record, wanted, settle) if wanted else {}
    return {name: {k * record.sample_interval: error for k, error in of.items()} for name, of in swept.items()}


def is_white(test: Mapping[str, Any]) -> bool:
    """Whether a residual passes as white."""
    return test["p_value"] > WHITE


def strongest_input_correlation(test: Mapping[str, Any]) -> tuple[str, float]:
    """The input that a residual correlates with most, and how much, in 95 % noise bounds; without inputs "", 0."""
    # lags above zero: the present input correlates with the residual by feedback, not by an error of the model
    ties = {driver: _largest(tie) / tie["bound"] for driver, tie in test["inputs"].items()}
    driver = max(ties, key=lambda name: ties[name], default="")
    return driver, ties.get(driver, 0.0)


def poles_of(model: Model) -> list[tuple[float, float]]:
    """Real and imaginary parts of the poles in continuous time, 1/s, slowest first; none without a linear form.

    For a vehicle: the poles of its linearisation about cruise, with the default inputs and outputs.
    """
    if isinstance(model, Plant):
        try:
            model = linearise(model)
        except ValueError:
            return []
    if isinstance(model, Polynomial):
        model = model.to_state_space()
    if not isinstance(model, StateSpace):
        return []
    discrete = model.poles().astype(complex)
    poles = np.log(discrete[np.abs(discrete) > _DEAD_BEAT]) / model.dt
    poles = poles[np.argsort(np.abs(poles), kind="stable")]
    return [(float(p.real) if abs(p) > 1e-9 else 0.0, float(p.imag)) for p in poles]


def over_time(elapsed: np.ndarray, error: np.ndarray, scale: float) -> dict[str, list[float]]:
    """RMS error in percent of a scale, in at most `BINS` equal spans of time, with the middle of each."""
    edges = np.linspace(0.0, float(elapsed.max()) * (1.0 + 1e-9), min(BINS, max(error.size // 2, 1)) + 1)
    middles, sizes = [], []
    for low, high in pairwise(edges):
        inside = (elapsed >= low) & (elapsed < high) & np.isfinite(error)
        if inside.any():
            middles.append(0.5 * (low + high))
            sizes.append(100.0 * float(np.sqrt(np.mean(error[inside] ** 2))) / scale)
    return {"time_s": middles, "percent": sizes}


def _largest(tie: Mapping[str, Any]) -> float:
    return float(np.max(np.abs(tie["correlation"])[np.asarray(tie["lags_s"]) > 0.0]))
