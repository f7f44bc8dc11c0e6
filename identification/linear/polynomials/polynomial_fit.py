"""The result of a polynomial fit, and the steps that the polynomial methods share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.channels import channel
from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.estimate import Estimate, half_width
from identification.linear.polynomials.filtering import largest_root
from identification.linear.polynomials.levenberg_marquardt import linearised
from identification.linear.polynomials.prediction import Prediction
from identification.linear.polynomials.structure import Structure, blocks
from identification.linear.regressors import SAMPLES_PER_COEFFICIENT, Series, solve
from identification.linear.scaled import Scaled
from identification.linear.triangles import triangle_from

_AT_CIRCLE = 0.999  # largest magnitude of a root of C; above it, old errors still count, and intervals are invalid
# maps the errors and the least-squares parameters to the method's parameters, the starts (None: zeros), and a
# description of any problem
Method = Callable[[Prediction, np.ndarray], tuple[np.ndarray, np.ndarray | None, str]]


@dataclass(frozen=True, eq=False)
class PolynomialFit:
    """A polynomial model and the uncertainty of its coefficients.

    estimates: a_j of `a1[depth_m]`, b_j of `b1[depth_m, stern_plane_rad]`, c_j, and `intercept[depth_m]`, which
    represents the operating point.  vector, covariance: (P,), (P, P), of the free parameters, output by output; zero
    between outputs that are fitted separately.  noise: (p, p), covariance of the one-step errors.  samples: of all
    outputs together.  freedom: samples minus parameters, of the output with the fewest.  loss: (p,), mean square error.
    """

    model: Polynomial
    estimates: tuple[Estimate, ...]
    vector: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    freedom: int
    samples: int
    loss: np.ndarray
    structure: Structure
    scaled: Scaled

    @property
    def parameters(self) -> int:
        """Number of fitted coefficients, including those of C, without intercepts and starts."""
        return self.structure.parameters

    def at(self, vector: np.ndarray) -> Polynomial:
        """The model for other parameters, in the order of `vector`."""
        return _model(self.structure, self.scaled, self.model.dt, vector)

    def __getitem__(self, name: str) -> Estimate:
        """The estimate with this name; raises KeyError if there is none."""
        for estimate in self.estimates:
            if estimate.path == name:
                return estimate
        raise KeyError(f"There is no coefficient {name!r}; there are {', '.join(e.path for e in self.estimates)}")


def fit_coupled_outputs(
    name: str, records: Sequence[Record], structure: Structure, offset: bool, skip: int, method: Method
) -> PolynomialFit:
    """Fit a method to records, each group of coupled outputs by itself; errors name the method `name`.

    skip: minimum number of samples at the start of each segment used only as lags.
    """
    if isinstance(skip, bool) or not isinstance(skip, int) or skip < 0:
        raise ValueError(f"{name} needs skip >= 0 as a whole number of samples, got {skip!r}.")
    series = Series.of(records, structure.inputs, structure.outputs, name)
    scaled = Scaled.of(series, offset, name)
    p = len(structure.outputs)
    vectors: dict[int, np.ndarray] = {}
    covariances, problems, errors = [], {}, {}
    freedom, samples, loss = [], 0, np.zeros(p)
    for numbers in structure.coupled():
        prediction = Prediction.of(scaled, structure, numbers, skip)
        arx = np.concatenate([_least_squares(name, prediction, k) for k in range(len(numbers))])
        free, starts, problem = method(prediction, arx)
        starts = prediction.starts() if starts is None else starts
        lags = prediction.lags
        parts = prediction.errors(free, starts)
        counts = np.array([row.free + offset for row in prediction.rows])
        left = prediction.samples - counts
        together = sum(e.T @ e for e in parts) / np.sqrt(np.outer(left, left))
        tall = scaled.output_spread[numbers]
        loss[numbers] = tall**2 * np.concatenate([e[lags:] for e in parts]).var(axis=0, mean=0.0)
        matrix, shift = prediction.in_units()
        covariances.append(matrix @ _covariance(prediction, free, starts, together) @ matrix.T)
        for row, part, end in zip(prediction.rows, prediction.split(matrix @ free + shift), left):
            vectors[row.number] = part
            freedom.append(int(end))
        for i, number in enumerate(numbers):
            errors[number] = [tall[i] * e[lags:, i] for e in parts]
        samples += prediction.samples * len(numbers)
        if lags and not structure.tied and largest_root(prediction.c(free)) > _AT_CIRCLE:
            problem = (
                "a root of C is at the unit circle: the intervals of this output do not hold; lower n_c, or use "
                "output_error if the noise is on the measurement"
            )
        problems |= {structure.outputs[n]: problem for n in numbers}
    # coupled() lists outputs in order, so the parts can be concatenated
    vector, covariance = np.concatenate([vectors[i] for i in range(p)]), blocks(covariances)
    return PolynomialFit(
        _model(structure, scaled, series.dt, vector),
        _estimates(structure, offset, vector, covariance, freedom, problems),
        vector,
        covariance,
        _noise(errors, loss, freedom, samples // p),
        min(freedom),
        samples,
        loss,
        structure,
        scaled,
    )


def _least_squares(name: str, prediction: Prediction, k: int) -> np.ndarray:
    """The parameters of an output without C; raises if the data do not determine them."""
    row = prediction.rows[k]
    problem = prediction.regressions[k]
    count = row.free + prediction.intercept
    if problem.target.size < SAMPLES_PER_COEFFICIENT * count:
        raise ValueError(
            f"{name} needs at least {SAMPLES_PER_COEFFICIENT} samples per coefficient ({count} coefficients of "
            f"{row.output}), got {problem.target.size} that have all their lags: record longer or ask for fewer lags."
        )
    found = solve(problem, name, row.output)
    free = np.zeros(count)
    known = [i for i, term in enumerate(row.free_terms) if term.kind != "c"]
    free[known + [row.free] * prediction.intercept] = found
    return free


def _covariance(prediction: Prediction, free: np.ndarray, starts: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of the parameters for white errors of this covariance: inverse information, with estimated starts."""
    floor = np.finfo(float).eps ** 2 * np.eye(len(noise))
    weight = np.linalg.cholesky(np.linalg.inv(noise + floor))
    about = linearised(prediction, free, starts, weight)
    triangle = triangle_from(about.reduced, lambda: [prediction.triangle(free, starts, weight)])
    size = np.maximum(np.sqrt(np.sum(triangle**2, axis=0)), np.finfo(float).tiny)
    inverse = np.linalg.pinv(triangle / size, rcond=1e-14) / size[:, None]
    return inverse @ inverse.T


