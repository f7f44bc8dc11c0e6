"""Agreement of a model with a record: free runs, scores per channel, and tests of the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy import stats

from auv_gym.channels import channel, wrap
from auv_gym.plant import Plant
from auv_gym.records.attitude import ANGLES
from auv_gym.records.record import Record
from identification.fit.shooting import Shooting

_TURNS = ("turn about the level axis ahead", "turn about the level axis to starboard", "turn about the vertical")


@dataclass(frozen=True)
class Score:
    """Agreement of one channel over a stated horizon, in the channel's unit where it has one.

    fit_percent = 100 (1 - |y - yh| / |y - mean y|).  r2 = 1 - |y - yh|^2 / |y - mean y|^2.
    """

    rmse: float
    mean_absolute: float
    maximum: float
    r2: float
    fit_percent: float
    samples: int

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


@dataclass(frozen=True, eq=False)
class FreeRuns:
    """Free runs over windows: rows of the record, model outputs and residuals, by channel (rows, C).

    scored: rows past the samples to which the initial states were fitted.  readings: (rows, C), see `Record.readings`;
    None if all are.  signals: (rows, C), measured rotations about the body axes if the attitude turns far
    (`auv_gym.plant.Chart`), else None: the residuals of roll, pitch and heading are then the rotations from the model's
    attitude to the measured one, about the level axes ahead and to starboard and the vertical.  The model's angles stay
    angles.
    """

    channels: tuple[str, ...]
    rows: np.ndarray
    window: np.ndarray
    model: np.ndarray
    residual: np.ndarray
    scored: np.ndarray
    readings: np.ndarray | None = None
    signals: np.ndarray | None = None

    def label(self, name: str) -> str:
        """A description of the error that the residual of a channel is."""
        turned = self.signals is not None and name in ANGLES
        return _TURNS[ANGLES.index(name)] if turned else channel(name).label

    def held(self, number: int) -> np.ndarray:
        """Which rows hold a reading of a channel, (rows,); values between readings have smaller errors."""
        read = np.isfinite(self.residual[:, number])
        return read if self.readings is None else read & self.readings[:, number]

    def errors(self, number: int) -> np.ndarray:
        """The residual of a channel at its readings in scored rows."""
        return self.residual[self.scored & self.held(number), number]

    def white(self, number: int) -> Whiteness:
        """The whiteness of a channel's residual at its readings."""
        held = self.held(number)
        return whiteness(self.residual[held, number], self.window[held])

    def scores(self, record: Record) -> dict[str, Score]:
        """A score for each channel, over the readings in scored rows."""
        result = {}
        for c, name in enumerate(self.channels):
            keep = self.scored & self.held(c)
            told = record[name][self.rows] if self.signals is None else self.signals[:, c]
            result[name] = score(told[keep], self.residual[keep, c])
        return result


def free_runs(plant: Plant, record: Record, windows: Sequence[slice], settle: float = 20.0) -> FreeRuns:
    """Free runs of a plant over windows of a record, each from states fitted to the window's first seconds alone.

    settle: s, at least three samples; those samples are not scored.  Raises Diverged.
    """
    heads = head_windows(record, windows, settle)
    starts = _starts(plant, record, heads)
    scored = np.concatenate([np.arange(w.start, w.stop) >= h.stop for w, h in zip(windows, heads, strict=True)])
    return _runs(Shooting(plant, record, windows), plant, starts, scored)


def joined_runs(parts: Sequence[FreeRuns]) -> FreeRuns:
    """Free runs over different windows joined into one, in the order of the record, for runs of one vehicle."""
    first = np.cumsum([0, *(int(p.window.max()) + 1 for p in parts)])
    rows = np.concatenate([p.rows for p in parts])
    order = np.argsort(rows, kind="stable")
    windows = np.concatenate([p.window + f for p, f in zip(parts, first, strict=False)])[order]
    numbers = np.cumsum(np.r_[0, windows[1:] != windows[:-1]])
    told = [p.readings for p in parts if p.readings is not None]
    readings = np.concatenate(told)[order] if len(told) == len(parts) else None
    model, residual = (np.concatenate([getattr(p, name) for p in parts])[order] for name in ("model", "residual"))
    scored = np.concatenate([p.scored for p in parts])[order]
    turned = [p.signals for p in parts if p.signals is not None]
    signals = np.concatenate(turned)[order] if len(turned) == len(parts) else None
    return FreeRuns(parts[0].channels, rows[order], numbers, model, residual, scored, readings, signals)


def head_windows(record: Record, windows: Sequence[slice], settle: float) -> list[slice]:
    """The first `settle` seconds of each window, at least three samples."""
    heads = []
    for w in windows:
        count = int(np.searchsorted(record.time[w], record.time[w.start] + settle))
        heads.append(slice(w.start, w.start + min(max(count, 3), w.stop - w.start)))
    return heads


