"""The search in time: effects and changes of coefficients that begin, end, act between two times, or grow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from auv_gym.param import spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.changes.forms import Changeable, Sized, in_form, kind_of, sized, tied_names, usable_log
from identification.changes.spans import BETWEEN, OUTSIDE, best_spans, spans_of
from identification.changes.times import Located, finer_rows, moved_to_best, placed, split_evidence
from identification.deciding import (
    BLOCKS,
    CLOSE,
    DOUBT,
    FEW_STATES,
    HOPELESS,
    MOST_EFFECTS,
    MOST_PARTS,
    PROMISED,
    TIE,
    TIMED,
    UNSTEADY,
)
from identification.diagnosis.log.checking import Asked, CheckedLog
from identification.diagnosis.log.parts import Part, block_numbers
from identification.diagnosis.search.attribution import Round, selected, settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, Screening, screen, screen_signatures
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.remainder import likeliest_to_change
from identification.diagnosis.search.trials import Progress, Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, Course, changed
from identification.fit.linearised import at_once

FROM, UNTIL, GROWING = "from", "until", "growing"


@dataclass(frozen=True)
class Timed:
    """An effect, or a change of a coefficient, and when it acts.

    form: "" throughout, "from" or "until" a time, "between" two times or "outside" of them, or "growing" from the log's
    beginning to its end (`size` is then that at the end).  time, second: s, in the log's time, with 95 % intervals from
    the likelihood profile; None if the form has none.  evidence: twice the gain in log-likelihood.  tied: what else
    would explain it as well.  steady: whether both halves of the time in which it acts agree on its size; if they
    contradict each other, no form is named.
    """

    path: str
    title: str
    unit: str
    form: str
    size: Sized
    evidence: float
    time: Sized | None = None
    second: Sized | None = None
    tied: tuple[str, ...] = ()
    steady: bool = True


@dataclass(frozen=True, eq=False)
class Timeline:
    """The result of `find_onsets`.

    candidates: number of forms and times that were tried.  span: the first and last time searched, s, in the log's
    time.  notes: on the log.
    """

    found: tuple[Timed, ...]
    candidates: int
    plant: Plant
    span: tuple[float, float]
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
    """Effects that a plant is missing in a record, each in the form in time that explains the record best.

    The search is like that of a diagnosis.  Each effect is a candidate throughout, from and until each of 23 times,
    between and outside of every two of them, and growing; each coefficient is a candidate from each time on, and
    growing.  The bar accounts for all of these candidates.  The times are then refined between the 23, and their
    intervals come from the likelihood profile.  Parts are interleaved, so that each has a share of every time.
    Raises ValueError if the record cannot be used or looks mislabelled.
    """
    log = usable_log(record, plant, Asked(most=most, doubt=doubt, trust=trust))
    may = Changeable.of(plant, log.record, doubt)
    parts, edges = _interleaved(log)
    courses = _courses(edges, len(may.effects))
    own = {name: _paths_of(name, may) for name in courses}
    changing = ChangingPlant.of(log.plant, own, courses)
    known = fit_known(replace(log, plant=changing, parts=parts), progress)
    forms = [Forms.of(c, courses, k) for k, c in enumerate(may.effects)]
    forms += [Forms.of(c, courses) for c in may.refitted(known)]
    count = sum(f.count for f in forms) + 2 * len(spans_of(edges)) * len(may.effects)
    known, state, rounds, times = _beside_noises(known, forms, count, most, progress)
    bench = known.bench
    state, rounds = settled(bench, known.nominal, state, rounds, count)
    span = (float(log.record.time[0]), float(log.record.time[-1]))
    return Timeline(tuple(_timed(bench, state, rounds, times)), count, plant, span, tuple(log.record.notes))


@dataclass(frozen=True)
class Forms:
    """An effect, or a coefficient, in the forms in which it may act.

    throughout: None for a coefficient.  groups: from each of the times on, until each of them, growing.  spans: between
    and outside of two times, which are set once a pair of times looks promising.
    """

    throughout: Candidate | None
    groups: tuple[tuple[Candidate, ...], ...]
    spans: tuple[Candidate, ...] = ()

    @classmethod
    def of(cls, own: Candidate, courses: Mapping[str, Course], number: int | None = None) -> Forms:
        """All forms of an effect with a number, or of a coefficient (number None)."""
        kinds = (FROM, GROWING) if number is None else (FROM, UNTIL, GROWING)
        groups = tuple(tuple(in_form(own, name) for name in courses if kind_of(name) == kind) for kind in kinds)
        if number is None:
            return cls(None, groups)
        spans = (BETWEEN, OUTSIDE) if own.sloped else ()  # found from slopes
        return cls(own, groups, tuple(in_form(own, f"{kind}{number}") for kind in spans))

    @property
    def paths(self) -> set[str]:
        """The paths of what may change."""
        return {changed(p)[1] for c in self.screened for p in c.paths}

    @property
    def count(self) -> int:
        """The number of forms, without those of two times."""
        return (self.throughout is not None) + sum(map(len, self.groups))

    @property
    def screened(self) -> list[Candidate]:
        """The forms that are screened one by one."""
        return [*([self.throughout] if self.throughout else []), *(c for group in self.groups for c in group)]

    def without(self, chosen: Candidate) -> Forms:
        """The forms that are left once one is chosen; spans, built from whole groups, stay only if all groups do."""
        groups = tuple(group for group in self.groups if chosen not in group)
        whole = len(groups) == len(self.groups) and chosen is not self.throughout and chosen not in self.spans
        return Forms(self.throughout if chosen is not self.throughout else None, groups, self.spans if whole else ())


def _paths_of(form: str, may: Changeable) -> list[str]:
    """The paths that may change in a form; for a form of two times, those of the one effect whose number it has."""
    kind = kind_of(form)
    if kind in (BETWEEN, OUTSIDE):
        return list(may.effects[int(form.removeprefix(kind))].paths)
    return may.paths if kind == UNTIL else [*may.coefficients, *may.paths]


def _interleaved(log: CheckedLog) -> tuple[tuple[Part, ...], list[int]]:
    """Parts of every sixth of 24 equal spans of a log, and the rows at which these spans begin, except the first."""
    stretches = sorted((piece for part in log.parts for piece in part), key=lambda w: w.start)
    rows = np.concatenate([np.arange(w.start, w.stop) for w in stretches])
    block = block_numbers(log.record, stretches, BLOCKS)
    cuts = np.flatnonzero((np.diff(block) != 0) | (np.diff(rows) != 1)) + 1
    parts: list[list[slice]] = [[] for _ in range(MOST_PARTS)]
    for piece in np.split(np.arange(rows.size), cuts):
        parts[block[piece[0]] % MOST_PARTS].append(slice(int(rows[piece[0]]), int(rows[piece[-1]]) + 1))
    edges = rows[np.flatnonzero(np.diff(block) != 0) + 1]
    return tuple(tuple(part) for part in parts if part), edges.tolist()


def _courses(edges: Sequence[int], effects: int) -> dict[str, Course]:
    """The forms in which something may change, by name; `from7`: from the seventh of the rows on.

    Forms of two times have an effect's number; their times are not set yet.
    """
    count = len(edges) + 1
    found = {f"{FROM}{k}": Course((edge,), (0.0, 1.0)) for k, edge in enumerate(edges, 1)}
    found |= {f"{UNTIL}{k}": Course((edge,), (1.0, 0.0)) for k, edge in enumerate(edges, 1)}
    for k in range(effects):
        found[f"{BETWEEN}{k}"] = Course((edges[0], edges[-1]), (0.0, 1.0, 0.0))
        found[f"{OUTSIDE}{k}"] = Course((edges[0], edges[-1]), (1.0, 0.0, 1.0))
    return found | {GROWING: Course(tuple(edges), tuple((np.arange(count) + 0.5) / count))}


def _beside_noises(
    known: Known, forms: Sequence[Forms], count: int, most: int, progress: Progress
) -> tuple[Known, State, list[Round], dict[str, list[Located]]]:
    """The search, repeated with waves and correlated sensor errors if its result leaves some.

    Returns the known part, on the bench with the times that were found, and the rest as `searched_in_time` does.
    """
    bench, state, rounds, times = searched_in_time(known, forms, count, most, progress)
    given, nominal = (placed(bench, one, {})[1] for one in (known.given, known.nominal))
    here = replace(known, bench=bench, given=given, nominal=nominal)
    progress(0.85, "looking for waves and for sensor errors that last")
    again = here.beside_noises(state, lambda noisier: _beside_noises(noisier, forms, count, most, progress), count)
    return again or (here, state, rounds, times)


def searched_in_time(
    known: Known, forms: Sequence[Forms], count: int, most: int, progress: Progress
) -> tuple[Workbench, State, list[Round], dict[str, list[Located]]]:
    """Forward selection among effects throughout and, for each form of each, the currently most promising member.

    The times of an effect that is chosen, or nearly, are refined at once: a slightly wrong time would leave an error
    that looks like more of the same effect.  So are those of others that come near it, and all in this form are then
    tried at the best times: one may merely have had the best coarse time.  Effects throughout are tried, too, and win
    unless the times have the evidence that a name needs.  Returns the bench with these times, the state, the rounds,
    and the times by form.
    """
    bench, state, rounds, times = known.bench, known.nominal, [], dict[str, list[Located]]()
    for number in range(most):
        share = 0.1 + 0.75 * number / most
        progress(share, "screening the times")
        left, spans = _promising(bench, state, _contenders(bench, state, forms), threshold(count))
        bench, state = placed(bench, state, spans)
        made = selected(bench, state, left, count, (), lambda f, text, s=share: progress(s, text))
        first = made.chosen or _nearly(made, threshold(count))
        if first is None:
            break
        best, reached = _best_at_its_times(bench, made, first)
        rivals, spans = _at_the_same_times(forms, best.candidate, reached)
        if rivals:
            bench, state = placed(reached.bench, state, spans)
            again = selected(bench, state, rivals, count, ())
            if again.chosen is not None:
                other = reached if again.chosen.candidate is best.candidate else _at_best_times(bench, again.chosen)
                if made.chosen is None or reached.bench.gain(reached.state, other.state) >= 0.0:
                    made, reached = _each_at_its_times(bench, again, other)
        if made.chosen is None:
            break
        if made.chosen is first and best is not first:  # the better one was refused
            reached = _at_best_times(bench, first)
        made, reached = _unless_at_one_time(state, forms, made, reached, count)
        made, reached = _if_at_two_times(state, forms, made, reached, count)
        made, reached = _unless_throughout(state, forms, made, reached, count)
        assert made.chosen is not None
        own, bench, state = made.chosen.candidate, reached.bench, reached.state
        rounds.append(made)
        times[changed(own.paths[0])[0]] = reached.times
        forms = [f.without(own) if own in (*f.screened, *f.spans) else f for f in forms]
    return bench, state, rounds, times


def _contenders(bench: Workbench, state: State, forms: Sequence[Forms]) -> Sequence[Forms]:
    """The forms of the parameters in which sixths of the log seem to differ most, with given or weaker noises.

    All forms for a vehicle of few states; for others, each time of each form needs a costly run of the vehicle.
    """
    if bench.followed <= FEW_STATES:
        return forms
    paths = list(dict.fromkeys(p for f in forms for p in sorted(f.paths)))
    bases = (state, *bench.quieted(state))
    kept = {p for base in bases for p in likeliest_to_change(bench, base, paths, TIMED)}
    return [f for f in forms if not kept.isdisjoint(f.paths)]


@dataclass(frozen=True, eq=False)
class _Reached:
    """A state whose newest form has the most likely times, with these times and their bench."""

    bench: Workbench
    state: State
    times: list[Located]

    def edges(self, form: str) -> tuple[int, ...]:
        """The rows of a form's times."""
        plant = self.bench.problem.plant
        assert isinstance(plant, ChangingPlant)
        return plant.courses[form].edges


