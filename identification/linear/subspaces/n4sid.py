"""N4SID: state-space models by projecting the future onto the past."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auv_gym.records.record import Record
from identification.linear.polynomials.structure import check_channels
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.hankel import rows_of, triangle
from identification.linear.subspaces.long_predictor import LONGEST, LongPredictor
from identification.linear.subspaces.state_space_fit import StateSpaceFit
from identification.linear.subspaces.subspace import (
    ROWS_PER_COLUMN,
    States,
    check_excitation,
    check_settings,
    finished,
    least_horizon,
)

_DROPPED = 1e-10  # relative singular value below which a direction is rounding
WEIGHTS = ("cva", "n4sid", "moesp")


@dataclass(frozen=True)
class N4sid:
    """State space by the projection of future outputs onto the past, orthogonal to future inputs.

    horizon: samples of the past and of the future, by default twice the lags that AIC chooses, or as many as the record
    allows.  weight: of the future, "cva" (canonical variates), "n4sid" or "moesp".  order, integrators, offset, stable,
    refine: see `subspace.Settings`.
    It is biased in closed loop, because the inputs depend on past noise; see Pbsid.
    Source: Van Overschee and De Moor 1996, Subspace Identification for Linear Systems, ch. 4.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import N4sid, closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = N4sid(["rudder_rad"], ["heading_rad"]).fit(log)
        >>> fit.model.poles().round(2)
        array([1.  , 0.82])
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    order: int | Literal["auto"] = "auto"
    horizon: int | None = None
    weight: Literal["cva", "n4sid", "moesp"] = "cva"
    integrators: int | Literal["auto"] = "auto"
    offset: bool | Literal["auto"] = "auto"
    stable: bool = False
    refine: bool = False

    def __post_init__(self) -> None:
        check_channels("N4sid", self.inputs, self.outputs)
        check_settings(self)
        if self.weight not in WEIGHTS:
            raise ValueError(f"N4sid needs a weight of {', '.join(WEIGHTS)}, got {self.weight!r}.")

    def fit(self, *records: Record) -> StateSpaceFit:
        """Fit over all segments of all records, each with its own start; raises if the data do not determine it."""
        series = Series.of(records, self.inputs, self.outputs, "N4sid")
        scaled = Scaled.of(series, self.offset is not False, "N4sid")
        longest = self._longest(series, scaled)
        predictor = LongPredictor.of(scaled, longest)
        horizon = self.horizon or predictor.horizon(least_horizon(self.order, scaled.outputs))
        states = self._states(series, scaled, horizon)
        return finished(self, series, scaled, states, predictor.shortened(horizon))

    def _longest(self, series: Series, scaled: Scaled) -> int:
        """The requested horizon, or the longest to choose from; raises if the record is too short for it."""
        q = scaled.inputs + scaled.outputs

        def needed(horizon: int) -> int:
            return ROWS_PER_COLUMN * (2 * horizon * q + 1)

        def given(horizon: int) -> int:
            return rows_of(series.y, 2 * horizon)

        least = least_horizon(self.order, scaled.outputs)
        asked = self.horizon or least
        if given(asked) < needed(asked):
            lower = "horizon" if self.horizon else "order"
            raise ValueError(
                f"N4sid needs at least {needed(asked)} windows of {2 * asked} samples for a horizon of {asked}, "
                f"got {given(asked)}: record longer{'' if asked == 2 else f' or lower {lower}'}."
            )
        if self.horizon:
            return self.horizon
        return max(h for h in range(least, max(LONGEST, least) + 1) if given(h) >= needed(h))

    def _states(self, series: Series, scaled: Scaled, horizon: int) -> States:
        m, q = scaled.inputs, scaled.inputs + scaled.outputs
        at = np.arange(2 * horizon * q).reshape(2 * horizon, q)
        future_u, past, future_y = at[horizon:, :m].ravel(), at[:horizon].ravel(), at[horizon:, m:].ravel()
        lower = triangle(scaled.joint, 2 * horizon, np.concatenate([future_u, past, future_y])).T
        given, known = 1 + future_u.size, 1 + future_u.size + past.size
        check_excitation("N4sid", lower[1:given, 1:given].T, series, horizon)
        own, told, rest = lower[given:known, given:known], lower[known:, given:known], lower[known:, known:]
        prediction = told @ np.linalg.pinv(own, rcond=_DROPPED)  # of the future from the past alone
        if self.weight == "cva":
            left, size, _ = np.linalg.svd(np.concatenate([told, rest], axis=1), full_matrices=False)
            kept = size > _DROPPED * size[0]
            weight = (left[:, kept] / size[kept]).T
            left, values, _ = np.linalg.svd(weight @ told, full_matrices=False)
        else:
            weight = np.eye(future_y.size)
            seen = told if self.weight == "moesp" else prediction @ lower[given:known, :known]
            left, values, _ = np.linalg.svd(seen, full_matrices=False)
        kept = values > _DROPPED * values[0]
        return States((left[:, kept] / values[kept]).T @ weight @ prediction, values, horizon)
