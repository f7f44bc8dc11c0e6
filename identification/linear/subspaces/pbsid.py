"""PBSID: state-space models from a long predictor, in open or closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auv_gym.records.record import Record
from identification.linear.polynomials.structure import check_channels
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.hankel import rows_of
from identification.linear.subspaces.long_predictor import LongPredictor, most_predictor_lags
from identification.linear.subspaces.state_space_fit import StateSpaceFit
from identification.linear.subspaces.subspace import (
    States,
    check_excitation,
    check_settings,
    finished,
    least_horizon,
)

_ROWS_NEEDED = 2  # times the number of coefficients; with fewer rows, a predictor would follow the noise
_DROPPED = 1e-10  # relative singular value below which a direction is rounding


@dataclass(frozen=True)
class Pbsid:
    """State space from a one-step predictor in `horizon` lags of inputs and outputs; unbiased in closed loop, too.

    horizon: lags of the past and of the future; by default twice those that AIC chooses.  order, integrators, offset,
    stable, refine: see `subspace.Settings`; unstable poles may be real here.
    It needs a delay in the loop: the input must not depend on the output of the same sample.
    Source: Chiuso 2007, The role of vector autoregressive modeling in predictor-based subspace identification,
    Automatica 43; van der Veen, van Wingerden, Bergamasco, Lovera and Verhaegen 2013, IET Control Theory A. 7.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Pbsid, closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = Pbsid(["rudder_rad"], ["heading_rad"]).fit(log)
        >>> fit.model.poles().round(2)
        array([1.  , 0.81])
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    order: int | Literal["auto"] = "auto"
    horizon: int | None = None
    integrators: int | Literal["auto"] = "auto"
    offset: bool | Literal["auto"] = "auto"
    stable: bool = False
    refine: bool = False

    def __post_init__(self) -> None:
        check_channels("Pbsid", self.inputs, self.outputs)
        check_settings(self)

    def fit(self, *records: Record) -> StateSpaceFit:
        """Fit over all segments of all records, each with its own start; raises if the data do not determine it."""
        series = Series.of(records, self.inputs, self.outputs, "Pbsid")
        scaled = Scaled.of(series, self.offset is not False, "Pbsid")
        predictor = self._predictor(series, scaled)
        states = self._states(predictor.factor, predictor.lags, scaled)
        return finished(self, series, scaled, states, predictor)

    def _predictor(self, series: Series, scaled: Scaled) -> LongPredictor:
        """The predictor with the requested or chosen lags; raises if the record does not determine it."""
        q, p = scaled.inputs + scaled.outputs, scaled.outputs
        longest = self.horizon or most_predictor_lags(series, q)
        if rows_of(series.y, longest + 1) < _ROWS_NEEDED * (longest * q + 1):
            raise ValueError(
                f"Pbsid needs at least {_ROWS_NEEDED * (longest * q + 1)} samples that have {longest} lags, got "
                f"{rows_of(series.y, longest + 1)}: record longer" + (" or lower horizon." if self.horizon else ".")
            )
        found = LongPredictor.of(scaled, longest)
        lags = np.arange(longest * q).reshape(longest, q)
        check_excitation("Pbsid", found.factor[1:, 1 + lags[:, : q - p].ravel()], series, longest)
        return found if self.horizon else found.shortened(found.horizon(least_horizon(self.order, p)))

    def _states(self, factor: np.ndarray, horizon: int, scaled: Scaled) -> States:
        """States from the predictor's coefficients; those for an earlier sample are the same, shifted by one lag."""
        q, p = scaled.inputs + scaled.outputs, scaled.outputs
        lags = factor[1 : 1 + horizon * q, 1 : 1 + horizon * q]
        predictor = np.linalg.lstsq(lags, factor[1 : 1 + horizon * q, -p:], rcond=_DROPPED)[0].T
        left = factor[1 + horizon * q :, -p:]
        errors = left.T @ left / np.sum(factor[1:, -p:] ** 2, axis=0) + _DROPPED * np.eye(p)
        apart = np.linalg.inv(np.linalg.cholesky(errors))  # in units of the errors, so that no output outweighs another
        future = np.zeros((horizon, p, horizon * q))
        for ahead in range(horizon):
            future[ahead, :, : (horizon - ahead) * q] = apart @ predictor[:, ahead * q :]
        future = future.reshape(horizon * p, horizon * q)
        left, values, _ = np.linalg.svd(future @ lags.T, full_matrices=False)
        kept = values > _DROPPED * values[0]
        weights = (left[:, kept] / values[kept]).T @ future
        oldest_first = weights.reshape(len(weights), horizon, q)[:, ::-1].reshape(len(weights), -1)
        return States(oldest_first, values, horizon)
