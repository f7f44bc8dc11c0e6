"""What a diagnosis finds: effects, what they are tied with, coefficients, and what a record could have shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from identification.diagnosis.search.constancy import OfDive, varies
from identification.diagnosis.wording import at_most, interval, quantity, sized


@dataclass(frozen=True)
class AsCoefficient:
    """The coefficient that an effect does nothing but change: what was given, what it comes to, and the interval."""

    path: str
    title: str
    unit: str
    given: float
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Member:
    """An effect that may be the cause in place of a named one: its probability, and its size if it is the cause.

    spared: other named effects, by path, that the likeliest set with it does without.
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
        """Its size in words."""
        return at_most(self.value, self.ci95, self.neutral) + quantity(self.value, self.unit)


@dataclass(frozen=True)
class Effect:
    """A named effect: its size with a 95 % interval, the evidence for it, and what the record cannot tell from it.

    frequency: share of the halves of the record that name it, or what it is tied with.
    changes: by channel, in its unit, by how much free runs over the record's windows change without it, RMS.
    coefficient: what it is reported as, where it does nothing but change that one.
    probability: of all sets of effects that explain the record nearly as well, those that have it; None where it was
    found by a coefficient's change.  members: what it is tied with, the same of each.
    steady: probability that parts of the record differ in its size as much, if it is the same in all.  apart: by how
    much they do at the most, as a share of it.
    by_dive: its size in each dive, where the dives contradict each other in it.
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
        """Whether its size differs much between parts of the record, and not from dive to dive."""
        return varies(self.steady, self.apart) and not self.by_dive

    @property
    def name(self) -> str:
        """What the matter is called."""
        return self.title if self.coefficient is None else f"another {self.coefficient.title}"

    @property
    def size(self) -> str:
        """Its size in words, as that of a coefficient where it does nothing but change one."""
        c = self.coefficient
        if c is not None:
            return quantity(c.value, c.unit)
        return at_most(self.value, self.ci95, self.neutral) + quantity(self.value, self.unit)

    @property
    def told(self) -> str:
        """What is the matter, its size and its interval, in words."""
        c = self.coefficient
        if c is None:
            return sized(self.title, self.size, interval(self.ci95, self.unit))
        return sized(f"another {c.title}", self.size, interval(c.ci95, c.unit), f"given {quantity(c.given, c.unit)}")


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of the vehicle, as given and as refitted.

    moved: surely not what was given.  wrong: nor within what the vehicle states.  limited: as far from there as its
    doubt lets a fit go.
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
        """By how much it differs from the given value, with the interval, in words."""
        if self.given == 0.0:
            return f"{quantity(self.value, self.unit)} (95 % interval {interval(self.ci95, self.unit)}, given 0)"
        share, *limits = (100.0 * (v / self.given - 1.0) for v in (self.value, *self.ci95))
        return f"{share:+.3g} % (95 % interval {interval((min(limits), max(limits)), '%')})"


@dataclass(frozen=True)
class Detectable:
    """The smallest size of a candidate that this record would have shown, infinite if it cannot show it at all."""

    path: str
    title: str
    unit: str
    size: float
    reason: str = ""
