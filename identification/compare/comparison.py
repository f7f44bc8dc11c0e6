"""Comparison of models with a record, by free runs and by predictions."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import (
    Continuous,
    Diverged,
    Model,
    Spread,
    check_finite,
    check_interval,
    check_model,
    inputs_of,
    model_constant_inputs,
    outputs_of,
    run_free,
    stepper,
)
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.plant import Chart, Plant
from auv_gym.records.record import Record
from identification.fit.shooting import Shooting
from identification.fit.validation import FreeRuns, Score, free_runs, head_windows
from identification.fit.windows import free_run_windows
from identification.recursive.diving_model import DivingModel, settled_starts

SETTLE_SHARE = 0.05  # of the shortest window; starts are fitted to at least this much
MOST_ORIGINS = 200  # number of prediction origins in a horizon sweep
_ITERATIONS = 10
_LEAST_SHARE = 0.02  # of a step that increases the error; it is given up when cut to this
# Smallest relative singular value of the sensitivity to the starts that counts: linear models are solved exactly; in
# others, a state that the outputs hardly show stays at its value from `initial`.
_SEEN_LINEAR, _SEEN = 1e-9, 1e-3


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """Free runs of several models over the same windows of a record.

    settle: s, at the beginning of each window; the start is fitted to it, and it is not scored.  runs: by model.
    failed: by model, why it has no run.
    """

    record: Record
    windows: tuple[slice, ...]
    settle: float
    runs: dict[str, FreeRuns]
    failed: dict[str, str]

    @property
    def scores(self) -> dict[str, dict[str, Score]]:
        """A score by model and channel, over the samples past `settle`."""
        return {name: run.scores(self.record) for name, run in self.runs.items()}

    def shown(self, name: str | None = None) -> Record:
        """The record in the windows, one segment each, as measured or with a model's outputs instead."""
        rows = np.concatenate([np.arange(w.start, w.stop) for w in self.windows])
        window = np.repeat(np.arange(len(self.windows)), [w.stop - w.start for w in self.windows])
        values = {channel_name: self.record[channel_name][rows] for channel_name in self.record.names}
        if name is not None:
            run = self.runs[name]
            near = self.record.matrix(run.channels)[rows] - run.residual if run.signals is None else run.model
            values |= dict(zip(run.channels, near.T, strict=True))
        return Record.from_arrays(self.record.time[rows], values, window)


def compare_open(
    models: Mapping[str, Model], record: Record, *, window: float | None = None, settle: float | None = None
) -> OpenLoop:
    """Compare models by free runs over the same windows, each from a start fitted to the window's first seconds.

    All models are treated alike: the start is a least-squares fit to the first `settle` seconds, which are not scored.
    window: s; default: the window of a vehicle among the models, else whole segments.  settle: s; default: the longest
    that any model needs (twice its states over its measured outputs, or a vehicle's own), at least 5 % of the shortest
    window.
    A model that diverges is listed in `failed`; a model that does not fit the record raises ValueError with its name.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, replace_at
        >>> from identification import closed_loop, compare_open
        >>> glider = load_vehicle("slocum")
        >>> bent = replace_at(glider, "effects.rudder.offset", 0.03)
        >>> found = compare_open({"glider": glider, "bent": bent}, closed_loop(bent, rng=np.random.default_rng(0)))
        >>> {name: round(score["heading_rad"].rmse, 3) for name, score in found.scores.items()}
        {'glider': 0.076, 'bent': 0.013}
    """
    if not models:
        raise ValueError("compare_open needs at least one model, got none.")
    for name, model in models.items():
        check_usable(name, model, record)
    windows = _windows(models, record, window)
    shortest = _shortest(record, windows)
    if settle is None:
        settle = start_fit_seconds(list(models.values()), record, windows)
    if not 0.0 < settle < 0.5 * shortest:
        raise ValueError(
            f"Starts are fitted to the first {settle:g} s of windows, and the shortest window has {shortest:g} s: "
            "choose longer windows, or give a shorter settle."
        )
    runs, failed = {}, {}
    for name, model in models.items():
        try:
            runs[name] = free_runs_of(model, record, windows, settle)
        except Diverged as error:
            failed[name] = str(error)
    return OpenLoop(record, tuple(windows), float(settle), runs, failed)


def start_fit_seconds(models: Sequence[Model], record: Record, windows: Sequence[slice]) -> float:
    """The length of a window's head to fit starts to, s: the longest need of a model, or a share of a window."""
    return max(SETTLE_SHARE * _shortest(record, windows), *(_needed(model, record) for model in models))


def _shortest(record: Record, windows: Sequence[slice]) -> float:
    return min(float(record.time[w.stop - 1] - record.time[w.start]) for w in windows)


