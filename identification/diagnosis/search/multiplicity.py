"""The significance level of each of many correlated tests, which count as fewer than they are."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

_DRAWS = 4000  # draws of all tests under the null hypothesis: at a level of 0.25 %, ten exceed the quantile
_NUMBERS = 400  # length to which long signatures are reduced: correlations are off by a twentieth


def summed_up(signatures: np.ndarray) -> np.ndarray:
    """Signatures, (P, n), reduced to fewer numbers each, (P, m), with nearly the same inner products.

    The numbers are sums with random signs over random groups (Charikar, Chen and Farach-Colton 2004, Theoretical
    Computer Science 312).
    """
    size = signatures.shape[1]
    if size <= _NUMBERS:
        return signatures
    rng = np.random.default_rng(0)
    signs, order = rng.choice([-1.0, 1.0], size), rng.permutation(size)
    edges = np.linspace(0, size, _NUMBERS, endpoint=False).astype(int)
    return np.add.reduceat((signatures * signs)[:, order], edges, axis=1)


def level_of_each(signatures: np.ndarray, level: float) -> float:
    """The level of each of some tests at which the probability of any false alarm is `level`.

    signatures: (P, m); test k compares the square of its projection of noise, over its variance, with chi-square of one
    degree of freedom.  The level comes from the largest of these in draws of noise (Westfall and Young 1993,
    Resampling-Based Multiple Testing, ch. 2); it is never below Bonferroni's.
    """
    if level >= 1.0 or not len(signatures):
        return level
    units = signatures / np.maximum(np.linalg.norm(signatures, axis=1), 1e-300)[:, None]
    noise = np.random.default_rng(0).standard_normal((units.shape[1], _DRAWS))
    largest = np.abs(units @ noise).max(axis=0)
    return max(float(chi2.sf(np.quantile(largest, 1.0 - level) ** 2, 1)), level / len(signatures))
