"""Prediction errors of polynomial models with their derivatives and normal equations, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from auv_gym.compiled import outlined

SPAN = 512  # rows of slopes at a time: they stay in a processor's first cache
INTERCEPT = 3  # code of an intercept, after those of terms
_SQUARINGS = 24  # of a matrix; a root of 1 - 1e-6 has vanished by then
_GONE = 1e-40  # below this, the effect of a start counts as zero; computing with denormal numbers is slow


class Problem(NamedTuple):
    """The errors of some outputs' equations over segments, laid out for compiled code.

    y, u: all segments below one another.  begins, at: (S + 1,), where each begins in y and in the errors; the errors of
    each segment start with nc rows of starts.  first: number of rows used only as lags.  described: (4, terms), kind (0
    a, 1 b, 2 c, 3 an intercept), row in the block, number of the channel, lag.  late: (k, 4), for each coefficient of
    lagged errors its lag, row, number of the error and place among the terms.  numbers: of the outputs.  terms = base +
    mix @ parameters.
    """

    y: np.ndarray
    u: np.ndarray
    begins: np.ndarray
    at: np.ndarray
    first: int
    described: np.ndarray
    late: np.ndarray
    numbers: np.ndarray
    base: np.ndarray
    mix: np.ndarray

    @property
    def rows(self) -> int:
        """Number of errors of each output, including the starts."""
        return int(self.at[-1])


@outlined
def fill_c(values, late, c):
    """C from the values of the terms, (powers, r, r) with the unit matrix first."""
    c[:] = 0.0
    for i in range(c.shape[1]):
        c[0, i, i] = 1.0
    for k in range(late.shape[0]):
        c[late[k, 0], late[k, 1], late[k, 2]] = values[late[k, 3]]


def largest_root(c: np.ndarray) -> float:
    """The magnitude of the largest root of det(z^n + c_1 z^(n-1) + ...), 0 if there is none; c: (n + 1, r, r)."""
    powers, r = len(c) - 1, c.shape[1]
    if powers == 0:
        return 0.0
    companion = np.eye(powers * r, k=-r)
    companion[:r] = -np.concatenate(list(c[1:]), axis=1)
    return float(np.abs(np.linalg.eigvals(companion)).max())


@outlined
def is_stable(c):
    """Whether all roots of a polynomial matrix with a leading unit matrix lie inside the unit circle."""
    powers, r = c.shape[0] - 1, c.shape[1]
    if r > 1:
        return _decays(c)
    # for a scalar polynomial, by the reflection coefficients of Schur and Cohn
    now, before = np.empty(powers + 1), np.empty(powers + 1)
    for k in range(powers + 1):
        now[k] = c[k, 0, 0]
    for n in range(powers, 0, -1):
        reflection = now[n]
        if not abs(reflection) < 1.0:
            return False
        for k in range(n + 1):
            before[k] = now[k]
        for k in range(n):
            now[k] = (before[k] - reflection * before[n - k]) / (1.0 - reflection * reflection)
    return True


@outlined
def _decays(c):
    """Whether powers of the companion matrix converge to zero, by repeated squaring."""
    r, size = c.shape[1], (c.shape[0] - 1) * c.shape[1]
    now, squared = np.zeros((size, size)), np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            now[i, j] = -c[1 + j // r, i, j % r] if i < r else (1.0 if j == i - r else 0.0)
    for _ in range(_SQUARINGS):
        largest = 0.0
        for i in range(size):
            for j in range(size):
                squared[i, j] = 0.0
                for k in range(size):
                    squared[i, j] += now[i, k] * now[k, j]
                largest = max(largest, abs(squared[i, j]))
        if not largest < 1e100:
            return False
        if largest < 1e-3:
            return True
        for i in range(size):
            for j in range(size):
                now[i, j] = squared[i, j]
    return False


@outlined
def fill_errors(problem, values, c, starts, e):
    """Write the one-step errors for these term values into e, (rows, r); starts: (S, nc r)."""
    y, u, first, described, numbers = problem.y, problem.u, problem.first, problem.described, problem.numbers
    r, nc = e.shape[1], c.shape[0] - 1
    for s in range(problem.begins.size - 1):
        begin, stop, at = problem.begins[s] + first, problem.begins[s + 1], problem.at[s] + nc
        for row in range(nc):
            for i in range(r):
                e[at - nc + row, i] = starts[s, row * r + i]
        for i in range(r):
            for t in range(begin, stop):
                e[at + t - begin, i] = y[t, numbers[i]]
        for q in range(values.size):
            kind, i, column, lag, value = described[0, q], described[1, q], described[2, q], described[3, q], values[q]
            if kind == 0:
                for t in range(begin, stop):
                    e[at + t - begin, i] += value * y[t - lag, column]
            elif kind == 1:
                for t in range(begin, stop):
                    e[at + t - begin, i] -= value * u[t - lag, column]
            elif kind == 3:
                for t in range(begin, stop):
                    e[at + t - begin, i] -= value
        for row in range(at, problem.at[s + 1]):
            for k in range(1, nc + 1):
                for i in range(r):
                    for j in range(r):
                        e[row, i] -= c[k, i, j] * e[row - k, j]


@outlined
def fill_slopes(problem, s, c, e, begin, slopes):
    """Derivatives of the errors of segment s, (rows, r), from prediction `begin` on, by terms and then by starts.

    slopes: (nc + count, r, terms + nc r + 1); the first nc rows, those before `begin`, are given; the last column is
    for the errors.
    """
    y, u, described, late = problem.y, problem.u, problem.described, problem.late
    nc, r, terms = c.shape[0] - 1, c.shape[1], described.shape[1]
    width, count = terms + nc * r, slopes.shape[0] - nc
    slopes[nc:] = 0.0
    for q in range(terms):
        kind, i, column = described[0, q], described[1, q], described[2, q]
        at = problem.begins[s] + problem.first + begin - described[3, q]
        if kind == 0:
            for t in range(count):
                slopes[nc + t, i, q] = y[at + t, column]
        elif kind == 1:
            for t in range(count):
                slopes[nc + t, i, q] = -u[at + t, column]
        elif kind == 3:
            for t in range(count):
                slopes[nc + t, i, q] = -1.0
    for k in range(late.shape[0]):
        at = nc + begin - late[k, 0]
        for t in range(count):
            slopes[nc + t, late[k, 1], late[k, 3]] -= e[at + t, late[k, 2]]
    for line in range(nc, nc + count):
        for k in range(1, nc + 1):
            for i in range(r):
                for j in range(r):
                    factor = c[k, i, j]
                    if factor != 0.0:
                        for q in range(width):
                            slopes[line, i, q] -= factor * slopes[line - k, j, q]
        for i in range(r):
            slopes[line, i, width] = e[begin + line, i]
            for q in range(terms, width):
                if abs(slopes[line, i, q]) < _GONE:
                    slopes[line, i, q] = 0.0


@outlined
def half_squares(e, weight):
    """Half the weighted sum of squares of the errors; weight: (r, r)."""
    total = 0.0
    for row in range(e.shape[0]):
        for i in range(e.shape[1]):
            part = 0.0
            for j in range(e.shape[1]):
                part += e[row, j] * weight[j, i]
            total += part * part
    return 0.5 * total if np.isfinite(total) else np.inf


@outlined
def normal_equations(problem, c, e, weight, chain, gradient, matrix, start_gradient, across, start_matrix):
    """Normal equations of the weighted errors for parameters z, with terms changing as chain z, and for the starts.

    gradient: (P,).  matrix: (P, P).  start_gradient: (S, q).  across: (S, P, q).  start_matrix: (S, q, q).
    """
    nc, r, terms, size = c.shape[0] - 1, c.shape[1], chain.shape[0], chain.shape[1]
    q = nc * r
    width = terms + q
    buffer, weighted = np.zeros((nc + SPAN, r, width + 1)), np.empty((SPAN * r if r > 1 else 0, width + 1))
    flat = buffer.reshape(-1, width + 1)
    products, halfway = np.empty((width + 1, width + 1)), np.empty((size, width))
    gradient[:] = 0.0
    matrix[:] = 0.0
    for s in range(problem.begins.size - 1):
        begins, stops = problem.at[s], problem.at[s + 1]
        products[:] = 0.0
        buffer[:nc] = 0.0
        for row in range(nc):  # each start is an error that depends only on itself
            for i in range(r):
                buffer[row, i, terms + row * r + i] = 1.0
                buffer[row, i, width] = e[begins + row, i]
        begin, count, line = 0, nc, 0  # which rows of the buffer; the first ones are those of the starts
        while True:
            if r == 1:
                part = flat[line : line + count]
            else:
                _weigh(buffer[line : line + count], weight, weighted)
                part = weighted[: count * r]
            products += np.dot(part.T, part)
            if line:
                for row in range(nc):
                    for i in range(r):
                        for k in range(width):
                            buffer[row, i, k] = buffer[count + row, i, k]
            begin, line = begin + count, nc
            count = min(SPAN, stops - begins - begin)
            if count <= 0:
                break
            fill_slopes(problem, s, c, e[begins:stops], begin - nc, buffer[: nc + count])
        if r == 1:  # for one output, scale sums instead of columns
            products *= weight[0, 0] * weight[0, 0]
        for z in range(size):
            for k in range(width):
                halfway[z, k] = 0.0
                for j in range(terms):
                    halfway[z, k] += chain[j, z] * products[j, k]
            for k in range(terms):
                gradient[z] += chain[k, z] * products[k, width]
                for other in range(size):
                    matrix[z, other] += halfway[z, k] * chain[k, other]
            for k in range(q):
                across[s, z, k] = halfway[z, terms + k]
        for k in range(q):
            start_gradient[s, k] = products[terms + k, width]
            for j in range(q):
                start_matrix[s, k, j] = products[terms + k, terms + j]


@outlined
def _weigh(slopes, weight, weighted):
    """The slopes of errors times weight, row by row below one another."""
    r = weight.shape[0]
    for row in range(slopes.shape[0]):
        for i in range(r):
            for k in range(slopes.shape[2]):
                weighted[row * r + i, k] = 0.0
            for j in range(r):
                for k in range(slopes.shape[2]):
                    weighted[row * r + i, k] += weight[j, i] * slopes[row, j, k]
