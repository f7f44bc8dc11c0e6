"""Uncertainty of fitted parameters: covariances from the information, robust to a wrong colour, and profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.threads import side_by_side
from identification.estimate import half_width
from identification.fit.followed import Point
from identification.fit.parameters import jumps, kinked
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.sensitivities import NOTHING

# share of the squared slopes that remains beside the initial states, below which it is rounding error.  On eight frozen
# logs of seven vehicles, central differences leave at most some 1e-12 of what the initial states imitate, and 4e-9 or
# more of the rest; a log of Tethys has directions in between.  Responses hold only along the filter's path and have
# larger errors
_LEFT, _LEFT_SOON = 1e-11, 1e-6
_PROFILED = 6  # most values tried on each side of a profile
_DESCENTS = 12  # steps of the other parameters at each of them
# multiple of the wanted fall beyond which a nearer value is tried; least share of the interval for that value
_TOO_FAR, _SHORTEST = 4.0, 0.05
_FLAT = 1e-3  # share of the wanted fall below which the log-likelihood does not depend on the parameter yet
_NOISE_STEP = 0.2  # step of a noise's logarithm for slopes
_LEAST_TOLD = 0.25  # least curvature by a noise's logarithm; its deviation is then 2, a factor of e^2
_LEAST_FREEDOM = 2.0  # degrees of freedom of Student's t: it has no variance at or below this
_MOST_GROWTH = 1.0  # most growth of a variance's logarithm; the first order holds no further


@dataclass(frozen=True, eq=False)
class Information:
    """The information that a record holds on the paths, in units of their scales.

    covariance: (P, P), robust.  alone: (P, P), normal matrix without the priors.
    freedom: (P,), degrees of freedom of Student's t, since the noise behind the covariance is estimated as well.
    reach: (P,), half widths of 95 % intervals, in the standard errors that hold for white errors of known noise.
    """

    covariance: np.ndarray
    alone: np.ndarray
    freedom: np.ndarray
    reach: np.ndarray


def information_of(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> Information:
    """The information at a fitted point, and the covariance that follows from it.

    The prediction errors of the right model are white, and the covariance is the inverse of the information.  If the
    noise model is wrong, neighbouring scores correlate: the variance of each parameter is then at least that of the
    sandwich form with Bartlett weights (Newey and West 1987; Ljung 1999, sec. 9.3).
    """
    flat, size = _told(problem, point, paths)
    alone, known = flat @ flat.T, np.diag(problem.pulls(point.vector, paths)[1] ** 2)
    inverse = _inverse(alone + known, size)
    scores = np.einsum("prc,rc->rp", flat.reshape(len(paths), *point.errors.shape), point.errors)
    long_run = scores.T @ scores
    lags = int(np.ceil(4.0 * (max(len(scores), 1) / 100.0) ** (2.0 / 9.0)))  # Newey and West 1994, Bartlett
    same = problem.stretch_of_row
    for lag in range(1, lags + 1):
        near = (same[lag:] == same[:-lag])[:, None]
        cross = (scores[lag:] * near).T @ scores[:-lag]
        long_run += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    robust = inverse @ (long_run + known) @ inverse
    wider = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(inverse), 1e-300), 1.0))
    growth, freedom = _by_noise(problem, point, paths, known)
    wider *= np.exp(0.5 * (growth + _by_left_out(problem, point, paths, known)))
    freedom = np.minimum(freedom, max(problem.count - len(paths) - point.logs.size, 3))
    reach = np.array([half_width(f) for f in freedom]) * wider
    return Information(inverse * np.outer(wider, wider), alone, freedom, reach)


def _told(
    problem: PredictionErrors, point: Point, paths: Sequence[str], soon: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """The slopes by the paths that initial states cannot imitate, (P, rows * C), and norms of the whole slopes, (P,).

    Directions that the initial states imitate almost exactly are left out: what remains of them is rounding error, and
    would look like information on the parameters.
    soon: use responses where a point has them, and one-sided differences for the other paths.
    """
    if soon:
        slopes = problem.soon_slopes(point, paths)
        flat = problem.without_starts(point, slopes, soon=True)
    else:
        slopes, flat = problem.own_slopes(point, paths)
    size = np.maximum(np.linalg.norm(slopes, axis=1), NOTHING)
    flat = flat / size[:, None]
    values, vectors = np.linalg.eigh(flat @ flat.T)
    kept = vectors[:, values > (_LEFT_SOON if soon else _LEFT)]
    return size[:, None] * (kept @ (kept.T @ flat)), size


def _inverse(normal: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The inverse of a normal matrix, without directions that hold no information; size: (P,), norms of the slopes."""
    size = np.maximum(size, np.sqrt(np.diag(normal)))  # the prior of a path may be far stronger than its slopes
    each = np.outer(size, size)
    return np.linalg.pinv(normal / each, rcond=1e-13, hermitian=True) / each