def _timed_trials(made: Round, least: float) -> list[Trial]:
    """The fitted trials with a time or two times that have a least evidence at their coarse times."""
    fitted = [t for t in made.trials if t.state is not None and t.train >= least]
    return [t for t in fitted if kind_of(changed(t.candidate.paths[0])[0]) in (FROM, UNTIL, BETWEEN, OUTSIDE)]


def _nearly(made: Round, bar: float) -> Trial | None:
    """The best trial with a time or two times that has half of the evidence a name needs, at its coarse times."""
    return max(_timed_trials(made, PROMISED * bar), key=lambda t: t.total, default=None)


def _best_at_its_times(bench: Workbench, made: Round, first: Trial) -> tuple[Trial, _Reached]:
    """The likeliest trial at its own times: the first one or, unless it acts throughout, one with half its evidence."""
    best, reached, near = first, _at_best_times(bench, first), _timed_trials(made, PROMISED * first.train)
    whole = not changed(first.candidate.paths[0])[0]
    for trial in near if not whole else ():
        if trial is first:
            continue
        other = _at_best_times(bench, trial)
        if reached.bench.gain(reached.state, other.state) > 0.0:
            best, reached = trial, other
    return best, reached


def _at_best_times(bench: Workbench, trial: Trial) -> _Reached:
    """A trial's state with its times refined."""
    assert trial.state is not None
    form, state, found = changed(trial.candidate.paths[0])[0], trial.state, dict[int, Located]()
    # for two times, refine the first one again once the second one is right
    for edge in {FROM: (0,), UNTIL: (0,), BETWEEN: (0, 1, 0), OUTSIDE: (0, 1, 0)}.get(kind_of(form), ()):
        bench, state, found[edge] = moved_to_best(bench, state, form, edge)
    return _Reached(bench, state, [found[edge] for edge in sorted(found)])


