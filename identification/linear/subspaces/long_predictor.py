"""A long predictor, and what it shows before states are chosen: the length of past needed, and poles at 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.hankel import rows_of, triangle
from identification.linear.triangles import triangle_of

SHORTEST, LONGEST = 4, 30  # samples, if no horizon is given
_LONGER = 2  # times the lags that AIC chooses, so that the truncation error stays below the noise
_ROWS_PER_LAG = 6  # rows per lag, times the channels
_NOISELESS = 1e-9  # ratio of the error to an output's spread below which it is rounding


def most_predictor_lags(series: Series, channels: int) -> int:
    """The most lags of a predictor that are tried for this record."""
    rows = rows_of(series.y, SHORTEST + 1)
    return max(min(LONGEST, (rows - LONGEST) // (_ROWS_PER_LAG * channels)), SHORTEST)


@dataclass(frozen=True, eq=False)
class LongPredictor:
    """A regression of the outputs on a number of lags of inputs and outputs, and thereby on all fewer lags.

    factor: R of [1, lags, outputs], the latest lag first.  rows: of the regression.
    """

    factor: np.ndarray
    lags: int
    rows: int
    scaled: Scaled

    @classmethod
    def of(cls, scaled: Scaled, lags: int) -> LongPredictor:
        """The predictor of this length; the segments must have windows of one more sample."""
        q, p = scaled.inputs + scaled.outputs, scaled.outputs
        at = np.arange((lags + 1) * q).reshape(lags + 1, q)
        columns = np.concatenate([at[lags - 1 :: -1].ravel(), at[-1, -p:]])
        return cls(triangle(scaled.joint, lags + 1, columns), lags, rows_of(scaled.y, lags + 1), scaled)

    def shortened(self, lags: int) -> LongPredictor:
        """The predictor with fewer lags over the same rows."""
        q, p = self.scaled.inputs + self.scaled.outputs, self.scaled.outputs
        kept = np.r_[np.arange(1 + lags * q), np.arange(1 + self.lags * q, 1 + self.lags * q + p)]
        return LongPredictor(self.factor[:, kept], lags, self.rows, self.scaled)

    def horizon(self, least: int) -> int:
        """Twice the lags that AIC chooses, at least `least` and at most all; AIC is corrected for few samples.

        Source: Bauer 2005, Estimating linear dynamical systems using subspace methods, Econometric Theory 21, sec. 5;
        Hurvich and Tsai 1993, A corrected Akaike information criterion for vector autoregressive model selection.
        """
        q, p = self.scaled.inputs + self.scaled.outputs, self.scaled.outputs
        best, smallest = 1, np.inf
        for lags in range(1, self.lags + 1):
            free = self.rows - lags * q - p - 1
            if free < 1:
                break
            left = self.factor[1 + lags * q :, -p:]
            errors = left.T @ left / self.rows + np.finfo(float).eps * np.eye(p)
            size = np.linalg.slogdet(errors)[1] + p * (self.rows + lags * q) / free
            if size < smallest:
                best, smallest = lags, float(size)
        return min(max(_LONGER * best, SHORTEST, least), self.lags)

    @property
    def integrators(self) -> int:
        """Number of poles at exactly 1, at most one per output, chosen by BIC; none in a record without noise.

        With r such poles, the changes of the outputs depend on p - r combinations of their levels, beside all lags of
        changes and inputs: the rank of a regression, whose likelihood follows from canonical correlations.
        Source: Johansen 1991, Econometrica 59; Cheng and Phillips 2009, Semiparametric cointegrating rank selection,
        Econometrics Journal 12, for BIC.
        """
        m, p = self.scaled.inputs, self.scaled.outputs
        q = m + p
        columns = self.factor[:, 1 : 1 + self.lags * q].reshape(-1, self.lags, q)
        inputs, levels = columns[:, :, :m], columns[:, :, m:]
        one = self.factor[:, : 1 if self.scaled.offset else 0]
        short = np.concatenate([one, *(part.reshape(len(part), -1) for part in (inputs, -np.diff(levels, axis=1)))], 1)
        changes = self.factor[:, -p:] - levels[:, 0]
        first = short.shape[1]
        left = triangle_of([np.concatenate([short, levels[:, 0], changes], axis=1)])[first:, first:]
        level, change = left[:, :p], left[:, p:]
        if np.linalg.norm(change, axis=0).min() <= _NOISELESS * np.sqrt(self.rows):
            return 0
        across = np.linalg.qr(level)[0].T @ np.linalg.qr(change)[0]
        together = np.minimum(np.linalg.svd(across, compute_uv=False), 1.0 - np.finfo(float).eps)
        gained = np.concatenate([[0.0], np.cumsum(np.log1p(-(together**2)))])
        ranks = np.arange(p + 1)
        sizes = gained + ranks * (2 * p - ranks) * np.log(self.rows) / self.rows
        return p - int(np.argmin(sizes))
