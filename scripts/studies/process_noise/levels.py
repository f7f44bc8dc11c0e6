"""The strength of the process noise of a log, set by the error of the true model's free runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.plant import Plant
from identification.fit.validation import free_runs
from identification.fit.windows import free_run_windows
from scripts.studies.process_noise.flights import Experiment, Flight, fly
from scripts.studies.process_noise.pushes import Disturbance, accelerations, velocities

TOLERANCE = 0.03  # of the wanted error
TRIES = 12  # most tries of a factor
_FIRST = 1e-3  # 1/s, first factor tried
_FARTHEST = 10.0  # largest ratio between consecutive tries


@dataclass(frozen=True, eq=False)
class Draws:
    """The random numbers of a run.

    taus: (axes,), s.  pushes: (n, axes), white.  sensors, rehearsal: (n, sensors), white, of the log and of the run
    from which commands in open loop are taken.
    """

    taus: np.ndarray
    pushes: np.ndarray
    sensors: np.ndarray
    rehearsal: np.ndarray


@dataclass(frozen=True, eq=False)
class Level:
    """A log at a level of process noise.

    factor: deviations of the accelerations over the spread of their velocities, 1/s.  errors: of the true model's free
    runs by channel, over the deviation of its sensor's noise.
    """

    flight: Flight
    process: Mapping[str, Disturbance]
    factor: float
    errors: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Trials:
    """Runs of one experiment with one plant, which differ only in their process noise.

    spread: (axes,), RMS of the velocities about their means without process noise.  commands: given ones, else None.
    """

    plant: Plant
    experiment: Experiment
    draws: Draws
    spread: np.ndarray
    commands: np.ndarray | None

    @classmethod
    def of(cls, plant: Plant, experiment: Experiment, draws: Draws, loop: str) -> Trials:
        """The trials; loop: "closed", or "open" for the commands of an undisturbed closed loop, other sensor noise."""
        rehearsed = fly(plant, experiment, velocities(plant), np.zeros_like(draws.pushes), draws.rehearsal)
        spread = np.std(rehearsed.states, axis=0)
        return cls(plant, experiment, draws, spread, rehearsed.commands if loop == "open" else None)

    @cached_property
    def calm(self) -> Level:
        """The log without process noise."""
        return self.at(0.0)

    def at(self, factor: float, only: str = "") -> Level:
        """The log with accelerations whose deviations are `factor` times the spread; only: of one velocity."""
        axes, plant = velocities(self.plant), self.plant
        process = {
            name: Disturbance(factor * float(size) if only in ("", name) else 0.0, float(tau))
            for name, size, tau in zip(axes, self.spread, self.draws.taus, strict=True)
        }
        pushes = accelerations(process, self.draws.pushes, plant.dt)
        flight = fly(plant, self.experiment, axes, pushes, self.draws.sensors, self.commands)
        return Level(flight, process, factor, free_run_errors(plant, self.experiment, flight))

    def wanted(self, times: float) -> Level:
        """The log in which the true model's free runs err by `times` the noise of the leading sensor; 0 for no noise.

        Raises ValueError if no level is found.
        """
        leading = self.plant.family.leading
        if times == 0.0:
            return self.calm
        floor, factor = self.calm.errors[leading], _FIRST
        if not floor < times:
            raise ValueError(f"Sensor noise alone makes free runs err by {floor:.2f} times itself, wanted {times:g}.")
        for _ in range(TRIES):
            level = self.at(factor)
            error = level.errors[leading]
            if abs(error / times - 1.0) < TOLERANCE:
                return level
            # the squared errors of the starts and of the pushes add up, and the latter error is nearly linear
            part = max(error**2 - floor**2, 1e-3 * times**2)
            factor *= float(np.clip(np.sqrt((times**2 - floor**2) / part), 1.0 / _FARTHEST, _FARTHEST))
        raise ValueError(f"No level of process noise makes free runs err by {times:g} times the sensor's noise.")

    def shown(self, factor: float, axis: str) -> float:
        """The variance that one acceleration alone adds to free-run errors, over the sensor's, where it is largest."""
        if factor == 0.0:
            return 0.0
        alone = self.at(factor, axis).errors
        return max(alone[name] ** 2 - self.calm.errors[name] ** 2 for name in alone)


def free_run_errors(plant: Plant, experiment: Experiment, flight: Flight) -> dict[str, float]:
    """RMS error of free runs of a plant against the true outputs, over the deviation of each sensor's noise.

    The free runs cover the vehicle's windows, from states fitted to the noisy readings; the noise of the scored data is
    left out.
    """
    windows = free_run_windows(plant, flight.record, plant.window)
    runs = free_runs(plant, flight.record, windows, plant.settle)
    noise = flight.noise[runs.rows][:, [list(experiment.sensors).index(name) for name in runs.channels]]
    missed = np.sqrt(np.mean((runs.residual - noise)[runs.scored] ** 2, axis=0))
    return {name: float(rms) / experiment.sensors[name] for name, rms in zip(runs.channels, missed, strict=True)}