def _at_the_same_times(
    forms: Sequence[Forms], chosen: Candidate, reached: _Reached
) -> tuple[list[Candidate], dict[str, tuple[int, ...]]]:
    """All candidates in the chosen form, and the rows of the refined times: each had been tried at coarse ones."""
    form = changed(chosen.paths[0])[0]
    if kind_of(form) in (BETWEEN, OUTSIDE):
        spans = [span for f in forms for span in f.spans if kind_of(changed(span.paths[0])[0]) == kind_of(form)]
        return spans, {changed(span.paths[0])[0]: reached.edges(form) for span in spans}
    if kind_of(form) in (FROM, UNTIL):
        return [c for f in forms for group in f.groups for c in group if changed(c.paths[0])[0] == form], {}
    return [], {}


def _each_at_its_times(bench: Workbench, made: Round, reached: _Reached) -> tuple[Round, _Reached]:
    """The chosen trial, tied with or replaced by trials that explain the log as well or better at their own times.

    The best time for one effect is slightly wrong for another one that does the same.  bench: of the trials.
    """
    for trial in made.trials:
        chosen = made.chosen
        assert chosen is not None
        behind = chosen.total - trial.total
        if trial in (chosen, *made.tied) or trial.state is None or trial.objection or behind > HOPELESS:
            continue
        other = _at_best_times(bench, trial)
        ahead = bench.gain(reached.state, other.state)
        if ahead > 0.0:
            made, reached = replace(made, chosen=trial, tied=(chosen, *made.tied) if ahead < TIE else ()), other
        elif ahead > -TIE:
            made = replace(made, tied=(*made.tied, trial))
    return made, reached


