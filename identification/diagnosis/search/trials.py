"""Fits of candidates: a short list by what one step of each promises, then whole fits, then the gate."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.deciding import (
    CLOSE,
    CLOSER,
    FINALISTS,
    HERE,
    HOPELESS,
    LEAST_TRACE,
    PART_LEVEL,
    PRICE,
    PROMISED,
    SEEN,
    SHORT_LIST,
)
from identification.diagnosis.search.acceptance import Weighed, effect_size, weighed
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, Regression, Screening, part_of
from identification.diagnosis.search.workbench import State, Workbench, tried
from identification.fit.parameters import kinked

FIRST_ITERATIONS = 2  # of the short list
NO_TRACE = "leaves no trace in the residual"
FAR_LESS = "explains far less than the others"
IDLE_PART = "its part of the vehicle shows no missing effect"
UNSTABLE = "no stable run with it"
NO_TIME = "was not fitted to the end, for want of time"
_FITTING = "fitted all effects that look promising to the end"
UNSEEN = "not detectable in this log"

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate fitted jointly with everything fitted before it.

    train, held: evidence for it in all rows, and in parts foretold by the others.  objection: why it is
    not accepted, or "".
    """

    candidate: Candidate
    state: State | None
    train: float
    held: float
    screening: Screening
    objection: str

    @property
    def price(self) -> float:
        """What a second component or a sought period is expected to gain by chance."""
        return PRICE * (len(self.candidate.paths) - 1 + float(np.log(self.screening.tried)))

    @property
    def total(self) -> float:
        """Evidence, less its price."""
        return self.train - self.price


def trials_of(
    bench: Workbench,
    state: State,
    left: Sequence[Candidate],
    count: int,
    progress: Progress,
    plain: Collection[str],
) -> list[Trial]:
    """A trial for each candidate beside what was fitted before, most evidence first.

    count: of all candidates.  plain: paths that are fitted to the end whatever they promise.
    """
    progress(0.0, "screening")
    screened, bases, first = _screened(bench, state, left, threshold(count))
    listed = _short_list(screened, list(first)[:HERE], threshold(count), plain)

    progress(0.2, "trying what is promising")

    wanted = list(dict.fromkeys(bases[s.candidate] for s in listed))
    rivals = dict(zip(wanted, side_by_side(partial(rival_of, bench, state), wanted), strict=True))

    def begin(screening: Screening) -> Begun:
        base, here = bases[screening.candidate], first[screening.candidate]
        begun = begun_from(bench, state, base, screening, rivals[base])
        if base is state or begun.promise >= here.evidence or here.evidence < LEAST_TRACE * threshold(count):
            return begun
        # far from where the state is, a few steps may lead nowhere
        return max(begun, begun_from(bench, state, state, here, state), key=lambda one: one.promise)

    begun = side_by_side(begin, listed)
    progress(0.6, "fitting what is left of it")

    finalists = finalists_of(begun, plain, LEAST_TRACE * threshold(count))
    trials = all_finished(bench, state, finalists, count)
    # with too little process noise all promise too much: what finalists keep of it tells by how much
    promised = {b.screening.candidate: b.promise for b in finalists if b.state.quiet and b.promise > 0.0}
    both = [(t.train, promised[t.candidate]) for t in trials if t.candidate in promised]
    kept = float(np.clip(max((train / promise for train, promise in both), default=1.0), 0.0, 1.0))
    gain = {b.screening.candidate: b.promise * (kept if b.state.quiet else 1.0) for b in begun}
    late = _overtaken(begun, trials, gain, threshold(count))
    if late and bench.goes_on(_FITTING):
        trials += all_finished(bench, state, late, count)
    done, chosen = {t.candidate for t in trials}, {b.screening.candidate for b in (*finalists, *late)}
    for screening in screened:
        if screening.candidate not in done:
            reached = gain.get(screening.candidate, screening.evidence)
            reason = NO_TRACE if reached < LEAST_TRACE * threshold(count) else FAR_LESS
            if screening.candidate in chosen:
                reason = NO_TIME
            if screening.chance >= PART_LEVEL:
                reason = IDLE_PART
            if screening.seen < SEEN:
                reason = UNSEEN + (f": {screening.unseen}" if screening.unseen else "")
            elif not np.isfinite(reached):
                reason = UNSTABLE
            size = reached if np.isfinite(reached) else 0.0
            trials.append(Trial(screening.candidate, None, size, 0.0, screening, reason))
    return sorted(trials, key=lambda t: -t.total)


