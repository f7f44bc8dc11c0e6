"""Stability selection: the regressors that explain a residual in most halves of the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from identification.deciding import ALIKE, LEVEL, SEEN

_MOST = 3  # most regressors chosen in a half
_DRAWS = 50  # number of pairs of halves


@dataclass(frozen=True, eq=False)
class Selection:
    """The choices of forward selection in halves of the data, and the regression on all of the data.

    frequency: (P,), share of the halves that chose the regressor or one `ALIKE`.  evidence: (P,), gain in twice the
    log-likelihood of each alone.  estimate: (P,), coefficient of each alone.  cosine: (P, P), beside the nuisances.
    """

    frequency: np.ndarray
    evidence: np.ndarray
    estimate: np.ndarray
    cosine: np.ndarray


def select(
    columns: np.ndarray,
    nuisance: np.ndarray,
    residual: np.ndarray,
    blocks: np.ndarray,
    rng: np.random.Generator,
) -> Selection:
    """Stability selection by forward selection in pairs of complementary halves of blocks.

    columns: (P, N), nuisance: (K, N), always in the regression; residual: (N,), of unit variance apart from missing
    terms; blocks: (N,), the number of each value's block.
    Source: Meinshausen and Buhlmann 2010; complementary pairs by Shah and Samworth 2013.
    """
    count = len(columns)
    every = np.concatenate([nuisance, columns, residual[None]])
    grams = np.array([every[:, blocks == b] @ every[:, blocks == b].T for b in np.unique(blocks)])
    sizes = np.array([(blocks == b).sum() for b in np.unique(blocks)])
    whole = _swept(grams.sum(axis=0), len(nuisance))
    power, cross = np.diag(whole)[:count], whole[:count, count]
    seen = power > SEEN * np.maximum((columns**2).sum(axis=1), 1e-300)
    safe = np.where(seen, power, np.inf)
    root = np.sqrt(np.where(seen, power, 1.0))
    cosine = np.where(np.outer(seen, seen), whole[:count, :count] / np.outer(root, root), np.eye(count))
    variance = whole[count, count] / residual.size
    bar = float(stats.chi2.isf(LEVEL / max(count, 1), 1))
    chosen = np.zeros((2 * _DRAWS, count), dtype=bool)
    for draw in range(_DRAWS):
        order = rng.permutation(len(grams))
        for side, half in enumerate((order[: len(order) // 2], order[len(order) // 2 :])):
            gram = _swept(grams[half].sum(axis=0), len(nuisance))
            chosen[2 * draw + side, _forward(gram, seen, int(sizes[half].sum()), bar)] = True
    near = np.abs(cosine) >= ALIKE
    frequency = (chosen @ near.astype(int) > 0).mean(axis=0) * seen
    return Selection(frequency, cross**2 / safe / variance, cross / safe, cosine)


def _swept(gram: np.ndarray, count: int) -> np.ndarray:
    """The Gram matrix of the other rows with the first `count` rows projected out."""
    if count == 0:
        return gram
    inner, mixed = gram[:count, :count], gram[:count, count:]
    return gram[count:, count:] - mixed.T @ np.linalg.lstsq(inner, mixed, rcond=1e-10)[0]


def _forward(gram: np.ndarray, seen: np.ndarray, size: int, bar: float) -> list[int]:
    """Regressors in the order of the greatest gain, up to `_MOST`, while the gain in evidence is above the bar.

    gram: (P + 1, P + 1), the last row is the residual's.
    """
    gram, count = gram.copy(), len(gram) - 1
    first = np.diag(gram)[:count].copy()
    found: list[int] = []
    for _ in range(_MOST):
        power = np.diag(gram)[:count]
        open_ = seen & (power > SEEN * first)
        gains = np.where(open_, gram[:count, count] ** 2 / np.where(open_, power, 1.0), 0.0)
        best = int(np.argmax(gains))
        left = max(gram[count, count] - gains[best], 1e-300)
        if size * np.log1p(gains[best] / left) < bar:
            break
        found.append(best)
        gram -= np.outer(gram[:, best], gram[best]) / gram[best, best]
    return found
