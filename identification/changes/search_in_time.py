"""Forward selection among effects throughout a record, and in forms with times."""

from __future__ import annotations

from collections.abc import Sequence

from identification.changes.best_times import (
    at_best_times,
    at_the_same_times,
    best_at_its_times,
    each_at_its_times,
    if_at_two_times,
    nearly,
    unless_at_one_time,
    unless_growing,
    unless_throughout,
)
from identification.changes.promising_times import contenders, promising
from identification.changes.timed_forms import Forms
from identification.changes.times import Located, placed
from identification.diagnosis.search.attribution import Round, selected
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.known import Known
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import changed


def searched_in_time(
    known: Known, forms: Sequence[Forms], count: int, most: int, progress: Progress
) -> tuple[Workbench, State, list[Round], dict[str, list[Located]]]:
    """Forward selection among effects throughout and, for each form of each, the currently most promising member.

    The times of an effect that is chosen, or nearly, are refined at once: a slightly wrong time would leave an error
    that looks like more of the same effect.  So are those of others that come near it, and all in this form are then
    tried at the best times: one may merely have had the best coarse time.  One time more or less, growth, and effects
    throughout are tried, too: each time must have the evidence that it needs.  Returns the bench with these times, the
    state, the rounds, and the times by form.
    """
    bench, state, rounds, times = known.bench, known.nominal, [], dict[str, list[Located]]()
    for number in range(most):
        share = 0.1 + 0.75 * number / most
        progress(share, "screening the times")
        left, spans = promising(bench, state, contenders(bench, state, forms), threshold(count))
        bench, state = placed(bench, state, spans)
        made = selected(bench, state, left, count, (), lambda f, text, s=share: progress(s, text))
        first = made.chosen or nearly(made, threshold(count))
        if first is None:
            break
        best, reached = best_at_its_times(bench, made, first)
        rivals, spans = at_the_same_times(forms, best.candidate, reached)
        if rivals:
            bench, state = placed(reached.bench, state, spans)
            again = selected(bench, state, rivals, count, ())
            if again.chosen is not None:
                other = reached if again.chosen.candidate is best.candidate else at_best_times(bench, again.chosen)
                if made.chosen is None or reached.bench.gain(reached.state, other.state) >= 0.0:
                    made, reached = each_at_its_times(bench, again, other)
        if made.chosen is None:
            break
        if made.chosen is first and best is not first:  # the better one was refused
            reached = at_best_times(bench, first)
        made, reached = unless_at_one_time(state, forms, made, reached, count)
        made, reached = if_at_two_times(state, forms, made, reached, count)
        made, reached = unless_growing(state, forms, made, reached, count)
        made, reached = unless_throughout(state, forms, made, reached, count)
        assert made.chosen is not None
        own, bench, state = made.chosen.candidate, reached.bench, reached.state
        rounds.append(made)
        times[changed(own.paths[0])[0]] = reached.times
        forms = [f.without(own) if own in (*f.screened, *f.spans) else f for f in forms]
    return bench, state, rounds, times
