"""Cases of the blind benchmark: each follows from the seed and its number alone, whatever else runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import TOGETHER, Candidate, candidates_of, screen
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from scripts.blind.kinds import effects_of, kind_of, known, log_of, outside_log
from scripts.blind.logs import Conditions
from scripts.blind.outside import sized
from scripts.blind.pushed import PUSHED, pushed_log, pushed_plant
from scripts.blind.sampling import EVEN


@dataclass(frozen=True)
class Group:
    """Vehicles that are drawn, and counted, together.

    durations: s, range from which a log's length is drawn to ten seconds, None: 600 s.  window, settle: of free runs,
    s, None for the vehicle's own.  drawn: whether its cases are drawn by default.  measured: see `Conditions`.
    """

    name: str
    vehicles: tuple[str, ...]
    durations: tuple[float, float] | None = None
    window: float | None = None
    settle: float | None = None
    drawn: bool = True
    measured: str = "all"


_GROUPS = (
    Group("glider", ("slocum", "ganeshblue")),
    Group("float", ("qiandao_float", "mermaid")),
    Group("torpedo", ("remus100", "vt690", "npsauv"), (200.0, 400.0), window=25.0, settle=5.0),
    Group("glide", ("seaglider", "slocum_flight", "seaexplorer"), drawn=False),
    Group("rov", ("bluerov2_heavy", "bluerov"), (40.0, 80.0), window=5.0, settle=1.0, drawn=False),
    Group(
        "rov_attitude",
        ("bluerov2_heavy", "bluerov"),
        (40.0, 80.0),
        window=5.0,
        settle=1.0,
        drawn=False,
        measured="attitude",
    ),
)
FAMILIES: Mapping[str, Group] = {group.name: group for group in _GROUPS}
KINDS = {  # and their shares of the cases; those with a share of 0 are drawn only if they are asked for
    "none": 0.16,
    "one": 0.3,
    "two": 0.14,
    "one_wrong": 0.14,
    "none_wrong": 0.1,
    "outside": 0.16,
    "none_pushed": 0.0,
    "one_pushed": 0.0,
}
EFFECTS = {"one": 1, "two": 2, "one_wrong": 1, "one_pushed": 1}  # how many are missing, none in cases of other kinds
PUSH = 1.0  # see `Conditions`, of pushed cases
FRESH = 5  # most attempts to draw another log of a case's vehicle
WRONG = 0.1  # relative standard deviation of a wrong coefficient
MULTIPLES = (2.0, 6.0)  # of the detectable size
PERIOD_OF = dict.fromkeys(("effects.water.heave_sin", "effects.water.heave_cos"), "effects.water.heave_period")
PERIODS = (120.0, 600.0)  # s
ATTEMPTS = 60


class Undrawn(ValueError):
    """Error: no log of a case shows what it should."""


@dataclass(frozen=True)
class Case:
    """What is known of a case without simulating; window, settle: s, None for the vehicle's own."""

    seed: int
    number: int
    kind: str
    family: str
    vehicle: str
    conditions: Conditions
    window: float | None
    settle: float | None


@dataclass(frozen=True, eq=False)
class Drawn:
    """A case with its log, the true vehicle and the one that the modeller believes in.

    effects: value by path; detectable: size by path, that such a log would just show.  wrong: (true, given) by path.
    cause, size, excess: of a case outside the library.  attempts: number of draws.  fresh: another log of the true
    vehicle under the same conditions, None for a case outside the library or if the vehicle could not be controlled.
    """

    case: Case
    record: Record
    true: Plant
    believed: Plant
    effects: Mapping[str, float] = field(default_factory=dict)
    detectable: Mapping[str, float] = field(default_factory=dict)
    wrong: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cause: str = ""
    size: float = 0.0
    excess: float = 0.0
    attempts: int = 1
    fresh: Record | None = None


def sketch(seed: int, number: int, family: str = "", kind: str = "", sampling: str = EVEN) -> Case:
    """The case of a number, without its log; family, kind: in place of the drawn ones.

    Raises ValueError if the family has no vehicle whose logs can be pushed, for a kind of case that needs one.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number, 0)))
    of_kinds = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    drawn = str(rng.choice([name for name, group in FAMILIES.items() if group.drawn]))
    kind, family = kind or of_kinds, family or drawn
    group, pushed = FAMILIES[family], kind.endswith("_pushed")
    vehicles = [name for name in group.vehicles if not pushed or name in PUSHED]
    if not vehicles:
        some = [name for name, group in FAMILIES.items() if set(group.vehicles) & set(PUSHED)]
        raise ValueError(f"Cases of kind {kind} are made of the families {', '.join(some)}, got {family}.")
    vehicle = str(rng.choice(vehicles))
    duration = float(np.round(rng.uniform(*group.durations), -1)) if group.durations else 600.0
    noise, excitation = float(rng.choice([0.5, 1.0, 2.0])), float(rng.uniform(0.7, 1.3))
    conditions = Conditions(noise, excitation, duration, group.measured, sampling)
    if not pushed:
        return Case(seed, number, kind, family, vehicle, conditions, group.window, group.settle)
    water = int(rng.integers(2**31))
    own = replace(conditions, excitation=1.0, duration=PUSHED[vehicle].duration, push=PUSH, water=water)
    return Case(seed, number, kind, family, vehicle, own, None, None)


def draw(case: Case) -> Drawn:
    """The case with its log; draws again if an effect is hidden, too large, or ends the mission.

    Raises Undrawn if that is so in every attempt.
    """
    rng = np.random.default_rng(np.random.SeedSequence(case.seed, spawn_key=(case.number, 1)))
    true = pushed_plant(case.vehicle) if case.conditions.push else known(case.vehicle)
    why = ""
    for attempt in range(1, ATTEMPTS + 1):
        try:
            found = _outside(case, true, rng) if case.kind == "outside" else _within(case, true, rng)
        except (ValueError, Diverged, np.linalg.LinAlgError) as error:  # the vehicle could not be controlled
            why = f" The last error: {error}"
            continue
        if found is not None:
            return Drawn(**found, case=case, attempts=attempt, fresh=_fresh(case, found["true"]))
    raise Undrawn(
        f"Case {case.number} of seed {case.seed} ({case.kind}, {case.vehicle}) shows nothing in {ATTEMPTS} draws.{why}"
    )


def _fresh(case: Case, true: Plant) -> Record | None:
    """Another log of the true vehicle, see `Drawn`."""
    rng = np.random.default_rng(np.random.SeedSequence(case.seed, spawn_key=(case.number, 2)))
    for seed in rng.integers(2**31, size=FRESH if case.kind != "outside" else 0).tolist():
        try:
            return _log_for(case)(true, case.conditions, seed)
        except (ValueError, Diverged, np.linalg.LinAlgError):
            continue
    return None


def _log_for(case: Case) -> Callable[[Plant, Conditions, int], Record]:
    """The function that makes a log of a case's vehicle, by its seed."""
    return pushed_log if case.conditions.push else log_of


