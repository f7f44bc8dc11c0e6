"""A square-root Kalman filter of a linear, time-varying system; `adjoint.py` has the gradient of its likelihood.

The state is [x | d]: the accelerations d, each a first-order Gauss-Markov process, push x.  Those of a swell come in
pairs of such processes that rotate into each other, of which the first pushes.  Their spectrum has a peak at the
frequency of the rotation, and is wider for shorter correlation times (Harvey 1989, sec. 2.3.5, a stochastic cycle).
Rows follow each other in stretches, each with initial states of its own.
Source: Potter's update and the triangular time update, Bierman 1977, sec. II.3 and V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import ref

import numpy as np

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.pushes import turned
from identification.fit.responses import Responses

LEAST_VARIANCE = 1e-300
_HELD = 3  # cached systems without some of their accelerations
NOTHING = 1e-100  # entries of a root below this count as zero: their squares would underflow


@dataclass(frozen=True, eq=False)
class System:
    """A linear system over rows.

    a: (rows, N - D, N), from a row to the next one's x.  c: (rows, C, N).  forcing: (rows, N - D), subtracted from x on
    the way.  error: (rows, C), measured minus the output of a zero state; finite: (rows, C).
    begin: (rows,), 0 within a stretch, 1 where one begins, 2 where one begins and the `constant` states (N,) carry
    over.
    durations: (rows,), s, to the next row.  start: (W, N - D, N - D), transposed square root of the initial covariance
    of x of a stretch, zero in rows and columns of states carried over.  origin: (W, N), the initial mean.
    moves: (rows, N - D, N), as `a`, but including sensors without a lag; only where gains act at the end of a row.
    turns: (D,), rad/s, of the rotation of an acceleration and the one after it into each other; 0, or None, for none.
    vector: (n_parameters,), of the linearised vehicle; path: (rows, F), of the linearisation.
    responses: of its parameters, computed there or nearby, if any.
    """

    a: np.ndarray
    c: np.ndarray
    forcing: np.ndarray
    error: np.ndarray
    finite: np.ndarray
    counts: np.ndarray
    begin: np.ndarray
    constant: np.ndarray
    durations: np.ndarray
    start: np.ndarray
    origin: np.ndarray
    moves: np.ndarray | None = None
    vector: np.ndarray | None = None
    path: np.ndarray | None = None
    responses: Responses | None = None
    turns: np.ndarray | None = None

    @property
    def turning(self) -> np.ndarray:
        """The turns, (D,), zero for none."""
        return np.zeros(self.a.shape[2] - self.a.shape[1]) if self.turns is None else self.turns

    def with_pushes(self, kept: np.ndarray) -> System:
        """The system without some of its accelerations; kept: (D,) bool."""
        own = np.r_[np.arange(self.a.shape[1]), self.a.shape[1] + np.flatnonzero(kept)]
        return replace(
            self,
            a=np.take(self.a, own, axis=2),
            c=np.take(self.c, own, axis=2),
            constant=self.constant[own],
            origin=np.take(self.origin, own, axis=1),
            turns=self.turning[kept],
        )


@dataclass(frozen=True, eq=False)
class Pass:
    """The results of a filter over a system.

    gains: (rows, N, C).  whiten: (rows, C, C), lower triangular, scales an innovation to unit variance; zero where
    nothing was measured.  innovations: (rows, C), scaled in this way.  scores: (rows,), log-likelihood.
    roots: (rows, M, M), transposed square roots of the covariances before the readings, and means: (rows, M), after the
    readings, of the M states that were not left out.
    """

    gains: np.ndarray
    whiten: np.ndarray
    innovations: np.ndarray
    scores: np.ndarray
    roots: np.ndarray
    means: np.ndarray

    @property
    def spreads(self) -> np.ndarray:
        """Half the logarithm of the determinant of each row's innovations' covariance, but for a constant, (rows,)."""
        return -self.scores - 0.5 * (self.innovations**2).sum(axis=1)


def run_filter(
    system: System,
    variances: np.ndarray,
    deviations: np.ndarray,
    times: np.ndarray,
    start: np.ndarray | None = None,
) -> Pass:
    """Run the filter with given variances of readings (C,), and accelerations' deviations and correlation times (D,).

    An acceleration without deviation is left out, which does not change the result; its gains are zero.
    start: as that of the system, which is the default.
    """
    kept = deviations > 0.0
    s, own = latest(system, kept), own_states(system, kept)
    (rows, count, _), size = system.c.shape, int(own.sum())
    gains, roots, means = np.zeros((rows, size, count)), np.zeros((rows, size, size)), np.zeros((rows, size))
    whiten, innovations, scores = np.zeros((rows, count, count)), np.zeros((rows, count)), np.zeros(rows)
    start = np.ascontiguousarray(s.start if start is None else start)
    numbers = (s.a, s.c, s.forcing, s.error, s.finite, s.counts, s.begin, s.constant, s.durations, start, s.origin)
    made = (gains, whiten, innovations, scores, roots, means)
    _forward(*numbers, variances, deviations[kept], times[kept], s.turning, *made)
    return Pass(among(gains, own, 1), whiten, innovations, scores, roots, means)


_latest: tuple[tuple[ref[System], bytes, System], ...] = ()


def latest(system: System, kept: np.ndarray) -> System:
    """A system without some of its accelerations, kept: (D,) bool.

    The last few results are cached while their systems live, since a search of noises repeats its requests.
    """
    global _latest
    if kept.all():
        return system
    for held, own, found in _latest:
        if held() is system and own == kept.tobytes():
            return found
    s = system.with_pushes(kept)
    _latest = ((ref(system), kept.tobytes(), s), *[p for p in _latest if p[0]() is not None][:_HELD])
    return s


def own_states(system: System, kept: np.ndarray) -> np.ndarray:
    """Which of a system's states a filter keeps without some of the accelerations, (N,) bool."""
    return np.r_[np.ones(system.a.shape[1], dtype=bool), kept]


