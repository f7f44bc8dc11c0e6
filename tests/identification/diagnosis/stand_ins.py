"""A workbench that reads evidence from a table, with its parts, for tests of decisions based on evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant, load_vehicle
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate, Screening
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State
from identification.fit.followed import Point

PLANT = load_vehicle("slocum")


def point_of(scores: Sequence[float] = (0.0,), vector: Sequence[float] = (), errors: np.ndarray | None = None) -> Point:
    """A point without a filter, with given log-likelihoods of the rows."""
    rows, nothing = len(scores), np.zeros((len(scores), 1))
    given = nothing if errors is None else errors
    square = np.zeros((rows, 1, 1))
    return Point(
        np.asarray(vector, dtype=float), np.zeros(1), given, np.asarray(scores, dtype=float),
        nothing, square, square, nothing, nothing, square, None,
    )  # fmt: skip


def state_of(plant: Plant, *paths: str) -> State:
    """A state made without any run."""
    return State(plant, paths, point_of())


def with_probes(probes: Mapping[str, float], *others: str) -> State:
    """A state with effects of given sizes, in probes; others: further fitted paths."""
    values = {p: spec_at(PLANT, p).neutral + n * spec_at(PLANT, p).probe for p, n in probes.items()}
    return state_of(replace_at(PLANT, values), *others, *probes)


def trial_of(candidate: Candidate, state: State | None = None, objection: str = "", evidence=(0.0, 0.0)) -> Trial:
    size = np.zeros(len(candidate.paths))
    return Trial(candidate, state, *evidence, Screening(candidate, size, 0.0, 1.0, size), objection)


def round_of(chosen: Trial) -> Round:
    return Round((chosen,), chosen, (), {})


@dataclass
class Table:
    """A workbench in which the evidence for a model depends only on its effects.

    likely: by the effects, twice the log-likelihood, and that of parts predicted from the others.
    stable: whether free runs stay finite.  error: standard error of each size, in probes.  known: farthest distance
    from neutral in a fit, in probes.  asked: states fitted so far.
    """

    likely: Mapping[frozenset[str], tuple[float, float]]
    stable: bool = True
    error: float = 0.1
    known: float = np.inf
    asked: list[State] = field(default_factory=list)

    @property
    def problem(self) -> SimpleNamespace:
        return SimpleNamespace(bounds=self._bounds)

    def _bounds(self, path: str) -> tuple[float, float]:
        spec = spec_at(PLANT, path)
        return max(spec.bounds[0], spec.neutral - self.known * spec.probe), spec.neutral + self.known * spec.probe

    def _likely(self, state: State) -> tuple[float, float]:
        return self.likely[frozenset(p for p in state.paths if p.startswith("effects."))]

    def gains(self, before: State, after: State) -> tuple[float, float]:
        a, b = self._likely(before), self._likely(after)
        return b[0] - a[0], b[1] - a[1]

    def gain_foretold(self, before: State, after: State, soon: bool = False) -> float:
        return self.gains(before, after)[1]

    def half_widths_if_white(self, state: State, paths: Sequence[str]) -> list[float]:
        return [self.intervals(state)[p][2] for p in paths]

    def gain(self, before: State, after: State) -> float:
        return self.gains(before, after)[0]

    def known_gain(self, before: State, after: State) -> float:
        return 0.0

    def costs(self, state: State) -> np.ndarray:
        return -np.array(self._likely(state))

    def with_given(self, state: State) -> tuple[State, ...]:
        return ()

    def likelier_from_given(self, state: State, hopeless: float) -> State:
        return state

    def goes_on(self, step: str) -> bool:
        return True

    def flies(self, state: State, settle: float | None = None) -> bool:
        return self.stable

    def intervals(self, state: State) -> dict[str, tuple[float, float, float]]:
        sizes = {p: self.error * (spec_at(state.plant, p).probe or 1.0) for p in state.paths}
        return {p: (value_at(state.plant, p), size, 1.96 * size) for p, size in sizes.items()}

    def fit(self, plant: Plant, paths: Sequence[str], near: State | None = None) -> State:
        self.asked.append(state_of(plant, *paths))
        return self.asked[-1]

    def fit_from(self, starts: Sequence[tuple[Plant, State]], paths: Sequence[str], rival: State, hopeless: float):
        return self.fit(starts[0][0], paths, rival)

    def without(self, state: State, paths: Sequence[str]) -> State:
        plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in paths})
        return self.fit(plant, [p for p in state.paths if p not in paths])
