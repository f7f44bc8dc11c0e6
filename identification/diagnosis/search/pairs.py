"""Effects that show only in pairs: pairs are screened by regression, and the most promising ones fitted.

If two effects are missing, coefficients and process noise adapt to the second one, so that either effect alone explains
next to nothing.  With the coefficients as given and little process noise, both become visible together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from auv_gym.threads import side_by_side
from identification.deciding import LEAST_TRACE, PAIRS
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.begun import Begun, begun_from, rival_of
from identification.diagnosis.search.candidates import Candidate, Screening, screen_pairs
from identification.diagnosis.search.trials import Trial, all_finished, finalists_of, gate
from identification.diagnosis.search.workbench import State, Workbench


def best_pair(
    bench: Workbench, state: State, left: Sequence[Candidate], count: int, instead: Candidate | None
) -> tuple[Trial, Trial] | None:
    """The likeliest pair that passes the gate as one change, each effect judged beside the other; None if none passes.

    The trials hold the state with both.  left: effects not fitted yet, of `count` candidates, for the bar.
    instead: an effect outside the state that the pair must exceed in evidence.
    """
    many = count * (count - 1) // 2
    promising = []
    for known in (*bench.with_given(state), state):
        base = (*bench.quieted(known), known)[0]
        pairs = screen_pairs(bench.problem, base.point, state.paths, left, threshold(many, 2), PAIRS, instead)
        rival = rival_of(bench, state, base)
        promising += [(base, rival, whole, parts) for whole, parts in pairs]
    tried = side_by_side(lambda one: begun_from(bench, state, one[0], one[2], one[1]), promising)
    begun: dict[Candidate, tuple[Begun, tuple[Screening, Screening]]] = {}
    for one, (*_, parts) in zip(tried, promising, strict=True):  # the same pair may come from several bases
        known = begun.setdefault(one.screening.candidate, (one, parts))
        if one.promise > known[0].promise:
            begun[one.screening.candidate] = one, parts
    finalists = finalists_of([one for one, _ in begun.values()], (), LEAST_TRACE * threshold(many, 2))
    found = []
    for whole in all_finished(bench, state, finalists, many):
        if whole.objection or whole.state is None:
            continue
        members = [_beside(bench, whole.state, one, count) for one in begun[whole.candidate][1]]
        if not any(t.objection for t in members):
            found.append((whole.total, members))
    if not found:
        return None
    first, second = max(found, key=lambda item: item[0])[1]
    return first, second


def _beside(bench: Workbench, both: State, one: Screening, count: int) -> Trial:
    """The trial of one effect of a pair, judged beside the other."""
    without = bench.without(both, one.candidate.paths)
    told = gate(bench, without, both, [(one.candidate, one)], count)
    return Trial(one.candidate, both, told.train, told.held, replace(one, evidence=told.train), told.objection)
