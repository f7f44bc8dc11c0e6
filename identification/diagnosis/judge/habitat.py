"""The habitat of an unexplained residual: its channel, the depth, speed or heading at which it is large, its period.

Tests exchange whole windows: errors within one free run are correlated from sample to sample, those of two are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from auv_gym.channels import channel
from auv_gym.records.record import Record
from identification.deciding import BINS, LEAST_EXCHANGED, LEAST_GROWTH, LEAST_POWER, LEVEL, MOST_OF_ERROR
from identification.diagnosis.judge.spectrum import Rhythm, residual_period
from identification.diagnosis.wording import ends, quantity
from identification.fit.residual import noise_floors
from identification.fit.validation import FreeRuns

PERMUTATIONS = 4000
DRAWS = 1000
PARTS = 8  # of a run, to measure its growth
_TRACK = ("north_m", "east_m")  # left out: position says little that time does not


@dataclass(frozen=True, eq=False)
class Share:
    """The distribution of the squared error over one quantity.

    edges: (n + 1,).  error, samples: (n,), shares of the bins.  stretch: (low, high), the interval with the densest
    error, with its shares; low > high if an interval of angles includes north.  p_value: probability of so dense an
    interval by chance.
    """

    name: str
    edges: np.ndarray
    error: np.ndarray
    samples: np.ndarray
    stretch: tuple[float, float]
    error_share: float
    sample_share: float
    p_value: float

    @property
    def words(self) -> str:
        """A phrase such as: 71 % of the squared error is in the 24 % of samples with depth between 20 and 60 m."""
        label, unit = channel(self.name).label, channel(self.name).unit
        between = " and ".join(ends(self.stretch, unit or "1"))
        where = f"the {100 * self.sample_share:.0f} % of samples with {label} between {between}"
        return f"{100 * self.error_share:.0f} % of the squared error is in {where}"


@dataclass(frozen=True, eq=False)
class Growth:
    """RMS error by time within a window, and whether it grows; first, last: RMS in the first and last quarter."""

    time: np.ndarray
    rms: np.ndarray
    first: float
    last: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Habitat:
    """The habitat of a residual: when and where it is large.

    channel: the one with most of the error.  channels: share of each channel in the mean square above the noise, each
    relative to its noise.
    certain: share of resamples of the windows in which that channel leads.  level: significance level of the p-values.
    """

    channel: str
    channels: dict[str, float]
    certain: float
    shares: tuple[Share, ...]
    rhythm: Rhythm | None
    growth: Growth | None
    level: float
    rms: float

    @property
    def found(self) -> tuple[Share, ...]:
        """The quantities that the error correlates with, the most significant first."""
        return tuple(s for s in self.shares if s.p_value < self.level)

    def summary(self) -> str:
        """A plain paragraph about the findings that pass a test, corrected for the number of tests."""
        name, unit = channel(self.channel).label, channel(self.channel).unit
        size = f"With starts fitted to whole windows, free runs still err by {quantity(self.rms, unit)} RMS in {name}"
        if len(self.channels) > 1 and 1.0 - self.certain < self.level:
            share = self.channels[self.channel]
            most = "most" if share > MOST_OF_ERROR else f"the largest part ({100 * share:.0f} %)"
            size += f", which is {most} of the remaining error"
        text = "; ".join(s.words for s in self.found[:2])
        later = []
        if self.rhythm is not None and self.rhythm.p_value < self.level and self.rhythm.share > LEAST_POWER:
            later.append(f"it has a period of about {_two_digits(self.rhythm.period_s)} s")
        if self.growth is not None and self.growth.p_value < self.level:
            first, last = (quantity(v, unit) for v in (self.growth.first, self.growth.last))
            later.append(f"it grows within a run, from {first} to {last}")
        said = "; ".join(p for p in (text, *later) if p)
        if not said:
            return f"{size}. This error correlates with no recorded signal and is not periodic."
        return f"{size}: {said}."


def residual_habitat(runs: FreeRuns, record: Record, rng: np.random.Generator) -> Habitat:
    """The habitat of the residual of free runs, in the channel with most of the error.

    Raises ValueError if the runs have no residual.
    """
    keep = runs.scored & np.isfinite(runs.residual).any(axis=1)
    if keep.sum() < 2 * BINS:
        raise ValueError(
            f"A residual needs at least {2 * BINS} scored samples, got {keep.sum()}: choose longer windows."
        )
    rows, window = runs.rows[keep], np.unique(runs.window[keep], return_inverse=True)[1]
    residual = np.where(np.isfinite(runs.residual[keep]), runs.residual[keep], 0.0)
    shares, certain = _channels(runs, residual, window, rng)
    top = max(shares, key=lambda c: shares[c])
    e = residual[:, runs.channels.index(top)]
    signals = {n: record[n][rows] for n in record.names if n not in _TRACK and np.ptp(record[n][rows]) > 0.0}
    signals["time_s"] = record.time[rows] - record.time[0]
    signals = {n: s for n, s in signals.items() if np.isfinite(s).all()}
    spread = _shares(e**2, window, signals, rng)
    rhythm = residual_period(e, window, record.time[rows])
    growth = _growth(e, window, record.time[rows])
    tests = len(spread) + (rhythm is not None) + (growth is not None) + (len(shares) > 1)
    ordered = tuple(sorted(spread, key=lambda s: (s.p_value, s.sample_share - s.error_share)))
    rms = float(np.sqrt(np.mean(e**2)))
    return Habitat(top, shares, certain[top], ordered, rhythm, growth, LEVEL / max(tests, 1), rms)


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _channels(runs: FreeRuns, residual: np.ndarray, window: np.ndarray, rng) -> tuple[dict, dict]:
    """Share of each channel in the excess over the noise, and how often it leads in resamples of the windows."""
    floors = noise_floors(runs.residual, runs.window, runs.readings)
    sizes = np.bincount(window).astype(float)
    squares = np.stack([np.bincount(window, r**2) for r in residual.T], axis=1) / floors**2
    excess = np.maximum(squares.sum(axis=0) / sizes.sum() - 1.0, 0.0)
    total = max(float(excess.sum()), 1e-300)
    drawn = rng.integers(0, len(sizes), size=(DRAWS, len(sizes)))
    leaders = (squares[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)[:, None]).argmax(axis=1)
    leads = np.bincount(leaders, minlength=len(runs.channels)) / DRAWS
    return (
        {n: float(excess[c] / total) for c, n in enumerate(runs.channels)},
        {n: float(leads[c]) for c, n in enumerate(runs.channels)},
    )


def _shares(squares: np.ndarray, window: np.ndarray, signals: dict[str, np.ndarray], rng) -> list[Share]:
    """The distribution of squared errors over each signal, tested by permuting the windows' errors."""
    count = int(window.max()) + 1
    members = [np.flatnonzero(window == w) for w in range(count)]
    # row a: the squared errors of window b as they would fall on the samples of window a
    moved = [np.stack([squares[b][np.arange(a.size) * b.size // a.size] for b in members]) for a in members]
    orders = [np.arange(count)]
    if count >= LEAST_EXCHANGED:
        orders += [rng.permutation(count) for _ in range(PERMUTATIONS)]
    orders = np.array(orders)
    found = []
    for name, signal in signals.items():
        edges, bins = _binned(name, signal)
        number = len(edges) - 1
        if number < 2:
            continue
        samples = np.bincount(bins, minlength=number) / bins.size
        table = np.array(
            [[np.bincount(bins[a], row, minlength=number) for row in moved[w]] for w, a in enumerate(members)]
        )
        sums = table[np.arange(count)[None], orders].sum(axis=1)  # (orders, bins)
        error = sums / np.maximum(sums.sum(axis=1, keepdims=True), 1e-300)
        circular = _circular(name, signal)
        best, excess = _stretches(error - samples, circular)
        p = float((excess >= excess[0] - 1e-12).mean()) if len(orders) > 1 else 1.0
        first, length = best
        inside = np.arange(first, first + length) % number
        stretch = (float(edges[first]), float(edges[(first + length - 1) % number + 1]))
        found.append(
            Share(
                name, edges, error[0], samples, stretch, float(error[0][inside].sum()), float(samples[inside].sum()), p
            )
        )
    return found


def _circular(name: str, signal: np.ndarray) -> bool:
    return channel(name).angle and bool(np.ptp(signal) > np.pi)


def _binned(name: str, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges of bins with about equal numbers of samples, and each sample's bin; equal sectors for a full circle."""
    if _circular(name, signal):
        edges = np.linspace(0.0, 2.0 * np.pi, BINS + 1)
        signal = np.mod(signal, 2.0 * np.pi)
    else:
        edges = np.unique(np.quantile(signal, np.linspace(0.0, 1.0, BINS + 1)))
    bins = np.clip(np.searchsorted(edges, signal, side="right") - 1, 0, max(len(edges) - 2, 0))
    return edges, bins


def _stretches(excess: np.ndarray, circular: bool) -> tuple[tuple[int, int], np.ndarray]:
    """The run of adjacent bins, (first, length), with the largest excess in the first row; the largest in every row.

    excess: (rows, bins), each row sums to zero.
    """
    number = excess.shape[1]
    twice = np.concatenate([np.zeros((len(excess), 1)), np.cumsum(np.tile(excess, (1, 2)), axis=1)], axis=1)
    best, largest = (0, 1), np.full(len(excess), -np.inf)
    for length in range(1, number):
        for first in range(number if circular else number - length + 1):
            value = twice[:, first + length] - twice[:, first]
            if value[0] > largest[0]:
                best = (first, length)
            largest = np.maximum(largest, value)
    return best, largest


def _growth(e: np.ndarray, window: np.ndarray, time: np.ndarray) -> Growth | None:
    """The error by time since the window began, and a signed-rank test over the windows; None if windows are few."""
    members = [np.flatnonzero(window == w) for w in range(int(window.max()) + 1)]
    members = [m for m in members if m.size >= PARTS]
    if len(members) < LEAST_EXCHANGED:
        return None
    parts = np.array([[np.mean(e[p] ** 2) for p in np.array_split(m, PARTS)] for m in members])
    spans = np.array([time[m[-1]] - time[m[0]] for m in members])
    rms = np.sqrt(parts.mean(axis=0))
    outer = PARTS // 4
    first, last = parts[:, :outer].mean(axis=1), parts[:, -outer:].mean(axis=1)
    sizes = (float(np.sqrt(first.mean())), float(np.sqrt(last.mean())))
    difference = np.log((last + 1e-300) / (first + 1e-300))
    p = float(np.asarray(stats.wilcoxon(difference, alternative="greater"))[1]) if np.any(difference) else 1.0
    p = p if sizes[1] > LEAST_GROWTH * sizes[0] else 1.0
    return Growth((np.arange(PARTS) + 0.5) / PARTS * float(np.median(spans)), rms, *sizes, p)
