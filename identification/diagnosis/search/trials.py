"""Fits of candidates: a short list by what one step of each promises, then whole fits, then the gate."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from identification.diagnosis.search.acceptance import Weighed, effect_size, threshold, weighed
from identification.diagnosis.search.candidates import SEEN, Candidate, Screening, screen
from identification.diagnosis.search.workbench import State, Workbench, given_values
from identification.fit.likelihood import colour, evidence
from identification.fit.shooting import Point

LEAST_TRACE = 0.2  # of the bar: what a candidate must promise before it is fitted
SHORT_LIST, FINALISTS = 12, 4
CLOSE, CLOSER = 0.5, 0.8  # of the best one's evidence: nearer ones are on the list, or finalists, however many
FEW_STATES = 4  # that are fitted at a window's start, up to which fits begin from every first value
FIRST_ITERATIONS, ITERATIONS = 4, 15  # of the short list, and then of the finalists
NO_TRACE = "leaves no trace in the residual"
FAR_LESS = "explains far less than others"
UNSTABLE = "no stable run with it"
UNSEEN = "cannot be seen in this record"
KINKED_STEPS = (1.0, 5.0)  # probes over which slopes are taken where an effect has a corner at neutral

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate fitted jointly with everything fitted before it.

    train, held: evidence for it in the fitted and in the held-out windows.  objection: why it is not accepted, or "".
    """

    candidate: Candidate
    state: State | None
    train: float
    held: float
    screening: Screening
    objection: str

    @property
    def total(self) -> float:
        """Evidence from all windows, less what a second component or a sought period is expected to gain by chance."""
        return self.train + self.held - 2.0 * (len(self.candidate.paths) - 1 + float(np.log(self.screening.tried)))


@dataclass(frozen=True, eq=False)
class _Promise:
    """A candidate with points to start its fit from, best first, and the evidence that they promise."""

    candidate: Candidate
    screening: Screening
    points: tuple[Point, ...]
    evidence: float
    objection: str = ""


def trials_of(
    bench: Workbench,
    state: State,
    left: Sequence[Candidate],
    count: int,
    progress: Progress,
    plain: Collection[str] = (),
) -> list[Trial]:
    """A trial for each candidate beside what was fitted before, most evidence first.

    count: of all candidates.  plain: paths that are fitted to the end whatever they promise.
    """
    progress(0.0, "screening")
    promises = _promises(bench, state, left, threshold(count))
    listed = _short_list(promises, threshold(count), plain)
    begun = []
    for number, promise in enumerate(listed):
        progress(0.2 + 0.5 * number / len(listed), promise.candidate.title)
        begun.append(_begun(bench, state, promise))
    finalists = _finalists(state, begun, plain)
    trials = []
    for number, (promise, point) in enumerate(finalists):
        progress(0.7 + 0.3 * number / len(finalists), promise.candidate.title)
        paths = (*state.paths, *promise.candidate.free)
        plant = bench.train.plant_at(point, paths)
        trials.append(judged(bench, state, promise.candidate, promise.screening, plant, point.starts, count))
    done = {t.candidate for t in trials}
    gain = {promise.candidate: 2.0 * (state.train.cost - point.cost) for promise, point in begun}
    for promise in promises:
        if promise.candidate not in done:
            reached = gain.get(promise.candidate, promise.evidence)
            reason = promise.objection or NO_TRACE
            if promise.candidate in gain:
                reason = FAR_LESS if np.isfinite(reached) else UNSTABLE
            trials.append(
                Trial(promise.candidate, None, reached if np.isfinite(reached) else 0.0, 0.0, promise.screening, reason)
            )
    return sorted(trials, key=lambda t: -t.total)