def _screened(
    bench: Workbench, state: State, left: Sequence[Candidate], bar: float
) -> tuple[list[Screening], dict[Candidate, State], dict[Candidate, Screening]]:
    """The screening of each candidate, most promising first, the state in which it promised that, and those here.

    From the state; from it with the coefficients as given, since those that were fitted without the missing effect may
    be so wrong that its signature at them means nothing; and from it with less process noise, which may have grown to
    take the effect's part, and then leaves little of it to see.
    """
    problem = bench.problem
    found: dict[Candidate, Screening] = {}
    bases: dict[Candidate, State] = {}
    here: dict[Candidate, Screening] = {}
    for base in (state, *bench.with_given(state), *bench.quieted(state)):
        regression = Regression(problem, base.point, state.paths, bar)
        less, times = _behind(bench, state, base, regression), misjudged(bench, base)
        promising = regression.screened(left)
        here = here or {s.candidate: s for s in promising}
        for s in promising:
            evidence, parameters = s.together
            together = (evidence / times - less, parameters)
            s = replace(s, evidence=s.evidence / times - less, together=together)
            if s.candidate in found:  # what any of the states shows of a part is worth a search
                likelier = min(s, found[s.candidate], key=lambda one: one.chance).together
                s, found[s.candidate] = (replace(one, together=likelier) for one in (s, found[s.candidate]))
            if s.candidate not in found:
                found[s.candidate], bases[s.candidate] = s, base
            elif s.evidence > found[s.candidate].evidence:
                # the detectable size rests on the noise as it was found
                found[s.candidate], bases[s.candidate] = replace(s, detectable=found[s.candidate].detectable), base
    return sorted(found.values(), key=lambda s: -s.evidence), bases, here


def _behind(bench: Workbench, state: State, base: State, regression: Regression) -> float:
    """By how much a base, its fitted parameters moved as a regression promises, is less likely than the state.

    What a poorer base leaves is not evidence for a candidate.  With the noises of the base, by which evidence is
    counted there: process noise that makes up for wrong coefficients has made all evidence small.
    """
    if base is state or base.quiet:
        return 0.0
    rival, problem = rival_of(bench, state, base), bench.problem
    ahead = problem.objective(rival.point, state.paths) - problem.objective(base.point, state.paths)
    return max(2.0 * ahead - regression.regained, 0.0)


def misjudged(bench: Workbench, base: State) -> float:
    """How much too large evidence beside a state is, whose process noise is taken for weaker than suits it."""
    if not base.quiet:
        return 1.0
    squares = float((base.point.errors**2 * bench.problem.counted[:, None]).sum())
    return max(squares / max(bench.problem.count, 1), 1.0)


def _short_list(
    screened: Sequence[Screening], here: Collection[Candidate], bar: float, plain: Collection[str]
) -> list[Screening]:
    """The candidates that are worth a fit, most promising first.

    here: those that promise most from the state as it is.  Where random accelerations are taken for weaker than they
    are, what they do looks like many effects, and these would be all of the list.
    """
    # none for what cannot be seen; where candidates are many, none of a part that shows nothing: one effect that is
    # plain to see may be lost in the evidence for all effects of a large part
    loud = {part_of(s.candidate.paths[0]) for s in screened if s.evidence >= bar}
    worth = [
        s
        for s in screened
        if s.evidence >= LEAST_TRACE * bar
        and (
            s.chance < PART_LEVEL
            or part_of(s.candidate.paths[0]) in loud
            or not set(plain).isdisjoint(s.candidate.paths)
        )
    ]
    best = worth[0].evidence if worth else 0.0
    known = [s.candidate in here or not set(plain).isdisjoint(s.candidate.paths) for s in worth]
    return [s for i, s in enumerate(worth) if i < SHORT_LIST or s.evidence >= CLOSE * best or known[i]]