def _within(case: Case, plant: Plant, rng: np.random.Generator) -> dict | None:
    seed, make = int(rng.integers(2**31)), _log_for(case)
    believed, wrong = plant, {}
    if case.kind.endswith("_wrong"):
        given = {p: value_at(plant, p) * (1.0 + WRONG * rng.standard_normal()) for p in plant.doubted}
        believed = replace_at(plant, given)
        wrong = {p: (value_at(plant, p), given[p]) for p in given}
    values, detectable, shared = {}, {}, plant
    names = [str(p) for p in rng.choice(effects_of(case.vehicle), EFFECTS.get(case.kind, 0), replace=False)]
    if len({whole(p) for p in names}) < len(names):
        return None
    if names:
        periods = {PERIOD_OF[p]: float(np.exp(rng.uniform(*np.log(PERIODS)))) for p in names if p in PERIOD_OF}
        shared = replace_at(plant, periods)
        clean = make(plant, case.conditions, seed)
        detectable = detectable_sizes(shared, clean, names)
        for path in names:
            value = _value(plant, path, detectable[path], rng)
            if value is None or _same(make(replace_at(shared, {path: value}), case.conditions, seed), clean):
                return None
            values[path] = value
        values |= periods
    true = replace_at(plant, values)
    record = make(true, case.conditions, seed)
    effects = {path: values[path] for path in names}
    return {
        "record": record, "true": true, "believed": believed, "effects": effects, "detectable": detectable,
        "wrong": wrong,
    }  # fmt: skip


def _outside(case: Case, plant: Plant, rng: np.random.Generator) -> dict | None:
    cause, seed = str(rng.choice(kind_of(plant).causes)), int(rng.integers(2**31))
    clean = log_of(plant, case.conditions, seed)
    make = partial(outside_log, plant, cause, conditions=case.conditions, seed=seed)
    found = sized(plant, make, clean, case.window or plant.window)
    if found is None:
        return None
    return {
        "record": found.record, "true": plant, "believed": plant, "cause": cause, "size": found.size,
        "excess": found.excess,
    }  # fmt: skip


def detectable_sizes(plant: Plant, clean: Record, paths: list[str]) -> dict[str, float]:
    """Size by path that a clean log would show, with the others and all coefficients fitted, within their doubts.

    Infinite if no size would be visible, as for an effect that acts like a coefficient; in the parameter's unit.
    """
    return Clean.of(plant, clean).detectable(paths)


@dataclass(frozen=True, eq=False)
class Clean:
    """A log without effects, the fit of its vehicle's coefficients, and the bar of its candidates."""

    plant: Plant
    problem: PredictionErrors
    point: Point
    bar: float

    @classmethod
    def of(cls, plant: Plant, clean: Record) -> Clean:
        clean = described(plant, clean)
        pieces = [piece for part in parts_of(plant, clean) for piece in part]
        problem = PredictionErrors(plant, clean, pieces, doubt=WRONG)
        point = problem.solve(plant, plant.family.coefficients)
        return cls(plant, problem, point, threshold(len(candidates_of(plant, clean))))

    def detectable(self, paths: list[str]) -> dict[str, float]:
        """See `detectable_sizes`."""
        plant, sizes = self.plant, dict[str, float]()
        for path in paths:
            if plant.twins.get(path) in plant.doubted:
                sizes[path] = np.inf
                continue
            fitted = [*plant.doubted, *(p for p in paths if p != path)]
            candidate = Candidate(spec_at(plant, path).title, (path,))
            (found,) = screen(self.problem, self.point, fitted, [candidate], self.bar)
            sizes[path] = float(found.detectable[0])
        return sizes


def _same(one: Record, other: Record) -> bool:
    """Whether an effect does nothing, such as a rate limit that is never reached because of a lag."""
    return all(np.array_equal(one[name], other[name]) for name in other.names)


def _value(plant: Plant, path: str, detectable: float, rng: np.random.Generator) -> float | None:
    """A value 2 to 6 detectable sizes from neutral; None if it is beyond the bounds."""
    spec, change = spec_at(plant, path), rng.uniform(*MULTIPLES) * detectable
    side = rng.choice([-1.0, 1.0]) if spec.bounds[0] < spec.neutral else 1.0
    value = spec.neutral + side * change
    return float(value) if np.isfinite(value) and spec.bounds[0] < value < spec.bounds[1] else None


def whole(path: str) -> str:
    """The physical quantity of a path: its two components count as one name."""
    return next((title for title, paths in TOGETHER if path in paths), path)