def _promises(bench: Workbench, state: State, left: Sequence[Candidate], bar: float) -> list[_Promise]:
    """What one step with each candidate promises, from the state and from it with coefficients as given."""
    bases = [state]
    other = _with_given_coefficients(bench, state)
    if other is not None:
        bases.append(other)
    found: dict[Candidate, list[_Promise]] = {c: [] for c in left}
    for base in bases:
        seen = screen(bench.train, base.train, state.paths, left, base.colour, bar)
        for promise in _jumped(bench, state, base, [s for s in seen if s.seen >= SEEN]):
            found[promise.candidate].append(promise)
        for s in seen:
            if s.seen < SEEN:
                by = f": {s.unseen}" if s.unseen else ""
                found[s.candidate].append(_Promise(s.candidate, s, (), 0.0, UNSEEN + by))
    result = []
    for several in found.values():
        points = sorted((p for one in several for p in one.points), key=lambda p: p.cost)
        best = max(several, key=lambda one: one.evidence)
        objection = "" if points else best.objection
        result.append(replace(best, screening=several[0].screening, points=tuple(points), objection=objection))
    return sorted(result, key=lambda p: -p.evidence)


def _jumped(bench: Workbench, state: State, base: State, seen: Sequence[Screening]) -> list[_Promise]:
    """Promises of candidates from one base: points one step away, and the evidence of the best."""
    groups, steps, owners, points = [], [], [], {s.candidate: [] for s in seen}
    for s in seen:
        for step in KINKED_STEPS if s.candidate.kinked else KINKED_STEPS[:1]:
            groups.append(s.candidate.paths)
            steps.append(step)
            owners.append(s.candidate)
    # a period means something only once it is the best one: those candidates step from a point of their own
    shared = [i for i, owner in enumerate(owners) if not owner.period]
    reached: list[tuple[Candidate, Point]] = []
    if shared:
        found = bench.train.jumps(base.train, state.paths, [groups[i] for i in shared], [steps[i] for i in shared])
        reached += zip([owners[i] for i in shared], found, strict=True)
    for s in seen:
        if s.candidate.period:
            vector = base.train.vector.copy()
            vector[bench.train.index[s.candidate.period]] = s.period
            here = replace(base.train, vector=vector)
            reached.append((s.candidate, bench.train.jumps(here, state.paths, [s.candidate.paths], [1.0])[0]))
    for candidate, point in reached:
        points[candidate].append(point)
    result = []
    for s in seen:
        mine = sorted(points[s.candidate], key=lambda p: p.cost)
        result.append(_Promise(s.candidate, s, tuple(mine), max(_gained(bench, state, mine[0]), s.evidence)))
    return result


def _gained(bench: Workbench, state: State, there: Point) -> float:
    """Evidence for a point by the colour that it leaves: what is missing colours a residual, and would hide itself."""
    if not np.isfinite(there.cost):
        return 0.0
    return evidence(bench.train, state.train, there, np.minimum(state.colour, colour(bench.train, there)))


def _short_list(promises: Sequence[_Promise], bar: float, plain: Collection[str]) -> list[_Promise]:
    """The candidates that are worth a fit, most promising first.

    Also those that gain most if residuals are taken for white: one step away from a state, slow residuals say little.
    """
    worth = [p for p in promises if p.points and p.evidence >= LEAST_TRACE * bar]
    best = worth[0].evidence if worth else 0.0
    known = [not set(plain).isdisjoint(p.candidate.paths) for p in worth]
    as_white = sorted(worth, key=lambda p: p.points[0].cost)[:FINALISTS]
    return [p for i, p in enumerate(worth) if i < SHORT_LIST or p.evidence >= CLOSE * best or known[i] or p in as_white]


def _begun(bench: Workbench, state: State, promise: _Promise) -> tuple[_Promise, Point]:
    """The promise with the best point after a few iterations from each of several first values."""
    problem, paths = bench.train, (*state.paths, *promise.candidate.free)
    points = list(promise.points[:2])
    period = {promise.candidate.period: promise.screening.period} if promise.candidate.period else {}
    for values in _first_values(state.plant, promise.screening):
        plant = replace_at(state.plant, dict(zip(promise.candidate.paths, values, strict=True)) | period)
        points.append(problem.point(plant.vector, state.train.starts, paths))
    points = sorted((p for p in points if np.isfinite(p.cost)), key=lambda p: p.cost) or points[:1]
    # a vehicle of many states shows at once which start is good, and its fits are dear
    few = len(problem.start_states) <= FEW_STATES
    found = [
        problem.solve(problem.plant_at(p, paths), paths, p.starts, FIRST_ITERATIONS, 1e-5, state.train)
        for p in (points if few else points[:2])
    ]
    return promise, min(found, key=lambda point: point.cost)


