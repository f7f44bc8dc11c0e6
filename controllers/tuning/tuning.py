"""Tuning of a vehicle's gains by simulation for the least cost, and assessment over vehicles that the data allow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from auv_gym.channels import set_point_of
from auv_gym.model import Diverged
from auv_gym.param import value_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from controllers.autopilots import autopilot
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.kinds import KINDS as CONTROL
from controllers.trials.settling import step_response
from controllers.trials.trial import NOISE
from controllers.tuning.bench import Bench, Run, bench_of, run_cost, segments, tried
from controllers.tuning.kinds import KINDS, first_loops, loops_of
from controllers.tuning.requirements import QUANTITIES, USUAL, Requirement, parse_requirements, worst
from controllers.tuning.response import UNSETTLED, Response, loop_response
from controllers.tuning.spread import Intervals, corner, drawn

EVALUATIONS = 40  # of the cost, per loop
DRAWS = 12  # number of vehicles on which gains are assessed, plus half as many corners
BAND = 0.05  # of the step, or the sensor's noise if larger: counts as settled
LAWS = ("pid", "gpc")
_SEARCH = 0.7  # approximate share of the time spent on the search
_FAILED = 1e6
_FACTORS = 0.7  # natural logarithm of the first changes of the gains
# cost per plant of a requirement that is not met: as much as an overshoot of half a step, plus a term proportional to
# the distance from the limit, relative to it
_UNMET, _SHORT = 5.0, 20.0
_SCREENED = 6  # draws, and as many corners; the worst of them are the plants in the second half of a search
_TUNED = (
    *("proportional", "integral", "derivative", "error_scale", "rate_scale"),
    *("frequency", "damping", "effort", "drift_factor"),
)
_FULL = 1e-3  # of the range; closer to its limit, a command counts as being at it

Progress = Callable[[float, str], object]


@dataclass(frozen=True, eq=False)
class Trying:
    """The result of a channel's loop on one vehicle: its response, step and quantities; run: of its trial.

    run: None if it diverged.
    """

    response: Response
    run: Run | None
    quantities: Mapping[str, float]


class Hardest(NamedTuple):
    """The loop furthest from a requirement: the number of the vehicle, the loop's channel, and the value."""

    at: int
    channel: str
    requirement: Requirement
    value: float


@dataclass(frozen=True, eq=False)
class Judged:
    """The assessment of gains on the vehicles that the data allow, by channel; the first is the given vehicle.

    plants: as drawn, corners last, without those that could not be started; refused: the reason for each of these.
    warnings: why the vehicle or its intervals may be wrong, in sentences.
    """

    plant: Plant
    law: str
    gains: Gains
    requirements: tuple[Requirement, ...]
    intervals: Intervals
    plants: tuple[Plant, ...]
    names: tuple[str, ...]
    loops: Mapping[str, tuple[Trying, ...]]
    corners: int
    refused: tuple[str, ...]
    seed: int
    warnings: tuple[str, ...] = ()

    def values(self, channel: str, quantity: str) -> list[float]:
        """A quantity of a loop on all vehicles."""
        return [trying.quantities[quantity] for trying in self.loops[channel]]

    def verdicts(self) -> list[tuple[str, Requirement, float, int]]:
        """The worst value for each loop and requirement, and the number of vehicles that meet it."""
        found = []
        for channel in self.loops:
            for requirement in self.requirements:
                if requirement.channel in ("", channel):
                    values = self.values(channel, requirement.quantity)
                    met = sum(map(requirement.is_met, values))
                    found.append((channel, requirement, worst(requirement.quantity, values), met))
        return found

    def hardest(self) -> Hardest | None:
        """The drawn vehicle on which a loop is furthest from a requirement, relative to its limit; None without any."""
        found = []
        for channel, requirement, value, _ in self.verdicts():
            at = self.values(channel, requirement.quantity).index(value)
            found.append((requirement.excess(value), Hardest(at, channel, requirement, value)))
        return max(found, key=lambda pair: pair[0])[1] if found else None

    def changed(self, at: int) -> dict[str, float]:
        """The uncertain parameters of one of the vehicles by path, those with the largest changes first."""
        given = {path: value_at(self.plant, path) for path in self.intervals}
        values = {path: value_at(self.plants[at], path) for path in given}

        def distance(path: str) -> float:
            low, high = self.intervals[path]
            return abs(values[path] - given[path]) / ((high - low) if given[path] == 0.0 else abs(given[path]))

        return dict(sorted(values.items(), key=lambda item: -distance(item[0])))

    def notes(self) -> tuple[str, ...]:
        """Notes for a file of these gains: warnings, requirements that are not met, and the worst vehicle in SI."""
        count = len(self.plants)
        tested = "Tested on the vehicle itself" + (
            f" and on {count - 1} drawn from its intervals." if count > 1 else "."
        )
        notes = [*(f"Warning: {text}" for text in self.warnings), tested]
        for channel, requirement, _, met in self.verdicts():
            if met < count:
                notes.append(f"Not met by all: {channel}.{requirement.words}, met on {met} of {count} vehicles.")
        hardest = self.hardest()
        if hardest is not None:
            values = ", ".join(f"{path} = {value:.4g}" for path, value in self.changed(hardest.at).items())
            title = QUANTITIES[hardest.requirement.quantity].label
            where = f"{self.names[hardest.at]}, {hardest.channel} loop"
            notes.append(f"Worst vehicle: {where}, {title} {hardest.value:.3g}; {values}.")
        return tuple(notes)

    @property
    def passed(self) -> bool:
        """Whether all vehicles could be started, and each met all requirements."""
        return not self.refused and all(requirement.is_met(value) for _, requirement, value, _ in self.verdicts())