def _unless_throughout(
    before: State, forms: Sequence[Forms], made: Round, reached: _Reached, count: int
) -> tuple[Round, _Reached]:
    """The chosen trial, or the best effect throughout the log unless the chosen one's times pass the bar against it.

    A time near either end fits nearly as well as none, and the best of many times fits better by chance: the bar
    accounts for the number of times in the form.
    """
    assert made.chosen is not None
    own = made.chosen.candidate
    whole = next((f for f in forms if f.throughout is not None and own in (*f.screened, *f.spans)), None)
    if whole is None or own is whole.throughout:
        return made, reached
    bench, before = placed(reached.bench, before, {})
    again = selected(bench, before, [f.throughout for f in forms if f.throughout is not None], count, ())
    if again.chosen is None or again.chosen.state is None:
        return made, reached
    tried = next((len(group) for group in whole.groups if own in group), count)
    if bench.gain(again.chosen.state, reached.state) >= threshold(tried):
        return made, reached
    return again, _at_best_times(bench, again.chosen)


def _unless_at_one_time(
    before: State, forms: Sequence[Forms], made: Round, reached: _Reached, count: int
) -> tuple[Round, _Reached]:
    """The chosen trial, or the same effect from or until one time unless the second time passes the bar for it."""
    assert made.chosen is not None
    own = next((f for f in forms if made.chosen.candidate in f.spans), None)
    if own is None:
        return made, reached
    bench, before = placed(reached.bench, before, {})
    one_time = [group for group in own.groups if kind_of(changed(group[0].paths[0])[0]) in (FROM, UNTIL)]
    left, _ = _promising(bench, before, [Forms(None, tuple(one_time))], threshold(count))
    again = selected(bench, before, left, count, ())
    if again.chosen is None:
        return made, reached
    other = _at_best_times(bench, again.chosen)
    if reached.bench.gain(other.state, reached.state) >= threshold(len(one_time[0])):
        return made, reached
    return again, other


