"""The search in time: effects and changes of coefficients that begin, end, act between two times, or grow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from auv_gym.param import spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.changes.forms import Changeable, Sized, kind_of, sized, tied_names, usable_log
from identification.changes.search_in_time import searched_in_time
from identification.changes.spans import spans_of
from identification.changes.timed_forms import FROM, Forms, courses_of, paths_of
from identification.changes.times import Located, placed, split_evidence
from identification.deciding import BLOCKS, DOUBT, MOST_EFFECTS, MOST_PARTS, UNSTEADY
from identification.diagnosis.log.checking import Asked, CheckedLog
from identification.diagnosis.log.parts import Part, block_numbers
from identification.diagnosis.search.attribution import Round, settled
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, changed


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
    courses = courses_of(edges, len(may.effects))
    own = {name: paths_of(name, may) for name in courses}
    changing = ChangingPlant.of(log.plant, own, courses, log.record)
    known = fit_known(replace(log, plant=changing, parts=parts), progress)
    forms = [Forms.of(c, courses, k) for k, c in enumerate(may.effects)]
    forms += [Forms.of(c, courses) for c in may.refitted(known)]
    count = sum(f.count for f in forms) + 2 * len(spans_of(edges)) * len(may.effects)
    known, state, rounds, times = _beside_noises(known, forms, count, most, progress)
    bench = known.bench
    state, rounds = settled(bench, known.nominal, state, rounds, count)
    span = (float(log.record.time[0]), float(log.record.time[-1]))
    return Timeline(tuple(_timed(bench, state, rounds, times)), count, plant, span, tuple(log.record.notes))


def _interleaved(log: CheckedLog) -> tuple[tuple[Part, ...], list[int]]:
    """Parts of every sixth of 24 equal spans of a log, and the rows at which these spans begin, except the first."""
    stretches = sorted((piece for part in log.parts for piece in part), key=lambda w: w.start)
    rows = np.concatenate([np.arange(w.start, w.stop) for w in stretches])
    block = block_numbers(log.record, stretches, BLOCKS)
    begins = np.isin(rows[1:], [w.start for w in stretches])  # also where the rows go on, across a gap in time
    cuts = np.flatnonzero((np.diff(block) != 0) | begins) + 1
    parts: list[list[slice]] = [[] for _ in range(MOST_PARTS)]
    for piece in np.split(np.arange(rows.size), cuts):
        parts[block[piece[0]] % MOST_PARTS].append(slice(int(rows[piece[0]]), int(rows[piece[-1]]) + 1))
    edges = rows[np.flatnonzero(np.diff(block) != 0) + 1]
    return tuple(tuple(part) for part in parts if part), edges.tolist()


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
