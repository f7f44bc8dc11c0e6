"""Fits of candidate effects: screening by regression, a few steps for a short list, whole fits, and the gate."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.threads import side_by_side
from identification.deciding import (
    CLOSE,
    CLOSER,
    FINALISTS,
    HELD_BACK,
    HERE,
    HOPELESS,
    LEAST_TRACE,
    PART_LEVEL,
    PRICE,
    PROMISED,
    SEEN,
    SHORT_LIST,
    TIE,
)
from identification.diagnosis.search.acceptance import Size, Weighed, effect_size, weighed
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.begun import Begun, begun_from, misjudged, rival_of
from identification.diagnosis.search.candidates import Candidate, Regression, Screening, part_of
from identification.diagnosis.search.workbench import State, Workbench, tried

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

    train, held: evidence for it in all rows, and in parts predicted from the others.
    objection: the reason why it is not accepted, or "".
    """

    candidate: Candidate
    state: State | None
    train: float
    held: float
    screening: Screening
    objection: str

    @property
    def price(self) -> float:
        """The evidence that a second component or the search for a setting is expected to gain by chance."""
        return PRICE * (len(self.candidate.paths) - 1 + float(np.log(self.screening.tried)))

    @property
    def total(self) -> float:
        """The evidence minus its price."""
        return self.train - self.price


@dataclass(frozen=True, eq=False)
class Screened:
    """The screenings of candidates beside a state and its variants.

    best: the best one of each, most promising first.  bases: the state or the variant of which it is.  here: those
    beside the state itself.  leading: the candidates that lead beside noises that suit: those of the state, and brief
    accelerations instead of lasting ones.
    """

    best: list[Screening]
    bases: dict[Candidate, State]
    here: dict[Candidate, Screening]
    leading: list[Candidate]


def trials_of(
    bench: Workbench,
    state: State,
    left: Sequence[Candidate],
    count: int,
    progress: Progress,
    plain: Collection[str],
) -> list[Trial]:
    """A trial for each candidate beside what was fitted before, most evidence first.

    count: number of all candidates.  plain: paths that are fitted to the end however little they promise.
    """
    progress(0.0, "screening")
    screened = _screened(bench, state, left, threshold(count))
    listed = _short_list(screened.best, screened.leading, threshold(count), plain)

    progress(0.2, "trying what is promising")

    wanted = list(dict.fromkeys(screened.bases[s.candidate] for s in listed))
    rivals = dict(zip(wanted, side_by_side(partial(rival_of, bench, state), wanted), strict=True))

    def begin(screening: Screening) -> Begun:
        base, here = screened.bases[screening.candidate], screened.here[screening.candidate]
        begun = begun_from(bench, state, base, screening, rivals[base])
        if base is state or begun.promise >= here.evidence or here.evidence < LEAST_TRACE * threshold(count):
            return begun
        # a few steps from far away may lead nowhere
        return max(begun, begun_from(bench, state, state, here, state), key=lambda one: one.promise)

    begun = side_by_side(begin, listed)
    progress(0.6, "fitting what is left of it")

    finalists = finalists_of(begun, plain, LEAST_TRACE * threshold(count))
    trials = all_finished(bench, state, finalists, count)
    late = _overtaken(begun, trials, threshold(count))
    if late and bench.goes_on(_FITTING):
        trials += all_finished(bench, state, late, count)
    done, chosen = {t.candidate for t in trials}, {b.screening.candidate for b in (*finalists, *late)}
    promised = {b.screening.candidate: b.promise for b in begun}
    for screening in screened.best:
        if screening.candidate not in done:
            reached = promised.get(screening.candidate, screening.evidence)
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