def first_gains(plant: Plant, laws: Sequence[str] = ("pid",)) -> Gains:
    """Initial gains: for a hull from linear-quadratic regulators, for others from their lags and engines."""
    share = KINDS.of(plant.family).bow_share(plant)
    return Gains(plant.name, plant.dt, share, {law: first_loops(plant, law) for law in laws})


def tuned(
    bench: Bench,
    evaluations: int,
    show: Progress,
    laws: Sequence[str] = ("pid",),
    requirements: Sequence[Requirement] = (),
    start: Gains | None = None,
) -> Gains:
    """The gains of a bench's vehicle after `evaluations` for each loop, from `first_gains` or another start.

    Without requirements, they minimise the cost; with requirements, a shortfall adds to the cost.
    """
    plant = bench.plants[0]
    gains = _all_rounded(first_gains(plant, laws) if start is None else start)
    plan = [(law, name) for law in laws for name in loops_of(plant, law) if name in bench.trial.steps]
    for i, (law, name) in enumerate(plan):

        def told(done: int, text: str = f"{gains.vehicle} {law} {name}", i: int = i) -> None:
            show((i + done / max(evaluations, 1)) / len(plan), text)

        asked = tuple(r for r in requirements if r.channel in ("", name))
        first = (evaluations + 1) // 2 if asked else evaluations
        gains = _improved(bench, gains, law, name, first, told, asked)
        if evaluations > first:
            hard = _hardest(bench, gains, law, name, asked)
            again = lambda done, first=first, told=told: told(first + done)  # noqa: E731
            gains = _improved(hard, gains, law, name, evaluations - first, again, asked)
    return gains


def _hardest(bench: Bench, gains: Gains, law: str, name: str, requirements: Sequence[Requirement]) -> Bench:
    """The bench with the same number of variants, but those on which a loop is furthest from its requirements."""
    plant, rng = bench.plants[0], np.random.default_rng([bench.seed, 2])
    others = [*bench.plants[1:]]
    for make in (drawn, corner):
        others += [make(plant, bench.intervals, rng) for _ in range(_SCREENED)]
    able, _ = bench.with_able((plant, *others))  # the others cannot hold themselves at the start, whatever the gains
    controller = _controller(able, gains, law)
    short = [_shortfall(able, at, controller, gains, law, name, requirements) for at in range(1, len(able.plants))]
    worst_first = 1 + np.argsort(-np.array(short), kind="stable")[: len(bench.plants) - 1]
    kept = (0, *worst_first.tolist())
    return bench._replace(plants=tuple(able.plants[at] for at in kept), starts=tuple(able.starts[at] for at in kept))


