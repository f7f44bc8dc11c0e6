"""Uncertainty of poles, frequency responses and free runs, from that of a linear fit's parameters.

By the delta method: the covariance is split into independent directions, each one standard deviation long.  The model
is moved along each, and the squared changes of a result are summed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np
from scipy import linalg, sparse, stats

from auv_gym.model import Diverged
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.records.record import Record
from identification.compare.comparison import OpenLoop, compare_open, fitted_starts, free_runs_of
from identification.estimate import Estimate, half_width
from identification.fit.validation import head_windows
from identification.linear.fit import LinearFit, has_errors

NO_ERRORS = "this method gives no errors of its parameters"
_STEP = 1e-2  # standard deviations; a central difference is then accurate to 1e-4, and rounding stays below 1e-10
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


@dataclass(frozen=True, eq=False)
class ResponseBand:
    """A frequency response and its uncertainty.

    omega: rad/s, (n,).  response: from inputs to outputs in SI, (n, p, m).  covariance: of real and imaginary part, (n,
    p, m, 2, 2).
    """

    omega: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    response: np.ndarray
    covariance: np.ndarray
    freedom: int

    @property
    def gain(self) -> np.ndarray:
        """Magnitude of the response, (n, p, m)."""
        return np.abs(self.response)

    @property
    def phase(self) -> np.ndarray:
        """Phase of the response, rad, continuous over the frequencies, (n, p, m)."""
        return np.unwrap(np.angle(self.response), axis=0)

    @property
    def gain_error(self) -> np.ndarray:
        """Standard error of the gain, relative to it, (n, p, m)."""
        return self._along(self.response)

    @property
    def phase_error(self) -> np.ndarray:
        """Standard error of the phase, rad, (n, p, m)."""
        return self._along(1j * self.response)

    @property
    def gain_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """95 % bounds of the gain, each (n, p, m); symmetric in its logarithm, so that both are positive."""
        with np.errstate(over="ignore", invalid="ignore"):
            apart = np.exp(half_width(self.freedom) * self.gain_error)
            return self.gain / apart, self.gain * apart

    @property
    def phase_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """95 % bounds of the phase, rad, each (n, p, m)."""
        half = half_width(self.freedom) * self.phase_error
        return self.phase - half, self.phase + half

    def _along(self, direction: np.ndarray) -> np.ndarray:
        """Standard error along a direction in the complex plane, relative to the gain."""
        size = np.maximum(self.gain, 1e-300)
        unit = np.stack([np.real(direction), np.imag(direction)], axis=-1) / size[..., None]
        spread = np.einsum("...i,...ij,...j->...", unit, self.covariance, unit)
        return np.where(self.gain > 0.0, np.sqrt(np.maximum(spread, 0.0)) / size, 0.0)


@dataclass(frozen=True, eq=False)
class SimulatedBand:
    """Free runs over windows and the 95 % half width around each, in SI.

    rows: of the record.  window: the number of the window of each row.  model, half: (rows, C), C the channels.
    diverged: number of draws whose run diverged; they are left out.
    """

    channels: tuple[str, ...]
    rows: np.ndarray
    window: np.ndarray
    model: np.ndarray
    half: np.ndarray
    diverged: int = 0


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
    moves = [_dynamics(up)[0] - _dynamics(down)[0] for up, down in _moved(fit)]
    moves = np.array(moves).reshape(-1, *centre.shape) / (2.0 * _STEP)
    found = []
    for block in _blocks((centre != 0.0) | np.any(moves != 0.0, axis=0)):
        at = np.ix_(block, block)
        outputs = tuple(dict.fromkeys(owners[i] for i in block if owners[i]))
        found += _poles_of(fit, centre[at], moves[(slice(None), *at)], outputs)
    return tuple(sorted(found, key=lambda pole: (-abs(pole.value), -pole.value.real)))


def response_band(fit: LinearFit, omega: np.ndarray | Sequence[float]) -> ResponseBand:
    """The frequency response of a fit at frequencies in rad/s, up to pi / dt, with its uncertainty.

    Frequency 0 gives the steady gain; raises if the model integrates.  Errors are NaN if the fit has none.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Arx, closed_loop, response_band
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> band = response_band(Arx(["rudder_rad"], ["heading_rad"]).fit(log), [0.01, 0.1])
        >>> band.gain[:, 0, 0].round(2)
        array([3.88, 0.29])
    """
    omega = np.atleast_1d(np.asarray(omega, dtype=float))
    model = fit.model
    if not omega.size or omega.min() < 0.0 or omega.max() > (1.0 + 1e-9) * pi / model.dt:
        raise ValueError(
            f"response_band needs frequencies from 0 to the Nyquist frequency {pi / model.dt:g} rad/s, got "
            f"{np.array2string(omega, threshold=4)}."
        )
    if not omega.min() > 0.0:
        _state_space(model).dc_gain()
    response = _state_space(model).frequency_response(omega)
    covariance = np.zeros((*response.shape, 2, 2)) if has_errors(fit) else np.full((*response.shape, 2, 2), np.nan)
    for up, down in _moved(fit):
        slope = _state_space(up).frequency_response(omega) - _state_space(down).frequency_response(omega)
        parts = np.stack([np.real(slope), np.imag(slope)], axis=-1) / (2.0 * _STEP)
        covariance += parts[..., :, None] * parts[..., None, :]
    return ResponseBand(omega, model.inputs, model.outputs, response, covariance, fit.freedom)


def simulated_band(
    fit: LinearFit,
    record: Record,
    *,
    windows: Sequence[slice] | None = None,
    settle: float | None = None,
    starts: np.ndarray | None = None,
    noise: bool = False,
    draws: int = 0,
    rng: np.random.Generator | None = None,
) -> SimulatedBand:
    """Free runs of a fit over windows of a record, with their 95 % band from the parameter uncertainty.

    windows: default whole segments.  settle: s, of each window, to which the start of every model is fitted; default
    that of `compare_open`.  starts: instead, states at the windows' first rows for all models, (n_windows, n_states).
    noise: also include the model's own noise and its effect on fitted starts; measurements lie in that band.
    draws: number of models drawn with `rng` instead of linearisation, for a band too wide to be linear.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Arx, closed_loop, simulated_band
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> band = simulated_band(Arx(["rudder_rad"], ["heading_rad"]).fit(log), log)
        >>> round(float(band.half.mean()), 1)
        1.0
    """
    if draws and rng is None:
        raise ValueError("simulated_band needs rng, a numpy random generator, to draw models: give one.")
    if not has_errors(fit):
        raise ValueError(f"simulated_band needs the errors of a fit's parameters, and {NO_ERRORS}.")
    if windows is None or settle is None:
        plain: OpenLoop = compare_open({"model": fit.model}, record, settle=settle)
        windows, settle = plain.windows if windows is None else tuple(windows), plain.settle
    runs = free_runs_of(fit.model, record, windows, settle)
    columns = [fit.model.outputs.index(name) for name in runs.channels]
    heads = head_windows(record, windows, settle)

    def run(model: Polynomial | StateSpace) -> np.ndarray:
        begun = fitted_starts(model, record, heads) if starts is None else starts
        return model.run(record, windows, begun)[:, columns]

    centre = runs.model if starts is None else run(fit.model)
    diverged, width = 0, half_width(fit.freedom)
    if draws and rng is not None:
        drawn, diverged = _drawn(fit, run, draws, rng)
        low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
        half = 0.5 * (high - low)
    else:
        variance = np.zeros_like(centre)
        for up, down in _moved(fit):
            variance += ((run(up) - run(down)) / (2.0 * _STEP)) ** 2
        half = width * np.sqrt(variance)
    if noise:
        left = np.where(np.isfinite(runs.residual), runs.residual, 0.0)
        unit = np.sqrt(np.mean(left[~runs.scored] ** 2, axis=0)) if starts is None else None
        lengths = [(w.stop - w.start, h.stop - h.start) for w, h in zip(windows, heads, strict=True)]
        added = np.concatenate([_noise_variance(fit, columns, n, head, unit) for n, head in lengths])
        half = np.hypot(half, width * np.sqrt(added))
    return SimulatedBand(runs.channels, runs.rows, runs.window, centre, half, diverged)


def zeros(model: Polynomial | StateSpace, output: str, given: str) -> np.ndarray:
    """The finite zeros from the input `given` to an output, in discrete time, without those that cancel a pole."""
    i, j = model.outputs.index(output), model.inputs.index(given)
    if isinstance(model, Polynomial) and not _off_diagonal(model).any():
        return np.roots(np.trim_zeros(model.b[:, i, j]))
    space = _state_space(model)
    n = len(space.states)
    if not space.b[:, j].any() or not space.c[i].any():
        return np.empty(0)
    pencil = np.block([[space.a, space.b[:, [j]]], [space.c[[i]], np.zeros((1, 1))]])
    found = linalg.eigvals(pencil, linalg.block_diag(np.eye(n), 0.0))
    found = found[np.isfinite(found)]
    found = found[np.abs(found) < _INFINITE]
    return found[np.all(np.abs(found[:, None] - space.poles()) > _APART, axis=1)]


def _directions(fit: LinearFit) -> np.ndarray:
    """Independent changes of the parameters, (r, P), one standard deviation long: their squares sum to the covariance.

    None if the fit has no covariance.
    """
    if not has_errors(fit):
        return np.empty((0, fit.vector.size))
    size = np.sqrt(np.diag(fit.covariance))
    unit = np.where(size > 0.0, size, 1.0)  # parameters have units: unscaled, the small ones would be lost to rounding
    values, columns = np.linalg.eigh(fit.covariance / np.outer(unit, unit))
    kept = values > 1e-14 * values.max(initial=0.0)
    return (unit[:, None] * columns[:, kept] * np.sqrt(values[kept])).T


def _moved(fit: LinearFit) -> Iterator[tuple[Polynomial | StateSpace, Polynomial | StateSpace]]:
    """The model moved by `_STEP` along each direction, forwards and backwards."""
    for direction in _directions(fit):
        yield fit.at(fit.vector + _STEP * direction), fit.at(fit.vector - _STEP * direction)


def _state_space(model: Polynomial | StateSpace) -> StateSpace:
    return model.state_space if isinstance(model, Polynomial) else model


def _off_diagonal(model: Polynomial) -> np.ndarray:
    return model.a[:, ~np.eye(len(model.outputs), dtype=bool)]


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


def _drawn(
    fit: LinearFit, run: Callable[..., np.ndarray], draws: int, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """Free runs of models drawn from the fit's uncertainty, (draws, rows, C), and how many diverged."""
    directions, found = _directions(fit), []
    for _ in range(draws):
        model = fit.at(fit.vector + rng.standard_normal(len(directions)) @ directions)
        # squares of a run may overflow, and its start then fail, before the run itself diverges
        with suppress(Diverged, np.linalg.LinAlgError), np.errstate(over="ignore", invalid="ignore"):
            found.append(run(model))
    if len(found) < 0.5 * draws:
        raise ValueError(
            f"simulated_band drew {draws} models and {draws - len(found)} of them diverged: the fit is too unsure of "
            "its poles for a band; take longer records or lower orders."
        )
    return np.array(found), draws - len(found)


