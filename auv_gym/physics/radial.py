"""Sums of Gaussian radial basis functions around many centres, the form of a kernel machine.

    f(x) = sum_j c_j exp(-|(x - s_j) rate|^2)

The centres are stored side by side in blocks of LANES, so that a processor works on several at a time, and the
exponential is written out for that: 2^v is a whole power of two, put into the exponent's bits, times a polynomial of
the rest.  |x - s|^2 is computed as x^2 - 2 x s + s^2, with an error of some 1e-15 (x^2 + s^2) in the exponent.
"""

from __future__ import annotations

from math import factorial, log, sqrt

import numpy as np

from auv_gym.compiled import compiled

LANES = 128
BITS = sqrt(1.0 / log(2.0))  # scale of the inputs, so that powers are of two
_ROUNDS = 1.5 * 2.0**52  # adding this to a number leaves the rounded number in the last bits
_LEAST = -1000.0  # 2^v is zero below, and its bits are those of a normal number
# Taylor, to 1e-16 of 2^f where |f| <= 1/2
_C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9, _C10, _C11, _C12 = (log(2.0) ** k / factorial(k) for k in range(1, 13))


def radial_blocks(support: np.ndarray, rate: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Centres and coefficients as `radial_sums` takes them, shape (blocks, d + 1 + m, LANES).

    support: (n, d), in the units of x.  rate: (d,), 1 / (scale sigma).  coefficients: (n, m).
    """
    scaled = support * (rate * BITS)
    rows = np.column_stack([2.0 * scaled, (scaled**2).sum(axis=1), coefficients])
    count = -(-len(rows) // LANES)
    blocks = np.zeros((count * LANES, rows.shape[1]))
    blocks[: len(rows)] = rows
    blocks[len(rows) :, scaled.shape[1]] = np.inf  # empty slot: infinitely far
    return np.ascontiguousarray(blocks.reshape(count, LANES, -1).transpose(0, 2, 1))


@compiled
def fill_gaussian_exponents(x, block, power):
    """Write -|(x - s) rate|^2 / ln 2 for the centres of a block into power (LANES,)."""
    d, n = x.shape[0], power.shape[0]
    own, square = block[d], 0.0
    for i in range(d):
        square += x[i] * x[i]
    for j in range(n):
        power[j] = -square - own[j]
    for i in range(d):
        value, centre = x[i], block[i]
        for j in range(n):
            power[j] += value * centre[j]


@compiled
def radial_sums(x, blocks, room, out):
    """Write f(x) into out (m,).

    x: (d,), times rate BITS.  blocks: see `radial_blocks`.  room: scratch, shape (2 + m, LANES).
    """
    d, m, n = x.shape[0], out.shape[0], blocks.shape[2]
    power, bell = room[0], room[1]
    power_bits, bell_bits = power.view(np.int64), bell.view(np.int64)
    for o in range(m):
        total = room[2 + o]
        for j in range(n):
            total[j] = 0.0
    for b in range(blocks.shape[0]):
        block = blocks[b]
        fill_gaussian_exponents(x, block, power)
        for j in range(n):
            v = power[j] if power[j] > _LEAST else _LEAST
            rounded = v + _ROUNDS
            f = v - (rounded - _ROUNDS)
            f2 = f * f
            f4 = f2 * f2
            bell[j] = ((1.0 + _C1 * f) + f2 * (_C2 + _C3 * f)) + f4 * (
                ((_C4 + _C5 * f) + f2 * (_C6 + _C7 * f)) + f4 * (((_C8 + _C9 * f) + f2 * (_C10 + _C11 * f)) + f4 * _C12)
            )
            power[j] = rounded
        for j in range(n):
            bell_bits[j] += power_bits[j] << 52
        for o in range(m):
            total, coefficient = room[2 + o], block[d + 1 + o]
            for j in range(n):
                total[j] += coefficient[j] * bell[j]
    for o in range(m):
        total, half = room[2 + o], n // 2
        while half > 4:  # pairwise halving: a single long sum would be a chain of dependent additions
            for j in range(half):
                total[j] += total[half + j]
            half //= 2
        value = 0.0
        for j in range(2 * half):
            value += total[j]
        out[o] = value


@compiled
def radial_distance(x, blocks, room):
    """The distance |(x - s) rate| to the nearest centre; arguments as in `radial_sums`."""
    power, most = room[0], room[1]
    for j in range(most.shape[0]):
        most[j] = -np.inf
    for b in range(blocks.shape[0]):
        fill_gaussian_exponents(x, blocks[b], power)
        for j in range(most.shape[0]):
            most[j] = power[j] if power[j] > most[j] else most[j]
    half = most.shape[0] // 2
    while half > 0:
        for j in range(half):
            most[j] = most[half + j] if most[half + j] > most[j] else most[j]
        half //= 2
    nearest = most[0]
    return sqrt(max(-nearest, 0.0)) / BITS


@compiled
def radial_distances(x, blocks, out):
    """Write `radial_distance` of every row of x (n, d) into out (n,)."""
    room = np.empty((2, blocks.shape[2]))
    for i in range(x.shape[0]):
        out[i] = radial_distance(x[i], blocks, room)
