"""What has changed between the missions of a vehicle before and after: one fit, and each change by its evidence."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.changes.forms import Changeable, Sized, in_form, sized, tied_names
from identification.changes.joined import joined_sides
from identification.deciding import DOUBT, MOST_EFFECTS, SURPRISE, TIE
from identification.diagnosis.log.checking import Asked
from identification.diagnosis.search.attribution import Round, attribute, confirmed, settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, deviations_shown, screen
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.trials import Progress, Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, Course, change, changed

BEFORE, AFTER = "before", "after"


@dataclass(frozen=True)
class Changed:
    """A parameter that is not the same before and after.

    evidence: twice the gain in log-likelihood against one value for both sides.  tied: paths of what else
    would explain it as well, with the form in front where that is a change.  surely: whether all of these are changes.
    """

    path: str
    title: str
    unit: str
    before: Sized
    after: Sized
    change: Sized
    evidence: float
    tied: tuple[str, ...] = ()
    surely: bool = True


@dataclass(frozen=True)
class Common:
    """An effect that is there before and after alike; tied: see `Changed`."""

    path: str
    title: str
    unit: str
    size: Sized
    evidence: float
    tied: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unchanged:
    """A parameter that shows no change.

    change: its estimate.  detectable: the change that would have been found with 95 % probability; infinite where the
    missions cannot show one, with the reason.  value: of the vehicle.
    """

    path: str
    title: str
    unit: str
    value: float
    change: Sized
    detectable: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare_missions` found; missions: names of those before and after; fitted: values before, by path."""

    plant: Plant
    missions: tuple[tuple[str, ...], tuple[str, ...]]
    changed: tuple[Changed, ...]
    common: tuple[Common, ...]
    unchanged: tuple[Unchanged, ...]
    candidates: int
    fitted: Mapping[str, float]
    notes: tuple[str, ...] = ()


def compare_missions(
    before: Record,
    after: Record,
    plant: Plant,
    *,
    names: tuple[Sequence[str], Sequence[str]] = (("before",), ("after",)),
    most: int = MOST_EFFECTS,
    doubt: float = DOUBT,
    trust: bool = False,
    progress: Progress = lambda fraction, text: None,
) -> Comparison:
    """What of a vehicle has changed between two records, each of one mission or of several in segments.

    All is fitted at once with common coefficients, noises and, as evidence says, effects that are common or of one side
    only; a coefficient may change, too.  A change passes the gate that every name of a diagnosis passes.
    names: of the missions, for the report.  most: effects and changes at once.  doubt, trust: see
    `identification.diagnosis.diagnose`.
    """
    progress(0.0, "checking the missions")
    log, edge = joined_sides({BEFORE: before, AFTER: after}, plant, Asked(most=most, doubt=doubt, trust=trust))
    may = Changeable.of(plant, log.record, doubt)
    courses = {BEFORE: Course((edge,), (1.0, 0.0)), AFTER: Course((edge,), (0.0, 1.0))}
    changing = ChangingPlant.of(log.plant, {BEFORE: may.paths, AFTER: [*may.coefficients, *may.paths]}, courses)
    known = fit_known(replace(log, plant=changing), progress)
    alone = [*may.refitted(known), *may.effects]
    candidates = [
        *may.effects,
        *(in_form(c, AFTER) for c in alone),
        *(in_form(c, BEFORE) for c in may.effects),
    ]
    known, state, rounds = _attributed(known, candidates, most, progress)
    bench = known.bench
    state, rounds = settled(bench, known.nominal, state, rounds, len(candidates))
    state, rounds = coefficients_first(bench, known.nominal, state, rounds, len(candidates))
    progress(0.85, "sizing what has changed")
    found = [r for r in rounds if r.chosen is not None]
    own = [_own_paths(r, state) for r in found]
    moving = dict.fromkeys(changed(p)[1] for paths in own for p in paths if changed(p)[0])
    rest = [c for c in alone if moving.keys().isdisjoint(c.paths)]
    told = [one_or_two(bench, state, path, found, len(candidates)) for path in moving]
    common = [
        _common(bench, state, r, p)
        for r, paths in zip(found, own, strict=True)
        for p in paths
        if not changed(p)[0] and p not in moving
    ]
    return Comparison(
        plant,
        (tuple(names[0]), tuple(names[1])),
        tuple(c for c in told if isinstance(c, Changed)),
        (*common, *(c for c in told if isinstance(c, Common))),
        tuple(_unchanged(bench, state, rest, len(candidates))),
        len(candidates),
        {p: value_at(state.plant, p) for p in state.paths if not changed(p)[0]},
        tuple(log.record.notes),
    )


