"""Logs of vehicles that are pushed by unrecorded accelerations, as in the study of process noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from scripts.blind.logs import Conditions
from scripts.blind.sampling import recorded, simulated
from scripts.studies.process_noise.experiments import VEHICLES
from scripts.studies.process_noise.levels import Draws, Trials
from scripts.studies.process_noise.logs import TAUS
from scripts.studies.process_noise.pushes import velocities

PUSHED = {vehicle.preset: vehicle for vehicle in VEHICLES.values()}


def pushed_plant(vehicle: str) -> Plant:
    """The preset, sampled and judged as in the study."""
    return PUSHED[vehicle].plant


def pushed_log(plant: Plant, conditions: Conditions, seed: int) -> Record:
    """The log of a vehicle in closed loop, pushed along each velocity.

    The same seed gives the same manoeuvres and noise; the strength of the pushes depends on the vehicle.
    Raises ValueError if no strength makes free runs of the vehicle err as the conditions say, or Diverged.
    """
    vehicle = replace(PUSHED[plant.name], duration=simulated(conditions).duration)
    plans, noises = np.random.default_rng(seed).spawn(2)
    drawn = vehicle.experiment(vehicle, plans)
    experiment = replace(drawn, sensors={name: conditions.noise * size for name, size in drawn.sensors.items()})
    rows, axes, sensors = experiment.time.size, len(velocities(plant)), len(experiment.sensors)
    draws = Draws(
        taus=np.exp(np.random.default_rng(conditions.water).uniform(*np.log(TAUS), size=axes)),
        pushes=noises.standard_normal((rows, axes)),
        sensors=noises.standard_normal((rows, sensors)),
        rehearsal=noises.standard_normal((rows, sensors)),
    )
    level = Trials.of(plant, experiment, draws, "closed").wanted(conditions.push)
    return recorded(plant, level.flight.record, conditions, seed)
