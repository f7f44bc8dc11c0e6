"""Effects as a diagnosis reports them, with sizes and intervals; also wrong coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.deciding import BEYOND, HOPELESS, LEAST_CHANGE, REACH, SURPRISE
from identification.diagnosis.judge.effects import AsCoefficient, Coefficient, Effect, Member
from identification.diagnosis.judge.selected import selected_interval
from identification.diagnosis.search.acceptance import Size, at_limit, weighed
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.constancy import steadiness
from identification.diagnosis.search.explanations import UNWEIGHED, Explanations
from identification.diagnosis.search.survival import Survival
from identification.diagnosis.search.workbench import State, Workbench
from identification.diagnosis.wording import quantity
from identification.fit.changing import changed

Sizes = Mapping[str, tuple[float, float, float]]  # value, standard error and half-width of the interval, by path


def effects_of(
    bench: Workbench,
    state: State,
    rounds: Sequence[Round],
    sizes: Sizes,
    survivals: Sequence[Survival],
    count: int,
    found: Explanations = UNWEIGHED,
) -> tuple[list[Effect], list[tuple[str, ...]]]:
    """The named effects with their intervals, and the groups that the record cannot tell apart.

    count: number of all candidates.  found: all sets of effects that explain the record.
    """
    effects, groups = [], []
    for r, survived in zip(rounds, survivals, strict=True):
        assert r.chosen is not None
        own = tuple(p for p in r.chosen.candidate.paths if p in state.paths)
        others = tuple(dict.fromkeys(p for t in r.tied for p in t.candidate.paths))
        beside = [p for o in rounds if o is not r and o.chosen is not None for p in o.chosen.candidate.paths]
        members = tuple(m for m in (_member(bench, found, path, beside) for path in others) if m is not None)
        others += r.instead
        if others:
            groups.append((*own, *others))
        bar = threshold(count + r.chosen.screening.tried - 1, len(r.chosen.candidate.free))
        set_to = _set_to(state.plant, r.chosen.candidate)
        for path in own:
            spec, steady = spec_at(state.plant, path), steadiness(bench, state, [path])
            effects.append(
                Effect(
                    path=path,
                    title=_title(spec.title, path, state, set_to),
                    value=sizes[path][0],
                    neutral=spec.neutral,
                    unit=spec.unit,
                    ci95=selected_interval(
                        sizes[path][0], spec.neutral, bench.interval(state, path), r.evidence[0], bar
                    ),
                    evidence_train=r.evidence[0],
                    evidence_held=r.evidence[1],
                    tied_with=others,
                    frequency=survived.frequency,
                    steady=steady.probability,
                    apart=steady.apart,
                    probability=found.probability(path) if found.sets else None,
                    members=members,
                )
            )
    return effects, groups


def _title(title: str, path: str, state: State, set_to: str) -> str:
    """The title of an effect, with its setting before a remark in brackets, as in "rudder stuck at 5.7 deg (...)".

    It is "change of ..." for an effect of some logs beside the same effect in all of them.
    """
    form, own = changed(path)
    name, bracket, remark = title.partition(" (")
    title = f"{name}{set_to}{bracket}{remark}"
    return f"change of {title}" if form and own in state.paths else title


def _set_to(plant: Plant, candidate: Candidate) -> str:
    """An effect's setting in words, "" without one."""
    if not candidate.setting:
        return ""
    value = quantity(value_at(plant, candidate.setting), spec_at(plant, candidate.setting).unit)
    return f" with a period of {value}" if candidate.periodic else f" at {value}"


def _member(bench: Workbench, found: Explanations, path: str, beside: Sequence[str]) -> Member | None:
    """A member of a tie, with its size in the likeliest set that includes it; beside: the other named effects."""
    best = found.best_with(path)
    if best is None:
        return None
    spec, (value, _, half) = spec_at(best.state.plant, path), bench.intervals(best.state)[path]
    low, high = spec.bounds
    limits = (max(value - half, min(low, value)), min(value + half, max(high, value)))
    spared = tuple(p for p in beside if p not in best.state.paths)
    return Member(path, spec.title, found.probability(path), value, spec.neutral, spec.unit, limits, spared)