def fitted_runs(plant: Plant, record: Record, windows: Sequence[slice]) -> FreeRuns:
    """Free runs of a plant over windows of a record, each from the states that fit the whole window best.

    Raises Diverged.
    """
    problem = Shooting(plant, record, windows)
    point = problem.solve(plant, ())
    if not np.isfinite(point.cost):  # diverges from the first readings; from fitted states it may not
        point = problem.solve(plant, (), guess=_starts(plant, record, head_windows(record, windows, plant.settle)))
    return _runs(problem, plant, point.starts, np.ones(problem.runs.rows, dtype=bool))


def _starts(plant: Plant, record: Record, windows: Sequence[slice]) -> np.ndarray:
    """The initial states of windows that fit all of their readings best, (W, n_states)."""
    return Shooting(plant, record, windows).solve(plant, ()).starts


def _runs(problem: Shooting, plant: Plant, starts: np.ndarray, scored: np.ndarray) -> FreeRuns:
    model = plant.run(problem.record, problem.windows, problem.euler_starts(starts))[:, problem.columns]
    residual = problem.point(plant.vector, starts).residual
    rows = np.concatenate([np.arange(w.start, w.stop) for w in problem.windows])
    readings = np.stack([problem.record.readings(name)[rows] for name in problem.channels], axis=1)
    signals = problem.signals if problem.chart.on else None
    if problem.chart.on:  # whole turns mean nothing there, and each passage of the vertical jumps by half a turn
        angles = [problem.channels.index(name) for name in ANGLES]
        model[:, angles] = problem.logged[:, angles] - wrap(problem.logged[:, angles] - model[:, angles])
    return FreeRuns(problem.channels, rows, problem.window_of_row, model, residual, scored, readings, signals)


def score(measured: np.ndarray, residual: np.ndarray) -> Score:
    """The score of a residual against its measured signal; raises if there is no sample."""
    if residual.size == 0:
        raise ValueError(
            "A score needs at least one sample, got none: choose longer windows or a shorter settling time."
        )
    power, spread = float(residual @ residual), float(np.sum((measured - measured.mean()) ** 2))
    ratio = power / spread if spread > 0.0 else np.inf
    return Score(
        rmse=float(np.sqrt(power / residual.size)),
        mean_absolute=float(np.mean(np.abs(residual))),
        maximum=float(np.max(np.abs(residual))),
        r2=1.0 - ratio,
        fit_percent=100.0 * (1.0 - np.sqrt(ratio)),
        samples=int(residual.size),
    )


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Autocorrelation of residuals with its 95 % bound, and the Ljung-Box test of whiteness."""

    lags: np.ndarray
    correlation: np.ndarray
    bound: float
    p_value: float


def whiteness(residual: np.ndarray, window: np.ndarray, lags: int = 15, fitted: np.ndarray | None = None) -> Whiteness:
    """Autocorrelation of a residual within its windows.

    residual, window: (n,).  fitted: (n, q), orthonormal columns of what was fitted.  The fit removes their part from
    white errors, which alone correlates the rest; this is corrected.  Source: Ljung and Box 1978.
    """
    e = np.where(np.isfinite(residual), residual, 0.0)
    basis = np.zeros((e.size, 0)) if fitted is None else fitted
    lags = max(min(lags, int(np.min(np.bincount(window)[np.unique(window)])) - 1), 1)
    n = e.size
    variance = float(e @ e) / max(n - float((basis**2).sum()), 1.0)
    correlation = np.zeros(lags)
    for k in range(1, lags + 1):
        same = window[k:] == window[:-k]
        expected = -float((basis[k:][same] * basis[:-k][same]).sum())  # for white errors, over the variance
        if variance > 0.0:
            correlation[k - 1] = (float((e[k:] * e[:-k])[same].sum()) / variance - expected) / n
    pairs = np.array([np.sum(window[k:] == window[:-k]) for k in range(1, lags + 1)])
    # over short windows there are fewer pairs than rows: the estimate is scaled to their number
    scaled = correlation * n / np.maximum(pairs, 1)
    statistic = float(np.sum(pairs * scaled**2))
    bound = 1.96 / np.sqrt(n)
    return Whiteness(np.arange(1, lags + 1), correlation, bound, float(stats.chi2.sf(statistic, lags)))


def input_correlation(
    residual: np.ndarray, signal: np.ndarray, window: np.ndarray, lags: int = 15
) -> tuple[np.ndarray, np.ndarray, float]:
    """Correlation of a residual with an input at lags -lags..lags (positive: the input leads), and the 95 % bound.

    Source: Ljung 1999, sec. 16.6, with the bound for a white residual.
    """
    e = residual - np.nanmean(residual)
    e = np.where(np.isfinite(e), e, 0.0)
    u = signal - signal.mean()
    norm = np.sqrt(float(e @ e) * float(u @ u))
    ks = np.arange(-lags, lags + 1)
    values = []
    for k in ks:
        a, b = (slice(k, None), slice(None, e.size - k)) if k >= 0 else (slice(None, e.size + k), slice(-k, None))
        values.append(float(np.sum(e[a] * u[b] * (window[a] == window[b]))) / norm if norm > 0.0 else 0.0)
    return ks, np.array(values), 1.96 / np.sqrt(e.size)
