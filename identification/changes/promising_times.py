"""Which effects, forms and times are worth a fit, by regression on their signatures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.changes.forms import kind_of
from identification.changes.spans import best_spans
from identification.changes.timed_forms import Forms
from identification.changes.times import finer_rows
from identification.deciding import CLOSE, FEW_STATES, PROMISED, TIMED
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, Screening, screen_signatures
from identification.diagnosis.search.remainder import likeliest_to_change
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, changed
from identification.fit.linearised import at_once


def contenders(bench: Workbench, state: State, forms: Sequence[Forms]) -> Sequence[Forms]:
    """The forms of the parameters in which sixths of the log seem to differ most, with given or weaker noises.

    All forms for a vehicle of few states; for others, each time of each form needs a costly run of the vehicle.
    """
    if bench.followed <= FEW_STATES:
        return forms
    paths = list(dict.fromkeys(p for f in forms for p in sorted(f.paths)))
    bases = (state, *bench.quieted(state))
    kept = {p for base in bases for p in likeliest_to_change(bench, base, paths, TIMED)}
    return [f for f in forms if not kept.isdisjoint(f.paths)]


def promising(
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
