"""The findings of a diagnosis: effects, the causes they are tied with, coefficients, and detectable sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from identification.diagnosis.search.constancy import OfDive, varies
from identification.diagnosis.wording import at_most, inside, interval, quantity, sized


@dataclass(frozen=True)
class AsCoefficient:
    """The one coefficient that an effect changes: its given value, its value with the effect, and the interval."""

    path: str
    title: str
    unit: str
    given: float
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Member:
    """An effect that may be the cause instead of a named one: its probability, and its size if it is the cause.

    spared: paths of other named effects that are not needed in the likeliest set with this one.
    """

    path: str
    title: str
    probability: float
    value: float
    neutral: float
    unit: str
    ci95: tuple[float, float]
    spared: tuple[str, ...] = ()

    @property
    def size(self) -> str:
        """The size in words."""
        return at_most(self.value, self.ci95, self.neutral) + inside(self.value, self.ci95, self.unit)


@dataclass(frozen=True)
class Effect:
    """A named effect: its size with a 95 % interval, the evidence for it, and the causes it is tied with.

    frequency: share of the halves of the record that choose it or an effect tied with it.
    changes: RMS change of free runs over the record's windows when the effect is removed, by channel, in the channel's
    unit.
    coefficient: if the effect only changes one coefficient, that coefficient; the effect is reported as such.
    probability: total probability of the sets of effects that include it, among all sets that explain the record about
    as well; None if it was found from a coefficient's change.  members: the tied effects, with the same quantities.
    steady: probability of differences in size this large between parts of the record if the size is constant.  apart:
    the largest such difference, as a share of the size.
    by_dive: its size in each dive, if the dives contradict each other.
    """

    path: str
    title: str
    value: float
    neutral: float
    unit: str
    ci95: tuple[float, float]
    evidence_train: float
    evidence_held: float
    tied_with: tuple[str, ...] = ()
    frequency: float = 1.0
    changes: Mapping[str, float] = field(default_factory=dict)
    coefficient: AsCoefficient | None = None
    probability: float | None = None
    members: tuple[Member, ...] = ()
    steady: float = 1.0
    apart: float = np.inf
    by_dive: tuple[OfDive, ...] = ()

    @property
    def unsteady(self) -> bool:
        """Whether its size differs significantly between parts of the record, other than from dive to dive."""
        return varies(self.steady, self.apart) and not self.by_dive

    @property
    def name(self) -> str:
        """The name of the cause: the effect's title, or the coefficient that it changes."""
        return self.title if self.coefficient is None else f"change in {self.coefficient.title}"

    @property
    def size(self) -> str:
        """The size in words; that of the coefficient if the effect only changes one."""
        c = self.coefficient
        if c is not None:
            return inside(c.value, c.ci95, c.unit)
        return at_most(self.value, self.ci95, self.neutral) + inside(self.value, self.ci95, self.unit)

    @property
    def told(self) -> str:
        """The cause, its size and its interval, in words."""
        c = self.coefficient
        if c is None:
            return sized(self.title, self.size, interval(self.ci95, self.unit))
        title, _, remark = c.title.removesuffix(")").partition(" (")
        told = ", ".join([f"95 % interval {interval(c.ci95, c.unit)}", *([remark] if remark else [])])
        return f"{title} of {self.size} instead of {quantity(c.given, c.unit)} ({told})"


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of the vehicle, as given and as refitted.

    moved: significantly different from the given value.  wrong: also outside the uncertainty that the vehicle states.
    limited: at the limit that the given value's uncertainty sets for the fit.
    """

    path: str
    title: str
    unit: str
    given: float
    value: float
    ci95: tuple[float, float]
    wrong: bool = False
    limited: bool = False
    moved: bool = False

    @property
    def change(self) -> str:
        """The difference from the given value, with the interval, in words."""
        if self.given == 0.0:
            return (
                f"{inside(self.value, self.ci95, self.unit)} (95 % interval {interval(self.ci95, self.unit)}, given 0)"
            )
        share, *limits = (100.0 * (v / self.given - 1.0) for v in (self.value, *self.ci95))
        return f"{share:+.3g} % (95 % interval {interval((min(limits), max(limits)), '%')})"


@dataclass(frozen=True)
class Detectable:
    """The smallest size of a candidate that this record would have shown; infinite if it cannot show it at all."""

    path: str
    title: str
    unit: str
    size: float
    reason: str = ""