def _screened(bench: Workbench, state: State, left: Sequence[Candidate], bar: float) -> Screened:
    """The screenings of candidates beside a state and two kinds of variants.

    Variants with the coefficients as given: coefficients that were fitted without the missing effect may be so wrong
    that its signature is meaningless there.  Variants with less process noise: the noise may have grown to absorb the
    effect, and then leaves little of it to see.  Beside brief accelerations of suitable strength, evidence is not
    exaggerated: what passes the bar there comes before what is louder beside accelerations that are merely weakened.
    """
    problem = bench.problem
    found: dict[Candidate, Screening] = {}
    bases: dict[Candidate, State] = {}
    here: dict[Candidate, Screening] = {}
    leading: list[Candidate] = []

    def rank(s: Screening, base: State) -> tuple[bool, float]:
        return base.brief and s.evidence >= bar, s.evidence

    for base in (state, *bench.with_given(state), *bench.quieted(state)):
        regression = Regression(problem, base.point, state.paths, bar)
        less, times = _behind(bench, state, base, regression), misjudged(bench, base)
        promising = regression.screened(left)
        here = here or {s.candidate: s for s in promising}
        if base is state or base.brief:
            leading += [s.candidate for s in promising[:HERE]]
        for s in promising:
            evidence, parameters = s.together
            together = (evidence / times - less, parameters)
            s = replace(s, evidence=s.evidence / times - less, together=together)
            if s.candidate in found:  # a part is searched if any of the states shows something of it
                likelier = min(s, found[s.candidate], key=lambda one: one.chance).together
                s, found[s.candidate] = (replace(one, together=likelier) for one in (s, found[s.candidate]))
            if s.candidate not in found:
                found[s.candidate], bases[s.candidate] = s, base
            elif rank(s, base) > rank(found[s.candidate], bases[s.candidate]):
                # the detectable size is that for the noise as fitted
                found[s.candidate], bases[s.candidate] = replace(s, detectable=found[s.candidate].detectable), base
    best = sorted(found.values(), key=lambda s: rank(s, bases[s.candidate]), reverse=True)
    return Screened(best, bases, here, leading)


def _behind(bench: Workbench, state: State, base: State, regression: Regression) -> float:
    """The evidence by which a base falls short of the state, once its fitted parameters are moved by the regression.

    Errors due to a poorer base are not evidence for a candidate.  The two are compared with the noises of the base,
    with which the evidence there is computed: process noise that compensates wrong coefficients makes all evidence
    small.
    """
    if base is state or base.quiet:
        return 0.0
    rival, problem = rival_of(bench, state, base), bench.problem
    ahead = problem.objective(rival.point, state.paths) - problem.objective(base.point, state.paths)
    return max(2.0 * ahead - regression.regained, 0.0)


def _short_list(
    screened: Sequence[Screening], leading: Collection[Candidate], bar: float, plain: Collection[str]
) -> list[Screening]:
    """The candidates that are worth a fit, most promising first.

    leading: those that promise most beside noises that suit.  With too little process noise, random accelerations look
    like many effects, which would otherwise fill the list.
    """
    # candidates below the least trace are left out.  So are those of a part without evidence, if parts are tested and
    # none of its effects passes the bar alone: a clear effect may be lost among all effects of a large part
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
    best = max((s.evidence for s in worth), default=0.0)
    known = [s.candidate in leading or not set(plain).isdisjoint(s.candidate.paths) for s in worth]
    return [s for i, s in enumerate(worth) if i < SHORT_LIST or s.evidence >= CLOSE * best or known[i]]


def all_finished(bench: Workbench, state: State, begun: Sequence[Begun], count: int) -> list[Trial]:
    """The trials of begun candidates, fitted with the noises that suit them.

    The first one is fitted even if no time is left.  Another one begins in its place, at its end, if it explains the
    record as well there (`TIE`): many candidates act almost alike.
    """
    if not begun:
        return []
    first, *others = begun

    def finish(one: Begun, led: Trial | None = None) -> Trial | None:
        if led is not None and not bench.goes_on(_FITTING):
            return None
        near, settled = one.state, False
        if led is not None and led.state is not None and led.state.finite:
            swapped = _in_place(bench, state, one, first, led.state)
            if bench.gain(swapped, led.state) < TIE:
                near, settled = swapped, True
        return judged(bench, state, one.screening.candidate, one.screening, near, count, settled)

    led = finish(first)
    later = side_by_side(lambda one: finish(one, led), others)
    return [trial for trial in (led, *later) if trial is not None]


def _in_place(bench: Workbench, state: State, one: Begun, first: Begun, reached: State) -> State:
    """A begun candidate at the end of the first one's fit, in its place, of a size that has grown as much."""
    own, other = one.screening.candidate, first.screening.candidate
    grown = 1.0
    if len(other.paths) == 1:
        (path,) = other.paths
        begun, ended = (
            value_at(plant, path) - value_at(state.plant, path) for plant in (first.state.plant, reached.plant)
        )
        grown = ended / begun if begun else 1.0
    values = {p: value_at(one.state.plant, p) for p in own.free}
    for p in own.paths:
        neutral = value_at(state.plant, p)
        values[p] = float(np.clip(neutral + grown * (values[p] - neutral), *bench.problem.bounds(p)))
    plant = replace_at(reached.plant, {p: value_at(state.plant, p) for p in other.free} | values)
    return State(plant, one.state.paths, bench.problem.with_gains(reached.point, plant.vector))