def as_coefficients(plant: Plant, effects: Sequence[Effect]) -> list[Effect]:
    """The effects; those that only change one coefficient also get that coefficient's value with the effect."""
    known = plant.family.coefficients_of(plant.parameters)
    told = []
    for effect in effects:
        if effect.path in known:
            path, law = known[effect.path]
            spec, given = spec_at(plant, path), value_at(plant, path)
            low, high = sorted(law(given, size) for size in effect.ci95)
            title = spec.title or path
            effect = replace(
                effect,
                coefficient=AsCoefficient(path, title, spec.unit, given, law(given, effect.value), (low, high)),
            )
        told.append(effect)
    return told


def coefficient_of(
    plant: Plant, path: str, size: tuple[float, float, float], count: int, deviation: float
) -> Coefficient:
    """A refitted coefficient; wrong if it moved significantly, and further than the stated uncertainty allows.

    deviation: standard deviation of the given value; it counts as stated only if the vehicle itself gives it.
    """
    spec, given, (value, error, _) = spec_at(plant, path), value_at(plant, path), size
    change, least = abs(value - given), LEAST_CHANGE * abs(given)
    stated = SURPRISE * deviation if path in plant.deviations else least
    sure = change > np.sqrt(threshold(count)) * error
    wrong, moved, limited = sure and change > stated, sure and change > least, change >= 0.999 * REACH * deviation > 0.0
    span = _span(size)
    return Coefficient(path, spec.title, spec.unit, given, value, span, bool(wrong), bool(limited), bool(moved))


def coefficient_twins(plant: Plant, found: Sequence[Coefficient]) -> list[tuple[str, ...]]:
    """Pairs of an effect and the wrong coefficient that it is equivalent to."""
    wrong = {c.path: c for c in found if c.wrong and c.given != 0.0}
    return [(effect, path) for effect, path in plant.twins.items() if path in wrong]


def turned_gains(plant: Plant, found: Sequence[Coefficient]) -> list[Coefficient]:
    """Coefficients equivalent to an actuator's gain whose sign has significantly changed.

    No actuator reverses: either a command or the reading of what it moves has the opposite sign in the record, or the
    record is of another vehicle.
    """
    gains = {path for effect, path in plant.twins.items() if effect.endswith(".gain")}
    return [c for c in found if c.path in gains and max(c.given * end for end in c.ci95) < 0.0]


def size_as_effect(plant: Plant, effect: str, given: float, value: float) -> float:
    """The size of an effect that turns the given coefficient into this value; the value is linear in the size."""
    shift = 1.0 - spec_at(plant, effect).neutral  # gains are neutral at one, errors at zero
    scaled = ("", lambda coefficient, size: coefficient * (shift + size))
    _, law = plant.family.coefficients_of(plant.parameters).get(effect, scaled)
    none, one = law(given, 0.0), law(given, 1.0)
    return (value - none) / (one - none)


def twin_effects(groups, effects, found, bench: Workbench, state: State, count: int) -> list[Effect]:
    """Effects equivalent to a coefficient that changed by more than `BEYOND`: the record does not tell which it was.

    An effect is named if the coefficient's change, expressed as the effect's size, passes the gate against the
    coefficient as given.
    """
    named = {e.path for e in effects}

    def tried(group: tuple[str, ...]) -> Effect | None:
        path, c = group[0], next(c for c in found if c.path == group[-1])
        if path in named or abs(c.value / c.given - 1.0) <= BEYOND:
            return None
        spec = spec_at(bench.plant, path)
        value = size_as_effect(bench.plant, path, c.given, c.value)
        low, high = sorted(size_as_effect(bench.plant, path, c.given, v) for v in c.ci95)
        size = Size(abs(value - spec.neutral), at_limit(value, spec.bounds, spec.neutral))
        put_back = replace_at(state.plant, c.path, c.given)
        before = bench.fit_from([(put_back, state)], tuple(p for p in state.paths if p != c.path), state, HOPELESS)
        passed = weighed(bench, before, state, [size], lambda half=(high - low) / 2.0: [half], threshold(count))
        if passed.objection:
            return None
        return Effect(
            path, spec.title, value, spec.neutral, spec.unit, (low, high), passed.train, passed.held, group[1:]
        )

    return [effect for effect in side_by_side(tried, groups) if effect is not None]


def _span(size: tuple[float, float, float]) -> tuple[float, float]:
    return (size[0] - size[2], size[0] + size[2])