def _if_at_two_times(
    before: State, forms: Sequence[Forms], made: Round, reached: _Reached, count: int
) -> tuple[Round, _Reached]:
    """The chosen trial with one time, or the same effect with a second time if that passes the bar for it.

    A regression may have missed the second time beside a slightly wrong first one, which is refined by now.
    """
    assert made.chosen is not None
    chosen = made.chosen.candidate
    form = changed(chosen.paths[0])[0]
    own = next((f for f in forms if any(chosen in group for group in f.groups)), None)
    if own is None or not own.spans or kind_of(form) not in (FROM, UNTIL):
        return made, reached
    bench, state, bar = reached.bench, reached.state, threshold(len(own.groups[0]))
    steps = [c for c in own.groups[0] if c is not chosen]
    best = max(screen(bench.problem, state.point, state.paths, steps, bar), key=lambda one: one.evidence)
    found = finer_rows(bench, state, state.paths, [best.candidate], bar)
    evidence, row = max(found.values(), default=(0.0, 0))
    (first,) = reached.edges(form)
    if evidence < PROMISED * bar or row == first:
        return made, reached
    kind = BETWEEN if (row > first) == (kind_of(form) == FROM) else OUTSIDE
    span = next(s for s in own.spans if kind_of(changed(s.paths[0])[0]) == kind)
    bench, before = placed(bench, before, {changed(span.paths[0])[0]: (min(row, first), max(row, first))})
    again = selected(bench, before, [span], count, ())
    if again.chosen is None:
        return made, reached
    other = _at_best_times(bench, again.chosen)
    return (again, other) if reached.bench.gain(reached.state, other.state) >= bar else (made, reached)


