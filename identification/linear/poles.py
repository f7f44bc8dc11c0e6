"""Poles and zeros of a linear fit, with the uncertainty of the poles."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np
from scipy import linalg, sparse, stats

from auv_gym.models.linear import Polynomial, StateSpace
from identification.estimate import Estimate, half_width
from identification.linear.fit import LinearFit, has_errors
from identification.linear.uncertainty import NO_ERRORS, STEP, moved, state_space

_FIXED = 1e-7  # of the error that a pole would have without cancellation; below this, only rounding moves it
_APART = 1e-6  # distance below which two poles count as one
_INFINITE = 1e6  # magnitude of a discrete zero above which it counts as infinite
_DELAY = 1e-6  # magnitude of a discrete pole below which it is a pure delay


@dataclass(frozen=True, eq=False)
class PoleInterval:
    """A pole in discrete time and its uncertainty.

    value: for a complex pair, the one with positive imaginary part.  covariance: of real and imaginary part, (2, 2).
    outputs: those whose equations have it.  fixed: by the model's structure, such as an integrator's.  problem: why
    there is no interval.  Derived quantities are Estimates, such as `pole.time_constant.ci95`.
    """

    value: complex
    covariance: np.ndarray
    dt: float
    outputs: tuple[str, ...]
    freedom: int
    fixed: bool = False
    problem: str = ""

    @property
    def pair(self) -> bool:
        """Whether the conjugate is a pole, too."""
        return self.value.imag > 0.0

    @property
    def delay(self) -> bool:
        """Whether it is at zero: one sample of delay."""
        return abs(self.value) < _DELAY

    @property
    def continuous(self) -> complex:
        """The corresponding pole in continuous time, 1/s."""
        return complex(np.log(complex(self.value))) / self.dt

    @property
    def real(self) -> Estimate:
        return self._estimate("real part", "1", self.value.real, np.array([1.0, 0.0]))

    @property
    def imaginary(self) -> Estimate:
        return self._estimate("imaginary part", "1", self.value.imag, np.array([0.0, 1.0]))

    @property
    def rate(self) -> Estimate:
        """The real part in continuous time; negative if the mode decays."""
        return self._estimate("rate", "1/s", self.continuous.real, self._slopes[0])

    @property
    def time_constant(self) -> Estimate:
        """The time in which the mode falls to 37 %; infinite for an integrator, negative if it grows."""
        rate, path, unit = self.rate, "time constant", "s"
        if abs(rate.value) < 1e-12 / self.dt:
            return Estimate(path, unit, inf, 0.0 if self.fixed else inf, (inf, inf) if self.fixed else (-inf, inf))
        value, (low, high) = -1.0 / rate.value, rate.ci95
        through = low <= 0.0 <= high and not self.fixed  # the reciprocal of a rate that may be zero
        limits = (-1.0 / low, inf) if low < 0.0 < high else (-inf, inf) if through else (-1.0 / low, -1.0 / high)
        return Estimate(path, unit, value, rate.error * value**2, limits, rate.problem)

    @property
    def natural_frequency(self) -> Estimate:
        s = self.continuous
        along = np.array([s.real, s.imag]) / max(abs(s), 1e-300)
        return self._estimate("natural frequency", "rad/s", abs(s), along @ self._slopes)

    @property
    def damping(self) -> Estimate:
        """The damping ratio: 1 for a mode that decays without oscillating, 0 for an integrator."""
        turned = self.continuous / max(abs(self.continuous), 1e-300)
        along = np.array([-(turned.imag**2), turned.real * turned.imag]) / max(abs(self.continuous), 1e-300)
        return self._estimate("damping ratio", "1", -turned.real, along @ self._slopes)

    def ellipse(self) -> np.ndarray:
        """The border of the 95 % region, complex; for a real pole, the ends of its interval; empty without one."""
        if self.problem or self.fixed:
            return np.empty(0, dtype=complex)
        if not self.pair:
            return np.array(self.real.ci95, dtype=complex)
        sizes, axes = np.linalg.eigh(self.covariance)
        turn = np.linspace(0.0, 2.0 * pi, 60)
        radius = np.sqrt(2.0 * stats.f.ppf(0.95, 2, self.freedom) * np.maximum(sizes, 0.0))
        border = axes @ (radius[:, None] * np.array([np.cos(turn), np.sin(turn)]))
        return self.value + border[0] + 1j * border[1]

    @property
    def _slopes(self) -> np.ndarray:
        """Derivatives of real and imaginary part in continuous time by those in discrete time, (2, 2)."""
        slope = 1.0 / (complex(self.value) * self.dt)
        return np.array([[slope.real, -slope.imag], [slope.imag, slope.real]])

    def _estimate(self, path: str, unit: str, value: float, slope: np.ndarray) -> Estimate:
        if self.problem:
            return Estimate(path, unit, value, inf, (-inf, inf), self.problem)
        error = float(np.sqrt(max(slope @ self.covariance @ slope, 0.0)))
        width = half_width(self.freedom) * error
        return Estimate(path, unit, value, error, (value - width, value + width))


def pole_intervals(fit: LinearFit) -> tuple[PoleInterval, ...]:
    """The poles of a fit, largest first, one for a complex pair, each with its uncertainty.

    Derivatives of eigenvalues are analytic.  If a pole is no farther from another one than its error, there is no
    linear interval, and `problem` says so.  A pole that no parameter moves, such as that of an integrator, has error 0.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Arx, closed_loop, pole_intervals
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> pole = pole_intervals(Arx(["rudder_rad"], ["heading_rad"]).fit(log))[1]
        >>> [round(bound, 1) for bound in pole.time_constant.ci95]
        [6.9, 13.0]
    """
    centre, owners = _dynamics(fit.model)
    moves = [_dynamics(up)[0] - _dynamics(down)[0] for up, down in moved(fit)]
    moves = np.array(moves).reshape(-1, *centre.shape) / (2.0 * STEP)
    found = []
    for block in _blocks((centre != 0.0) | np.any(moves != 0.0, axis=0)):
        at = np.ix_(block, block)
        outputs = tuple(dict.fromkeys(owners[i] for i in block if owners[i]))
        found += _poles_of(fit, centre[at], moves[(slice(None), *at)], outputs)
    return tuple(sorted(found, key=lambda pole: (-abs(pole.value), -pole.value.real)))


def zeros(model: Polynomial | StateSpace, output: str, given: str) -> np.ndarray:
    """The finite zeros from the input `given` to an output, in discrete time, without those that cancel a pole."""
    i, j = model.outputs.index(output), model.inputs.index(given)
    if isinstance(model, Polynomial) and not model.a[:, ~np.eye(len(model.outputs), dtype=bool)].any():
        return np.roots(np.trim_zeros(model.b[:, i, j]))
    space = state_space(model)
    n = len(space.states)
    if not space.b[:, j].any() or not space.c[i].any():
        return np.empty(0)
    pencil = np.block([[space.a, space.b[:, [j]]], [space.c[[i]], np.zeros((1, 1))]])
    found = linalg.eigvals(pencil, linalg.block_diag(np.eye(n), 0.0))
    found = found[np.isfinite(found)]
    found = found[np.abs(found) < _INFINITE]
    return found[np.all(np.abs(found[:, None] - space.poles()) > _APART, axis=1)]


def _dynamics(model: Polynomial | StateSpace) -> tuple[np.ndarray, list[str]]:
    """A matrix whose eigenvalues are the poles, and for each row the output in whose equation it is, if any."""
    if isinstance(model, StateSpace):
        return model.a, [""] * len(model.states)
    # c = a: no noise in the states; b = 0: no input; only A remains, without states for a longer B or C
    still = np.zeros((1, *model.b.shape[1:]))
    alone = Polynomial(model.a, still, model.inputs, model.outputs, model.dt, c=model.a).to_state_space()
    return alone.a, [name.rpartition(" ")[0] for name in alone.states]


def _blocks(linked: np.ndarray) -> list[np.ndarray]:
    """Indices of the diagonal blocks of a matrix that is block triangular in some order, which have its eigenvalues.

    This separates poles of different outputs, and delays, even if they coincide.
    """
    count, label = sparse.csgraph.connected_components(sparse.csr_matrix(linked), connection="strong")
    return [np.flatnonzero(label == number) for number in range(count)]


def _poles_of(fit: LinearFit, matrix: np.ndarray, moves: np.ndarray, outputs: tuple[str, ...]) -> list[PoleInterval]:
    solved: Any = linalg.eig(matrix, left=True, right=True)
    values, left, right = solved
    across = np.sum(left.conj() * right, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.einsum("ki,rkl,li->ri", left.conj(), moves, right) / across
        most = np.einsum("ki,rkl,li->ri", np.abs(left), np.abs(moves), np.abs(right)) / np.abs(across)
    spread, largest = (np.sqrt(np.sum(np.abs(part) ** 2, axis=0)) for part in (slopes, most))
    fixed = (spread <= _FIXED * largest) & np.isfinite(spread) & has_errors(fit)
    distance = np.abs(values[:, None] - values)
    np.fill_diagonal(distance, inf)
    free = np.where(fixed[:, None] | fixed, inf, distance).min(axis=1, initial=inf)  # a fixed factor divides out
    found = []
    for i in np.flatnonzero(values.imag >= 0.0):
        parts = np.array([slopes[:, i].real, slopes[:, i].imag])
        known, problem = bool(np.isfinite(parts).all()), ""
        if not has_errors(fit):
            problem = NO_ERRORS
        elif not known or (distance[i].min(initial=inf) < _APART and not fixed[i]):
            problem = "a repeated pole has no linear interval"
        elif not spread[i] <= free[i]:
            problem = "no farther from another pole than its error: no linear interval"
        covariance = parts @ parts.T * (not fixed[i]) if known else np.full((2, 2), np.nan)
        snapped = fixed[i] and abs(values[i] - 1.0) < _APART
        value = 1.0 + 0.0j if snapped else complex(values[i])
        found.append(PoleInterval(value, covariance, fit.model.dt, outputs, fit.freedom, bool(fixed[i]), problem))
    return found