def among(some: np.ndarray, own: np.ndarray, *axes: int) -> np.ndarray:
    """Expand arrays of some states to all states, with zeros for the others; own: (N,) bool."""
    if own.all():
        return some
    for axis in axes:
        whole = np.zeros([own.size if a == axis else n for a, n in enumerate(some.shape)])
        whole[(*[slice(None)] * axis, own)] = some
        some = whole
    return some


def start_slopes(system: System, gains: np.ndarray, whiten: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Slopes of the scaled predictions by the initial x of stretches, with the gains held, (N - D, rows, C).

    Each state is changed at the start of every stretch.  gains: (rows, N, C) and whiten: (rows, C, C), as in a pass.
    times: (D,), correlation times of the accelerations, s.
    """
    s, (rows, count, _) = system, system.c.shape
    slopes = np.zeros((s.a.shape[1], rows, count))
    decays = np.exp(-s.durations[:, None] / times)
    angles = s.durations[:, None] * s.turning
    _started(s.a, s.c, s.begin, s.constant, decays, angles, np.ascontiguousarray(gains), whiten, slopes)
    return slopes


# Loops over contiguous numbers are innermost and add to an array: compilers vectorise such loops without reordering
# sums.


@outlined
def _forward(
    a, c, forcing, error, finite, counts, begin, constant, durations, start, origin, variances, deviations,
    times, turns, gains, whiten, innovations, scores, roots, means,
):  # fmt: skip
    """The compiled loop of `run_filter`."""
    rows, count, size = c.shape
    pushed = deviations.shape[0]
    solid = size - pushed
    root, wide = np.zeros((size, size)), np.zeros((size + pushed, size))  # transposed
    onward = np.zeros((size, solid))
    mean, moved, column, gain = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    reflector, share_of = np.zeros(size + pushed), np.zeros(size)
    stretch = -1
    for k in range(rows):
        if begin[k] > 0:
            stretch += 1
            for i in range(size):
                power = 0.0
                for j in range(size):
                    power += root[j, i] * root[j, i]
                    root[j, i] = start[stretch, j, i] if i < solid and j < solid else 0.0
                if begin[k] == 2 and constant[i]:
                    root[i, i] = np.sqrt(power)
                else:
                    mean[i] = origin[stretch, i]
                    if i >= solid:
                        root[i, i] = deviations[i - solid]
        for j in range(size):
            for i in range(size):
                roots[k, j, i] = root[j, i]
        numbers = (c[k], error[k], finite[k], counts[k], variances)
        scores[k] = read_row(root, mean, *numbers, column, gain, gains[k], whiten[k], innovations[k])
        for i in range(size):
            means[k, i] = mean[i]
        if k + 1 < rows and begin[k + 1] != 1:
            pushes = (durations[k], deviations, times, turns)
            turned_over(a[k], onward)
            to_next_row(root, mean, onward, forcing[k], *pushes, wide, moved, reflector, share_of)


@compiled
def turned_over(a, onward):
    """Write the transpose of a row's `a` (N - D, N) into onward, (N, N - D)."""
    solid, size = a.shape
    for n in range(size):
        for i in range(solid):
            onward[n, i] = a[i, n]


@compiled
def read_row(root, mean, c, error, finite, counts, variances, column, gain, gains, whiten, innovations):
    """Log-likelihood of a row's readings, which update root (transposed, N, N) and mean (N,) one by one (Potter).

    gains (N, C), whiten (C, C) and innovations (C,), initially zero, become those of `Pass`.  column, gain: work, (N,).
    """
    count, size = c.shape
    score = 0.0
    for m in range(count):
        if not finite[m]:
            continue
        variance = variances[m] / counts[m]
        spread = variance
        ahead = error[m]
        for j in range(size):
            column[j] = 0.0
            gain[j] = 0.0
        for i in range(size):
            factor = c[m, i]
            if factor != 0.0:
                ahead -= factor * mean[i]
                for j in range(size):
                    column[j] += factor * root[j, i]
        for j in range(size):
            spread += column[j] * column[j]
        spread = max(spread, LEAST_VARIANCE)
        share = 1.0 / (spread * (1.0 + np.sqrt(variance / spread)))
        for j in range(size):
            factor = column[j]
            for i in range(size):
                gain[i] += factor * root[j, i]
        for j in range(size):
            factor = share * column[j]
            for i in range(size):
                root[j, i] -= factor * gain[i]
        for i in range(size):
            gain[i] /= spread
            mean[i] += gain[i] * ahead
        # this reading's innovation in terms of those of the row: T, then the full gain
        whiten[m, m] = 1.0
        for i in range(size):
            factor = c[m, i]
            if factor != 0.0:
                for n in range(m):
                    whiten[m, n] -= factor * gains[i, n]
        for i in range(size):
            factor = gain[i]
            for n in range(m + 1):
                gains[i, n] += factor * whiten[m, n]
        scale = 1.0 / np.sqrt(spread)
        for n in range(m + 1):
            whiten[m, n] *= scale
        innovations[m] = ahead * scale
        score -= 0.5 * (np.log(2.0 * np.pi * spread) + ahead * ahead / spread)
    return score


@compiled
def to_next_row(root, mean, onward, forcing, duration, deviations, times, turns, wide, moved, reflector, share_of):
    """Move root (transposed, N, N) and mean (N,) to the next row, duration s later: [A S | sqrt(Q)], made square.

    onward: (N, N - D), `a` of the row transposed.  wide: work, (N + D, N), as are moved (N,) and those of reflections.
    """
    size, solid = onward.shape
    pushed = size - solid
    for i in range(size):
        moved[i] = -forcing[i] if i < solid else 0.0
    for n in range(size):
        factor = mean[n]
        for i in range(solid):
            moved[i] += factor * onward[n, i]
    for j in range(size):
        for i in range(size):
            wide[j, i] = 0.0
        for n in range(size):
            factor = root[j, n]
            if factor != 0.0:
                for i in range(solid):
                    wide[j, i] += factor * onward[n, i]
    for j in range(size, size + pushed):
        for i in range(size):
            wide[j, i] = 0.0
    for d in range(pushed):
        i = solid + d
        decay = np.exp(-duration / times[d])
        moved[i] = decay * mean[i]
        reflector[d] = decay
        wide[size + d, i] = deviations[d] * np.sqrt(max(1.0 - decay * decay, 0.0))
    for j in range(size):
        for d in range(pushed):
            wide[j, solid + d] = reflector[d] * root[j, solid + d]
    for d in range(pushed):
        if turns[d] != 0.0:
            i = solid + d
            c, s = np.cos(turns[d] * duration), np.sin(turns[d] * duration)
            moved[i], moved[i + 1] = turned(moved[i], moved[i + 1], c, s)
            for j in range(size):
                wide[j, i], wide[j, i + 1] = turned(wide[j, i], wide[j, i + 1], c, s)
    for i in range(size):
        mean[i] = moved[i]
    _made_square(wide, root, reflector, share_of)


@outlined
def _made_square(wide, root, reflector, share_of):
    """Write a lower-triangular root (n, n) of wide wide^T; wide (m, n) and root are transposed.

    The method is Householder reflections.
    """
    width, size = wide.shape
    for i in range(size):
        norm = 0.0
        for j in range(i, width):
            reflector[j] = wide[j, i]
            norm += reflector[j] * reflector[j]
        norm = np.sqrt(norm)
        if norm > NOTHING:
            sign = 1.0 if wide[i, i] >= 0.0 else -1.0
            power = 2.0 / (2.0 * norm * (norm + abs(wide[i, i])))
            reflector[i] += sign * norm
            first, left = i + 1, size - i - 1  # loops start from 0: otherwise they would not be vectorised
            for n in range(left):
                share_of[n] = 0.0
            for j in range(i, width):
                factor = reflector[j]
                if factor != 0.0:
                    for n in range(left):
                        share_of[n] += factor * wide[j, first + n]
            for j in range(i, width):
                factor = power * reflector[j]
                if factor != 0.0:
                    for n in range(left):
                        wide[j, first + n] -= factor * share_of[n]
            wide[i, i] = -sign * norm
    for j in range(size):
        for i in range(size):
            root[j, i] = wide[j, i] if j <= i and abs(wide[j, i]) > NOTHING else 0.0


@outlined
def _started(a, c, begin, constant, decays, angles, gains, whiten, slopes):
    """The compiled loop of `start_slopes`.  decays, angles: (rows, D)."""
    rows, count, size = c.shape
    solid = slopes.shape[0]
    moved, after, change = np.zeros((solid, size)), np.zeros(size), np.zeros(count)
    onward = np.zeros((size, solid))
    for k in range(rows):
        turned_over(a[k], onward)
        for j in range(solid):
            if begin[k] > 0:
                for i in range(size):
                    if begin[k] == 1 or not constant[i]:
                        moved[j, i] = 1.0 if i == j else 0.0
            for m in range(count):
                change[m] = 0.0
                for i in range(size):
                    change[m] += c[k, m, i] * moved[j, i]
            for m in range(count):
                for n in range(m + 1):
                    slopes[j, k, m] += whiten[k, m, n] * change[n]
            for i in range(size):
                after[i] = 0.0
                for m in range(count):
                    moved[j, i] -= gains[k, i, m] * change[m]
            for n in range(size):
                factor = moved[j, n]
                if factor != 0.0:
                    for i in range(solid):
                        after[i] += factor * onward[n, i]
            for i in range(solid):
                moved[j, i] = after[i]
            for d in range(size - solid):
                moved[j, solid + d] *= decays[k, d]
            for d in range(size - solid):
                if angles[k, d] != 0.0:
                    i, cosine, sine = solid + d, np.cos(angles[k, d]), np.sin(angles[k, d])
                    moved[j, i], moved[j, i + 1] = turned(moved[j, i], moved[j, i + 1], cosine, sine)
