"""The evidence for a linear term of unknown size, with the noises estimated again beside it.

Random accelerations grow to explain whatever is missing.  Judged with such noises, a missing term counts for little: at
most for as many readings as the noises leave independent.  So a term is judged by a likelihood ratio in which both
sides have the noises that fit them best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import expm1

import numpy as np
from scipy import stats

from identification.diagnosis.search.candidates import Regression
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.responses import Responses

_TURNS, _GAIN = 6, 0.1  # most iterations of size and noises; the gain of log-likelihood below which they end
_NOISE_STEPS = 40
_SMALL_STEP = 0.05  # change of the logarithm of a noise, for slopes
_LEAST_INFORMATION = 1e-3  # least information on a noise's logarithm
_MOST = 500.0  # limit of evidence over degrees of freedom, for a finite exponential
_LEAST_REST = 1e-3  # share of a term's squared length left beside the fitted parameters, below which it is invisible


@dataclass(frozen=True)
class Weight:
    """Twice the gain in log-likelihood by some parameters, and the degrees of freedom of the noises.

    The noises are estimated as if from so many independent readings (Satterthwaite 1946, Biometrics Bulletin 2).
    """

    evidence: float
    freedom: float
    parameters: int = 1

    @property
    def chance(self) -> float:
        """The probability of at least as much evidence if nothing is missing.

        With few degrees of freedom, a likelihood ratio is larger by chance: that of a regression corresponds to
        Fisher's F, that of one parameter to Student's t squared (Kendall and Stuart 1979, ch. 24).
        """
        if self.freedom <= self.parameters:
            return 1.0
        if not np.isfinite(self.freedom):
            return float(stats.chi2.sf(max(self.evidence, 0.0), self.parameters))
        rest = self.freedom - self.parameters
        ratio = rest / self.parameters * expm1(min(max(self.evidence, 0.0) / self.freedom, _MOST))
        return float(stats.f.sf(ratio, self.parameters, rest))


def weigh(
    problem: PredictionErrors, point: Point, paths: Sequence[str], terms: Responses, enough: float = 1.0
) -> tuple[Weight, ...]:
    """The weight of each of some terms alone, given by responses of readings and next states, beside fitted paths.

    The filter is linearised about the point's path; size and noises are estimated in turns.  Errors that are larger
    where the term acts than the filter expects lower the evidence accordingly (White 1980, Econometrica 48).
    enough: the chance above which degrees of freedom are not computed, and are infinite: they only raise the chance.
    """
    first = Regression(problem, point, paths, 0.0)
    renewed = problem.with_noise(point, problem.better_noise(point, _NOISE_STEPS)[0])
    without = max(_likelihood(first), _likelihood(Regression(problem, renewed, paths, 0.0)))
    found = []
    for k in range(len(terms.paths)):
        term = terms.at([k])
        weight = Weight(_evidence(first, term, without), np.inf)
        if weight.chance <= enough:
            weight = replace(weight, freedom=freedom_of(problem, renewed, _slopes_by(problem, term)))
        found.append(weight)
    return tuple(found)


def _slopes_by(problem: PredictionErrors, term: Responses) -> Callable[[Point], np.ndarray]:
    return lambda point: problem.flattened(problem.slopes_by(point, term))


def _evidence(first: Regression, term: Responses, without: float) -> float:
    """Twice the gain in log-likelihood by a term, from a regression at the point; without: the best without it."""
    problem, point, regression = first.problem, first.point, first
    best, trust = -np.inf, 0.0
    for _ in range(_TURNS):
        here, plain = regression.point, _likelihood(regression)
        size, evidence, trusted = _sized(regression, problem.flattened(problem.slopes_by(here, term))[0])
        without = max(without, plain)
        if plain + 0.5 * evidence < best + _GAIN:
            break
        best, trust = plain + 0.5 * evidence, trusted
        there = problem.with_noise(point, problem.better_noise(_beside(here, term, size), _NOISE_STEPS)[0])
        regression = Regression(problem, there, first.fitted, 0.0)
    return 2.0 * (best - without) * trust


def _likelihood(regression: Regression) -> float:
    """The log-likelihood of a point after a step of its fitted paths and starts, with the prior of the noises."""
    return regression.problem.objective(regression.point, ()) + 0.5 * regression.regained


def _sized(regression: Regression, signature: np.ndarray) -> tuple[float, float, float]:
    """The likeliest size of a term, the evidence for it, and the share of this that allows for errors of varying size.

    The errors include the term's part: otherwise a term that acts in few rows would remove their errors.
    """
    (rest,) = regression.beside(signature[None])
    told, precision = float(rest @ regression.left), float(rest @ rest)
    if precision <= _LEAST_REST * float(signature @ signature):
        return 0.0, 0.0, 1.0
    return told / precision, told**2 / precision, min(1.0, precision / float(rest**2 @ regression.left**2))


def _beside(point: Point, term: Responses, size: float) -> Point:
    """A point whose system has the effect of a term of a given size removed."""
    system = point.system
    assert system is not None
    forcing, error = system.forcing - size * term.onward[:, :, 0], system.error - size * term.seen[:, :, 0]
    return replace(point, system=replace(system, forcing=forcing, error=error))


def freedom_of(problem: PredictionErrors, point: Point, slopes: Callable[[Point], np.ndarray]) -> float:
    """Degrees of freedom of a point's noises, as far as the precision of some parameters depends on them.

    The noises' information comes from slopes of the likelihood.  slopes: of the errors by the parameters, (P, n), at a
    point; their precision is that with nothing else fitted.
    """
    moved = [*range(len(problem.channels)), *problem.pushing(point)]
    precision, changes = _precision(slopes(point)), np.zeros(len(moved))
    for k, i in enumerate(moved):
        there = point.logs.copy()
        there[i] += _SMALL_STEP
        changes[k] = (_precision(slopes(problem.with_noise(point, there))) - precision) / _SMALL_STEP
    values, vectors = np.linalg.eigh(problem.noise_information(point, moved, _SMALL_STEP))
    told = vectors.T @ changes
    return float(2.0 / max(told @ (told / np.maximum(values, _LEAST_INFORMATION)), 1e-12))


def _precision(slopes: np.ndarray) -> float:
    """The logarithm of the precision of parameters, averaged over the independent directions in which they act."""
    values = np.linalg.eigvalsh(slopes @ slopes.T)
    return float(np.log(np.maximum(values, max(1e-12 * values[-1], 1e-300))).mean())