def _attributed(
    known: Known, candidates: Sequence[Candidate], most: int, progress: Progress, sought: Collection[str] = ()
) -> tuple[Known, State, list[Round]]:
    """Forward selection beside the noises, and in the steps and rows, that suit what it finds; what is known in these,
    state, rounds.

    sought: paths that are fitted to the end whatever they promise.
    """

    def told(fraction: float, text: str) -> None:
        progress(0.1 + 0.7 * fraction, text)

    state, rounds = attribute(known.bench, known.nominal, candidates, most, (), told, sought)
    suited = known.in_suited_steps(state)
    if suited is not known:
        return _attributed(suited, candidates, most, progress, sought)
    progress(0.8, "looking for waves and for sensor errors that last")
    chosen = [p for made in rounds if made.chosen for p in made.chosen.candidate.paths]
    again = known.beside_noises(
        state, lambda noisier: _attributed(noisier, candidates, most, progress, chosen), len(candidates)
    )
    if again is not None:
        return again
    suited = known.suited_to(state)
    return (known, state, rounds) if suited is known else _attributed(suited, candidates, most, progress, sought)


def coefficients_first(
    bench: Workbench, nominal: State, state: State, rounds: Sequence[Round], count: int
) -> tuple[State, list[Round]]:
    """The state and the rounds in which a coefficient that has changed leads where it is tied with a changed effect.

    The model has its coefficients anyway, each with a value that no mission knows exactly: an effect beside them is one
    thing more, and must explain the missions better by more than a tie.  Where it acts as a coefficient does, as a
    clock's rate in steady flight acts as drag, that value takes up any size that it has on both sides, and evidence
    does not tell what has changed.
    nominal, count: see `settled`.
    """
    rounds = list(rounds)
    for number, made in enumerate(rounds):
        if made.chosen is None or not _changes_an_effect(made.chosen, state.plant):
            continue
        able = [t for t in made.trials if _may_lead(bench, t, made.chosen)]
        if not able:
            continue
        first = max(able, key=lambda t: t.total)
        (path,) = first.candidate.paths
        there = _in_its_place(bench, state, made.chosen, first)
        others = (made.chosen, *(t for t in made.tied if t is not first))
        instead = [*rounds[:number], replace(made, chosen=first, tied=others), *rounds[number + 1 :]]
        passed, kept = confirmed(bench, nominal, there, instead, count)
        if len(kept) == len(rounds) and _behind(bench, passed, state, path) < TIE:
            state, rounds = passed, kept
    return state, rounds


def _changes_an_effect(trial: Trial, plant: Plant) -> bool:
    form, path = changed(trial.candidate.paths[0])
    return bool(form) and path not in plant.doubted


def _may_lead(bench: Workbench, trial: Trial, chosen: Trial) -> bool:
    """Whether a trial is of a coefficient that has changed, and is tied with the chosen one."""
    form, path = changed(trial.candidate.paths[0])
    if not form or path not in bench.plant.doubted or trial.objection or trial.state is None:
        return False
    assert chosen.state is not None
    return _behind(bench, trial.state, chosen.state, trial.candidate.paths[0]) < TIE


def _behind(bench: Workbench, own: State, other: State, path: str) -> float:
    """The evidence by which a state with a changed coefficient is behind another one.

    path: of the change.  What is known of the coefficient is held against the side on which it is nearer to that, and
    not against its change: a fit holds it against the side before, though a hull may have been cleaned since.
    """
    _, coefficient = changed(path)
    value = value_at(own.plant, coefficient) + value_at(own.plant, path)
    after = replace_at(own.plant, coefficient, float(np.clip(value, *spec_at(own.plant, coefficient).bounds)))
    before, late = (float(bench.problem.pulls(p.vector, [coefficient])[0][0]) ** 2 for p in (own.plant, after))
    return bench.gain(own, other) - max(before - late, 0.0)