def _size(normal: np.ndarray) -> float:
    """The logarithm of a determinant, without directions that hold no information."""
    values = np.linalg.eigvalsh(normal)
    return float(np.log(values[values > 1e-13 * values[-1]]).sum())


def _by_noise(
    problem: PredictionErrors, point: Point, paths: Sequence[str], known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The growth of the variances' logarithms due to estimated accelerations, and the degrees of freedom, (P,) each.

    A log of a few correlation times determines the noise poorly.  Three corrections follow, all to first order in the
    logarithms of the noises.  Fitted parameters absorb a part of the noise, so that its estimate is too small; the
    restricted likelihood corrects this (Patterson and Thompson 1971).  The estimates move with the noise, which adds
    the variance of that movement (Kackar and Harville 1984).  If the logarithm of a variance has the variance s^2, the
    interval is that of Student's t with 2 / s^2 degrees of freedom (Satterthwaite 1946; Kenward and Roger 1997).
    If a point has responses to its coefficients, these give the slopes at each noise without runs of the vehicle.
    """
    pushing, count = problem.pushing(point), len(paths)
    if not pushing or not count or point.system is None:  # without a system, the vehicle diverges
        return np.zeros(count), np.full(count, np.inf)
    size, point = len(pushing), problem.prepared(point, paths)
    slopes, fall = np.zeros((size, count)), np.zeros(size)
    ways = np.zeros((size, count))  # slopes of the likeliest parameters by the noises
    here = first_order(problem, point, paths, known)
    for j, i in enumerate(pushing):
        more = point.logs.copy()
        more[i] += _NOISE_STEP
        there = problem.with_noise(point, more)
        if not np.isfinite(there.scores).all():  # the vehicle diverges with these gains: no slope can be taken
            continue
        other = first_order(problem, there, paths, known)
        slopes[j] = np.log(other.variances / here.variances) / _NOISE_STEP
        ways[j] = (other.ways - here.ways) / _NOISE_STEP
        fall[j] = -0.5 * (other.size - here.size) / _NOISE_STEP
    values, vectors = np.linalg.eigh(problem.noise_information(point, pushing, _NOISE_STEP))
    spread = (vectors / np.maximum(values, _LEAST_TOLD)) @ vectors.T
    variance = np.einsum("jp,jk,kp->p", slopes, spread, slopes)
    freedom = np.maximum(2.0 / np.maximum(variance, 1e-12), _LEAST_FREEDOM)
    moving = np.einsum("jp,jk,kp->p", ways, spread, ways)
    growth = np.exp(np.clip(slopes.T @ spread @ fall, 0.0, _MOST_GROWTH))
    return np.log(growth + moving / here.variances), freedom


def _by_left_out(problem: PredictionErrors, point: Point, paths: Sequence[str], known: np.ndarray) -> np.ndarray:
    """The growth of the variances' logarithms due to accelerations that a fit has left out, (P,).

    A fit leaves out an acceleration that gains less than it costs.  It may be present all the same: then the parameters
    are less certain, and biased by as much as it moves them.  Model selection adds both to the variance (Buckland,
    Burnham and Augustin 1997, Biometrics 53).  Each acceleration gets its likeliest strength at no cost, by the
    restricted likelihood, which allows for the part that the parameters have absorbed (Patterson and Thompson 1971).
    """
    count = len(paths)
    if not count or point.system is None:
        return np.zeros(count)
    point, logs = problem.prepared(point, paths), point.logs

    def restricted(logs: np.ndarray) -> tuple[float, FirstOrder]:
        there = problem.with_noise(point, logs)
        if not np.isfinite(there.scores).all():
            return -np.inf, FirstOrder(np.ones(count), np.zeros(count), 0.0, 0.0)
        told = first_order(problem, there, paths, known)
        # not the marginal likelihood: it makes intervals several times too wide in most logs without any acceleration
        return problem.total(there) + told.gain - 0.5 * told.size, told

    first = best = None
    for d in problem.left_out(point):
        tried = problem.with_acceleration(point, logs, int(d))
        if tried and best is None:
            first = best = restricted(logs)
        for other, found in zip(tried, side_by_side(restricted, tried), strict=True):
            if best is None or found[0] > best[0]:
                logs, best = other, found
    if first is None or best is None or best is first or not np.isfinite(first[0]):  # not finite: it diverges
        return np.zeros(count)
    before, after = first[1], best[1]
    wider = np.maximum(after.variances, before.variances) + (after.ways - before.ways) ** 2
    return np.log(wider / before.variances)


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """First-order information at a point: variances of the paths and steps to their likeliest values, (P,) each.

    gain: of the objective by these steps.  size: logarithm of the determinant of the information.
    """

    variances: np.ndarray
    ways: np.ndarray
    gain: float
    size: float


def first_order(problem: PredictionErrors, point: Point, paths: Sequence[str], known: np.ndarray) -> FirstOrder:
    """The information at a point to first order, by responses if it has any.  known: (P, P), from the priors."""
    pulled, rates = problem.pulls(point.vector, paths)
    flat, scale = _told(problem, point, paths, soon=True)
    normal = flat @ flat.T + known
    inverse = _inverse(normal, scale)
    pull = flat @ point.errors.ravel() - rates * pulled
    ways = inverse @ pull
    return FirstOrder(np.maximum(np.diag(inverse), 1e-300), ways, 0.5 * float(pull @ ways), _size(normal))


@dataclass(frozen=True, eq=False)
class ByPart:
    """The log-likelihood of each part of a record, to second order about a fitted point, in units of the paths' scales.

    normals: (K, P, P), information.  pulls: (K, P), slopes.  scores: (K,), values.
    known, known_pull: the same of the priors.  known_score: the objective's terms other than the scores.
    """

    normals: np.ndarray
    pulls: np.ndarray
    scores: np.ndarray
    known: np.ndarray
    known_pull: np.ndarray
    known_score: float

    @cached_property
    def spread(self) -> np.ndarray:
        """The covariance of the paths from all parts together, (P, P), for white errors of known noise."""
        normal = self.known + self.normals.sum(axis=0)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        each = np.outer(size, size)
        return np.linalg.pinv(normal / each, rcond=1e-10, hermitian=True) / each

    def refitted(self, counted: np.ndarray) -> tuple[np.ndarray, float]:
        """The steps of the paths, (P,), to their fit to some parts only, (K,) bool, and the objective there."""
        normal = self.known + self.normals[counted].sum(axis=0)
        pull = self.known_pull + self.pulls[counted].sum(axis=0)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        step = np.linalg.lstsq(normal / np.outer(size, size), pull / size, rcond=1e-10)[0] / size
        return step, float(self.scores[counted].sum() + self.known_score + 0.5 * pull @ step)

    @cached_property
    def foretold(self) -> np.ndarray:
        """The log-likelihood of each part given the others, (K,), integrated over the uncertainty that those leave.

        The integral is over the linearised posterior (Rasmussen and Williams 2006, sec. 2.7): if the other parts do not
        determine a parameter, the part in which it matters may differ from what they predict.
        """
        every = np.ones(len(self.scores), dtype=bool)
        whole, found = self._integrated(every), []
        for k, score in enumerate(self.scores):
            every[k] = False
            found.append(score + whole - self._integrated(every))
            every[k] = True
        return np.array(found)

    def _integrated(self, counted: np.ndarray) -> float:
        normal = self.known + self.normals[counted].sum(axis=0)
        pull, size = self.known_pull + self.pulls[counted].sum(axis=0), np.sqrt(np.diag(normal) + 1e-12)
        values, vectors = np.linalg.eigh(normal / np.outer(size, size))
        values, along = np.maximum(values, 1e-12), vectors.T @ (pull / size)
        return 0.5 * float((along**2 / values).sum() - np.log(values).sum()) - float(np.log(size).sum())


def told_by_part(
    problem: PredictionErrors,
    point: Point,
    paths: Sequence[str],
    parts: Sequence[Sequence[slice]],
    soon: bool = False,
) -> ByPart:
    """The log-likelihood of each part of the rows as a function of the paths; see `ByPart`.

    The slopes are without what the initial states of the stretches can imitate.
    soon: use responses where the point has them.
    """
    flat, _ = _told(problem, point, paths, soon)
    columns, errors = flat.reshape(len(paths), *point.errors.shape), point.errors
    pulled, rates = problem.pulls(point.vector, paths)
    normals, pulls, scores = [], [], []
    for part in parts:
        inside = problem.within(part) > 0.0
        own = columns[:, inside].reshape(len(paths), errors[inside].size)
        normals.append(own @ own.T)
        pulls.append(own @ errors[inside].ravel())
        scores.append(float(point.scores[inside].sum()))
    known = (np.diag(rates**2), -rates * pulled, problem.objective(point, paths) - problem.total(point))
    return ByPart(np.array(normals), np.array(pulls), np.array(scores), *known)


def interval_of(
    problem: PredictionErrors, point: Point, paths: Sequence[str], path: str, told: Information
) -> tuple[float, float]:
    """The 95 % interval of a path, by the likelihood profile if the path has a corner or the interval meets a bound."""
    k, value = list(paths).index(path), float(point.vector[problem.index[path]])
    error = float(np.sqrt(max(told.covariance[k, k], 0.0))) * problem.scale(path)
    half = half_width(float(told.freedom[k])) * error
    low, high = problem.bounds(path)
    if low < value - half and value + half < high and not kinked(path):
        return value - half, value + half
    way = told.covariance[:, k] / max(float(told.covariance[k, k]), 1e-300)
    if error > high - low:  # the slope is rounding error
        error, way = 0.0, None
    found = profile_interval(problem, point, paths, path, error, float(told.reach[k]), way)
    return min(found[0], value), max(found[1], value)


def profile_interval(
    problem: PredictionErrors,
    point: Point,
    paths: Sequence[str],
    path: str,
    error: float,
    reach: float,
    way: np.ndarray | None,
) -> tuple[float, float]:
    """The interval in which the log-likelihood, all else refitted, falls by less than half of `reach` squared.

    A side without such a fall ends at the bound.  For an effect with jumps, a side ends at the tried value that shows
    the fall.  The filter's gains are held, as in the fit of the parameters: with new gains, the profile would also
    count the information in the colour of the errors, which the estimates and their covariance leave out.
    error: standard error of the path, in its unit; the first step is based on it.  0 if the slope is zero.
    way: (P,), in scales, the change of all paths with this one to first order.  For a vehicle that turns away from its
    course with hardly any process noise, a fit from farther away does not find the compensating parameters.
    """
    bar = 0.5 * reach**2
    value = float(point.vector[problem.index[path]])
    best = problem.objective(problem.descended(point, paths, _DESCENTS), paths)
    limits = problem.bounds(path)
    found = []
    for side, limit in zip((-1.0, 1.0), limits, strict=True):
        inner, drop_inner, near = value, 0.0, point
        outer, drop_outer, falls = limit, 0.0, False
        step = 1.5 * max(error, 1e-3 * problem.scale(path))
        for _ in range(_PROFILED):
            tried = float(np.clip(inner + side * step, *limits))
            there = _refitted(problem, near, paths, path, tried, way)
            drop = best - problem.objective(there, paths)
            if drop >= bar:
                outer, drop_outer, falls = tried, drop, True
                if drop < _TOO_FAR * bar:
                    break
                step = max(_share(bar, drop_inner, drop), _SHORTEST) * abs(tried - inner)
                continue
            inner, drop_inner, near = tried, drop, there
            if tried == limit:
                break
            if falls or (drop < _FLAT * bar and np.isfinite(limit)):
                # no slope, as where an actuator has no travel left
                step = 0.5 * abs(outer - inner)
                continue
            reached = abs(inner - value)  # the distance is proportional to the root of the fall
            step = float(
                np.clip(reached * (np.sqrt(bar / max(drop, 0.05 * bar)) * 1.1 - 1.0), 0.3 * reached, 3.0 * reached)
            )
        between = falls and not jumps(path)
        found.append(inner + _share(bar, drop_inner, drop_outer) * (outer - inner) if between else outer)
    return found[0], found[1]


def _share(bar: float, inner: float, outer: float) -> float:
    """Where the log-likelihood has fallen by `bar`, as a share of the way between two values with these falls."""
    inside = np.sqrt(max(inner, 0.0))
    return float((np.sqrt(bar) - inside) / max(np.sqrt(outer) - inside, 1e-12))


def _refitted(
    problem: PredictionErrors, near: Point, paths: Sequence[str], path: str, value: float, way: np.ndarray | None
) -> Point:
    """The likeliest point with a path held at a value, all else refitted; way: see `profile_interval`.

    The fit begins at a nearby point, or at that point moved along `way` if this is likelier.
    """
    i, others = problem.index[path], [p for p in paths if p != path]
    vector = near.vector.copy()
    vector[i] = value
    begun = [problem.with_gains(near, vector)]
    if way is not None:
        moved = problem.moved_vector(near.vector, paths, way * (value - near.vector[i]) / problem.scale(path))
        moved[i] = value
        begun.append(problem.with_gains(near, moved))
    best = max(begun, key=lambda p: problem.objective(p, paths))
    return problem.descended(best, others, _DESCENTS)
