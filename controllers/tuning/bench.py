"""The test bench for tuning loops: a vehicle and variants of it, target steps, and the cost of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.param import replace_at
from auv_gym.plant import Plant
from controllers.controller import Controller
from controllers.trials.trial import Steps, run_trial
from controllers.tuning.kinds import KINDS, Start, Trial
from controllers.tuning.spread import Intervals, corner, known_intervals

_OVERSHOOT, _TRAVEL = 10.0, 0.15  # weights: of overshoot over the step, of full travels of the command

Run = Mapping[str, np.ndarray]


class Bench(NamedTuple):
    """A vehicle's trial: plants, the first being the vehicle itself, and where each starts.

    intervals: uncertainty of the vehicle's parameters, by path.
    """

    plants: tuple[Plant, ...]
    starts: tuple[Start, ...]
    trial: Trial
    intervals: Intervals
    seed: int

    def with_plants(self, plants: Sequence[Plant]) -> Bench:
        """The bench with other vehicles; raises if one cannot hold itself at the start."""
        return self._replace(plants=tuple(plants), starts=tuple(self.trial.start(plant) for plant in plants))

    def with_able(self, plants: Sequence[Plant]) -> tuple[Bench, dict[int, str]]:
        """The bench with the vehicles that can hold themselves at the start; by number, why others cannot."""
        kept, starts, refused = [], [], {}
        for number, plant in enumerate(plants):
            try:
                starts.append(self.trial.start(plant))
            except ValueError as error:
                refused[number] = str(error)
            else:
                kept.append(plant)
        return self._replace(plants=tuple(kept), starts=tuple(starts)), refused


def bench_of(plant: Plant, seed: int, intervals: Intervals | None = None) -> Bench:
    """The trial of a vehicle: steps suited to its size, and two variants with their actuators off zero.

    intervals: 95 %, by path; default those in the vehicle's file.  seed: draws at which ends they are.
    """
    kind, rng = KINDS.of(plant.family), np.random.default_rng(seed)
    known = known_intervals(plant) if intervals is None else intervals
    offsets, plants = kind.offsets(plant), [plant]
    for side in (1.0, -1.0):
        off = {path: side * value for path, value in offsets.items() if path not in known}
        plants.append(replace_at(corner(plant, known, rng), off))
    return Bench((), (), kind.trial(plant), known, seed).with_plants(plants)


def tried(bench: Bench, at: int, controller: Controller, name: str) -> Run:
    """The run of a channel's trial on one of the bench's plants, with noise; raises Diverged."""
    trial, rng = bench.trial, np.random.default_rng([bench.seed, at])
    return run_trial(
        bench.plants[at], controller, _targets(trial, name), trial.duration, start=bench.starts[at], rng=rng
    )


def run_cost(bench: Bench, run: Run, name: str) -> float:
    """The integral of the error over the step, plus overshoot and travel of the command, for both steps."""
    plant, total = bench.plants[0], 0.0
    moved = KINDS.of(plant.family).moved_by(plant, name)
    for part, target in segments(run, name):
        values = run[name][part]
        size = target - values[0]
        error = np.abs(values - target).sum() * plant.dt / bench.trial.scale
        beyond = max(float(((values - target) / size).max()), 0.0)
        travel = np.abs(np.diff(run[moved.command][part])).sum() / moved.span
        total += (error + _TRAVEL * travel * abs(size)) / abs(size)
        total += _OVERSHOOT * beyond
    return float(total)


def segments(run: Run, name: str) -> Iterator[tuple[slice, float]]:
    """The samples of each target that differs from the value before, and the target."""
    wanted = run[set_point_of(name)]
    edges = [0, *(np.flatnonzero(np.diff(wanted)) + 1).tolist(), wanted.size]
    for begin, end in pairwise(edges):
        if abs(wanted[begin] - run[name][begin]) > 1e-9:
            yield slice(begin, end), float(wanted[begin])


def _targets(trial: Trial, name: str) -> Steps:
    """The targets of a channel's trial; some move while all others are constant."""
    moving = (name,) if name in trial.alone else tuple(other for other in trial.steps if other not in trial.alone)
    return {other: steps if other in moving else [(0.0, trial.held[other])] for other, steps in trial.steps.items()}