@dataclass(frozen=True, eq=False)
class Begun:
    """A candidate's state after few steps; promise: twice the gain in log-likelihood there."""

    screening: Screening
    state: State
    promise: float


def rival_of(bench: Workbench, state: State, base: State) -> State:
    """What a candidate that begins at a base is compared with: as many steps of what is free without it.

    With weaker accelerations, or other coefficients, these alone bring much, which is no evidence for any candidate;
    nor is what brings a base that is far from the record nearer to it, but not as near as the state with the noises of
    the base: with weaker accelerations, or as it is where these cannot be.
    """
    if base is state:
        return state
    problem, paths = bench.problem, state.paths
    point = problem.descended(base.point, paths, FIRST_ITERATIONS)
    there = State(problem.plant_at(point, paths), paths, point, base.quiet)
    if base.quiet:
        rivals = bench.quieted(state) or (state,)
    else:
        rivals = (replace(state, point=problem.point(state.point.vector, base.point.logs, state.point)),)
    return max((there, *rivals), key=lambda one: problem.objective(one.point, paths))


def begun_from(bench: Workbench, state: State, base: State, screening: Screening, rival: State) -> Begun:
    """The candidate's state after steps with the gains of a state without it, from its likeliest first values.

    rival: what it promises more than.
    """
    problem, candidate = bench.problem, screening.candidate
    paths = (*state.paths, *candidate.free)
    period = {candidate.period: screening.period} if candidate.period else {}
    vectors = [
        replace_at(base.plant, dict(zip(candidate.paths, values, strict=True)) | period).vector
        for values in _first_values(base.plant, screening)
    ]
    points = [problem.with_gains(base.point, vector) for vector in vectors]
    if screening.beside.size:  # where little of its signature is its own, the fitted ones must move with it, and starts
        moved = replace_at(base.plant, period).vector
        step = np.r_[screening.beside, screening.estimate]
        vector = problem.moved_vector(moved, (*state.paths, *candidate.paths), step)
        points.append(problem.descended(problem.with_gains(base.point, vector), ()))
    finite = [p for p in points if np.isfinite(p.scores).all()]  # NaN would win against everything after it
    best = max(finite or points[:1], key=lambda p: problem.objective(p, paths))
    point = problem.descended(best, paths, FIRST_ITERATIONS)
    first = State(problem.plant_at(point, paths), paths, point, base.quiet)
    promise = bench.gain(rival, first) / misjudged(bench, base) if first.finite else -np.inf
    return Begun(screening, first, promise)


def _finished(bench: Workbench, state: State, begun: Begun, count: int) -> Trial:
    """The trial of a candidate that was begun, with the noises that suit it."""
    near, paths = begun.state, begun.state.paths
    if near.quiet:
        near = State(near.plant, paths, bench.problem.renewed(near.point, state.point.logs, paths))
    return judged(bench, state, begun.screening.candidate, begun.screening, near, count)


def all_finished(bench: Workbench, state: State, begun: Sequence[Begun], count: int) -> list[Trial]:
    """The trials of candidates that were begun, the first one whatever it takes."""

    def finish(one: Begun) -> Trial | None:
        if one is not begun[0] and not bench.goes_on(_FITTING):
            return None
        return _finished(bench, state, one, count)

    return [trial for trial in side_by_side(finish, begun) if trial is not None]


def finalists_of(begun: Sequence[Begun], plain: Collection[str], least: float) -> list[Begun]:
    """Those of the short list that are fitted to the end: by what they promise, which must be the least or more."""
    worth = (b for b in begun if b.promise >= least or not set(plain).isdisjoint(b.screening.candidate.paths))
    finite = sorted((b for b in worth if np.isfinite(b.promise)), key=lambda b: -b.promise)
    best = finite[0].promise if finite else 0.0
    known = [not set(plain).isdisjoint(b.screening.candidate.paths) for b in finite]
    return [b for i, b in enumerate(finite) if i < FINALISTS or b.promise >= CLOSER * best or known[i]]


