"""Changes of a vehicle between the missions before and after: one fit of all missions, each change by its evidence."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.changes.forms import Changeable, Sized, in_form, sized, tied_names
from identification.changes.joined import joined_sides
from identification.changes.moments import Moment, OfLog, Sides, Step, further_steps, sizes_by_log, step_elsewhere
from identification.deciding import DOUBT, MOST_EFFECTS, SLIGHTLY, SURPRISE, TIE
from identification.diagnosis.log.checking import Asked
from identification.diagnosis.log.parts import OneLog, logs_in
from identification.diagnosis.search.attribution import Round, attribute, confirmed, settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, deviations_shown, screen
from identification.diagnosis.search.constancy import steadiness
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.trials import Progress, Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, Course, change, changed

BEFORE, AFTER = "before", "after"


@dataclass(frozen=True)
class Changed:
    """A parameter that differs between before and after.

    evidence: twice the gain in log-likelihood over one value for both sides.  tied: paths of what else would explain it
    as well, preceded by the form if that is a change.  surely: whether all of these are changes.  moment: when it
    changed; None if nobody asked.  sizes: its size in each log, if there are more than two.
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
    moment: Moment | None = None
    sizes: tuple[OfLog, ...] = ()


@dataclass(frozen=True)
class Common:
    """An effect that is the same before and after; tied: see `Changed`."""

    path: str
    title: str
    unit: str
    size: Sized
    evidence: float
    tied: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unchanged:
    """A parameter that shows no change.

    change: its estimate.  detectable: the change that would have been found with 95 % probability; infinite, with the
    reason, if the missions cannot show one.  value: the vehicle's value.
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
    """The result of `compare_missions`; missions: names before and after; fitted: values before, by path."""

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
    times: bool = True,
    progress: Progress = lambda fraction, text: None,
) -> Comparison:
    """Compare two records of a vehicle, each of one mission or of several in segments, and find what has changed.

    Everything is fitted at once, with common coefficients and noises.  Depending on the evidence, an effect is common
    or belongs to one side, and a coefficient may change, too.  A change must pass the same gate as an effect in a
    diagnosis.
    names: of the missions, for the report.  most: the largest number of effects and changes.  doubt, trust: see
    `identification.diagnosis.diagnose`.  times: whether to find when each parameter changed, see `step_elsewhere`.
    """
    progress(0.0, "checking the missions")
    log, edge = joined_sides({BEFORE: before, AFTER: after}, plant, Asked(most=most, doubt=doubt, trust=trust))
    may = Changeable.of(plant, log.record, doubt)
    courses = {BEFORE: Course((edge,), (1.0, 0.0)), AFTER: Course((edge,), (0.0, 1.0))}
    changing = ChangingPlant.of(
        log.plant, {BEFORE: may.paths, AFTER: [*may.coefficients, *may.paths]}, courses, log.record
    )
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
    told = [
        *(
            _common(bench, state, r, p)
            for r, paths in zip(found, own, strict=True)
            for p in paths
            if not changed(p)[0] and p not in moving
        ),
        *(one_or_two(bench, state, path, found, len(candidates)) for path in moving),
    ]
    if times:
        progress(0.9, "finding when it changed")
        sides = sides_of(log.record, edge, names)
        told = [timed(bench, state, one, sides, len(candidates)) for one in told]
        if _one_step_each(bench, state, told, sides):
            paths, left = {one.path for one in told}, most - len(found)
            others = [c for c in alone if paths.isdisjoint(c.paths)]
            steps = further_steps(
                known, state, others, sides, len(candidates), left, lambda f, text: progress(0.92 + 0.08 * f, text)
            )
            told += [_stepped(bench, step) for step in steps]
    differing = {*moving, *(c.path for c in told if isinstance(c, Changed))}
    rest = [c for c in alone if differing.isdisjoint(c.paths)]
    return Comparison(
        plant,
        (tuple(names[0]), tuple(names[1])),
        tuple(c for c in told if isinstance(c, Changed)),
        tuple(c for c in told if isinstance(c, Common)),
        tuple(_unchanged(bench, state, rest, len(candidates))),
        len(candidates),
        {p: value_at(state.plant, p) for p in state.paths if not changed(p)[0]},
        tuple(log.record.notes),
    )


def _attributed(
    known: Known, candidates: Sequence[Candidate], most: int, progress: Progress, sought: Collection[str] = ()
) -> tuple[Known, State, list[Round]]:
    """Select effects and changes forward, repeated with the noises, steps and rows that suit the result.

    sought: paths that are always fitted to the end.  Returns the known part in these steps, the state and the rounds.
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
    """The state and rounds, with a changed coefficient in the place of each changed effect that it is tied with.

    The model has its coefficients anyway, each with a value that no mission determines exactly.  An effect beside them
    is an addition, and must explain the missions better by more than a tie.  If it acts like a coefficient (in steady
    flight, a clock's rate acts like drag), the coefficient takes up any part of it that both sides share, and the
    evidence does not say which of the two has changed.
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
    """Whether a trial is of a changed coefficient that is tied with the chosen trial."""
    form, path = changed(trial.candidate.paths[0])
    if not form or path not in bench.plant.doubted or trial.objection or trial.state is None:
        return False
    assert chosen.state is not None
    return _behind(bench, trial.state, chosen.state, trial.candidate.paths[0]) < TIE


def _behind(bench: Workbench, own: State, other: State, path: str) -> float:
    """The evidence by which a state with a changed coefficient falls behind another state.

    path: of the change.  The prior of the coefficient is applied to the side on which its value is nearer to it, not to
    the change: the fit applies it to the side before, although the change may have restored the stated value (a hull
    may have been cleaned).
    """
    _, coefficient = changed(path)
    value = value_at(own.plant, coefficient) + value_at(own.plant, path)
    after = replace_at(own.plant, coefficient, float(np.clip(value, *spec_at(own.plant, coefficient).bounds)))
    before, late = (float(bench.problem.pulls(p.vector, [coefficient])[0][0]) ** 2 for p in (own.plant, after))
    return bench.gain(own, other) - max(before - late, 0.0)


def _in_its_place(bench: Workbench, state: State, chosen: Trial, other: Trial) -> State:
    """The state with another trial in the place of the chosen one, fitted."""
    assert other.state is not None
    paths = [p for p in state.paths if p not in chosen.candidate.free]
    values = {p: spec_at(state.plant, p).neutral for p in chosen.candidate.paths}
    values |= {p: value_at(other.state.plant, p) for p in other.state.paths}
    return bench.fit(replace_at(state.plant, values), [*paths, *other.candidate.free], other.state)


def _own_paths(made: Round, state: State) -> list[str]:
    assert made.chosen is not None
    return [p for p in made.chosen.candidate.paths if p in state.paths]


def one_or_two(bench: Workbench, state: State, path: str, rounds: Sequence[Round], count: int) -> Changed | Common:
    """A parameter on both sides, with both values free; common if the evidence does not require two values.

    It is also common if the interval of the change includes zero; that interval allows for a misjudged colour of the
    errors.
    count: number of all candidates, which sets the bar.
    """
    spec, values = spec_at(state.plant, path), _values(bench, state, path)
    common, both, first, second = values.common, values.both, values.first, values.second
    mine = [r for r in rounds if {path, change(BEFORE, path), change(AFTER, path)} & set(_own_paths(r, state))]
    evidence, tied = bench.gain(common, both), tied_names(mine)
    moved = sized(bench, both, {p: second.get(p, 0.0) - first.get(p, 0.0) for p in {**first, **second}})
    if evidence < threshold(count) or moved.ci95[0] <= 0.0 <= moved.ci95[1]:
        size = Sized(value_at(common.plant, path), bench.interval(common, path))
        return Common(path, spec.title or path, spec.unit, size, sum(r.evidence[0] for r in mine), tied)
    return Changed(
        path,
        spec.title or path,
        spec.unit,
        sized(bench, both, first, values.added, spec.bounds),
        sized(bench, both, second, values.added, spec.bounds),
        moved,
        evidence,
        tied,
        _surely(tied),
    )


def _surely(tied: Sequence[str]) -> bool:
    """Whether all alternatives are changes."""
    return all(" " in t for t in tied)


@dataclass(frozen=True, eq=False)
class _Values:
    """The fits of a parameter with one value for all missions, `common`, and with one on each side, `both`.

    first, second: the shares of the fitted paths whose sum, plus `added`, is the value before and after.
    """

    common: State
    both: State
    first: dict[str, float]
    second: dict[str, float]
    added: float


def _values(bench: Workbench, state: State, path: str) -> _Values:
    """The fits of a parameter with one value and with two, with all else as in a state."""

    def fitted() -> _Values:
        spec, plant, added = spec_at(state.plant, path), state.plant, 0.0
        early, late = change(BEFORE, path), change(AFTER, path)
        kept = [p for p in state.paths if p not in (path, early, late)]
        if path in plant.doubted:  # its value is fitted with a prior; the change is added to it
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
        return _Values(common, both, first, second, added)

    return bench.once(state, ("values", path), fitted)


def timed(bench: Workbench, state: State, told: Changed | Common, sides: Sides, count: int) -> Changed | Common:
    """A change with its time and its sizes in the logs, or what is common on both sides.

    What seems to be common is a change if its size certainly changed at another time than between the sides, and by
    more than a little.
    count: number of all candidates.
    """
    values = _values(bench, state, told.path)
    step = step_elsewhere(bench, values.common, values.both, told.path, sides, count)
    if isinstance(told, Common) and (step is None or not _differs(step, values.common)):
        return told
    sizes = sizes_by_log(bench, values.common, told.path, sides)
    if step is None:
        assert isinstance(told, Changed)
        return replace(told, moment=sides.middle, sizes=sizes)
    others = tuple(name for name in told.tied if name.rpartition(" ")[2] != told.path)
    return _stepped(bench, replace(step, tied=others), sizes)


def _differs(step: Step, common: State) -> bool:
    """Whether a size before or after a step differs from the common one by more than a little."""
    size, neutral = value_at(common.plant, step.path), spec_at(common.plant, step.path).neutral
    return max(abs(one.value - size) for one in (step.before, step.after)) > SLIGHTLY * abs(size - neutral)


def _one_step_each(bench: Workbench, state: State, told: Sequence[Changed | Common], sides: Sides) -> bool:
    """Whether what was found has one size on each side: what it leaves would otherwise be taken for something else."""
    if any(isinstance(one, Changed) and one.moment != sides.middle for one in told):
        return False
    return not told or not steadiness(bench, state, [one.path for one in told]).varies


def _stepped(bench: Workbench, step: Step, sizes: tuple[OfLog, ...] = ()) -> Changed:
    """A step at another time than between the two sides as a change."""
    spec = spec_at(bench.plant, step.path)
    values = step.before, step.after, step.change
    title = spec.title or step.path
    return Changed(
        step.path, title, spec.unit, *values, step.evidence, step.tied, _surely(step.tied), step.moment, sizes
    )


def sides_of(record: Record, edge: int, names: tuple[Sequence[str], Sequence[str]]) -> Sides:
    """The logs of a record whose second side begins at a row; the only log of a side has the side's name as label."""
    found, rows = list[OneLog](), np.arange(len(record))
    for begin, own, side in ((0, rows < edge, names[0]), (edge, rows >= edge, names[1])):
        logs = logs_in(record.select(own))
        for one in logs:
            label, number = ", ".join(side) if len(logs) == 1 else one.name, len(found) + 1
            found.append(OneLog(label, number, slice(one.rows.start + begin, one.rows.stop + begin)))
    return Sides(tuple(found), edge)


def _common(bench: Workbench, state: State, made: Round, path: str) -> Common:
    spec = spec_at(state.plant, path)
    size = Sized(value_at(state.plant, path), bench.interval(state, path))
    return Common(path, spec.title, spec.unit, size, made.evidence[0], tied_names([made]))


def detectable_beside(change: Sized, count: int) -> float:
    """The change that is found with 95 % probability, from a change's interval; count: number of all candidates."""
    return 0.5 * (change.ci95[1] - change.ci95[0]) * _over_half(count)


def _over_half(count: int) -> float:
    """The size, in half-widths of its 95 % interval, at which a change is found with 95 % probability."""
    return deviations_shown(threshold(count)) / SURPRISE


def _unchanged(bench: Workbench, state: State, rest: Sequence[Candidate], count: int) -> list[Unchanged]:
    """Parameters that show no change, by regressing the final model's errors on a change of each."""
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
