"""PBSID: state-space models from a long predictor, in open and in closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auv_gym.record import Record
from identification.linear.hankel import rows_of, triangle
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.state_space_fit import StateSpaceFit
from identification.linear.structure import check_channels
from identification.linear.subspace import (
    States,
    check_excitation,
    check_settings,
    finished,
    identified,
)

_SHORTEST, _LONGEST = 4, 30  # samples, of a horizon that is not given
_LONGER = 2  # times the lags that AIC asks for, so that what is cut off stays below the noise
_ROWS_PER_LAG = 6  # times the channels
_ROWS_NEEDED = 2  # likewise, below which a predictor follows the noise
_DROPPED = 1e-10  # singular value over the largest, below which a direction is rounding


@dataclass(frozen=True)
class Pbsid:
    """State space from a one-step predictor in `horizon` lags of inputs and outputs: unbiased in closed loop too.

    order: of the model, or "auto".  horizon: lags, of the past and of the future; by default twice those that AIC
    chooses.  offset: whether an operating point is estimated.  stable: whether unstable poles are reflected into the
    unit circle; they may be true ones here.  refine: whether the model is the start of a descent to the least
    prediction errors, which also gives intervals.
    Needs a delay in the loop: the input must not see the output of its own sample before it is written down.
    Source: Chiuso 2007, The role of vector autoregressive modeling in predictor-based subspace identification,
    Automatica 43; van der Veen, van Wingerden, Bergamasco, Lovera and Verhaegen 2013, IET Control Theory A. 7.
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    order: int | Literal["auto"] = "auto"
    horizon: int | None = None
    offset: bool = True
    stable: bool = False
    refine: bool = False

    def __post_init__(self) -> None:
        check_channels("Pbsid", self.inputs, self.outputs)
        check_settings("Pbsid", self.order, self.horizon)

    def fit(self, *records: Record) -> StateSpaceFit:
        """Fit over all segments of all records, each with its own start; raises if the data cannot tell the model."""
        series = Series.of(records, self.inputs, self.outputs, "Pbsid")
        scaled = Scaled.of(series, self.offset, "Pbsid")
        factor, horizon = self._factor(series, scaled)
        states = self._states(factor, horizon, scaled)
        largest = min(len(states.weights), (horizon - 1) * scaled.outputs)
        found = identified(states, self.order, largest, scaled, "Pbsid", self.stable)
        return finished(series, scaled, found, states, self.stable, self.refine)

    def _factor(self, series: Series, scaled: Scaled) -> tuple[np.ndarray, int]:
        """R of [1, lags, outputs], the latest lag first, and how many lags it has."""
        q, p = scaled.inputs + scaled.outputs, scaled.outputs
        longest = self.horizon or self._longest(series, q)
        if rows_of(series.y, longest + 1) < _ROWS_NEEDED * (longest * q + 1):
            raise ValueError(
                f"Pbsid needs at least {_ROWS_NEEDED * (longest * q + 1)} samples that have {longest} lags, got "
                f"{rows_of(series.y, longest + 1)}: record longer" + (" or lower horizon." if self.horizon else ".")
            )
        at = np.arange((longest + 1) * q).reshape(longest + 1, q)
        factor = triangle(scaled.joint, longest + 1, np.concatenate([at[longest - 1 :: -1].ravel(), at[-1, -p:]]))
        lags = np.arange(longest * q).reshape(longest, q)
        check_excitation("Pbsid", factor[1:, 1 + lags[:, : q - p].ravel()], series, longest)
        if self.horizon:
            return factor, longest
        chosen = self._chosen(factor, longest, q, p, rows_of(series.y, longest + 1))
        needed = 2 if self.order == "auto" else int(self.order) // p + 2
        horizon = min(max(_LONGER * chosen, _SHORTEST, needed), longest)
        ends = np.r_[np.arange(1 + horizon * q), np.arange(1 + longest * q, 1 + longest * q + p)]
        return factor[:, ends], horizon

    def _longest(self, series: Series, q: int) -> int:
        rows = rows_of(series.y, _SHORTEST + 1)
        return max(min(_LONGEST, (rows - _LONGEST) // (_ROWS_PER_LAG * q)), _SHORTEST)

    def _chosen(self, factor: np.ndarray, longest: int, q: int, p: int, rows: int) -> int:
        """The number of lags of least AIC; the factor is that of every smaller number too."""
        best, least = 1, np.inf
        for lags in range(1, longest + 1):
            left = factor[1 + lags * q :, -p:]
            errors = left.T @ left / rows + np.finfo(float).eps * np.eye(p)
            size = np.linalg.slogdet(errors)[1] + 2.0 * lags * q * p / rows
            if size < least:
                best, least = lags, float(size)
        return best

    def _states(self, factor: np.ndarray, horizon: int, scaled: Scaled) -> States:
        """States from the predictor's coefficients, of which those of an earlier sample are the same, one lag on."""
        q, p = scaled.inputs + scaled.outputs, scaled.outputs
        lags = factor[1 : 1 + horizon * q, 1 : 1 + horizon * q]
        predictor = np.linalg.lstsq(lags, factor[1 : 1 + horizon * q, -p:], rcond=_DROPPED)[0].T
        left = factor[1 + horizon * q :, -p:]
        errors = left.T @ left / np.sum(factor[1:, -p:] ** 2, axis=0) + _DROPPED * np.eye(p)
        apart = np.linalg.inv(np.linalg.cholesky(errors))  # in units of the errors no output outweighs another
        future = np.zeros((horizon, p, horizon * q))
        for ahead in range(horizon):
            future[ahead, :, : (horizon - ahead) * q] = apart @ predictor[:, ahead * q :]
        future = future.reshape(horizon * p, horizon * q)
        left, values, _ = np.linalg.svd(future @ lags.T, full_matrices=False)
        kept = values > _DROPPED * values[0]
        weights = (left[:, kept] / values[kept]).T @ future
        oldest_first = weights.reshape(len(weights), horizon, q)[:, ::-1].reshape(len(weights), -1)
        return States(oldest_first, values, horizon)