def judged(
    plant: Plant,
    gains: Gains,
    law: str,
    requirements: Sequence[Requirement],
    intervals: Intervals,
    seed: int,
    *,
    draws: int = DRAWS,
    warnings: Sequence[str] = (),
    show: Progress = lambda share, text: None,
) -> Judged:
    """Assess gains on the vehicle, on draws from the intervals and on half as many corners of them."""
    bench, rng = bench_of(plant, seed, intervals), np.random.default_rng([seed, 1])
    corners = (draws + 1) // 2
    asked = [*(drawn(plant, intervals, rng) for _ in range(draws))]
    asked += [corner(plant, intervals, rng) for _ in range(corners)]
    bench, unable = bench.with_able([plant, *asked])
    names = ["the vehicle itself", *(f"draw {k + 1}" for k in range(draws))]
    names += [f"corner {k + 1}" for k in range(corners)]
    refused = [f"{names[k]}: {reason}" for k, reason in unable.items()]
    count = len(bench.plants)
    controller = _controller(bench, gains, law)
    loops: dict[str, list[Trying]] = {name: [] for name in bench.trial.steps}
    for at in range(count):
        for name, found in loops.items():
            show((at + len(found) / (at + 1) / len(loops)) / count, f"vehicle {at + 1} of {count}")
            found.append(trying(bench, at, controller, name, _bow_share(gains, law)))
    result = Judged(
        plant=plant,
        law=law,
        gains=gains,
        requirements=tuple(requirements),
        intervals=intervals,
        plants=bench.plants,
        names=tuple(name for k, name in enumerate(names) if k not in unable),
        loops={name: tuple(found) for name, found in loops.items()},
        corners=corners,
        refused=tuple(refused),
        seed=seed,
        warnings=tuple(warnings),
    )
    return replace(result, gains=replace(gains, notes={law: result.notes()}))


def check_law(plant: Plant, law: str) -> None:
    """Raise ValueError if gains of this law cannot be tuned for a vehicle."""
    if plant.family.kind not in KINDS.names:
        able = [name for name in list_vehicles() if load_vehicle(name).family.kind in KINDS.names]
        needless = plant.family.kind in CONTROL.names
        raise ValueError(
            f"Gains cannot be tuned for {plant.name!r}"
            f"{', whose autopilot follows from its model and needs no gains' if needless else ''}: choose a vehicle "
            f"like one of these presets: {', '.join(able)}."
        )
    if law not in LAWS:
        raise ValueError(f"The kind of controller needs to be {' or '.join(LAWS)}, got {law!r}.")


def tune_and_judge(
    plant: Plant,
    law: str,
    require: Sequence[str] | None,
    intervals: Intervals,
    seed: int,
    *,
    start: Gains | None = None,
    evaluations: int = EVALUATIONS,
    draws: int = DRAWS,
    warnings: Sequence[str] = (),
    show: Progress = lambda share, text: None,
) -> Judged:
    """Tune gains towards requirements, given as texts, and assess them over intervals on draws not used in tuning."""
    check_law(plant, law)
    bench = bench_of(plant, seed, intervals)
    asked = parse_requirements(require or USUAL, tuple(bench.trial.steps))
    if start is not None and law not in start.loops:
        raise ValueError(f"The gains of {start.vehicle!r} that you give have none of kind {law!r}: leave them out.")
    found = tuned(bench, evaluations, lambda share, text: show(_SEARCH * share, text), (law,), asked, start)
    found = replace(found, vehicle=plant.name, dt=plant.dt)
    tell = lambda share, text: show(_SEARCH + (1.0 - _SEARCH) * share, text)  # noqa: E731
    return judged(plant, found, law, asked, intervals, seed, draws=draws, warnings=warnings, show=tell)


def trying(
    bench: Bench, at: int, controller: Controller, name: str, bow_share: float, run: Run | None = None
) -> Trying:
    """The loop of a channel on one of the bench's plants; run: of its trial, if already simulated."""
    response = loop_response(bench, at, controller, name, bow_share)
    try:
        run = tried(bench, at, controller, name) if run is None else run
    except (Diverged, OverflowError):
        nothing = {quantity: 0.0 if upward else inf for quantity, (_, _, upward) in QUANTITIES.items()}
        return Trying(response, None, nothing | UNSETTLED._asdict())
    return Trying(response, run, {**response.margins()._asdict(), **step_quantities(bench, run, name)})


