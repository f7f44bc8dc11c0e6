"""The result of a state-space fit, and the final step of the subspace methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from auv_gym.channels import unit_per
from auv_gym.models.linear import StateSpace
from identification.estimate import Estimate, half_width
from identification.linear.poles import PoleInterval, pole_intervals
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.realisation import Realisation
from identification.linear.uncertainty import response_band

_INTEGRATES = 1e-3  # distance of a pole from 1 below which a steady gain has no meaning
NO_INTERVAL = "subspace estimates have no interval: refine=True gives one"


@dataclass(frozen=True, eq=False)
class StateSpaceFit:
    """A model in innovations form, and the uncertainty of what follows from it.

    vector, covariance: of all entries of a, b, c, k, of the drift (for the operating point) and of the level of the
    outputs, (P,), (P, P).  Since states can be chosen in many ways, only quantities that do not depend on this choice
    have errors of their own: poles, responses, free runs.  The covariance is NaN without a refinement.
    noise: covariance of the one-step errors.  freedom: samples minus free parameters and starts.  samples: of all
    outputs together.  loss: (p,), mean square one-step errors.  singular_values: of the subspace method, if there was
    one.  iterations: of the refinement.  horizon: samples, of the subspace method.  notes: its choices, in words.
    """

    model: StateSpace
    vector: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    freedom: int
    samples: int
    loss: np.ndarray
    scaled: Scaled
    centre: Realisation
    singular_values: np.ndarray = field(default_factory=lambda: np.empty(0))
    iterations: int = 0
    horizon: int = 0
    notes: tuple[str, ...] = ()

    @property
    def order(self) -> int:
        return len(self.centre.a)

    @property
    def parameters(self) -> int:
        """Number of parameters, whatever the choice of states: n (m + 2 p), minus those fixed by integrators."""
        return self.centre.parameters

    @property
    def integrating(self) -> tuple[str, ...]:
        """The outputs that follow the integrators most, one for each integrator."""
        share = np.linalg.norm(self.centre.summed, axis=1) / self.scaled.output_spread
        return tuple(self.model.outputs[i] for i in sorted(np.argsort(-share)[: self.centre.integrators]))

    def at(self, vector: np.ndarray) -> StateSpace:
        """The model for other parameters, in the order of `vector`."""
        found, offset, _ = self.centre.at(np.asarray(vector, dtype=float)).centred(self.scaled)
        return found.model(self.model, offset)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Poles, `pole 1` or for a pair `pole 1 (real)` and `pole 1 (imaginary)`, and gains `gain[output, input]`.

        Gains are steady ones; there are none if a pole is, or may be, at 1.
        """
        return self._estimates

    @cached_property
    def _estimates(self) -> tuple[Estimate, ...]:
        found, poles = [], pole_intervals(self)
        for number, pole in enumerate(poles, start=1):
            if pole.pair:
                found.append(replace(pole.real, path=f"pole {number} (real)"))
                found.append(replace(pole.imaginary, path=f"pole {number} (imaginary)"))
            else:
                found.append(replace(pole.real, path=f"pole {number}"))
        found += self._gains(poles)
        if np.isfinite(self.covariance).all():
            return tuple(found)
        return tuple(replace(estimate, problem=NO_INTERVAL) for estimate in found)

    def __getitem__(self, name: str) -> Estimate:
        """The estimate with this name; raises KeyError if there is none."""
        for estimate in self.estimates:
            if estimate.path == name:
                return estimate
        raise KeyError(f"There is no estimate {name!r}; there are {', '.join(e.path for e in self.estimates)}")

    @staticmethod
    def _integrates(pole: PoleInterval) -> bool:
        low, high = pole.real.ci95
        return not pole.pair and (abs(pole.value - 1.0) < _INTEGRATES or low <= 1.0 <= high < np.inf)

    def _gains(self, poles: Sequence[PoleInterval]) -> list[Estimate]:
        if any(self._integrates(pole) for pole in poles):
            return []
        band = response_band(self, np.zeros(1))
        width, found = half_width(self.freedom), []
        for i, output in enumerate(band.outputs):
            for j, given in enumerate(band.inputs):
                value = float(band.response[0, i, j].real)
                error = float(np.sqrt(band.covariance[0, i, j, 0, 0]))
                unit = unit_per(output, given)
                known = np.isfinite(error)
                ends = (value - width * error, value + width * error) if known else (-np.inf, np.inf)
                found.append(Estimate(f"gain[{output}, {given}]", unit, value, error if known else np.inf, ends))
        return found


def fit_of(
    series: Series,
    scaled: Scaled,
    found: Realisation,
    errors: np.ndarray,
    fitted: int,
    covariance: np.ndarray | None = None,
    singular_values: np.ndarray | None = None,
    iterations: int = 0,
) -> StateSpaceFit:
    """The fit for a realisation between scaled signals and its one-step errors there, (rows, p).

    fitted: how many numbers were fitted, including starts.  covariance: of the realisation's entries, if known.
    """
    rows, p = errors.shape
    in_units = found.in_units(scaled)
    centre, offset, shift = in_units.centred(scaled)
    bare = StateSpace(centre.a, centre.b, centre.c, series.inputs, series.outputs, series.dt)
    errors = errors * scaled.output_spread
    freedom = max(rows * p - fitted, 1)
    size = found.vector.size
    if covariance is None:
        known = np.full((size, size), np.nan)
    else:
        # units and a fixed shift of the states act as an affine map on the entries
        zero = found.at(np.zeros(size)).in_units(scaled).shifted(shift).vector
        slopes = [found.at(row).in_units(scaled).shifted(shift).vector - zero for row in np.eye(size)]
        known = np.transpose(slopes) @ covariance @ np.array(slopes)
        settled = centre.settled  # otherwise, rounding would give these a variance
        known[settled], known[:, settled] = 0.0, 0.0
    return StateSpaceFit(
        model=centre.model(bare, offset),
        vector=centre.vector,
        covariance=known,
        noise=errors.T @ errors * p / freedom,
        freedom=freedom,
        samples=rows * p,
        loss=np.mean(errors**2, axis=0),
        scaled=scaled,
        centre=centre,
        singular_values=np.empty(0) if singular_values is None else singular_values,
        iterations=iterations,
    )
