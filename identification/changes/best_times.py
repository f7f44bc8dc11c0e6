"""Effects compared at the times that suit each of them, and with no more times than the record supports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.changes.forms import kind_of
from identification.changes.promising_times import promising
from identification.changes.spans import BETWEEN, OUTSIDE
from identification.changes.timed_forms import FROM, GROWING, UNTIL, Forms
from identification.changes.times import Located, finer_rows, moved_to_best, placed
from identification.deciding import HOPELESS, PRICE, PROMISED, TIE
from identification.diagnosis.search.acceptance import INSIGNIFICANT
from identification.diagnosis.search.attribution import Round, selected
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, changed


@dataclass(frozen=True, eq=False)
class Reached:
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
    return [t for t in fitted if _form(t.candidate) in (FROM, UNTIL, BETWEEN, OUTSIDE)]


def nearly(made: Round, bar: float) -> Trial | None:
    """The best trial with a time or two times that has half of the evidence a name needs, at its coarse times."""
    return max(_timed_trials(made, PROMISED * bar), key=lambda t: t.total, default=None)


def best_at_its_times(bench: Workbench, made: Round, first: Trial) -> tuple[Trial, Reached]:
    """The likeliest trial at its own times: the first one or, unless it acts throughout, one with half its evidence."""
    best, reached, near = first, at_best_times(bench, first), _timed_trials(made, PROMISED * first.train)
    whole = not changed(first.candidate.paths[0])[0]
    for trial in near if not whole else ():
        if trial is first:
            continue
        other = at_best_times(bench, trial)
        if reached.bench.gain(reached.state, other.state) > 0.0:
            best, reached = trial, other
    return best, reached


def at_best_times(bench: Workbench, trial: Trial) -> Reached:
    """A trial's state with its times refined."""
    assert trial.state is not None
    form, state, found = changed(trial.candidate.paths[0])[0], trial.state, dict[int, Located]()
    # for two times, refine the first one again once the second one is right
    for edge in {FROM: (0,), UNTIL: (0,), BETWEEN: (0, 1, 0), OUTSIDE: (0, 1, 0)}.get(kind_of(form), ()):
        bench, state, found[edge] = moved_to_best(bench, state, form, edge)
    return Reached(bench, state, [found[edge] for edge in sorted(found)])


def at_the_same_times(
    forms: Sequence[Forms], chosen: Candidate, reached: Reached
) -> tuple[list[Candidate], dict[str, tuple[int, ...]]]:
    """All candidates in the chosen form, and the rows of the refined times: each had been tried at coarse ones."""
    form = changed(chosen.paths[0])[0]
    if kind_of(form) in (BETWEEN, OUTSIDE):
        spans = [span for f in forms for span in f.spans if _form(span) == kind_of(form)]
        return spans, {changed(span.paths[0])[0]: reached.edges(form) for span in spans}
    if kind_of(form) in (FROM, UNTIL):
        return [c for f in forms for group in f.groups for c in group if changed(c.paths[0])[0] == form], {}
    return [], {}


def each_at_its_times(bench: Workbench, made: Round, reached: Reached) -> tuple[Round, Reached]:
    """The chosen trial, tied with or replaced by trials that explain the log as well or better at their own times.

    The best time for one effect is slightly wrong for another one that does the same.  bench: of the trials.
    """
    for trial in made.trials:
        chosen = made.chosen
        assert chosen is not None
        behind = chosen.total - trial.total
        if trial in (chosen, *made.tied) or trial.state is None or trial.objection or behind > HOPELESS:
            continue
        other = at_best_times(bench, trial)
        ahead = bench.gain(reached.state, other.state)
        if ahead > 0.0:
            made, reached = replace(made, chosen=trial, tied=(chosen, *made.tied) if ahead < TIE else ()), other
        elif ahead > -TIE:
            made = replace(made, tied=(*made.tied, trial))
    return made, reached


