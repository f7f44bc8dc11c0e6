"""The gate before every name: why a change of the model is not accepted, or nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import spec_at, value_at
from auv_gym.plant import Plant
from identification.deciding import EFFECT_LEAST, EFFECT_SHARE, SURE, SURPRISE, TERM_LEAST, TERM_SHARE
from identification.diagnosis.search.workbench import State, Workbench

EDGE = 1e-4  # of the span between the bounds of a parameter: fits that stop early end near a bound, not at it

INSIGNIFICANT = "not significant"
UNREPEATED = "does not hold from one part of the log to the others"
DIVERGES = "free runs diverge with it"
LIMITED = "helps only at the limit of its physical or known range"
UNSURE = "its size is too uncertain"
GONE = "not significant next to the other effects"


@dataclass(frozen=True)
class Rule:
    """What parts foretold by the others must show of a change.

    least: evidence from them alone.  share: of the evidence in all rows that they must repeat.
    """

    least: float
    share: float


EFFECT = Rule(EFFECT_LEAST, EFFECT_SHARE)
TERM = Rule(TERM_LEAST, TERM_SHARE)


@dataclass(frozen=True)
class Size:
    """How far a parameter is from neutral, and whether it is at a bound."""

    moved: float
    limited: bool


@dataclass(frozen=True)
class Claim:
    """What speaks for a change of the model, against the same model without it.

    train, held: evidence in all rows, and in parts foretold by the others.  bar: what the first must reach.  sizes: of
    its parameters.  reach: half widths of their 95 % intervals.  flies: whether free runs stay finite with it.
    These two are costly and asked for last.  known: how much of the first is due to coefficients that are nearer to
    what was stated of them; parts say nothing of that.
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

    held: zero where the evidence in all rows does not reach the bar.
    """

    train: float
    held: float
    objection: str
    known: float = 0.0

    @property
    def total(self) -> float:
        return self.train


def objection(claim: Claim, rule: Rule = EFFECT) -> str:
    """Why a change is not accepted, or "": every name has passed here, by whatever way it was found."""
    if not claim.train >= claim.bar:
        return INSIGNIFICANT
    # what is known of the coefficients may be enough; parts must not contradict it then
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
    """What the gate says of sizes that one state has and the other has not; soon: see `Workbench.by_part`."""
    if not after.finite:
        return Weighed(0.0, 0.0, DIVERGES)
    train, known = bench.gain(before, after), bench.known_gain(before, after)
    held = bench.gain_foretold(before, after, soon) if train >= bar else 0.0
    claim = Claim(train, held, bar, sizes, reach, lambda: bench.flies(after.plant), known)
    return Weighed(train, held, objection(claim), known)


def effect_size(plant: Plant, path: str, bounds: tuple[float, float] | None = None) -> Size:
    """The size that a plant has at a path: what is sure is named however small it is, see `Effect.changes`.

    bounds: of the fit, where what is known of an effect makes them narrower than the physical range.
    """
    spec, value = spec_at(plant, path), value_at(plant, path)
    return Size(abs(value - spec.neutral), at_limit(value, bounds or spec.bounds, spec.neutral))


def at_limit(value: float, bounds: tuple[float, float], neutral: float) -> bool:
    """Whether a value is at a bound, or beyond, that is not its neutral value."""
    low, high = bounds
    slack = EDGE * (high - low) if np.isfinite(high - low) else 0.0
    return bool((low != neutral and value <= low + slack) or (high != neutral and value >= high - slack))