def _in_its_place(bench: Workbench, state: State, chosen: Trial, other: Trial) -> State:
    """A state with another trial in the place of a chosen one, fitted."""
    assert other.state is not None
    paths = [p for p in state.paths if p not in chosen.candidate.free]
    values = {p: spec_at(state.plant, p).neutral for p in chosen.candidate.paths}
    values |= {p: value_at(other.state.plant, p) for p in other.state.paths}
    return bench.fit(replace_at(state.plant, values), [*paths, *other.candidate.free], other.state)


def _own_paths(made: Round, state: State) -> list[str]:
    assert made.chosen is not None
    return [p for p in made.chosen.candidate.paths if p in state.paths]


def one_or_two(bench: Workbench, state: State, path: str, rounds: Sequence[Round], count: int) -> Changed | Common:
    """What a parameter is on each side, both free; common, where evidence does not ask for two values.

    Nor does it where the interval of the change has room for none: that allows for a misjudged colour of the errors.
    count: of all candidates, for the bar.
    """
    spec, plant = spec_at(state.plant, path), state.plant
    early, late, added = change(BEFORE, path), change(AFTER, path), 0.0
    mine = [r for r in rounds if {path, early, late} & set(_own_paths(r, state))]
    kept = [p for p in state.paths if p not in (path, early, late)]
    if path in plant.doubted:  # its value is fitted, with what is known of it: the change is beside it
        free, first, second = [*kept, path, late], {path: 1.0}, {path: 1.0, late: 1.0}
        alike = replace_at(plant, late, 0.0)
    else:
        added = spec.neutral
        base = value_at(plant, path) - added
        values = {path: added, early: base + value_at(plant, early), late: base + value_at(plant, late)}
        free, first, second = [*kept, early, late], {early: 1.0}, {late: 1.0}
        middle = added + 0.5 * (values[early] + values[late])
        alike = replace_at(plant, {path: float(np.clip(middle, *spec.bounds)), early: 0.0, late: 0.0})
        plant = replace_at(plant, values)
    both, common = bench.fit(plant, free, state), bench.fit(alike, [*kept, path], state)
    evidence, tied = bench.gain(common, both), tied_names(mine)
    moved = sized(bench, both, {p: second.get(p, 0.0) - first.get(p, 0.0) for p in {**first, **second}})
    if evidence < threshold(count) or moved.ci95[0] <= 0.0 <= moved.ci95[1]:
        size = Sized(value_at(common.plant, path), bench.interval(common, path))
        return Common(path, spec.title or path, spec.unit, size, sum(r.evidence[0] for r in mine), tied)
    return Changed(
        path,
        spec.title or path,
        spec.unit,
        sized(bench, both, first, added, spec.bounds),
        sized(bench, both, second, added, spec.bounds),
        moved,
        evidence,
        tied,
        all(t.startswith((f"{BEFORE} ", f"{AFTER} ")) for t in tied),
    )


def _common(bench: Workbench, state: State, made: Round, path: str) -> Common:
    spec = spec_at(state.plant, path)
    size = Sized(value_at(state.plant, path), bench.interval(state, path))
    return Common(path, spec.title, spec.unit, size, made.evidence[0], tied_names([made]))


def detectable_beside(change: Sized, count: int) -> float:
    """The change that would have been found with 95 % probability, by the interval of one; count: of all candidates."""
    return 0.5 * (change.ci95[1] - change.ci95[0]) * _over_half(count)


def _over_half(count: int) -> float:
    """How many halves of its 95 % interval a change needs, to be found with 95 % probability."""
    return deviations_shown(threshold(count)) / SURPRISE


def _unchanged(bench: Workbench, state: State, rest: Sequence[Candidate], count: int) -> list[Unchanged]:
    """What shows no change, by the regression of the final model's errors on a change of each."""
    late = [replace(in_form(c, AFTER), title=c.title) for c in rest]
    bar, found = threshold(count), []
    for screening in screen(bench.problem, state.point, state.paths, late, bar):
        for k, name in enumerate(screening.candidate.paths):
            path = changed(name)[1]
            spec, detectable = spec_at(state.plant, path), float(screening.detectable[k])
            estimate = float(screening.estimate[k]) * bench.problem.scale(name)
            half = detectable / _over_half(count)
            size = Sized(estimate, (estimate - half, estimate + half))
            value = value_at(state.plant, path)
            found.append(Unchanged(path, spec.title or path, spec.unit, value, size, detectable, screening.unseen))
    order = bench.problem.index
    return sorted(found, key=lambda u: (u.path not in state.paths, order[u.path]))
