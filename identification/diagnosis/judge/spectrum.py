"""Whether a residual has a period: its spectrum within windows, against that of slow noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from identification.deciding import LEAST_FOR_SPECTRUM, SLOWEST, UNEVEN


@dataclass(frozen=True)
class Rhythm:
    """The period with the most power above the background.

    band: periods of the neighbouring frequencies, s.  share: share of the power in this band.  p_value: probability of
    such a peak at any period in slow noise.
    """

    period_s: float
    band: tuple[float, float]
    share: float
    p_value: float


def residual_period(e: np.ndarray, window: np.ndarray, time: np.ndarray) -> Rhythm | None:
    """The period that stands out of a residual, (n,), in its windows; None if these are too short or unevenly sampled.

    The background is the spectrum of a first-order process, fitted robustly, so that a peak does not raise it.  The
    mean and drift of each window are removed first.  Source: Mann and Lees 1996; averaged periodograms after Welch
    1967.
    """
    members = [np.flatnonzero(window == w) for w in np.unique(window)]
    longest = max(m.size for m in members)
    members = [m for m in members if m.size > 0.7 * longest]
    n = min(m.size for m in members)
    steps = np.concatenate([np.diff(time[m]) for m in members])
    if n < LEAST_FOR_SPECTRUM or np.ptp(steps) > UNEVEN * np.median(steps):
        return None
    line = np.vander(np.linspace(-1.0, 1.0, n), 2)
    taper = np.hanning(n + 2)[1:-1]
    taper /= np.sqrt(np.mean(taper**2))
    pieces = np.array([e[m[:n]] for m in members])
    pieces = (pieces - (line @ np.linalg.lstsq(line, pieces.T, rcond=None)[0]).T) * taper
    power = (np.abs(np.fft.rfft(pieces, axis=1)) ** 2).mean(axis=0) / n**2
    frequency = np.fft.rfftfreq(n, float(np.median(steps)))
    kept = slice(SLOWEST, len(frequency) - (n % 2 == 0))
    frequency, power = frequency[kept], power[kept]
    freedom = 2 * len(members)
    ratio = power / _background(frequency * float(np.median(steps)), power, freedom)
    peak = int(np.argmax(ratio))
    single = float(stats.chi2.sf(freedom * ratio[peak], freedom))
    p = float(-np.expm1(len(frequency) * np.log1p(-min(single, 1.0 - 1e-12))))
    near = slice(max(peak - 1, 0), peak + 2)
    centre = float(np.sum(frequency[near] * power[near]) / np.sum(power[near]))
    step = float(frequency[1] - frequency[0])
    band = (1.0 / (centre + step), 1.0 / max(centre - step, 0.5 * step))
    share = float(power[near].sum() / power.sum())
    return Rhythm(1.0 / centre, band, share, p)


def _background(cycles: np.ndarray, power: np.ndarray, freedom: int) -> np.ndarray:
    """The spectrum of a first-order process plus white noise, fitted through the middle of a measured spectrum.

    cycles: frequencies in cycles per sample.
    """
    middle = float(stats.chi2.median(freedom)) / freedom

    def shape(log_size, slope, floor):
        phi = 1.0 / (1.0 + np.exp(-slope))
        return log_size + np.log(
            (1.0 - phi) ** 2 / (1.0 - 2.0 * phi * np.cos(2.0 * np.pi * cycles) + phi**2) + np.exp(floor)
        )

    level = np.log(power + 1e-300) - np.log(middle)
    start = [float(np.median(level[: max(len(level) // 8, 2)])), 2.0, -6.0]
    fit = optimize.least_squares(lambda x: shape(*x) - level, start, loss="soft_l1", f_scale=0.5, max_nfev=100)
    return np.exp(shape(*fit.x))
