"""The best two times between which, or outside of which, an effect acts: all pairs at once, by linear combination."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from identification.deciding import SEEN

BETWEEN, OUTSIDE = "between", "outside"


def spans_of(edges: Sequence[int]) -> list[tuple[int, int]]:
    """All pairs of some rows, in order."""
    return list(combinations(edges, 2))


def best_spans(signatures: np.ndarray, left: np.ndarray, form: str, one_sided: bool) -> tuple[float, tuple[int, int]]:
    """The pair of times between or outside of which an effect promises the largest gain, and that gain.

    signatures: (1 + E, paths, n), of the effect throughout and from each of E times on, orthogonal to what is fitted;
    an effect between two times is the difference of two of them.  left: (n,), the remaining errors.  one_sided: whether
    the effect works in one direction only.  Returns twice the gain in log-likelihood, and the numbers of the times,
    from 1.
    """
    count, paths, _ = signatures.shape
    flat = signatures.reshape(count * paths, -1)
    gram, told = (flat @ flat.T).reshape(count, paths, count, paths), (flat @ left).reshape(count, paths)
    pairs = spans_of(range(1, count))
    first, second = np.array(pairs).T
    shares = np.zeros((len(pairs), count))
    side = 1.0 if form == BETWEEN else -1.0
    shares[np.arange(len(pairs)), first], shares[np.arange(len(pairs)), second] = side, -side
    shares[:, 0] = float(form == OUTSIDE)
    own, moved = np.einsum("si,ipjq,sj->spq", shares, gram, shares, optimize=True), shares @ told
    estimate = np.einsum("spq,sq->sp", np.linalg.pinv(own, rcond=1e-8, hermitian=True), moved)
    evidence = np.einsum("sp,sp->s", estimate, moved)
    size = np.einsum("spp->s", own)
    evidence[size <= SEEN * max(float(np.einsum("ipip->i", gram).max()), 1e-30)] = 0.0
    if one_sided:
        evidence[(estimate < 0.0).any(axis=1)] = 0.0
    best = int(np.argmax(evidence))
    return float(evidence[best]), pairs[best]