def _finalists(
    state: State, begun: Sequence[tuple[_Promise, Point]], plain: Collection[str]
) -> list[tuple[_Promise, Point]]:
    finite = sorted((b for b in begun if np.isfinite(b[1].cost)), key=lambda b: b[1].cost)
    best = state.train.cost - finite[0][1].cost if finite else 0.0
    known = [not set(plain).isdisjoint(b[0].candidate.paths) for b in finite]
    return [
        b for i, b in enumerate(finite) if i < FINALISTS or state.train.cost - b[1].cost >= CLOSER * best or known[i]
    ]


def _with_given_coefficients(bench: Workbench, state: State) -> State | None:
    """The state with its coefficients as the vehicle was given, if the fit has taken them far from there.

    Coefficients that were fitted without the missing effect may be so wrong that its signature at them means nothing.
    """
    given = given_values(bench.plant, state)
    if not given:
        return None
    other = bench.fit(replace_at(state.plant, given), (), state)
    return other if np.isfinite(other.train.cost) else None


def judged(bench, state: State, candidate: Candidate, screening: Screening, plant: Plant, starts, count: int) -> Trial:
    """The trial of a candidate fitted from a plant and its starts."""
    paths = (*state.paths, *candidate.free)
    best = bench.train.solve(plant, paths, starts, ITERATIONS, 1e-5, state.train)
    plant = bench.train.plant_at(best, paths)
    held = bench.held.solve(plant, (), state.held.starts, 12, 1e-5, state.held)
    after = State(plant, paths, best, held, colour(bench.train, best))
    found = gate(bench, state, after, [(candidate, screening)], count)
    return Trial(candidate, after, found.train, found.held, screening, found.objection)


def gate(
    bench: Workbench, before: State, after: State, added: Sequence[tuple[Candidate, Screening]], count: int
) -> Weighed:
    """What speaks for candidates, as one change, and the objection to them; what is no longer free has gone already.

    count: of all candidates, for the bar; periods that were tried count, too.
    """
    free = [p for candidate, _ in added for p in candidate.free if p in after.paths]
    paths = [p for candidate, _ in added for p in candidate.paths if p in after.paths]
    tried = sum(screening.tried - 1 for _, screening in added)

    def reach() -> list[float]:
        intervals = bench.intervals(after)
        return [intervals[path][2] for path in paths]

    sizes = [effect_size(after.plant, path) for path in paths]
    return weighed(bench, before, after, sizes, reach, threshold(count + tried, len(free)))


def _first_values(plant: Plant, screening: Screening) -> list[tuple[float, ...]]:
    """Where to start a fit: at the screening's estimate, one probe off neutral on the side it points to, and opposite.

    Coefficients that were fitted without the effect may turn the estimate's sign, and a fit then stays on that side.
    """
    starts = []
    for far in (False, True):
        values = []
        for path, estimate in zip(screening.candidate.paths, screening.estimate, strict=True):
            spec = spec_at(plant, path)
            side = 1.0 if estimate >= 0.0 or spec.bounds[0] >= spec.neutral else -1.0
            if screening.candidate.kinked:
                side = 1.0
            size = np.clip(abs(estimate), 1.0, 12.0) if far else 1.0
            values.append(float(np.clip(spec.neutral + side * size * spec.probe, *spec.bounds)))
        starts.append(tuple(values))
    if screening.candidate.kinked:
        starts.append(
            tuple(
                min(v + 5.0 * spec_at(plant, p).probe, spec_at(plant, p).bounds[1])
                for p, v in zip(screening.candidate.paths, starts[0], strict=True)
            )
        )
    elif len(screening.candidate.paths) == 1:
        spec = spec_at(plant, screening.candidate.paths[0])
        opposite = float(np.clip(2.0 * spec.neutral - starts[0][0], *spec.bounds))
        starts += [(opposite,)] * (opposite != spec.neutral)
    return list(dict.fromkeys(starts))