def free_runs_of(model: Model, record: Record, windows: Sequence[slice], settle: float) -> FreeRuns:
    """Free runs of any model over windows, each from a start fitted to its first `settle` seconds; raises Diverged.

    If a plant's attitude turns far, attitudes are compared as rotations; see `FreeRuns`.
    """
    if isinstance(model, Plant) and Chart.along(model.family, record).on:
        return free_runs(model, record, windows, settle)
    heads = head_windows(record, windows, settle)
    starts = fitted_starts(model, record, heads)
    y = _free(model, record, windows, starts)
    rows = np.concatenate([np.arange(w.start, w.stop) for w in windows])
    number = np.repeat(np.arange(len(windows)), [w.stop - w.start for w in windows])
    scored = np.concatenate([np.arange(w.start, w.stop) >= h.stop for w, h in zip(windows, heads, strict=True)])
    columns = _measured_columns(model, record)
    residual = _residual(model, outputs_of(model, record)[rows] - y, number)
    names = tuple(model.outputs[c] for c in columns)
    return FreeRuns(names, rows, number, y[:, columns], residual[:, columns], scored)


def fitted_starts(model: Model, record: Record, heads: Sequence[slice]) -> np.ndarray:
    """States at the first rows of the heads that fit all samples of each head best, shape (n_heads, n_states).

    Least squares, with each channel in units of its residual.  A state that the outputs do not show stays as `initial`
    sets it; states of a model with `start_spread` are tied to that value with this standard deviation.
    """
    if isinstance(model, Plant):
        problem = Shooting(model, record, heads)
        return problem.euler_starts(problem.solve(model, ()).starts)
    if isinstance(model, DivingModel):
        return settled_starts(model, record, heads, np.inf)
    measured = outputs_of(model, record)
    x = first = np.array([model.initial(measured[h.start]) for h in heads])
    rows = np.concatenate([np.arange(h.start, h.stop) for h in heads])
    number = np.repeat(np.arange(len(heads)), [h.stop - h.start for h in heads])
    linear = isinstance(model, StateSpace | Polynomial)
    tied = 1.0 / (model.start_spread if isinstance(model, Spread) else np.full(x.shape[1], np.inf))
    seen = _SEEN_LINEAR if linear else _SEEN

    def left(states: np.ndarray) -> np.ndarray:
        return _residual(model, measured[rows] - _free(model, record, heads, states), number)

    def cost(states: np.ndarray, residual: np.ndarray) -> float:
        return float(np.nansum((residual / unit) ** 2) + np.sum((tied * (states - first)) ** 2))

    residual = left(x)
    for _ in range(2 if linear else _ITERATIONS):  # the second pass has the final units of the channels
        unit = _root_mean_square(residual)
        unit = np.maximum(unit, 1e-9 * max(float(unit.max()), 1e-300))
        slopes = np.empty((x.shape[1], *residual.shape))
        for j in range(x.shape[1]):
            moved, probe = x.copy(), 1e-3 if linear else 1e-5 * (1.0 + np.abs(x[:, j]).max())
            moved[:, j] += probe
            slopes[j] = (residual - left(moved)) / probe
        step = np.zeros_like(x)
        for w in range(len(heads)):
            mine = number == w
            target = np.where(np.isfinite(residual[mine]), residual[mine] / unit, 0.0).ravel()
            columns = np.where(np.isfinite(slopes[:, mine]), slopes[:, mine] / unit, 0.0).reshape(x.shape[1], -1).T
            if tied.any():
                target = np.concatenate([target, tied * (first[w] - x[w])])
                columns = np.concatenate([columns, np.diag(tied)])
            step[w] = np.linalg.lstsq(columns, target, rcond=seen)[0]
        tried, share = left(x + step), 1.0
        while not linear and not cost(x + share * step, tried) < cost(x, residual) and share > _LEAST_SHARE:
            share *= 0.5
            tried = left(x + share * step)
        if share <= _LEAST_SHARE:
            break
        x, residual = x + share * step, tried
    return x


def horizon_sweep(
    model: Model, record: Record, horizons: Sequence[int], settle: float = 0.0
) -> dict[str, dict[int, float]]:
    """RMS prediction error by channel and horizon in samples.

    Each prediction is a free run from an origin; the state there has been corrected with all measurements of its
    segment up to the origin, starting from a state fitted to the segment's first `settle` seconds.  At most 200 origins
    are spread evenly over the rest.  Raises Diverged.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import closed_loop, horizon_sweep
        >>> glider = load_vehicle("slocum")
        >>> errors = horizon_sweep(glider, closed_loop(glider, rng=np.random.default_rng(0)), [1, 10])
        >>> {n: round(error, 3) for n, error in errors["heading_rad"].items()}
        {1: 0.014, 10: 0.031}
    """
    if not isinstance(horizons, Collection) or not horizons or any(k < 1 for k in horizons):
        raise ValueError(f"horizon_sweep needs a list of horizons of at least 1 sample, got {horizons!r}.")
    check_usable(type(model).__name__, model, record)
    longest, inputs, measured = max(horizons), inputs_of(model, record), outputs_of(model, record)
    time = record.time
    possible = [
        k
        for s in record.segments
        for k in range(s.start + int(np.searchsorted(time[s], time[s.start] + settle)), s.stop - longest)
    ]
    if not possible:
        raise ValueError(
            f"A horizon of {longest} samples is longer than every segment of the record past its first {settle:g} s: "
            "choose shorter horizons."
        )
    picked = np.unique(np.linspace(0, len(possible) - 1, min(MOST_ORIGINS, len(possible))).astype(int))
    origins = [possible[k] for k in picked]
    states, wanted, stepped = [], set(origins), stepper(model)
    for s, x in zip(record.segments, prediction_starts(model, record, settle)):
        for k in range(s.start, min(s.stop, origins[-1] + 1)):
            if k > s.start:
                x = stepped(x, inputs[k - 1], time[k] - time[k - 1])
                x = model.correct(x, measured[k])
            if k in wanted:
                states.append(x)
    windows = [slice(k, k + longest + 1) for k in origins]
    y = _free(model, record, windows, np.array(states))
    rows = np.concatenate([np.arange(w.start, w.stop) for w in windows])
    number = np.repeat(np.arange(len(windows)), longest + 1)
    residual = _residual(model, measured[rows] - y, number).reshape(len(windows), longest + 1, -1)
    return {
        model.outputs[c]: {k: float(_root_mean_square(residual[:, k])[c]) for k in horizons}
        for c in _measured_columns(model, record)
    }


