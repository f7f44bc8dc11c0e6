"""The gate of a diagnosis: the acceptance test for changes of the model, which every named effect has passed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import spec_at, value_at
from auv_gym.plant import Plant
from identification.deciding import EFFECT_LEAST, EFFECT_SHARE, SURE, SURPRISE, TERM_LEAST, TERM_SHARE
from identification.diagnosis.search.workbench import State, Workbench

EDGE = 1e-4  # distance to a bound, over the span of the bounds, that counts as at it: fits may stop just before

INSIGNIFICANT = "not significant"
UNREPEATED = "does not hold from one part of the log to the others"
DIVERGES = "free runs diverge with it"
LIMITED = "helps only at the limit of its physical or known range"
UNSURE = "its size is too uncertain"
GONE = "not significant next to the other effects"


@dataclass(frozen=True)
class Rule:
    """The evidence that a change needs in parts of the log that are predicted from the others.

    least: the least evidence there.  share: the least such evidence, over the evidence in all rows.
    """

    least: float
    share: float


EFFECT = Rule(EFFECT_LEAST, EFFECT_SHARE)
TERM = Rule(TERM_LEAST, TERM_SHARE)


@dataclass(frozen=True)
class Size:
    """A parameter's distance from its neutral value, and whether it is at a bound."""

    moved: float
    limited: bool


@dataclass(frozen=True)
class Claim:
    """The evidence for a change of the model, compared with the same model without it.

    train, held: evidence in all rows, and in parts predicted from the others.  bar: threshold of `train`.
    sizes: of the change's parameters.  reach: returns half widths of their 95 % intervals.  flies: returns whether free
    runs with the change stay finite.  Both are costly, and called last.
    known: part of `train` due to coefficients closer to their stated values, about which the parts hold no evidence.
    """

    train: float
    held: float
    bar: float
    sizes: Sequence[Size]
    reach: Callable[[], Sequence[float]]
    flies: Callable[[], bool]
    known: float = 0.0


@dataclass(frozen=True)
class Weighed:
    """The evidence for a change, and the objection to it, or ""; see `Claim`.

    held: 0 if the evidence in all rows does not reach the threshold.
    """

    train: float
    held: float
    objection: str
    known: float = 0.0

    @property
    def total(self) -> float:
        return self.train


def objection(claim: Claim, rule: Rule = EFFECT) -> str:
    """The reason why a change is not accepted, or ""; every named effect passes this test, however it was found."""
    if not claim.train >= claim.bar:
        return INSIGNIFICANT
    # priors of the coefficients may suffice as evidence; then the parts must only not contradict
    least = -rule.least if claim.known >= claim.bar else max(rule.least, rule.share * claim.train)
    if not claim.held >= least:
        return UNREPEATED
    if any(size.limited for size in claim.sizes):
        return LIMITED
    if all(size.moved < SURE / SURPRISE * half for size, half in zip(claim.sizes, claim.reach(), strict=True)):
        return UNSURE
    if not claim.flies():
        return DIVERGES
    return ""


def weighed(
    bench: Workbench,
    before: State,
    after: State,
    sizes: Sequence[Size],
    reach: Callable[[], Sequence[float]],
    bar: float,
    soon: bool = False,
) -> Weighed:
    """The evidence for the change from one state to another, and the objection to it; soon: see `Workbench.by_part`."""
    if not after.finite:
        return Weighed(0.0, 0.0, DIVERGES)
    train, known = bench.gain(before, after), bench.known_gain(before, after)
    held = bench.gain_foretold(before, after, soon) if train >= bar else 0.0
    claim = Claim(train, held, bar, sizes, reach, lambda: bench.flies(after), known)
    return Weighed(train, held, objection(claim), known)


def effect_size(plant: Plant, path: str, bounds: tuple[float, float] | None = None) -> Size:
    """The size of an effect of a plant; a certain effect is named however small it is, see `Effect.changes`.

    bounds: those of the fit, which prior knowledge of an effect may make narrower than the physical range.
    """
    spec, value = spec_at(plant, path), value_at(plant, path)
    return Size(abs(value - spec.neutral), at_limit(value, bounds or spec.bounds, spec.neutral))


def at_limit(value: float, bounds: tuple[float, float], neutral: float) -> bool:
    """Whether a value is at or beyond a bound that is not its neutral value."""
    low, high = bounds
    slack = EDGE * (high - low) if np.isfinite(high - low) else 0.0
    return bool((low != neutral and value <= low + slack) or (high != neutral and value >= high - slack))
