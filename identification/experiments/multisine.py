"""Multisines: sums of sines with a low crest factor, whose power is concentrated at chosen frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import pi

import numpy as np

_POWERS = (4, 8, 16, 32, 64)  # orders of the norms that are minimised in turn; the last is close to the peak
_ITERATIONS = 25  # in each norm
_OVERSAMPLING = 16  # samples per period of the highest line; a sine rises by at most 2 % between them


def multisine(
    n: int,
    dt: float,
    rng: np.random.Generator,
    *,
    amplitude: float,
    lines: int | Sequence[int] = 20,
    band_Hz: Sequence[float] | None = None,
    period_s: float | None = None,
    shares: Sequence[float] | None = None,
) -> np.ndarray:
    """A sum of sines of low crest factor, shape (n,), with the largest sample `amplitude` and a random start.

    period_s: of the whole, default n dt.  lines: multiples of 1/period_s, or their number: then from the first one on,
    or spread evenly over band_Hz.  shares: the sines' relative amplitudes, default equal.
    Two signals on different lines, for example odd and even ones, are uncorrelated over a period.
    """
    samples = n if period_s is None else round(period_s / dt)
    if period_s is not None and not (2 <= samples <= n and abs(samples * dt - period_s) < 1e-6 * dt * samples):
        raise ValueError(
            f"multisine needs period_s, a whole number of samples of {dt:g} s and no longer than {n * dt:g} s, got "
            f"{period_s!r}."
        )
    chosen = _chosen_lines(lines, band_Hz, samples * dt)
    if not 2 * chosen[-1] < samples:
        raise ValueError(
            f"multisine has {samples} samples a period and so lines below {samples / 2:g}, got {chosen[-1]}: sample "
            "faster, take fewer lines or a lower band."
        )
    weights = (1.0,) * len(chosen) if shares is None else tuple(map(float, shares))
    if len(weights) != len(chosen) or not min(weights) > 0.0:
        raise ValueError(f"multisine needs a share above 0 for each of {len(chosen)} lines, got {list(weights)}.")
    phases = low_crest_phases(chosen, weights, min(samples, _OVERSAMPLING * chosen[-1]))
    angle = 2.0 * pi * np.outer((int(rng.integers(samples)) + np.arange(samples)) % samples, chosen) / samples
    period = np.cos(angle + phases) @ np.array(weights)
    return amplitude / np.abs(period).max() * np.resize(period, n)


def crest_factor(signal: np.ndarray) -> float:
    """The ratio of a signal's peak to its root mean square: 1 for a binary signal, 1.41 for a sine."""
    signal = np.asarray(signal, dtype=float)
    power = float(np.mean(signal**2)) if signal.size else 0.0
    if not power > 0.0:
        raise ValueError("A crest factor needs a signal that is not zero throughout.")
    return float(np.abs(signal).max() / np.sqrt(power))


@lru_cache(maxsize=64)
def low_crest_phases(lines: tuple[int, ...], shares: tuple[float, ...], samples: int) -> np.ndarray:
    """Phases of cosines, rad, with a small peak over `samples` samples of a period.

    Levenberg-Marquardt on norms of rising order, which approach the peak, starting from Schroeder's phases.
    Source: Schroeder 1970, IEEE Trans. Inf. Theory 16, 85-89; Guillaume et al. 1991, IEEE Trans. Instrum. Meas. 40,
    982-989.
    """
    weights = np.array(shares) / np.sqrt(0.5 * np.sum(np.square(shares)))
    basis = weights * np.exp(2j * pi * np.outer(np.arange(samples), lines) / samples)
    power = weights**2 / np.sum(weights**2)
    # 10 % less than Schroeder's phases, which for two lines are at a maximum of the peak
    phases = -0.9 * 2.0 * pi * np.cumsum(np.cumsum(power) - power)
    best, lowest = phases, np.inf
    for order in _POWERS:
        phases = _least_norm(basis, phases, order)
        peak = float(np.abs(_wave(basis, phases)).max())
        if peak < lowest:
            best, lowest = phases, peak
    best.flags.writeable = False  # all callers share one array
    return best


def _least_norm(basis: np.ndarray, phases: np.ndarray, order: int) -> np.ndarray:
    """Phases near the given ones at which the sum of the waveform's powers of order 2 `order` is smallest."""
    scale = float(np.abs(_wave(basis, phases)).max())  # keeps powers within floating point
    cost, damping = _cost(basis, phases, order, scale), 1e-2
    for _ in range(_ITERATIONS):
        turned = basis * np.exp(1j * phases)
        x = np.real(turned).sum(axis=1) / scale
        counting = np.abs(x) > 1e-8 ** (1.0 / order)  # the rest would be denormal numbers, which are slow
        turned, x = turned[counting], x[counting]
        jacobian = (order * x ** (order - 1) / scale)[:, None] * -np.imag(turned)
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ x**order
        weight = np.diag(normal) + 1e-12 * np.trace(normal)
        before = cost
        while damping < 1e8:
            moved = phases - np.linalg.solve(normal + damping * np.diag(weight), gradient)
            trial = _cost(basis, moved, order, scale)
            if trial < cost:
                phases, cost, damping = moved, trial, max(0.25 * damping, 1e-9)
                break
            damping *= 4.0
        if not before - cost > 1e-3 * before:
            break
    return phases


def _wave(basis: np.ndarray, phases: np.ndarray) -> np.ndarray:
    return np.real(basis @ np.exp(1j * phases))


def _cost(basis: np.ndarray, phases: np.ndarray, order: int, scale: float) -> float:
    return float(np.sum((_wave(basis, phases) / scale) ** (2 * order)))


def _chosen_lines(lines: int | Sequence[int], band: Sequence[float] | None, period: float) -> tuple[int, ...]:
    """The lines of a multisine as multiples of 1/period, rising."""
    if not isinstance(lines, int):
        chosen = tuple(sorted(set(lines)))
        if band is not None or not chosen or len(chosen) != len(lines) or any(k != int(k) or k < 1 for k in chosen):
            raise ValueError(
                f"multisine needs lines of its own as different whole numbers from 1 on, without band_Hz, got "
                f"{list(lines)!r} and band_Hz {band!r}."
            )
        return tuple(int(k) for k in chosen)
    if lines < 1:
        raise ValueError(f"multisine needs 1 line or more, got {lines}.")
    if band is None:
        return tuple(range(1, lines + 1))
    low, high = (float(edge) * period for edge in band)
    first, last = int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9))
    if not (1 <= first <= last and last - first + 1 >= lines):
        raise ValueError(
            f"multisine has lines {1.0 / period:.4g} Hz apart, of which {max(last - max(first, 1) + 1, 0)} lie within "
            f"band_Hz {list(band)}: {lines} are asked for. Widen the band, lengthen the period or take fewer."
        )
    return tuple(int(k) for k in np.round(np.linspace(first, last, lines)))
