"""Tests of whether random accelerations follow a signal: a speed, a depth, a command, the time, or their past."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import chi2

from auv_gym.channels import channel
from auv_gym.records.attitude import ANGLES
from identification.deciding import CLOCK_PARTS, FEW_STATES, FEWER_PIECES, LEFT, PIECES, WEIGHED
from identification.diagnosis.search.beside_noise import weigh
from identification.diagnosis.search.candidates import Regression
from identification.diagnosis.search.multiplicity import level_of_each, summed_up
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.responses import together

TIME = "time_s"
CLOCK = "effects.clock.rate"
_ORDERS = (1, 2, 3)  # harmonics of an angle with large changes
_FAINT = 4.0  # least evidence for a law to be weighed: two standard errors
_LEADS = (1, 2, 4, 8, 16)  # rows by which the compared commands are later
_STILL = 0.01  # least change in a row that counts, in standard deviations of the signal
_LEAST_REST = 1e-3  # share of a signature left beside the fitted parameters, below which it is invisible
_NO_WAVES = np.empty((0, 0))


@dataclass(frozen=True)
class Dependence:
    """A velocity (or position) that is pushed, and the signal that the push depends on.

    misread: whether it is instead a channel whose lasting errors follow the signal.
    remembers: whether it depends on the signal's past, as with hysteresis, backlash or sticking.
    """

    pushed: str
    signal: str
    remembers: bool
    misread: bool = False


@dataclass(frozen=True, eq=False)
class _Tried:
    """A law, (rows,), that an acceleration of the `axis`-th pushed state may follow, and the evidence for it.

    signature: (m,), see `summed_up`.
    """

    told: Dependence
    axis: int
    law: np.ndarray
    evidence: float
    signature: np.ndarray


def dependence(bench: Workbench, state: State) -> Dependence | None:
    """The most significant dependence of the random accelerations on a signal, None if there is none.

    A push that follows a signal is no noise.  The laws are steps and ramps at eighths of the signal's range, bands
    between two of these (a layer of water that moves), its square and its size, harmonics of an angle, switches with
    hysteresis, and the direction of the last motion.  Each is tried
    as an acceleration of each velocity, by regression.  The evidence is the smaller of that with errors of equal size
    and that with errors of any size (White 1980, Econometrica 48), so that errors that are merely larger at times show
    nothing.  If no law is significant, the likeliest ones are weighed with noises of their own, see `beside_noise.py`.
    A controller that steers against pushes, by more than was logged, makes commands follow them: a law of a command
    counts only if it explains more than the same law of later commands, see `_answers`.
    A sea pushes all velocities in one rhythm: what the waves of the others predict of a push is no law.
    For a vehicle with many states, only pushed velocities and quarters are tested.  `LEFT` is the probability of a
    false alarm; see `_shared`.
    """
    problem, point = bench.problem, state.point
    if point.system is None:
        return None
    few = bench.followed <= FEW_STATES
    axes = np.arange(len(problem.pushed)) if few else np.flatnonzero(problem.pushes(point))
    if not len(axes):
        return None
    regression = Regression(problem, point, state.paths, 0.0)
    begins = np.zeros(len(problem.rows), dtype=bool)
    begins[problem.offsets] = True
    found: list[_Tried] = []
    waves = {int(axis): _by_other_waves(regression, int(axis)) for axis in axes}
    for name, values in signals_of(problem, point).items():
        for remembers, laws in enumerate(laws_of(name, values, begins, PIECES if few else FEWER_PIECES)):
            for axis in axes if laws else ():
                told = Dependence(problem.pushed[axis], name, bool(remembers), bool(problem.misread[axis]))
                terms = problem.pushed_by(point, int(axis), np.array(laws))
                flat = problem.flattened(problem.slopes_by(point, terms))
                evidence, rest = _evidence(regression, flat, waves[int(axis)])
                tried = zip(evidence, laws, summed_up(rest), strict=True)
                found += [_Tried(told, int(axis), law, float(e), r) for e, law, r in tried if e > 0.0]
    shares = _shared(found, LEFT)
    likely = []
    for one, share in sorted(zip(found, shares, strict=True), key=lambda o: chi2.sf(o[0].evidence, 1) / o[1]):
        if len(likely) == WEIGHED:
            break
        sure = chi2.sf(one.evidence, 1) < share
        calm = not waves[one.axis].size
        worth = sure or (calm and one.evidence >= _FAINT and problem.is_pushed(point))
        if worth and not _answers(problem, regression, one, waves[one.axis]):
            if sure:
                return one.told
            likely.append((one.told, share, problem.pushed_by(point, one.axis, one.law[None])))
    if not likely:
        return None
    enough = max(share for _, share, _ in likely)
    weights = weigh(problem, point, state.paths, together([term for _, _, term in likely]), enough)
    chances = [weight.chance / share for weight, (_, share, _) in zip(weights, likely, strict=True)]
    return likely[int(np.argmin(chances))][0] if min(chances) < 1.0 else None


def _shared(found: Sequence[_Tried], level: float) -> np.ndarray:
    """The significance level of each law; half of the total is for pushes by the pushed velocity, like drag."""
    own = np.array([one.told.pushed == one.told.signal for one in found], dtype=bool)
    shares = np.empty(len(found))
    for group in (own, ~own):
        signatures = [one.signature for one, inside in zip(found, group, strict=True) if inside]
        shares[group] = level_of_each(np.array(signatures), 0.5 * level)
    return shares


def _answers(problem: PredictionErrors, regression: Regression, one: _Tried, waves: np.ndarray = _NO_WAVES) -> bool:
    """Whether a law of a command explains less than the same law of later commands, which then react to the push."""
    if one.told.signal not in problem.plant.inputs:
        return False
    rows, stretch = np.arange(len(one.law)), problem.stretch_of_row
    last = np.r_[problem.offsets[1:], len(one.law)][stretch] - 1
    later = np.array([one.law[np.minimum(rows + lead, last)] for lead in _LEADS])
    point = regression.point
    signatures = problem.flattened(problem.slopes_by(point, problem.pushed_by(point, one.axis, later)))
    return float(_evidence(regression, signatures, waves)[0].max()) > one.evidence


def _by_other_waves(regression: Regression, axis: int) -> np.ndarray:
    """An orthonormal basis of what waves on other velocities than the `axis`-th predict of its push, (K, n).

    It includes both phases: the push of a wave on one velocity may come before or after that on another.
    """
    problem, point = regression.problem, regression.point
    others = problem.swelling(point)[problem.leads] & ~problem.misread
    others &= np.array([name != problem.pushed[axis] for name in problem.pushed])
    if not others.any():
        return _NO_WAVES
    waves = point.path[:, len(point.path[0]) - len(others) + np.flatnonzero(others)].T
    rest = regression.beside(problem.flattened(problem.slopes_by(point, problem.pushed_by(point, axis, waves))))
    _, values, basis = np.linalg.svd(rest, full_matrices=False)
    return basis[values > _LEAST_REST * values[0]]


def clock_varies(bench: Workbench, state: State) -> bool:
    """Whether the clock of a record surely had different rates in different parts of it.

    The time stamps then disagree with the motion in all channels at once, which accelerations can only imitate.
    For a vehicle carried by internal waves, only depth shows either, so a clock cannot be told from such waves.
    """
    problem, point = bench.problem, state.point
    if point.system is None or CLOCK not in problem.index:
        return False
    if problem.plant.family.carried and problem.swelling(point).any():
        return False
    regression, chances, rows = Regression(problem, point, state.paths, 0.0), [], len(problem.rows)
    for parts in (CLOCK_PARTS // 2, CLOCK_PARTS):
        part = np.arange(rows) * parts // rows
        within = (part == np.arange(parts)[:, None]).astype(float)
        terms = problem.partly(point, CLOCK, within)
        chances.append(_chance(regression, problem.flattened(problem.slopes_by(point, terms))))
    return len(chances) * min(chances) < LEFT


def signals_of(problem: PredictionErrors, point: Point) -> dict[str, np.ndarray]:
    """The signals that a push may follow, by channel, (rows,): states along the filter's path, commands, the time."""
    family, record, rows = problem.plant.family, problem.record, problem.rows
    found = {n: point.path[:, i] for i, n in enumerate(family.states) if i in problem.live}
    if problem.chart.on:  # the attitudes are rotation vectors
        found = {n: values for n, values in found.items() if n not in ANGLES}
    found |= {n: record[n][rows] for n in problem.plant.inputs if record.has(n)} | {TIME: record.time[rows]}
    known = {n: np.nan_to_num(values) for n, values in found.items()}
    return {n: values for n, values in known.items() if np.ptp(values) > 0.0}