def _promising(
    bench: Workbench, state: State, forms: Sequence[Forms], bar: float
) -> tuple[list[Candidate], dict[str, tuple[int, ...]]]:
    """Candidates worth a trial, by regression, with the noises as they are or weaker, and the rows of their times.

    Included are effects throughout, the member of each group with the most evidence, which may be another one with
    weaker noises, and effects between or outside of two times if these promise more than one time by half of the
    evidence that one more time needs.
    """
    plant = bench.problem.plant
    assert isinstance(plant, ChangingPlant)
    left, gained = [f.throughout for f in forms if f.throughout], dict[str, tuple[float, tuple[int, int]]]()
    finer: dict[str, tuple[float, int]] = {}
    each = max((len(f.screened) for f in forms), default=1) * bench.problem.measured.size
    for base in (state, *bench.quieted(state)):
        for some in at_once(len(forms), each):
            every = [c for f in forms[some] for c in f.screened]
            signed, rest = screen_signatures(bench.problem, base.point, state.paths, every, bar)
            own: dict[Candidate, list[tuple[Screening, np.ndarray]]] = {c: [] for c in every}
            for one, signature in signed:
                own[one.candidate].append((one, signature))
            evidence = {c: max(one.evidence for one, _ in found) for c, found in own.items()}
            first = [max(group, key=evidence.__getitem__) for f in forms[some] for group in f.groups if group]
            left += first
            loud = [c for c in first if evidence[c] >= max(CLOSE * max(evidence.values()), bar)]
            for form, found in finer_rows(bench, base, state.paths, loud, bar).items():
                finer[form] = max(found, finer.get(form, found))
            for f in forms[some]:
                if not f.spans or f.throughout is None:
                    continue
                signatures = [[signature for _, signature in own[c]] for c in (f.throughout, *f.groups[0])]
                alone = max(evidence[c] for c in f.screened)
                for span in f.spans:
                    form = changed(span.paths[0])[0]
                    gain, pair = max(
                        best_spans(np.array(sizes), rest, kind_of(form), f.throughout.kinked)
                        for sizes in zip(*signatures, strict=True)
                    )
                    rows = tuple(plant.courses[changed(f.groups[0][k - 1].paths[0])[0]].edges[0] for k in pair)
                    more, least = gain - alone, PROMISED * threshold(len(f.groups[0]))
                    if rows[0] < rows[1] and more >= max(least, gained.get(form, (least,))[0]):
                        gained[form] = more, (rows[0], rows[1])
    left += [span for f in forms for span in f.spans if changed(span.paths[0])[0] in gained]
    rows: dict[str, tuple[int, ...]] = {form: (row,) for form, (_, row) in finer.items()}
    return list(dict.fromkeys(left)), rows | {form: pair for form, (_, pair) in gained.items()}


def _timed(
    bench: Workbench, state: State, rounds: Sequence[Round], times: Mapping[str, Sequence[Located]]
) -> list[Timed]:
    """The chosen effects with sizes and times; without a form if the halves of its time contradict each other."""
    chosen = [(r, p) for r in rounds if r.chosen for p in r.chosen.candidate.paths if p in state.paths]
    found = []
    for made, name in chosen:
        assert made.chosen is not None
        form, path = changed(name)
        spec, size = spec_at(state.plant, path), sized(bench, state, {name: 1.0})
        told = (spec.title or path, spec.unit)
        steady = split_evidence(bench, state, name, FROM) < threshold_of_halves(len(chosen))
        when = [_time_of(bench.record, one) for one in times.get(form, ())] if steady else []
        first, second = (*when, None, None)[:2]
        kind = kind_of(form) if steady else ""
        tied = tied_names([made]) if kind else _throughout(path, tied_names([made]))
        found.append(Timed(path, *told, kind, size, made.evidence[0], first, second, tied, steady))
    return found


def _time_of(record: Record, found: Located) -> Sized:
    """A time with its interval."""
    time, low, high = (float(record.time[row]) for row in (found.row, found.low, found.high))
    return Sized(time, (low, high))


def _throughout(path: str, tied: Sequence[str]) -> tuple[str, ...]:
    """The alternatives to an effect throughout the log, without the forms in time of the same effects."""
    whole = {path, *(name for name in tied if " " not in name)}
    return tuple(name for name in tied if name in whole or name.rpartition(" ")[2] not in whole)


def threshold_of_halves(count: int) -> float:
    """The evidence above which the halves of the time of one of `count` effects contradict each other."""
    return float(chi2.isf(UNSTEADY / count, 1))