def unless_throughout(
    before: State, forms: Sequence[Forms], made: Round, reached: Reached, count: int
) -> tuple[Round, Reached]:
    """The chosen trial, or the best effect throughout the log unless the chosen one's times pass the bar against it.

    A time near either end fits nearly as well as none, and the best of many times fits better by chance: the bar
    accounts for the number of times in the form.
    """
    assert made.chosen is not None
    own = made.chosen.candidate
    whole = next((f for f in forms if f.throughout is not None and own in (*f.screened, *f.spans)), None)
    if whole is None or own is whole.throughout:
        return made, reached
    every = [f.throughout for f in forms if f.throughout is not None]
    tried = next((len(group) for group in whole.groups if own in group), count)
    return _unless_worth(threshold(tried), before, made, reached, every, count)


def unless_at_one_time(
    before: State, forms: Sequence[Forms], made: Round, reached: Reached, count: int
) -> tuple[Round, Reached]:
    """The chosen trial, or the same effect from or until one time unless the second time passes the bar for it."""
    assert made.chosen is not None
    own = next((f for f in forms if made.chosen.candidate in f.spans), None)
    if own is None:
        return made, reached
    one_time = [group for group in own.groups if _form(group[0]) in (FROM, UNTIL)]
    left, _ = promising(*placed(reached.bench, before, {}), [Forms(None, tuple(one_time))], threshold(count))
    return _unless_worth(threshold(len(one_time[0])), before, made, reached, left, count)


def if_at_two_times(
    before: State, forms: Sequence[Forms], made: Round, reached: Reached, count: int
) -> tuple[Round, Reached]:
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
    span = next(s for s in own.spans if _form(s) == kind)
    rows = {changed(span.paths[0])[0]: (min(row, first), max(row, first))}
    again, there = _instead(before, reached, [span], count, rows)
    return (again, there) if there and reached.bench.gain(reached.state, there.state) >= bar else (made, reached)


def unless_growing(
    before: State, forms: Sequence[Forms], made: Round, reached: Reached, count: int
) -> tuple[Round, Reached]:
    """The chosen trial, or the same effect as one that grows, tied with it, unless the times are worth their price.

    A form with times has one more parameter for each, and the choice among all times (`PRICE`).
    """
    assert made.chosen is not None
    chosen = made.chosen
    own = next((f for f in forms if chosen.candidate in (*f.screened, *f.spans)), None)
    growing = [c for group in own.groups for c in group if _form(c) == GROWING] if own and reached.times else []
    if own is None or not growing:
        return made, reached
    price = PRICE * len(reached.times) * (1.0 + np.log(len(own.groups[0])))
    other, there = _unless_worth(price, before, made, reached, growing, count)
    return (other, there) if there is reached else (replace(other, tied=(*other.tied, chosen)), there)


def _unless_worth(
    least: float, before: State, made: Round, reached: Reached, simpler: Sequence[Candidate], count: int
) -> tuple[Round, Reached]:
    """The chosen trial if it gains at least so much over simpler candidates, else the best of these.

    If that one is only just below the bar by itself, it is tied with the chosen one instead.
    """
    again, there = _instead(before, reached, simpler, count)
    near = [t for t in again.trials if t.state is not None and t.objection in ("", INSIGNIFICANT)]
    best = again.chosen or max(near, key=lambda t: t.total, default=None)
    if best is None or best.state is None:
        return made, reached
    state = there.state if there else best.state
    if reached.bench.gain(state, reached.state) >= least:
        return made, reached
    return (again, there) if there else (replace(made, tied=(*made.tied, best)), reached)


def _instead(
    before: State,
    reached: Reached,
    candidates: Sequence[Candidate],
    count: int,
    rows: Mapping[str, tuple[int, ...]] | None = None,
) -> tuple[Round, Reached | None]:
    """The round of other candidates in place of what was chosen, and it at the best times; None if none is accepted.

    before: the state without what was chosen.  rows: of times that are tried.
    """
    bench, before = placed(reached.bench, before, rows or {})
    made = selected(bench, before, candidates, count, ())
    return made, None if made.chosen is None else at_best_times(bench, made.chosen)


def _form(candidate: Candidate) -> str:
    return kind_of(changed(candidate.paths[0])[0])