def prediction_starts(model: Model, record: Record, settle: float) -> np.ndarray:
    """Initial states of the segments for predictions, (segments, n_states), fitted to the first `settle` seconds.

    The initial state from a single row of outputs is a poor start for a model that learns slowly from measurements.
    """
    measured = outputs_of(model, record)
    short = min(s.stop - s.start for s in record.segments) <= 2 * len(model.states)
    if isinstance(model, Plant) or not settle > 0.0 or short:
        return np.array([model.initial(measured[s.start]) for s in record.segments])
    return fitted_starts(model, record, head_windows(record, record.segments, settle))


def check_usable(name: str, model: Model, record: Record) -> None:
    """Raise an error with the model's name if it cannot run over a record: missing channel or other sample time."""
    check_model(f"A comparison with {name!r}", model)
    constants = model_constant_inputs(model)
    lacking = [c for c in model.inputs if not record.has(c) and c not in constants]
    if lacking:
        raise ValueError(
            f"Model {name!r} needs the inputs {', '.join(model.inputs)}, and the record lacks {', '.join(lacking)}; it "
            f"has {', '.join(record.names)}: record them, or map columns to them."
        )
    if not _measured_columns(model, record):
        raise ValueError(
            f"Model {name!r} gives {', '.join(model.outputs)}, and the record has none of them; it has "
            f"{', '.join(record.names)}: there is nothing to compare."
        )
    if isinstance(model, Continuous):
        return
    for part in record.segments:
        try:
            check_interval(model, record.time[part])
        except ValueError as error:
            raise ValueError(f"Model {name!r}: {error}") from None


def _windows(models: Mapping[str, Model], record: Record, window: float | None) -> list[slice]:
    plant = next((m for m in models.values() if isinstance(m, Plant)), None)
    if plant is not None:
        windows = free_run_windows(plant, record, plant.window if window is None else window)
    elif window is not None:
        windows = record.windows(window)
    else:
        windows = record.segments
    if not windows:
        longest = max(float(np.ptp(record.time[s])) for s in record.segments)
        seconds = window or getattr(plant, "window", 0.0)
        raise ValueError(
            f"A comparison needs at least one window of {seconds:g} s with two samples, and the longest segment has "
            f"{longest:g} s, with samples {record.sample_interval:g} s apart: choose "
            f"{'longer' if seconds < 2.0 * record.sample_interval else 'shorter'} windows."
        )
    return windows


def _needed(model: Model, record: Record) -> float:
    """The length of a window's head that a start of this model needs, s."""
    if isinstance(model, Plant):
        return model.settle
    return 2.0 * ceil(len(model.states) / len(_measured_columns(model, record))) * record.sample_interval


def _measured_columns(model: Model, record: Record) -> list[int]:
    return [c for c, n in enumerate(model.outputs) if record.has(n) and np.isfinite(record[n]).any()]


def _free(model: Model, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
    """Outputs of free runs, shape (total rows, n_outputs)."""
    y = run_free(model, record, windows, starts)
    check_finite(model.outputs, np.concatenate([record.time[w] for w in windows]), y)
    return y


def _residual(model: Model, residual: np.ndarray, number: np.ndarray) -> np.ndarray:
    """The residual, with angles brought within half a turn at each window's start and not wrapped after that."""
    edges = np.r_[0, np.flatnonzero(np.diff(number)) + 1, number.size]
    for c, name in enumerate(model.outputs):
        if channel(name).angle:
            for a, b in pairwise(edges):
                finite = residual[a:b, c][np.isfinite(residual[a:b, c])]
                if finite.size:
                    residual[a:b, c] -= 2.0 * np.pi * np.round(finite[0] / (2.0 * np.pi))
    return residual


def _root_mean_square(residual: np.ndarray) -> np.ndarray:
    """Root mean square of each column over its finite rows; zero if it has none."""
    count = np.isfinite(residual).sum(axis=0)
    return np.sqrt(np.nansum(residual**2, axis=0) / np.maximum(count, 1))
