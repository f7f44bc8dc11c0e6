"""Sequential tests of innovations: sums with exponential forgetting, against thresholds for an alarm.

Each of several memories keeps, for each channel, the sum of its innovations and their sums weighted by each signal (a
command or a predicted output, minus its mean).  Each sum is divided by its standard deviation, giving z.  If the
innovations are white, z is standard normal whatever the signals do, since these are known beforehand.  The tests are
the square of each z, its sum over the channels, and the mean square of each channel, by Wilson and Hilferty's cube root
(1931, PNAS 17).
Sources: tests with several memories side by side, Lai 1995, J. R. Statist. Soc. B 57, sec. 3; the rate at which a
chi-square process crosses a high bar, Aldous 1989, sec. D10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar
from scipy.stats import chi2

from auv_gym.compiled import compiled, outlined, ready

LEAST = 1e-200  # keeps a sum of squares from being zero
CLIP = 5.0  # of an innovation; the lowest bar is higher, so a single outlier raises no alarm
_RATIO = 2.5  # between one memory and the next; an alarm then takes at most a fifth longer than with the best memory
_SHORTEST = 2.0  # samples
_BLOCK = 1000  # samples; the bars are computed from the greatest statistics of such blocks
_BLOCKS = 400
_OFTEN = 0.3  # share of blocks that pass the bar from which the rates of rarer ones are extrapolated


@dataclass(frozen=True, eq=False)
class Bars:
    """The bars for an alarm: `pooled` for the sum of squares over the channels, `single` for one square."""

    pooled: float
    single: float


def memories(longest: float) -> np.ndarray:
    """Memories of the tests in samples, up to the longest, (S,)."""
    count = int(np.floor(np.log(max(longest / _SHORTEST, 1.0)) / np.log(_RATIO))) + 1
    return _SHORTEST * _RATIO ** np.arange(count)


class Bank:
    """The sums of all tests; `memories`, (S,), are their time constants in samples.

    columns: (J - 1,), positions of the signals after the constant one among inputs and states.
    inflation: (S, 2, C), the mean of z squared over a clean log if above 1: for sums, and for mean squares.
    told: the greatest pooled square, its memory and signal; the greatest single square, its memory and signal.
    """

    def __init__(self, lasting: np.ndarray, columns: np.ndarray, channels: int, inflation: np.ndarray | None = None):
        count, signals = len(lasting), 1 + len(columns)
        inflation = np.ones((count, 2, channels)) if inflation is None else inflation
        # sums of innovations times signals and of squared signals; of squared innovations, weights and squared weights
        self._sums, self._own = np.zeros((count, 2, channels, signals)), np.zeros((count, 3, channels))
        self._means = np.zeros((count, signals + 1))  # of the signals; the last one is the weight of the past
        self.told, room = np.zeros(6), np.zeros((7, max(channels, signals)))
        self._numbers = (self._sums, self._own, self._means, self.told, room)
        self._columns, self._settings, self._program = columns, (np.exp(-1.0 / lasting), 1.0 / inflation), ready(_taken)

    @property
    def squares(self) -> np.ndarray:
        """The squares of z, (S, J + 1, C); the last row is that of the mean squares, zero if below expectation."""
        count, _, channels, signals = self._sums.shape
        found = np.zeros((count, signals + 1, channels))
        _squared(self._settings[1], self._sums, self._own, found)
        return found

    def clear(self) -> None:
        """Forget the past."""
        self._sums[:], self._own[:], self._means[:] = 0.0, 0.0, 0.0

    def take(self, innovations: np.ndarray, scales: np.ndarray, inputs: np.ndarray, states: np.ndarray) -> None:
        """Update the sums with a sample of innovations times scales, (C,)."""
        self._program(innovations, scales, inputs, states, self._columns, *self._settings, *self._numbers)

    def greatest(self, innovations: np.ndarray, signals: np.ndarray) -> np.ndarray:
        """The greatest pooled and single square over samples, (2,), without inflation.

        signals: (n, J - 1).
        """
        (decays, inverse), columns, found = self._settings, np.arange(signals.shape[1]), np.zeros(2)
        _greatest(innovations, signals, columns, decays, np.ones_like(inverse), *self._numbers, found)
        return found


@compiled
def _square(total, power, inverse):
    """The square of z, from a sum of innovations times a signal and that of the squared signal."""
    return total**2 * inverse / (power + LEAST)


@compiled
def _mean_square(total, weight, squared, inverse):
    """The square of z of a mean square, 0 if this is below expectation.

    total: sum of squared innovations.  weight, squared: sums of their weights, and of the squares of these.
    """
    if total > weight:
        spread = 2.0 * squared / (9.0 * weight**2)
        z = np.cbrt(total / weight) - 1.0 + spread
        return z * z / spread * inverse
    return 0.0


@outlined
def _taken(innovations, scales, inputs, states, columns, decays, inverse, sums, own, means, told, room):
    """Update all sums with one sample, see `Bank.take`; signals are innermost, as a sum over channels is a serial loop.

    inverse: 1 over the inflation.  room: work array, (7, max(C, J)).
    """
    count, _, channels, number = sums.shape
    e, there, signal, factor, power = room[0], room[1], room[2], room[3], room[4]
    pooled, single = room[5], room[6]
    for c in range(channels):
        there[c] = 1.0 if np.isfinite(innovations[c]) else 0.0
        e[c] = min(max(scales[c] * innovations[c], -CLIP), CLIP) if there[c] > 0.0 else 0.0
    for j in range(1, number):
        k = columns[j - 1]
        signal[j] = inputs[k] if k < inputs.shape[0] else states[k - inputs.shape[0]]
    factor[0], power[0] = 1.0, 1.0
    told[0], told[3] = 0.0, 0.0
    for s in range(count):
        decay = decays[s]
        faster = decay * decay
        weight = decay * means[s, number] + 1.0
        for j in range(1, number):
            apart = signal[j] - means[s, j]
            means[s, j] += apart / weight
            factor[j] = apart if weight > 1.0 else 0.0
            power[j] = factor[j] * factor[j]
        means[s, number] = weight
        for j in range(number):
            pooled[j], single[j] = 0.0, 0.0
        for c in range(channels):
            error, seen, share = e[c], there[c], inverse[s, 0, c]
            for j in range(number):
                sums[s, 0, c, j] = decay * sums[s, 0, c, j] + factor[j] * error
                sums[s, 1, c, j] = faster * sums[s, 1, c, j] + power[j] * seen
                square = _square(sums[s, 0, c, j], sums[s, 1, c, j], share)
                pooled[j] += square
                single[j] = max(single[j], square)
        for j in range(number):
            if pooled[j] > told[0]:
                told[0], told[1], told[2] = pooled[j], s, j
            if single[j] > told[3]:
                told[3], told[4], told[5] = single[j], s, j
        for c in range(channels):
            own[s, 0, c] = decay * own[s, 0, c] + e[c] * e[c]
            own[s, 1, c] = decay * own[s, 1, c] + there[c]
            own[s, 2, c] = faster * own[s, 2, c] + there[c]
        for c in range(channels):
            square = _mean_square(own[s, 0, c], own[s, 1, c], own[s, 2, c], inverse[s, 1, c])
            if square > told[3]:
                told[3], told[4], told[5] = square, s, number


@outlined
def _squared(inverse, sums, own, found):
    """Compute all squares of z, see `Bank.squares`."""
    count, _, channels, number = sums.shape
    for s in range(count):
        for c in range(channels):
            for j in range(number):
                found[s, j, c] = _square(sums[s, 0, c, j], sums[s, 1, c, j], inverse[s, 0, c])
            found[s, number, c] = _mean_square(own[s, 0, c], own[s, 1, c], own[s, 2, c], inverse[s, 1, c])


@outlined
def _greatest(innovations, signals, columns, decays, inverse, sums, own, means, told, room, found):
    """Run the tests over samples and keep the greatest squares; see `Bank.greatest`."""
    scales, none = np.ones(innovations.shape[1]), np.zeros(0)
    for k in range(innovations.shape[0]):
        numbers = (columns, decays, inverse, sums, own, means, told, room)
        _taken(innovations[k], scales, signals[k], none, *numbers)
        found[0], found[1] = max(found[0], told[0]), max(found[1], told[3])


def bars_for(bank: Bank, signals: np.ndarray, present: np.ndarray, rate: float, rng: np.random.Generator) -> Bars:
    """The bars at which white normal innovations raise `rate` alarms per sample; clears the bank's past.

    signals: (n, J - 1), from a clean log, which is repeated as often as needed.  present: (n, C), which readings it
    has.
    By simulation: the bar that is passed in `_OFTEN` of the blocks of `_BLOCK` samples fixes the constant K in each
    statistic's rate K h P(chi-square > h) at a bar h, and shows how often both are passed together; the higher bars
    follow from this.
    """
    channels, greatest = present.shape[1], np.zeros((_BLOCKS, 2))
    bank.clear()
    for b in range(_BLOCKS):
        rows = (b * _BLOCK + np.arange(_BLOCK)) % len(signals)
        white = np.where(present[rows], rng.standard_normal((_BLOCK, channels)), np.nan)
        greatest[b] = bank.greatest(white, signals[rows])
    bank.clear()
    often, freedoms = -np.log1p(-_OFTEN) / _BLOCK, (channels, 1)
    known = np.quantile(greatest, 1.0 - _OFTEN, axis=0)
    logs = [np.log(often) - _log_shape(h, f) for h, f in zip(known, freedoms, strict=True)]  # logarithms of K
    rates = np.stack([k + _log_shape(g, f) for k, g, f in zip(logs, greatest.T, freedoms, strict=True)])
    own = np.log(rate) + float(np.quantile(rates.min(axis=0), _OFTEN)) - np.log(often)
    return Bars(*(_bar(h, own - k, f) for h, k, f in zip(known, logs, freedoms, strict=True)))


def _log_shape(bar: np.ndarray | float, freedom: int):
    return np.log(bar) + chi2.logsf(bar, freedom)


def _bar(low: float, wanted: float, freedom: int) -> float:
    """The bar h, at least `low`, at which the logarithm of h P(chi-square > h) is `wanted`."""
    if _log_shape(low, freedom) <= wanted:
        return float(low)
    return float(root_scalar(lambda h: _log_shape(h, freedom) - wanted, bracket=(low, 1000.0)).root)
