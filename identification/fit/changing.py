"""A vehicle whose parameters change along a record: from a row on, up to a row, or gradually."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, make_dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from auv_gym.model import elapsed_in
from auv_gym.param import Spec, list_paths, part, positions, replace_at, spec_at, value_at
from auv_gym.plant import Correction, Plant, Runs
from auv_gym.records.record import Record

CHANGES = "changes"
_SHARE = 0.1  # of a coefficient's value: the step size of a fit for its change


@dataclass(frozen=True)
class Course:
    """The share of a change that acts at each row of a record; piecewise constant, with a new value from each edge on.

    shares: one before the first edge, and one from each edge on.  name: when the change acts, appended to the title of
    the changed parameter.
    """

    edges: tuple[int, ...]
    shares: tuple[float, ...]
    name: str = ""

    def at(self, row: int) -> float:
        """The share at a row."""
        return self.shares[int(np.searchsorted(self.edges, row, side="right"))]

    def over(self, rows: np.ndarray) -> np.ndarray:
        """The share at each of some rows."""
        return np.array(self.shares)[np.searchsorted(self.edges, rows, side="right")]

    def beyond(self, row: int, elapsed: np.ndarray) -> float:
        """The share at a row times the time since the log began, beyond the sum of the shares over that time, s."""
        steps = np.diff(self.shares)
        return float(sum(step * elapsed[edge] for edge, step in zip(self.edges, steps, strict=True) if edge <= row))

    def of(self, whole: Course) -> Course:
        """The product with another course, for a change of a change that itself acts by that other course."""
        edges = sorted({*self.edges, *whole.edges})
        return Course(tuple(edges), tuple(self.at(row) * whole.at(row) for row in (-1, *edges)), whole.name)


@dataclass(frozen=True)
class ChangingPlant(Plant):
    """A plant with one more parameter for each form in which one of its parameters may change.

    Their paths are `changes.FORM.PATH`; zero is no change.  The changed parameter may itself be a change, in a form of
    its own.
    courses: of the forms, by name.  The changed value stays within the bounds of the parameter.
    elapsed: (n,), s, the time that effects which add up over time count, at each row; None if it begins anew within the
    record, so that they do, too.
    """

    courses: Mapping[str, Course] = field(default_factory=dict, hash=False)
    elapsed: np.ndarray | None = field(default=None, compare=False)

    @classmethod
    def of(
        cls,
        plant: Plant,
        paths: Mapping[str, Sequence[str]],
        courses: Mapping[str, Course],
        record: Record | None = None,
    ) -> ChangingPlant:
        """The plant with changes of these paths, by form, in addition to those that it has, along a record."""
        elapsed = None if record is None else elapsed_in(record)
        if elapsed is not None and (np.diff(elapsed) < 0.0).any():
            elapsed = None
        specs = {
            f"{form}.{path}": _spec(plant, path, courses[form].name) for form, own in paths.items() for path in own
        }
        kept = {}
        if isinstance(plant, ChangingPlant):
            kept = {path: value_at(plant, path) for path in plant.changes}
            specs = {path.removeprefix(f"{CHANGES}."): spec_at(plant, path) for path in kept} | specs
            elapsed = plant.elapsed if elapsed is None else elapsed
            plant, courses = plant.plain, {**plant.courses, **courses}
        tree = plant.parameters
        group = _group("Changes", specs)
        kind = make_dataclass("Changing", [(CHANGES, group, part(group))], bases=(type(tree),), frozen=True)
        parameters = kind(**{f.name: getattr(tree, f.name) for f in fields(tree)})
        given = {f.name: getattr(plant, f.name) for f in fields(Plant)} | {"parameters": parameters}
        return replace_at(cls(**given, courses=dict(courses), elapsed=elapsed), kept)

    @property
    def changes(self) -> list[str]:
        """The paths of the changes."""
        return [path for path in list_paths(self) if path.startswith(f"{CHANGES}.")]

    @property
    def plain(self) -> Plant:
        """The plant without changes."""
        tree = self.parameters
        plain = type(tree).__bases__[0](**{f.name: getattr(tree, f.name) for f in fields(tree) if f.name != CHANGES})
        return Plant(**{f.name: getattr(self, f.name) for f in fields(Plant)} | {"parameters": plain})

    def at_row(self, row: int) -> Plant:
        """The plant as it is at a row of the record, without changes."""
        plant = self.plain
        values, places = self._layout.acting(self.vector[None], row)[0], positions(plant)
        return replace_at(plant, {path: float(values[places[path]]) for path in self._layout.changed})

    @cached_property
    def _layout(self) -> _Layout:
        return _Layout.of(self)

    @cached_property
    def derived(self) -> np.ndarray:
        """The quantities derived from the parameters at the first row."""
        return self.at_row(0).derived

    def pieces(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        edges = self._layout.edges(vector[None])
        acting = [self._layout.acting(vector[None], row)[0] for row in (0, *edges)]
        return np.array(edges, dtype=np.int64), np.array(acting)

    def _run(
        self,
        runs: Runs,
        vectors: np.ndarray,
        starts: np.ndarray,
        c: Correction,
        y: np.ndarray,
        after: Any = None,
        earlier: Sequence[tuple[int, np.ndarray]] = (),
    ) -> None:
        """Run in pieces between the edges, each from the final state of the one before."""
        edges = [0, *self._layout.edges(vectors), np.iinfo(np.int64).max]
        if len(edges) == 2:
            super()._run(runs, self._layout.acting(vectors, 0), starts, c, y, after, earlier)
            return
        rows_of = (runs.stop - runs.begin) // runs.stride
        offsets = np.r_[0, np.cumsum(rows_of)[:-1]]
        constant = np.flatnonzero(c.constant)
        size = max(len(self.family.states) + len(self.family.sensors), starts.shape[2])
        reached = np.empty((len(vectors), runs.rows, size)) if after is None or not after.shape[0] else after
        moved = list(earlier)  # actuators, too, continue from their last positions
        for first, last in pairwise(edges):
            acting = self._layout.acting(vectors, first)
            # a row of several samples is not divided: a change within it acts from the next row on
            begin, stop = (
                runs.begin + runs.stride * np.clip(-((runs.begin - edge) // runs.stride), 0, rows_of)
                for edge in (first, last)
            )
            own = np.flatnonzero(begin < stop)
            if not own.size:
                moved.append((last, acting))
                continue
            at = offsets[own] + (begin - runs.begin)[own] // runs.stride  # index of the first row of each piece
            lengths = (stop - begin)[own] // runs.stride
            rows = np.repeat(at - np.r_[0, np.cumsum(lengths)[:-1]], lengths) + np.arange(lengths.sum())
            begun = np.array(np.broadcast_to(starts[:, own], (len(vectors), own.size, starts.shape[2])))
            carried, goes_on = c.carried[own], begin[own] > runs.begin[own]
            begun[:, goes_on] = reached[:, at[goes_on] - 1, : starts.shape[2]]
            if carried[0] and not goes_on[0]:  # states carried over from the stretch before, in the piece before
                begun[:, 0, constant] = reached[:, at[0] - 1][:, constant]
            carried = carried & ~goes_on
            carried[0] = False
            piece = replace(runs, begin=begin[own], stop=stop[own], rows=rows.size)
            corrected = replace(
                c,
                measured=c.measured[rows] if len(c.measured) else c.measured,
                gains=c.gains[rows] if len(c.gains) else c.gains,
                decays=c.decays[rows] if len(c.decays) else c.decays,
                carried=carried,
            )
            read, ended = np.empty((len(vectors), rows.size, y.shape[2])), np.empty((len(vectors), rows.size, size))
            super()._run(piece, acting, begun, corrected, read, ended, moved)
            y[:, rows], reached[:, rows] = read, ended
            moved.append((last, acting))


@dataclass(frozen=True, eq=False)
class _Layout:
    """Which parameters change, and when.

    first: position of the first change in the vector.  index: (K,), position of the parameter that each one changes;
    changed: their paths.  low, high: (K,), their bounds.  courses: one for each.  added: (K,), position of the
    parameter that equals what has added up over the time before each edge, -1 for none.  elapsed: see `ChangingPlant`.
    """

    first: int
    index: np.ndarray
    low: np.ndarray
    high: np.ndarray
    changed: frozenset[str]
    courses: tuple[Course, ...]
    added: np.ndarray
    elapsed: np.ndarray | None

    @classmethod
    def of(cls, plant: ChangingPlant) -> _Layout:
        places, names = positions(plant), plant.changes
        split = [_resolved(plant, name) for name in names]
        bounds = [spec_at(plant, path).bounds for _, path in split]
        adding = plant.family.adding if plant.elapsed is not None else {}
        return cls(
            len(places) - len(names),
            np.array([places[path] for _, path in split], dtype=int),
            np.array([low for low, _ in bounds]),
            np.array([high for _, high in bounds]),
            frozenset(path for _, path in split),
            tuple(course for course, _ in split),
            np.array([places[adding[path]] if path in adding else -1 for _, path in split], dtype=int),
            plant.elapsed,
        )

    def edges(self, vectors: np.ndarray) -> list[int]:
        """The rows at which any change that is not zero in some of the vectors sets in or changes its share."""
        moved = (vectors[:, self.first : self.first + self.index.size] != 0.0).any(axis=0)
        return sorted({edge for k in np.flatnonzero(moved) for edge in self.courses[k].edges})

    def acting(self, vectors: np.ndarray, row: int) -> np.ndarray:
        """Parameters for the compiled functions that act at a row, (S, n), from vectors with changes."""
        own = slice(self.first, self.first + self.index.size)
        found, sizes = np.delete(vectors, own, axis=1), vectors[:, own]
        moved = np.flatnonzero((sizes != 0.0).any(axis=0))
        for k in moved:
            found[:, self.index[k]] += self.courses[k].at(row) * sizes[:, k]
        at = self.index[moved]
        found[:, at] = np.clip(found[:, at], self.low[moved], self.high[moved])
        if self.elapsed is not None:
            for k in moved[self.added[moved] >= 0]:
                found[:, self.added[k]] += self.courses[k].beyond(row, self.elapsed) * sizes[:, k]
        return np.ascontiguousarray(found)


def changed(path: str) -> tuple[str, str]:
    """The form and the parameter of a change's path; the form is empty for a path that is not a change."""
    head, _, rest = path.partition(".")
    if head != CHANGES:
        return "", path
    form, _, own = rest.partition(".")
    return form, own


