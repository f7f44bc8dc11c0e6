"""Uncertainty of frequency responses and free runs, from that of a linear fit's parameters.

By the delta method: the covariance is split into independent directions, each one standard deviation long.  The model
is moved along each, and the squared changes of a result are summed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import pi

import numpy as np

from auv_gym.model import Diverged
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.records.record import Record
from identification.compare.comparison import compare_open, fitted_starts, free_runs_of
from identification.estimate import half_width
from identification.fit.validation import head_windows
from identification.linear.fit import LinearFit, has_errors

NO_ERRORS = "this method gives no errors of its parameters"
STEP = 1e-2  # standard deviations; a central difference is then accurate to 1e-4, and rounding stays below 1e-10


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
        state_space(model).dc_gain()
    response = state_space(model).frequency_response(omega)
    covariance = np.zeros((*response.shape, 2, 2)) if has_errors(fit) else np.full((*response.shape, 2, 2), np.nan)
    for up, down in moved(fit):
        slope = state_space(up).frequency_response(omega) - state_space(down).frequency_response(omega)
        parts = np.stack([np.real(slope), np.imag(slope)], axis=-1) / (2.0 * STEP)
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
        plain = compare_open({"model": fit.model}, record, settle=settle)
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
        for up, down in moved(fit):
            variance += ((run(up) - run(down)) / (2.0 * STEP)) ** 2
        half = width * np.sqrt(variance)
    if noise:
        left = np.where(np.isfinite(runs.residual), runs.residual, 0.0)
        unit = np.sqrt(np.mean(left[~runs.scored] ** 2, axis=0)) if starts is None else None
        lengths = [(w.stop - w.start, h.stop - h.start) for w, h in zip(windows, heads, strict=True)]
        added = np.concatenate([_noise_variance(fit, columns, n, head, unit) for n, head in lengths])
        half = np.hypot(half, width * np.sqrt(added))
    return SimulatedBand(runs.channels, runs.rows, runs.window, centre, half, diverged)


def _directions(fit: LinearFit) -> np.ndarray:
    """Independent changes of the parameters, (r, P), one standard deviation long: their squares sum to the covariance.

    No rows if the fit has no errors.
    """
    if not has_errors(fit):
        return np.empty((0, fit.vector.size))
    size = np.sqrt(np.diag(fit.covariance))
    unit = np.where(size > 0.0, size, 1.0)  # parameters have units: unscaled, the small ones would be lost to rounding
    values, columns = np.linalg.eigh(fit.covariance / np.outer(unit, unit))
    kept = values > 1e-14 * values.max(initial=0.0)
    return (unit[:, None] * columns[:, kept] * np.sqrt(values[kept])).T


def moved(fit: LinearFit) -> Iterator[tuple[Polynomial | StateSpace, Polynomial | StateSpace]]:
    """The model moved by `STEP` along each direction, forwards and backwards."""
    for direction in _directions(fit):
        yield fit.at(fit.vector + STEP * direction), fit.at(fit.vector - STEP * direction)


def state_space(model: Polynomial | StateSpace) -> StateSpace:
    return model.state_space if isinstance(model, Polynomial) else model


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
    space = state_space(fit.model)
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
