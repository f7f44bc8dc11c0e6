"""The result of every linear fit: a model, its free parameters, and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np

from auv_gym.models.linear import Polynomial, StateSpace
from identification.estimate import Estimate


@runtime_checkable
class LinearFit(Protocol):
    """A linear model fitted to records, in SI units.

    vector, covariance: of its P free parameters, (P,) and (P, P); the covariance is NaN if the method gives none.
    at: the model for other values of the parameters, a smooth function of them.  noise: covariance of the one-step
    errors, (p, p).  freedom: degrees of freedom of the noise estimate.  samples: rows of the regression, summed over
    the outputs.  parameters: number of parameters for order criteria: free coefficients, without intercepts and starts.
    loss: mean square one-step error by output, (p,).
    """

    @property
    def model(self) -> Polynomial | StateSpace: ...

    @property
    def estimates(self) -> tuple[Estimate, ...]: ...

    @property
    def vector(self) -> np.ndarray: ...

    @property
    def covariance(self) -> np.ndarray: ...

    @property
    def noise(self) -> np.ndarray: ...

    @property
    def freedom(self) -> int: ...

    @property
    def samples(self) -> int: ...

    @property
    def parameters(self) -> int: ...

    @property
    def loss(self) -> np.ndarray: ...

    def at(self, vector: np.ndarray) -> Polynomial | StateSpace: ...


def is_linear(fit: object) -> TypeGuard[LinearFit]:
    """Whether a fit is a linear one, so that its poles, responses and free runs have intervals and figures."""
    return isinstance(fit, LinearFit) and isinstance(fit.model, Polynomial | StateSpace)


def has_errors(fit: LinearFit) -> bool:
    """Whether the covariance of its parameters is known."""
    return bool(np.isfinite(fit.covariance).all())


@dataclass(frozen=True, eq=False)
class Known:
    """A known model, such as a linearised vehicle, as a fit without parameters: its bands have zero width."""

    model: Polynomial | StateSpace
    estimates: tuple[Estimate, ...] = ()
    freedom: int = 1
    samples: int = 0
    parameters: int = 0

    @property
    def vector(self) -> np.ndarray:
        return np.empty(0)

    @property
    def covariance(self) -> np.ndarray:
        return np.empty((0, 0))

    @property
    def noise(self) -> np.ndarray:
        return np.zeros((len(self.model.outputs), len(self.model.outputs)))

    @property
    def loss(self) -> np.ndarray:
        return np.zeros(len(self.model.outputs))

    def at(self, vector: np.ndarray) -> Polynomial | StateSpace:
        """The model itself."""
        return self.model
