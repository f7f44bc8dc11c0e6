"""Fits of a plant whose motion is disturbed: an extended Kalman filter's one-step errors, beside free runs.

Free runs (output error) blame sensors for all that remains. Where gusts and waves push the vehicle, that puts too much
trust into slow residuals, and intervals come out too narrow. Source: Ljung 1999, sec. 7.3 and 7.4; Harvey 1989, ch. 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import minimize

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.estimate import Estimate, half_width
from identification.fit.disturbed import Filtered, Path, along, filtered
from identification.fit.residual import noise_floor
from identification.fit.shooting import Shooting, unknown_states
from identification.fit.validation import Whiteness, whiteness

Form = Literal["output error", "innovations"]

_PASSES = 4  # linearisations, each about the states that the filter of the one before found
_SETTLED = 0.02  # standard errors: a step of the parameters that is the last
_FIRST_GUESSES = 10.0 ** np.arange(-8.0, 1.0)  # of the disturbances, over the mean square of a velocity, 1/s
_SEARCH = (12, 4)  # steps towards the best noises, after the first linearisation and after each other one
_NOISE_STEP = 1e-3  # of the logarithms of deviations, for their gradient
_WIDE = np.log(1e4)  # how far a search may take a noise from where it begins
_COLOURED = 1e-3  # p value of the whiteness test, over all channels, below which free runs leave colour
_BETTER = 10.0  # in Akaike's criterion


@dataclass(frozen=True, eq=False)
class DisturbedFit:
    """A plant fitted by one of the forms.

    process: intensity of the random walk of each disturbed state, its unit over the root of s; empty for output error.
    measurement: standard deviation of each channel's noise.  log_likelihood, aic: of the one-step errors; both forms
    are filters, so they compare.  innovations: (rows, C), over their standard deviations.
    """

    form: Form
    plant: Plant
    estimates: tuple[Estimate, ...]
    process: Mapping[str, float]
    measurement: Mapping[str, float]
    log_likelihood: float
    aic: float
    innovations: np.ndarray
    whiteness: Mapping[str, Whiteness]


@dataclass(frozen=True, eq=False)
class Choice:
    """The form that suits a record, in words, and both fits."""

    form: Form
    output_error: DisturbedFit
    innovations: DisturbedFit
    words: str

    @property
    def fit(self) -> DisturbedFit:
        """The fit of the chosen form."""
        return self.innovations if self.form == "innovations" else self.output_error


class InnovationsForm:
    """A record in windows, and the filters of a plant over them.

    windows: each starts from states of its own.  states: indices of the states that are filtered; disturbed: which of
    them are driven by noise, the velocities where there are any.
    """

    def __init__(self, plant: Plant, record: Record, windows: Sequence[slice] | None = None):
        self.plant, self.record = plant, record
        self.problem = Shooting(plant, record, record.segments if windows is None else windows)
        shared = [index for index, _ in self.problem.shared]
        self.states = np.array([*self.problem.start_states, *shared], dtype=int)
        names = [plant.family.states[index] for index in self.states]
        moving = [k for k, name in enumerate(names) if name.endswith(("mps", "radps"))]
        constant = unknown_states(plant)
        self.disturbed = np.array(moving or [k for k, name in enumerate(names) if name not in constant], dtype=int)
        self.names = tuple(names[k] for k in self.disturbed)

    def fit(self, paths: Sequence[str], form: Form = "innovations") -> DisturbedFit:
        """The fit of greatest likelihood over the paths and the noises, with 95 % intervals.

        Raises ValueError if a path cannot be freed or the runs diverge.
        """
        paths = tuple(paths)
        for path in paths:
            if not spec_at(self.plant, path).probe > 0.0 and path not in self.plant.coefficients:
                raise ValueError(f"No fit can free {path}: choose an effect with a probe, or a coefficient.")
        point = self.problem.solve(self.plant, paths)
        if not np.isfinite(point.cost):
            raise ValueError(f"The free runs of {self.plant.name} diverge: check its parameters and the record.")
        plant, starts = self.problem.plant_at(point, paths), point.starts
        reference = along(self.problem, plant, self.states, starts, None, ())[1]
        logs, result, path_ = self._first_noise(point.residual, form), None, None
        for number in range(_PASSES if form == "innovations" else 1):
            path_, reference = along(self.problem, plant, self.states, starts, reference, paths)
            if number == 0 and form == "innovations":
                logs = self._seeded(path_, logs)
            logs = self._best_noise(path_, logs, _SEARCH[min(number, 1)])
            result = self._filter(path_, logs[None])
            change = result.change[0]
            limits = np.array([spec_at(self.plant, p).bounds for p in paths]).reshape(-1, 2)
            scales = np.array([self.problem.scale(p) for p in paths])
            moved = np.array([value_at(plant, p) for p in paths]) + change * scales
            moved = np.clip(moved, limits[:, 0], limits[:, 1])
            if form == "innovations":
                plant = replace_at(plant, dict(zip(paths, moved.tolist(), strict=True)))
                reference = reference + result.states[0]
            if not paths or np.all(np.abs(change) < _SETTLED * np.sqrt(np.diag(result.covariance[0]))):
                break
        assert result is not None
        return self._told(form, plant, paths, logs, result)

    def choose(self, paths: Sequence[str]) -> Choice:
        """Both fits, and the form that the record asks for."""
        free, disturbed = self.fit(paths, "output error"), self.fit(paths)
        form = choose_form(free, disturbed)
        p = min(w.p_value for w in free.whiteness.values())
        words = (
            f"Free runs leave {'coloured' if p < _COLOURED else 'white'} residuals (least p {p:.2g}); disturbances "
            f"lower Akaike's criterion by {free.aic - disturbed.aic:.3g}: {form}."
        )
        return Choice(form, free, disturbed, words)

    def _first_noise(self, residual: np.ndarray, form: Form) -> np.ndarray:
        """Logarithms of deviations: of the channels' noise, then of the disturbances."""
        window, found = self.problem.window_of_row, []
        for c, spread in enumerate(np.sqrt(np.nanmean(residual**2, axis=0))):
            found.append(max(noise_floor(residual[:, c], window) if form == "innovations" else float(spread), 1e-8))
        return np.log(found)

    def _seeded(self, path: Path, logs: np.ndarray) -> np.ndarray:
        """The noises with the disturbances, all of one share, that suit the record best."""
        sizes = np.sqrt(np.mean(path.reference[:, self.disturbed] ** 2, axis=0)) + 1e-9
        tried = np.array([[*logs, *np.log(sizes * np.sqrt(share))] for share in _FIRST_GUESSES])
        return tried[int(np.argmax(self._filter(path, tried).profile))]

    def _best_noise(self, path: Path, logs: np.ndarray, steps: int) -> np.ndarray:
        """The noises of greatest likelihood, the parameters at their best for each."""

        def cost(values: np.ndarray) -> tuple[float, np.ndarray]:
            tried = values + _NOISE_STEP * np.vstack([np.zeros(values.size), np.eye(values.size)])
            profile = self._filter(path, tried).profile
            return -profile[0], -(profile[1:] - profile[0]) / _NOISE_STEP

        bounds = [(value - _WIDE, value + _WIDE) for value in logs]
        options = {"maxiter": steps, "ftol": 1e-6}
        found = minimize(cost, logs, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return found.x if np.isfinite(found.fun) else logs

    def _filter(self, path: Path, logs: np.ndarray) -> Filtered:
        """The filters for several noises, (S, C + disturbed)."""
        count = len(self.problem.channels)
        process = np.zeros((len(logs), self.states.size))
        if logs.shape[1] > count:
            process[:, self.disturbed] = np.exp(2.0 * logs[:, count:])
        return filtered(path, np.exp(2.0 * logs[:, :count]), process)

    def _told(self, form: Form, plant: Plant, paths, logs: np.ndarray, result: Filtered) -> DisturbedFit:
        problem = self.problem
        known = int(problem.finite.sum())
        width = half_width(max(known - problem.nuisances - len(paths) - logs.size, 3))
        errors = np.sqrt(np.maximum(np.diag(result.covariance[0]), 0.0)) * [problem.scale(p) for p in paths]
        estimates = []
        for p, error in zip(paths, errors, strict=True):
            value = value_at(plant, p)
            limits = (value - width * error, value + width * error)
            estimates.append(Estimate(p, spec_at(plant, p).unit, value, float(error), limits))
        count = len(problem.channels)
        scaled = result.innovations[0]
        white = {n: whiteness(scaled[:, c], problem.window_of_row) for c, n in enumerate(problem.channels)}
        likelihood = float(result.profile[0])
        return DisturbedFit(
            form,
            plant,
            tuple(estimates),
            dict(zip(self.names, np.exp(logs[count:]).tolist())),
            dict(zip(problem.channels, np.exp(logs[:count]).tolist())),
            likelihood,
            2.0 * (len(paths) + logs.size) - 2.0 * likelihood,
            scaled,
            white,
        )


def choose_form(output_error: DisturbedFit, innovations: DisturbedFit) -> Form:
    """Innovations where free runs leave coloured residuals and a filter's are whiter and much likelier."""
    least = min(w.p_value for w in output_error.whiteness.values()) * len(output_error.whiteness)
    if least >= _COLOURED or innovations.aic > output_error.aic - _BETTER:
        return "output error"
    first = [np.mean([abs(w.correlation[0]) for w in f.whiteness.values()]) for f in (output_error, innovations)]
    return "innovations" if first[1] < first[0] else "output error"
