"""When it began: effects and coefficients that act from a time on, until a time, or more and more along a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from auv_gym.param import spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.changes.forms import Changeable, Sized, in_form, kind_of, sized, tied_names, usable_log
from identification.deciding import BLOCKS, DOUBT, MISSED, MOST_EFFECTS, MOST_PARTS
from identification.diagnosis.log.checking import Asked, CheckedLog
from identification.diagnosis.log.parts import Part, block_numbers
from identification.diagnosis.search.attribution import Round, selected, settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, Screening, screen
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.trials import Progress, quieted
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, Course, changed
from identification.fit.filtering import Point
from identification.fit.linearised import at_once
from identification.fit.prediction_errors import PredictionErrors

FROM, UNTIL, GROWING = "from", "until", "growing"
_SCANNED = 12  # rows of a profile at first, in the time between two that were screened
_REACH = 1.5  # such times to either side, that a profile covers at first
_DROP = 0.5 * float(chi2.isf(MISSED, 1))  # of the log-likelihood, at the ends of a time's interval


@dataclass(frozen=True)
class Timed:
    """An effect, or a change of a coefficient, and when it acts.

    form: "" throughout, else "from" or "until" a time, or "growing" from the log's beginning to its end, where `size`
    is that at the end.  time: s, as the log counts, with its 95 % interval by the profile of the likelihood; None
    throughout and growing.  evidence: twice the gain in log-likelihood.  tied: what else would explain it as well.
    """

    path: str
    title: str
    unit: str
    form: str
    size: Sized
    evidence: float
    time: Sized | None = None
    tied: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Timeline:
    """What `find_onsets` found; candidates: how many forms and times were tried; notes: on the log."""

    found: tuple[Timed, ...]
    candidates: int
    plant: Plant
    notes: tuple[str, ...] = ()


def find_onsets(
    record: Record,
    plant: Plant,
    *,
    most: int = MOST_EFFECTS,
    doubt: float = DOUBT,
    trust: bool = False,
    progress: Progress = lambda fraction, text: None,
) -> Timeline:
    """Effects that a plant is missing in a record, each in the form in time that explains it best.

    A search as that of a diagnosis, in which each effect is a candidate throughout, from and until each of 23 times,
    and growing, and each coefficient one from these times on, and growing; the bar counts them all.  The time is then
    sought between the 23, and its interval by profile.  Parts are interleaved, so that each has a share of every time.
    Raises ValueError of a record that cannot be used or looks mislabelled.
    """
    log = usable_log(record, plant, Asked(most=most, doubt=doubt, trust=trust))
    may = Changeable.of(plant, log.record, doubt)
    parts, edges = _interleaved(log)
    forms = _courses(edges)
    own = {name: may.paths if kind_of(name) == UNTIL else [*may.coefficients, *may.paths] for name in forms}
    changing = ChangingPlant.of(log.plant, own, forms)
    known = fit_known(replace(log, plant=changing, parts=parts), progress)
    wanted = [(c, kind) for c in may.effects for kind in (FROM, UNTIL, GROWING)]
    wanted += [(c, kind) for c in may.refitted(known) for kind in (FROM, GROWING)]
    groups = [[in_form(c, name) for name in forms if kind_of(name) == kind] for c, kind in wanted]
    count = len(may.effects) + sum(map(len, groups))
    bench, state, rounds, times = _searched(known, may.effects, groups, count, most, progress)
    state, rounds = settled(bench, known.nominal, state, rounds, count)
    return Timeline(tuple(_timed(bench, state, rounds, times)), count, plant, tuple(log.record.notes))


def _interleaved(log: CheckedLog) -> tuple[tuple[Part, ...], list[int]]:
    """Parts of every sixth of 24 equal times of a log, and the rows at which these times begin, after the first."""
    stretches = sorted((piece for part in log.parts for piece in part), key=lambda w: w.start)
    rows = np.concatenate([np.arange(w.start, w.stop) for w in stretches])
    block = block_numbers(log.record, stretches, BLOCKS)
    cuts = np.flatnonzero((np.diff(block) != 0) | (np.diff(rows) != 1)) + 1
    parts: list[list[slice]] = [[] for _ in range(MOST_PARTS)]
    for piece in np.split(np.arange(rows.size), cuts):
        parts[block[piece[0]] % MOST_PARTS].append(slice(int(rows[piece[0]]), int(rows[piece[-1]]) + 1))
    edges = rows[np.flatnonzero(np.diff(block) != 0) + 1]
    return tuple(tuple(part) for part in parts if part), edges.tolist()


def _courses(edges: Sequence[int]) -> dict[str, Course]:
    """The forms in which something may change at one of some rows, by name; `from7`: from the seventh row on."""
    count = len(edges) + 1
    found = {f"{FROM}{k}": Course((edge,), (0.0, 1.0)) for k, edge in enumerate(edges, 1)}
    found |= {f"{UNTIL}{k}": Course((edge,), (1.0, 0.0)) for k, edge in enumerate(edges, 1)}
    return found | {GROWING: Course(tuple(edges), tuple((np.arange(count) + 0.5) / count))}


def _searched(
    known: Known,
    effects: Sequence[Candidate],
    groups: Sequence[Sequence[Candidate]],
    count: int,
    most: int,
    progress: Progress,
) -> tuple[Workbench, State, list[Round], dict[str, Sized]]:
    """Forward selection among effects throughout and, of each group, the member that promises most just then.

    The time of what is chosen is sought at once between those of the group: what is a little late or early leaves
    enough to see for more of the same.  Returned are the bench with these times, state, rounds, and times by form.
    """
    bench, state, rounds, times = known.bench, known.nominal, [], dict[str, Sized]()
    for number in range(most):
        share = 0.1 + 0.75 * number / most
        progress(share, "screening the times")
        left = [*effects, *_best_members(bench, state, groups, threshold(count))]
        made = selected(bench, state, left, count, (), lambda f, text, s=share: progress(s, text))
        if made.chosen is None or made.chosen.state is None:
            break
        rounds.append(made)
        state, own = made.chosen.state, made.chosen.candidate
        form = changed(own.paths[0])[0]
        if kind_of(form) in (FROM, UNTIL):
            bench, state, times[form] = _moved_to_best(bench, state, form)
        effects = [c for c in effects if c is not own]
        groups = [group for group in groups if own not in group]
    return bench, state, rounds, times


def _best_members(bench: Workbench, state: State, groups: Sequence[Sequence[Candidate]], bar: float) -> list[Candidate]:
    """Of each group, the candidate of most evidence by regression, with the noises as they are or weaker ones."""
    best, every = dict[Candidate, Screening](), [c for group in groups for c in group]
    for base in (state, *quieted(bench, state)):
        for some in at_once(len(every), bench.problem.measured.size):
            for found in screen(bench.problem, base.point, state.paths, every[some], bar):
                if found.candidate not in best or found.evidence > best[found.candidate].evidence:
                    best[found.candidate] = found
    return [max(group, key=lambda c: best[c].evidence) for group in groups if group]


def _timed(bench: Workbench, state: State, rounds: Sequence[Round], times: Mapping[str, Sized]) -> list[Timed]:
    """What was chosen, with sizes and times."""
    chosen = [(r, p) for r in rounds if r.chosen for p in r.chosen.candidate.paths if p in state.paths]
    found = []
    for made, name in chosen:
        assert made.chosen is not None
        form, path = changed(name)
        spec, size = spec_at(state.plant, path), sized(bench, state, {name: 1.0})
        told = (spec.title or path, spec.unit, kind_of(form), size, made.evidence[0])
        found.append(Timed(path, *told, times.get(form), tied_names([made])))
    return found


def _moved_to_best(bench: Workbench, state: State, form: str) -> tuple[Workbench, State, Sized]:
    """The state with a form's edge where it is likeliest, the bench of that, and the time with its interval.

    Sought among rows about it, since commands that change make several likely ones, then by steps that are halved;
    parameters and starts refitted with the filter's gains held.  The interval ends at
    the first rows where the log-likelihood has fallen by `_DROP`.
    """
    problem, time = bench.problem, bench.record.time
    plant = problem.plant
    assert isinstance(plant, ChangingPlant)
    low, high = int(problem.rows[0]) + 1, int(problem.rows[-1])
    tried: dict[int, tuple[float, PredictionErrors, Point]] = {}

    def likely(row: int) -> float:
        if row not in tried:
            other = copy(problem)
            course = replace(plant.courses[form], edges=(row,))
            other.plant = replace(plant, courses={**plant.courses, form: course})
            near = tried[best][2] if tried else state.point
            point = other.descended(other.with_gains(near, near.vector), state.paths, exact=True)
            tried[row] = other.objective(point, state.paths), other, point
        return tried[row][0]

    best, cell = plant.courses[form].edges[0], len(problem.rows) / BLOCKS
    step = max(round(cell / _SCANNED), 1)
    scan = range(max(low, best - round(_REACH * cell)), min(high, best + round(_REACH * cell)) + 1, step)
    likely(best)
    best = max(scan, key=likely)
    while step:
        row = max((r for r in (best - step, best + step) if low <= r <= high), key=likely, default=best)
        if likely(row) > likely(best):
            best = row
        else:
            step //= 2
    within = [r for r in tried if likely(r) > likely(best) - _DROP]
    ends = [_end(likely, best, side, limit) for side, limit in ((min(within), low), (max(within), high))]
    _, moved, point = tried[best]
    other = copy(bench)
    other.problem, other.plant = moved, moved.plant
    point = moved.solve(moved.plant_at(point, state.paths), state.paths, point, iterations=4)
    reached = State(moved.plant_at(point, state.paths), state.paths, point)
    return other, reached, Sized(float(time[best]), (float(time[ends[0]]), float(time[ends[1]])))


def _end(likely: Callable[[int], float], best: int, inner: int, limit: int) -> int:
    """The first row from an inner one towards a limit where the likelihood has fallen by `_DROP`, or the limit."""
    side, reach, outer = (1 if limit > best else -1), 1, inner
    while outer != limit and likely(outer) > likely(best) - _DROP:
        inner, outer = outer, outer + side * min(reach, abs(limit - outer))
        reach *= 2
    while abs(outer - inner) > 1:
        middle = (inner + outer) // 2
        inner, outer = (inner, middle) if likely(middle) <= likely(best) - _DROP else (middle, outer)
    return outer