def _overtaken(
    begun: Sequence[Begun], trials: Sequence[Trial], gain: Mapping[Candidate, float], bar: float
) -> list[Begun]:
    """Those that were no finalists, and yet promise more than any of these reached, once all promises are true.

    Where none of these was accepted, half of the bar is enough of what was begun with random accelerations as strong as
    they are: such promises are true, less than whole fits bring, and what weaker accelerations promise has hidden them.
    gain: the true promises.
    """
    done = {t.candidate for t in trials}
    reached = max((t.train for t in trials if not t.objection), default=0.0)
    left = [
        b
        for b in begun
        if b.screening.candidate not in done
        and gain[b.screening.candidate] > max(reached, bar * (1.0 if b.state.quiet else PROMISED))
    ]
    return sorted(left, key=lambda b: -gain[b.screening.candidate])[:FINALISTS]


def judged(
    bench: Workbench, state: State, candidate: Candidate, screening: Screening, near: State, count: int
) -> Trial:
    """The trial of a candidate fitted from a state near by; what is accepted may fail to be `sure`."""
    reached = bench.likelier_from_given(tried(bench.problem, near), HOPELESS)
    found = gate(bench, state, reached, [(candidate, screening)], count, soon=True)
    return Trial(candidate, reached, found.train, found.held, screening, found.objection)


def sure(bench: Workbench, state: State, trial: Trial, count: int) -> Trial:
    """A trial beside a state, with all that the gate asks: what takes long is asked of few."""
    if trial.objection or trial.state is None:
        return trial
    found = gate(bench, state, trial.state, [(trial.candidate, trial.screening)], count)
    return replace(trial, train=found.train, held=found.held, objection=found.objection)


def gate(
    bench: Workbench,
    before: State,
    after: State,
    added: Sequence[tuple[Candidate, Screening]],
    count: int,
    soon: bool = False,
) -> Weighed:
    """What speaks for candidates, as one change, and the objection to them; what is no longer free has gone already.

    count: of all candidates, for the bar; periods that were tried count, too.  soon: for a first judgement, by
    which parts are told by responses and intervals are those of white errors.
    """
    free = [p for candidate, _ in added for p in candidate.free if p in after.paths]
    paths = [p for candidate, _ in added for p in candidate.paths if p in after.paths]
    tried = sum(screening.tried - 1 for _, screening in added)

    def reach() -> list[float]:
        if soon:
            return bench.half_widths_if_white(after, paths)
        intervals = bench.intervals(after)
        return [intervals[path][2] for path in paths]

    sizes = [effect_size(after.plant, path, bench.problem.bounds(path)) for path in paths]
    return weighed(bench, before, after, sizes, reach, threshold(count + tried, len(free)), soon)


def _first_values(plant: Plant, screening: Screening) -> list[tuple[float, ...]]:
    """Where to start a fit: at the screening's estimate, one probe off neutral on the side it points to, and opposite.

    Coefficients that were fitted without the effect may turn the estimate's sign, and a fit then stays on that side.
    A probe may be far more than a long record bears: then the estimate is the better start, but for corners, whose
    slopes next to neutral say nothing.
    """
    if screening.candidate.jumps:
        spec = spec_at(plant, screening.candidate.paths[0])
        return [(float(np.clip(spec.neutral + screening.estimate[0] * spec.probe, *spec.bounds)),)]
    starts = []
    for far in (False, True):
        values = []
        for path, estimate in zip(screening.candidate.paths, screening.estimate, strict=True):
            spec = spec_at(plant, path)
            side = 1.0 if estimate >= 0.0 or spec.bounds[0] >= spec.neutral or kinked(path) else -1.0
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
    small = np.abs(screening.estimate).max() < 1.0
    if small and not any(kinked(p) for p in screening.candidate.paths):
        specs = [spec_at(plant, path) for path in screening.candidate.paths]
        estimated = zip(specs, screening.estimate, strict=True)
        starts.append(tuple(float(np.clip(s.neutral + e * s.probe, *s.bounds)) for s, e in estimated))
    return list(dict.fromkeys(starts))
