"""The verdict: the named effects, effects that only resemble the record's behaviour, and wrong coefficients."""

from __future__ import annotations

from dataclasses import dataclass, replace

from identification.deciding import EXPLAINED
from identification.diagnosis.judge.common import Common
from identification.diagnosis.judge.effects import Coefficient, Effect
from identification.diagnosis.judge.explained import verdict_of
from identification.diagnosis.judge.reporting import Reported
from identification.diagnosis.judge.result import Stage, Verdict
from identification.diagnosis.judge.scoring import Scored, Scoring
from identification.diagnosis.judge.sizes import (
    as_coefficients,
    coefficient_of,
    coefficient_twins,
    turned_gains,
    twin_effects,
)
from identification.diagnosis.judge.weighing import common_predictions
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.wording import quantity, short


@dataclass(frozen=True, eq=False)
class Conclusion:
    """The verdict and the results it is based on; see `Diagnosis`."""

    verdict: Verdict
    effects: tuple[Effect, ...]
    alike: tuple[Effect, ...]
    tied: tuple[tuple[str, ...], ...]
    common: tuple[Common, ...]
    coefficients: tuple[Coefficient, ...]
    before: Stage
    explained: float
    doubts: tuple[Doubt, ...] = ()


def concluded(scoring: Scoring, found: Reported, scored: Scored) -> Conclusion:
    """The verdict on a log, from the reported effects and the scored stages."""
    log, searched, state = scoring.log, scoring.searched, found.state
    known, count = searched.known, len(searched.candidates)
    plant = known.plant
    coefficients = tuple(
        coefficient_of(plant, p, found.sizes[p], count, plant.deviation(p, log.asked.doubt))
        for p in known.coefficients
        if p in found.sizes
    )
    wrong = any(c.wrong for c in coefficients)
    before = scored.given if wrong and not found.effects else scored.refitted
    effects = [replace(e, changes=scoring.changes(e.path, e.neutral, scored.after)) for e in found.effects]
    tied = list(found.tied)
    common = common_predictions(effects, tied, found.weighed.found, state, scoring.every_run)
    if wrong:
        groups = coefficient_twins(plant, coefficients)
        effects += twin_effects(groups, effects, coefficients, known.bench, state, count)
        tied += [group for group in groups if not any(group[0] in other for other in tied)]
    explained = scoring.explained(before, scored.after)
    verdict = verdict_of(effects, tied, explained, bool(found.left), not found.effects, wrong)
    told = tuple(as_coefficients(known.given.plant, effects))
    unexplained = verdict == "unexplained"
    doubts = () if log.asked.trust else tuple(_turned(c) for c in turned_gains(plant, coefficients))
    if log.slipped or (log.doubts and unexplained and explained < EXPLAINED):  # the model is still far off
        verdict = "doubted"
    if doubts and not unexplained:
        return Conclusion("doubted", (), told, (), (), coefficients, before, explained, doubts)
    if unexplained:
        return Conclusion(verdict, (), told, (), (), coefficients, before, explained, doubts)
    return Conclusion(verdict, told, (), tuple(tied), common, coefficients, before, explained)


def _turned(c: Coefficient) -> Doubt:
    """The doubt about a log in which an actuator acts with the opposite sign."""
    sizes = f"{quantity(c.value, c.unit)}, given {quantity(c.given, c.unit)}"
    mend = "check the signs of the commands and of what they move, and turn the wrong one in a mapping (-NAME)"
    return Doubt(f"the {short(c.title)} has the opposite sign in this log ({sizes})", (), 1.0, mend)