def _noise_variance(
    fit: LinearFit, columns: Sequence[int], rows: int, head: int, unit: np.ndarray | None
) -> np.ndarray:
    """Variance, from the model's noise, of a measurement minus the free run, (rows, C).

    The start is exact, or fitted by least squares to the first `head` rows in these units of the outputs, and then
    contains part of their noise.
    """
    space = _state_space(fit.model)
    values, vectors = np.linalg.eigh(fit.noise)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drive, n, p = space.k @ root, len(space.states), len(columns)
    read, direct = space.c[columns], root[columns]
    size = root.shape[1]
    kept = np.zeros((n, head, size))  # response of the state to each whitened error so far
    if unit is not None:
        unit = np.maximum(unit, 1e-9 * max(float(unit.max()), 1e-300))
        seen, power = np.empty((head, p, n)), np.eye(n)
        for t in range(head):
            seen[t] = read @ power / unit[:, None]
            power = space.a @ power
        pull = np.linalg.pinv(seen.reshape(head * p, n), rcond=1e-9).reshape(n, head, p) / unit
        later = np.zeros((n, n))
        for t in reversed(range(head)):
            kept[:, t] = -(later @ drive + pull[:, t] @ direct)
            later = pull[:, t] @ read + later @ space.a
    result = np.empty((rows, p))
    for t in range(min(head, rows)):
        shown = np.tensordot(read, kept, axes=1)
        shown[:, t] += direct
        result[t] = np.sum(shown**2, axis=(1, 2))
        kept = np.tensordot(space.a, kept, axes=1)
        kept[:, t] += drive
    flat = kept.reshape(n, -1)
    spread = flat @ flat.T
    for t in range(head, rows):
        result[t] = np.einsum("ci,ij,cj->c", read, spread, read) + np.sum(direct**2, axis=1)
        spread = space.a @ spread @ space.a.T + drive @ drive.T
    return result