def change(form: str, path: str) -> str:
    """The path of a change."""
    return f"{CHANGES}.{form}.{path}"


def named_when(title: str, when: str) -> str:
    """A title with the words for when it acts, inserted before any brackets or comma."""
    name = plain(title)
    return f"{name} {when}".rstrip() + title.removeprefix(name)


def plain(title: str) -> str:
    """A title without its part in brackets or after a comma."""
    return title.partition(" (")[0].partition(",")[0]


def _resolved(plant: ChangingPlant, path: str) -> tuple[Course, str]:
    """The course of a change, and the parameter that it finally changes."""
    form, own = changed(path)
    course = plant.courses[form]
    if not changed(own)[0]:
        return course, own
    whole, own = _resolved(plant, own)
    return course.of(whole), own


def _spec(plant: Plant, path: str, when: str) -> Spec:
    """The specification of a change: it may take the parameter from one bound to the other.

    A change with a name for when it acts is an effect of its own, and takes the parameter from its value to either
    bound.
    """
    spec, value = spec_at(plant, path), value_at(plant, path)
    low, high = spec.bounds
    bounds = (low - value, high - value) if when else (low - high, high - low)
    probe = _SHARE * abs(value) if path in plant.doubted else spec.probe
    return spec._replace(title=named_when(spec.title or path, when), neutral=0.0, bounds=bounds, probe=probe)


def _group(name: str, specs: Mapping[str, Spec]) -> type:
    """A class of nested groups of parameters, from their paths."""
    own: list[tuple[str, Any, Any]] = []
    for head in dict.fromkeys(path.partition(".")[0] for path in specs):
        inner = {path.partition(".")[2]: spec for path, spec in specs.items() if path.startswith(f"{head}.")}
        kind = _group(head.title(), inner) if inner else float
        leaf = None if inner else specs[head]
        own.append((head, kind, part(kind) if leaf is None else field(default=0.0, metadata={"spec": leaf})))
    return make_dataclass(name, own, frozen=True)