def finalists_of(begun: Sequence[Begun], plain: Collection[str], least: float) -> list[Begun]:
    """The begun candidates to fit to the end: the most promising with at least `least`, and all of `plain`.

    Those begun beside less process noise are a group of their own: whole fits gain more than they promise, unless that
    is hopeless.
    """

    def leading(quiet: bool) -> list[Begun]:
        enough = -HOPELESS if quiet else least
        own = [b for b in begun if b.quiet == quiet and np.isfinite(b.promise)]
        best = max((b.promise for b in own), default=0.0)
        known = [b for b in own if not set(plain).isdisjoint(b.screening.candidate.paths)]
        worth = sorted((b for b in own if b.promise >= enough or b in known), key=lambda b: -b.promise)
        return [b for i, b in enumerate(worth) if i < FINALISTS or b.promise >= CLOSER * best or b in known]

    return sorted((*leading(False), *leading(True)), key=lambda b: -b.promise)


def _overtaken(begun: Sequence[Begun], trials: Sequence[Trial], bar: float) -> list[Begun]:
    """The begun candidates that were no finalists but promise more than any accepted finalist has gained.

    They must also promise half of the bar (`PROMISED`).
    """
    done = {t.candidate for t in trials}
    reached = max((t.train for t in trials if not t.objection), default=0.0)
    left = [b for b in begun if b.screening.candidate not in done and b.promise > max(reached, PROMISED * bar)]
    return sorted(left, key=lambda b: -b.promise)[:FINALISTS]


def judged(
    bench: Workbench,
    state: State,
    candidate: Candidate,
    screening: Screening,
    near: State,
    count: int,
    settled: bool = False,
) -> Trial:
    """The trial of a candidate fitted from a nearby state, by a first judgement; see `sure` for the complete gate.

    settled: whether the nearby state is where the fit of an effect that acts alike has ended, which has tried weaker
    accelerations and the coefficients as given.
    """
    reached = tried(bench.problem, near, settled)
    if not settled:
        reached = bench.likelier_from_given(reached, HOPELESS)
    found = gate(bench, state, reached, [(candidate, screening)], count, soon=True)
    return Trial(candidate, reached, found.train, found.held, screening, found.objection)


def sure(bench: Workbench, state: State, trial: Trial, count: int) -> Trial:
    """A trial judged by the complete gate, which takes long and is therefore applied to few."""
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
    """The evidence for candidates as one change of the model, and the objection to it.

    Only paths that are still free in `after` count.
    count: number of all candidates, for the bar; the tried settings are added.  soon: make a first judgement, by
    responses where there are any, and by intervals for white errors of known noise.
    """
    free = [p for candidate, _ in added for p in candidate.free if p in after.paths]
    paths = [p for candidate, _ in added for p in candidate.paths if p in after.paths]
    tried = sum(screening.tried - 1 for _, screening in added)

    def reach() -> list[float]:
        halves = bench.half_widths_if_white(after, paths) if soon else [bench.intervals(after)[p][2] for p in paths]
        return [_inward(bench, after, p) if at_bound[p] else half for p, half in zip(paths, halves, strict=True)]

    at_bound = {p: effect_size(after.plant, p, bench.problem.bounds(p)).limited for p in paths}
    sizes = [size_in(bench, after, path) for path in paths]
    return weighed(bench, before, after, sizes, reach, threshold(count + tried, len(free)), soon)


def size_in(bench: Workbench, state: State, path: str) -> Size:
    """The size of a fitted effect; it counts as limited only if the record asks for more than its bound allows.

    A thruster that has lost all of its thrust is at a bound, and is best described there.
    """
    size = effect_size(state.plant, path, bench.problem.bounds(path))
    return replace(size, limited=size.limited and _held_back(bench, state, path))


def _held_back(bench: Workbench, state: State, path: str) -> bool:
    """Whether the errors of a state ask for a value beyond the bound at which a path is: `HELD_BACK` deviations more.

    It is a score test (Rao 1948, Mathematical Proceedings of the Cambridge Philosophical Society 44) with all other
    fitted parameters free.
    """
    problem, value = bench.problem, value_at(state.plant, path)
    regression = Regression(problem, state.point, [p for p in state.paths if p != path], 0.0)
    (slope,) = regression.beside(problem.flat_slopes(state.point, [path]))
    outward = 1.0 if value > spec_at(state.plant, path).neutral else -1.0
    return float(outward * (slope @ regression.left)) > HELD_BACK * float(np.linalg.norm(slope))


def _inward(bench: Workbench, state: State, path: str) -> float:
    """How far the 95 % interval of an effect at a bound reaches towards neutral.

    It is by the likelihood profile: where an actuator has no travel left, the slopes say nothing.
    """
    value, ends = value_at(state.plant, path), bench.interval(state, path)
    return min(abs(value - end) for end in ends if end != value) if ends[0] < ends[1] else 0.0