def laws_of(
    name: str, values: np.ndarray, begins: np.ndarray, pieces: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Laws by which a push may follow a signal, (rows,) each: of its present value, and of its past.

    begins: rows in which a stretch begins.  pieces: number of pieces of the signal's range.
    """
    if channel(name).angle and np.ptp(values) > np.pi:
        return [law(order * values) for order in _ORDERS for law in (np.sin, np.cos)], []
    unit = np.std(values)
    present, past = [values / unit, ((values - values.mean()) / unit) ** 2], [_direction(values, begins)]
    signed = values.min() < 0.0 < values.max()
    if signed:
        present += [np.abs(values) / unit, values * np.abs(values) / unit**2]
    edges = np.quantile(values, np.arange(1, pieces) / pieces)
    present += [(values > edge).astype(float) for edge in edges]
    present += [np.maximum(values - edge, 0.0) / unit for edge in edges[1::2]]
    present += [((low < values) & (values <= high)).astype(float) for low, high in combinations(edges, 2)]
    for size in (values, np.abs(values))[: 1 + signed]:
        edges = np.quantile(size, np.arange(1, pieces) / pieces)
        past += [_switched(size, low, high, begins) for low, high in zip(edges[:-2:2], edges[2::2], strict=True)]
    if signed:  # odd in the signal, like drag
        past += [values * switch / unit for switch in past[-((pieces - 2) // 2) :]]
    return present, past


def _switched(values: np.ndarray, low: float, high: float, begins: np.ndarray) -> np.ndarray:
    """1 from where values are above `high` until they are at `low`, else 0."""
    events = np.where(values > high, 1.0, np.where(values <= low, 0.0, np.nan))
    return _held(np.where(begins & np.isnan(events), values > 0.5 * (low + high), events))


def _direction(values: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """The sign of the last change, 0 if there was none yet."""
    changes = np.where(begins, 0.0, np.diff(values, prepend=values[0]))
    moved = np.abs(changes) > _STILL * np.std(values)
    return _held(np.where(moved, np.sign(changes), np.where(begins, 0.0, np.nan)))


def _held(events: np.ndarray) -> np.ndarray:
    """Values with each NaN replaced by the last value before it."""
    known = ~np.isnan(events)
    return events[np.maximum.accumulate(np.where(known, np.arange(len(events)), 0))]


def _evidence(
    regression: Regression, signatures: np.ndarray, waves: np.ndarray = _NO_WAVES
) -> tuple[np.ndarray, np.ndarray]:
    """Evidence for each of some signatures, (P, n), see `dependence`, 0 if nothing is left; and the remainders.

    waves: (K, n), orthonormal, another possible cause.
    """
    size, left = np.maximum(np.linalg.norm(signatures, axis=1), 1e-300), regression.left
    rest = regression.beside(signatures / size[:, None])
    if waves.size:
        rest, left = rest - (rest @ waves.T) @ waves, left - (left @ waves.T) @ waves
    told, one_size = (rest @ left) ** 2, np.einsum("ij,ij->i", rest, rest)
    any_size = (rest**2) @ left**2
    evidence = told / np.maximum(np.maximum(one_size, any_size), 1e-30)
    return np.where(one_size > _LEAST_REST, evidence, 0.0), rest


def _chance(regression: Regression, signatures: np.ndarray) -> float:
    """The probability of so much evidence for all of some signatures, (P, n), at once, see `dependence`."""
    size = np.linalg.norm(signatures, axis=1)
    rest = regression.beside(signatures[size > 0.0] / size[size > 0.0, None])
    values, vectors = np.linalg.eigh(rest @ rest.T)
    kept = values > _LEAST_REST
    if not kept.any():
        return 1.0
    base = vectors[:, kept].T @ rest
    told = base @ regression.left
    one_size = float((told**2 / values[kept]).sum())
    any_size = float(told @ np.linalg.pinv((base * regression.left**2) @ base.T, hermitian=True) @ told)
    return float(chi2.sf(min(one_size, any_size), kept.sum()))
