"""The forms in time in which an effect, or a coefficient, may act: candidates, and their courses over a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identification.changes.forms import Changeable, in_form, kind_of
from identification.changes.spans import BETWEEN, OUTSIDE
from identification.diagnosis.search.candidates import Candidate
from identification.fit.changing import Course, changed

FROM, UNTIL, GROWING = "from", "until", "growing"


@dataclass(frozen=True)
class Forms:
    """An effect, or a coefficient, in the forms in which it may act.

    throughout: None for a coefficient.  groups: from each of the times on, until each of them, growing.  spans: between
    and outside of two times, which are set once a pair of times looks promising.
    """

    throughout: Candidate | None
    groups: tuple[tuple[Candidate, ...], ...]
    spans: tuple[Candidate, ...] = ()

    @classmethod
    def of(cls, own: Candidate, courses: Mapping[str, Course], number: int | None = None) -> Forms:
        """All forms of an effect with a number, or of a coefficient (number None)."""
        kinds = (FROM, GROWING) if number is None else (FROM, UNTIL, GROWING)
        groups = tuple(tuple(in_form(own, name) for name in courses if kind_of(name) == kind) for kind in kinds)
        if number is None:
            return cls(None, groups)
        spans = (BETWEEN, OUTSIDE) if own.sloped else ()  # found from slopes
        return cls(own, groups, tuple(in_form(own, f"{kind}{number}") for kind in spans))

    @property
    def paths(self) -> set[str]:
        """The paths of what may change."""
        return {changed(p)[1] for c in self.screened for p in c.paths}

    @property
    def count(self) -> int:
        """The number of forms, without those of two times."""
        return (self.throughout is not None) + sum(map(len, self.groups))

    @property
    def screened(self) -> list[Candidate]:
        """The forms that are screened one by one."""
        return [*([self.throughout] if self.throughout else []), *(c for group in self.groups for c in group)]

    def without(self, chosen: Candidate) -> Forms:
        """The forms that are left once one is chosen; spans, built from whole groups, stay only if all groups do."""
        groups = tuple(group for group in self.groups if chosen not in group)
        whole = len(groups) == len(self.groups) and chosen is not self.throughout and chosen not in self.spans
        return Forms(self.throughout if chosen is not self.throughout else None, groups, self.spans if whole else ())


def paths_of(form: str, may: Changeable) -> list[str]:
    """The paths that may change in a form; for a form of two times, those of the one effect whose number it has."""
    kind = kind_of(form)
    if kind in (BETWEEN, OUTSIDE):
        return list(may.effects[int(form.removeprefix(kind))].paths)
    return may.paths if kind == UNTIL else [*may.coefficients, *may.paths]


def courses_of(edges: Sequence[int], effects: int) -> dict[str, Course]:
    """The forms in which something may change, by name; `from7`: from the seventh of the rows on.

    Forms of two times have an effect's number; their times are not set yet.
    """
    count = len(edges) + 1
    found = {f"{FROM}{k}": Course((edge,), (0.0, 1.0)) for k, edge in enumerate(edges, 1)}
    found |= {f"{UNTIL}{k}": Course((edge,), (1.0, 0.0)) for k, edge in enumerate(edges, 1)}
    for k in range(effects):
        found[f"{BETWEEN}{k}"] = Course((edges[0], edges[-1]), (0.0, 1.0, 0.0))
        found[f"{OUTSIDE}{k}"] = Course((edges[0], edges[-1]), (1.0, 0.0, 1.0))
    return found | {GROWING: Course(tuple(edges), tuple((np.arange(count) + 0.5) / count))}