def step_quantities(bench: Bench, run: Run, name: str) -> dict[str, float]:
    """Overshoot, settling, error and time at the limit of the first step of a channel's trial."""
    part, target = next(segments(run, name))
    values = run[name][part]
    size = target - float(values[0])
    step = step_response(run["time_s"][part], values, target, max(BAND * abs(size), NOISE[name]))
    return {
        "overshoot_percent": 100.0 * step.overshoot / abs(size),
        "settling_s": step.settling_time,
        "rms_error_percent": 100.0 * float(np.sqrt(np.mean((values - target) ** 2))) / abs(size),
        "saturation_percent": 100.0 * float(_at_limit(bench, run, name)[part].mean()),
    }


def cost(bench: Bench, gains: Gains, law: str, name: str, requirements: Sequence[Requirement] = ()) -> float:
    """The cost of a channel's loop, the mean over the plants; large if a run diverges."""
    total, controller = 0.0, _controller(bench, gains, law)
    for at in range(len(bench.plants)):
        try:
            run = tried(bench, at, controller, name)
        except (Diverged, OverflowError):
            return _FAILED
        total += run_cost(bench, run, name)
        if requirements:
            total += _shortfall(bench, at, controller, gains, law, name, requirements, run)
    return min(total / len(bench.plants), _FAILED)


def _shortfall(
    bench: Bench,
    at: int,
    controller: Controller,
    gains: Gains,
    law: str,
    name: str,
    requirements: Sequence[Requirement],
    run: Run | None = None,
) -> float:
    """The cost of the requirements that a loop does not meet on one of the plants."""
    found = trying(bench, at, controller, name, _bow_share(gains, law), run)
    short = [requirement.shortfall(found.quantities[requirement.quantity]) for requirement in requirements]
    return sum(_UNMET + _SHORT * size for size in short if size > 0.0)


def _bow_share(gains: Gains, law: str) -> float:
    """The movement of bow planes relative to the stern planes; predictive control does not use them."""
    return 0.0 if law == "gpc" else gains.bow_share


def _controller(bench: Bench, gains: Gains, law: str) -> Controller:
    return autopilot(bench.plants[0], law, tuple(bench.trial.steps), gains=gains)


def _at_limit(bench: Bench, run: Run, name: str) -> np.ndarray:
    """Mask of the samples with the command of a channel at its limit, or thrusters short of the wanted wrench."""
    plant = bench.plants[0]
    moved = KINDS.of(plant.family).moved_by(plant, name)
    values, full = run[moved.command], _FULL * moved.span
    if set_point_of(moved.command) in run:
        return np.abs(run[set_point_of(moved.command)] - values) > full
    low, high = CONTROL.of(plant.family).ranges(plant)[moved.command]
    return (values < low + full) | (values > high - full)


def _improved(
    bench: Bench,
    gains: Gains,
    law: str,
    name: str,
    evaluations: int,
    told: Callable[[int], None],
    requirements: Sequence[Requirement],
) -> Gains:
    places = [
        (loop, key)
        for loop in loops_of(bench.plants[0], law)[name]
        if loop in gains.loops[law]
        for key in _TUNED
        if gains.loops[law][loop].get(key, 0.0) != 0.0
    ]
    if evaluations < 1:
        return gains
    done = 0

    def at(logarithms: np.ndarray) -> Gains:
        loops = {loop: dict(settings) for loop, settings in gains.loops[law].items()}
        for (loop, key), logarithm in zip(places, logarithms.tolist(), strict=True):
            loops[loop][key] = _rounded(loops[loop][key] * np.exp(logarithm))
        return replace(gains, loops={**gains.loops, law: loops})

    def costs(logarithms: np.ndarray) -> float:
        nonlocal done
        done += 1
        told(min(done, evaluations))
        # an integral that diverges in the logarithm is as good as zero, and not worth the search
        near = 0.01 * float(np.square(logarithms).sum())
        return cost(bench, at(logarithms), law, name, requirements) + near

    simplex = np.vstack([np.zeros(len(places)), _FACTORS * np.eye(len(places))])
    found = minimize(
        costs,
        simplex[0],
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-3},
    )
    return at(found.x)


def _all_rounded(gains: Gains) -> Gains:
    loops = {
        law: {
            loop: {key: _rounded(value) for key, value in settings.items() if value != 0.0 or key == "filter_time"}
            for loop, settings in of_law.items()
        }
        for law, of_law in gains.loops.items()
    }
    return replace(gains, loops=loops)


def _rounded(value: float) -> float:
    """The value rounded to four digits: more are meaningless, and differ between machines."""
    return float(f"{value:.4g}")
