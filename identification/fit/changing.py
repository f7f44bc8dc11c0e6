"""A vehicle whose parameters change along a record: from a row on, up to a row, or more and more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, make_dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from auv_gym.param import Spec, list_paths, part, positions, replace_at, spec_at, value_at
from auv_gym.plant import Correction, Plant, Runs

CHANGES = "changes"
_SHARE = 0.1  # of a coefficient's value, the change in which a fit steps


@dataclass(frozen=True)
class ChangingPlant(Plant):
    """A plant that has one more parameter for each form in which one of its parameters may change.

    Their paths are `changes.FORM.PATH`; zero is no change.  forms: by name, the share of a change that acts in each
    epoch.  edges: rows of the record where epochs begin, after the first.  What has changed stays within the bounds of
    the parameter.  Actuators stand where an epoch begins as if its values had held before, too.
    """

    forms: Mapping[str, tuple[float, ...]] = field(default_factory=dict, hash=False)
    edges: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        plant: Plant,
        paths: Mapping[str, Sequence[str]],
        forms: Mapping[str, Sequence[float]],
        edges: Sequence[int],
    ) -> ChangingPlant:
        """The plant with changes of these paths, by form; edges and forms: see the class."""
        specs = {f"{form}.{path}": _spec(plant, path) for form, own in paths.items() for path in own}
        tree = plant.parameters
        group = _group("Changes", specs)
        kind = make_dataclass("Changing", [(CHANGES, group, part(group))], bases=(type(tree),), frozen=True)
        parameters = kind(**{f.name: getattr(tree, f.name) for f in fields(tree)})
        given = {f.name: getattr(plant, f.name) for f in fields(Plant)} | {"parameters": parameters}
        shares = {name: tuple(float(w) for w in own) for name, own in forms.items()}
        return cls(**given, forms=shares, edges=tuple(int(edge) for edge in edges))

    def moved(self, edges: Sequence[int]) -> ChangingPlant:
        """The same plant whose epochs begin elsewhere."""
        return replace(self, edges=tuple(int(edge) for edge in edges))

    def in_epoch(self, epoch: int) -> Plant:
        """The plant as it is in an epoch, without changes."""
        tree = self.parameters
        plain = type(tree).__bases__[0](**{f.name: getattr(tree, f.name) for f in fields(tree) if f.name != CHANGES})
        plant = Plant(**{f.name: getattr(self, f.name) for f in fields(Plant)} | {"parameters": plain})
        values = self._values(self.vector[None], epoch)[0]
        changed = {path: float(values[i]) for path, i in positions(plant).items() if path in self._layout.changed}
        return replace_at(plant, changed)

    @cached_property
    def _layout(self) -> _Layout:
        return _Layout.of(self)

    def _values(self, vectors: np.ndarray, epoch: int) -> np.ndarray:
        """Parameter vectors as the compiled functions take them in an epoch, of vectors with changes, (S, n)."""
        at, count = self._layout, self._layout.shares.shape[1]
        found = np.delete(vectors, slice(at.first, at.first + count), axis=1)
        np.add.at(found, (slice(None), at.index), vectors[:, at.first : at.first + count] * at.shares[epoch])
        found[:, at.index] = np.clip(found[:, at.index], at.low, at.high)
        return np.ascontiguousarray(found)

    @cached_property
    def derived(self) -> np.ndarray:
        """What follows from the parameters of the first epoch."""
        return self.in_epoch(0).derived

    def _run(
        self, runs: Runs, vectors: np.ndarray, starts: np.ndarray, c: Correction, y: np.ndarray, after: Any = None
    ) -> None:
        """The runs in pieces, epoch by epoch, each from where the one before has ended."""
        offsets = np.r_[0, np.cumsum(runs.stop - runs.begin)[:-1]]
        states, constant = len(self.family.states), np.flatnonzero(c.constant)
        size = max(states + len(self.family.sensors), starts.shape[2])
        keep = after is not None and after.shape[0] > 0
        reached = after if keep else np.empty((len(vectors), runs.rows, size))
        for epoch, (first, last) in enumerate(pairwise((0, *self.edges, np.iinfo(np.int64).max))):
            begin, stop = np.maximum(runs.begin, first), np.minimum(runs.stop, last)
            own = np.flatnonzero(begin < stop)
            if not own.size:
                continue
            rows = np.concatenate([np.arange(b, e) + o for b, e, o in zip(
                (begin - runs.begin)[own], (stop - runs.begin)[own], offsets[own], strict=True
            )])  # fmt: skip
            begun = np.array(np.broadcast_to(starts[:, own], (len(vectors), own.size, starts.shape[2])))
            carried = c.carried[own].copy()
            for k, w in enumerate(own):
                if begin[w] > runs.begin[w]:
                    begun[:, k] = reached[:, offsets[w] + begin[w] - runs.begin[w] - 1, : begun.shape[2]]
                    carried[k] = False
                elif k == 0 and carried[0]:
                    begun[:, 0, constant] = reached[:, offsets[w] - 1][:, constant]
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
            super()._run(piece, self._values(vectors, epoch), np.ascontiguousarray(begun), corrected, read, ended)
            y[:, rows], reached[:, rows] = read, ended


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where changes act: number of the first one in the vector, the parameters (K,), shares (E, K), and bounds (K,)."""

    first: int
    index: np.ndarray
    shares: np.ndarray
    low: np.ndarray
    high: np.ndarray
    changed: frozenset[str]

    @classmethod
    def of(cls, plant: ChangingPlant) -> _Layout:
        places, names = positions(plant), [p for p in list_paths(plant) if p.startswith(f"{CHANGES}.")]
        split = [changed(name) for name in names]
        bounds = [spec_at(plant, path).bounds for _, path in split]
        return cls(
            len(places) - len(names),
            np.array([places[path] for _, path in split], dtype=int),
            np.array([plant.forms[form] for form, _ in split]).T,
            np.array([low for low, _ in bounds]),
            np.array([high for _, high in bounds]),
            frozenset(path for _, path in split),
        )


def changed(path: str) -> tuple[str, str]:
    """The form and the parameter of a change's path; no form where the path is that of no change."""
    head, _, rest = path.partition(".")
    if head != CHANGES:
        return "", path
    form, _, own = rest.partition(".")
    return form, own


def change(form: str, path: str) -> str:
    """The path of a change."""
    return f"{CHANGES}.{form}.{path}"


def _spec(plant: Plant, path: str) -> Spec:
    """What is known of a change: it may take the parameter from one bound to the other."""
    spec = spec_at(plant, path)
    low, high = spec.bounds
    probe = _SHARE * abs(value_at(plant, path)) if path in plant.doubted else spec.probe
    return spec._replace(title=spec.title or path, neutral=0.0, bounds=(low - high, high - low), probe=probe)


def _group(name: str, specs: Mapping[str, Spec]) -> type:
    """A class of nested groups of parameters, by their paths."""
    own: list[tuple[str, Any, Any]] = []
    for head in dict.fromkeys(path.partition(".")[0] for path in specs):
        inner = {path.partition(".")[2]: spec for path, spec in specs.items() if path.startswith(f"{head}.")}
        kind = _group(head.title(), inner) if inner else float
        leaf = None if inner else specs[head]
        own.append((head, kind, part(kind) if leaf is None else field(default=0.0, metadata={"spec": leaf})))
    return make_dataclass(name, own, frozen=True)