def _noise(errors: dict[int, list[np.ndarray]], loss: np.ndarray, freedom: Sequence[int], samples: int) -> np.ndarray:
    """Covariance of the one-step errors; between two outputs, over the rows that both have."""
    p = len(loss)
    noise = np.empty((p, p))
    for i in range(p):
        for j in range(i, p):
            pairs = [(a[-min(a.size, b.size) :], b[-min(a.size, b.size) :]) for a, b in zip(errors[i], errors[j])]
            count = sum(a.size for a, _ in pairs)
            left = np.sqrt(freedom[i] * freedom[j])
            noise[i, j] = noise[j, i] = sum(float(a @ b) for a, b in pairs) / left if count else 0.0
    return noise


def _model(structure: Structure, scaled: Scaled, dt: float, vector: np.ndarray) -> Polynomial:
    values, intercepts, at = [], [], 0
    for row in structure.rows:
        values.append(row.base + row.mix @ vector[at : at + row.free])
        at += row.free
        intercepts.append(vector[at] if scaled.offset else 0.0)
        at += scaled.offset
    a, b, c = structure.arrays(values)
    offsets = {}
    if scaled.offset:
        u0, y0 = _operating_point(a, b, np.array(intercepts), scaled)
        offsets = {"input_offset": u0, "output_offset": y0}
    return Polynomial(a, b, structure.inputs, structure.outputs, dt, c=c, **offsets)


def _operating_point(
    a: np.ndarray, b: np.ndarray, intercepts: np.ndarray, scaled: Scaled
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets of inputs and outputs with A(1) y - B(1) u = intercepts, as close to the means of the data as possible.

    Distances are in units of the signals' spread.  For an integrating output, A(1) is zero, so only the inputs can
    change.
    """
    means = np.r_[scaled.output_middle, scaled.input_middle]
    spread = np.r_[scaled.output_spread, scaled.input_spread]
    gains = np.concatenate([a.sum(axis=0), -b.sum(axis=0)], axis=1)
    moved = np.linalg.lstsq(gains * spread, intercepts - gains @ means, rcond=None)[0]
    offsets = means + spread * moved
    p = len(a[0])
    return offsets[p:], offsets[:p]


def _estimates(
    structure: Structure,
    offset: bool,
    vector: np.ndarray,
    covariance: np.ndarray,
    freedom: Sequence[int],
    problems: dict[str, str],
) -> tuple[Estimate, ...]:
    found, at = [], 0
    for row, left in zip(structure.rows, freedom):
        mix = blocks([row.mix, np.eye(int(offset))])
        inside = slice(at, at + mix.shape[1])
        values = np.r_[row.base, np.zeros(int(offset))] + mix @ vector[inside]
        errors = np.sqrt(np.maximum(np.diag(mix @ covariance[inside, inside] @ mix.T), 0.0))
        heads = [(term.name, term.unit) for term in row.terms]
        heads += [(f"intercept[{row.output}]", channel(row.output).unit)] * offset
        width, problem = half_width(left), problems.get(row.output, "")
        found += [
            Estimate(head, unit, float(v), float(e), (float(v - width * e), float(v + width * e)), problem)
            for (head, unit), v, e in zip(heads, values, errors)
        ]
        at += mix.shape[1]
    return tuple(found)
