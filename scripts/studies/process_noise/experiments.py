"""The experiments, one for each kind of vehicle, with the sensors of the blind logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import command_limits, find_cruise
from controllers.autopilots import autopilot
from controllers.composed.excited import Excited
from controllers.pid import float_depth_pid, heading_pid
from identification.experiments.excitation import prbs
from identification.experiments.float_dives import summer_lake
from identification.experiments.heading_control import closed_loop
from identification.experiments.manoeuvres import draw_manoeuvres, steered
from scripts.blind.kinds import known
from scripts.blind.logs import torpedo_noise
from scripts.blind.own_torpedo import SENSORS
from scripts.studies.process_noise.flights import Experiment

_RUN_IN = 30.0  # s before a log begins
_COMPASS, _TRACK, _PRESSURE = radians(0.5), 1.0, 0.02  # rad, m, m: sensors of a glider, and of a float
_RUDDER, _FINS = 0.3, 0.15  # excitation of a glider and of a torpedo, over a fin's limit
_BIT = 8.0  # s, of a glider's excitation
_DEEP, _SHALLOW = (30.0, 33.0, 36.0, 39.0), (18.0, 21.0, 24.0, 27.0)  # m, alternating


@dataclass(frozen=True)
class Vehicle:
    """A vehicle of the study.

    dt: s, of its log.  duration: s.  experiment: draws one for it.  judged: velocities whose process noise is judged.
    pieces: of a sample, so that pushes act like accelerations on states that decay in less than a sample.
    window, settle: of free runs, s, None for the vehicle's own.  loops: no open one for an unstable vehicle.
    """

    preset: str
    dt: float
    duration: float
    experiment: Callable[[Vehicle, np.random.Generator], Experiment]
    judged: tuple[str, ...]
    pieces: int
    window: float | None = None
    settle: float | None = None
    loops: tuple[str, ...] = ("closed", "exact", "open")

    @property
    def plant(self) -> Plant:
        """The vehicle without effects, sampled as its log is."""
        plant = known(self.preset)
        return replace(plant, dt=self.dt, window=self.window or plant.window, settle=self.settle or plant.settle)

    @property
    def time(self) -> np.ndarray:
        """Times of the samples of a run, s, with the run-in."""
        return self.dt * np.arange(round((self.duration + _RUN_IN) / self.dt) + 1)

    @property
    def skipped(self) -> int:
        """Number of samples of the run-in."""
        return round(_RUN_IN / self.dt)


def _glider(vehicle: Vehicle, rng: np.random.Generator) -> Experiment:
    plant, time = vehicle.plant, vehicle.time
    limit = plant.hull.rudder_limit
    # independent of the run: set points, and the speed and attitude of dives and climbs
    plan = closed_loop(plant, rng=rng, duration=float(time[-1]), run_in=0.0)
    added = prbs(time.size, round(_BIT / plant.dt), _RUDDER * limit, rng)
    return Experiment(
        time,
        {"heading_rad": float(plan["heading_cmd_rad"][0])},
        Excited(heading_pid(plant), {"rudder_rad": added}, plant.dt),
        wanted={"heading_rad": plan["heading_cmd_rad"]},
        limits={"rudder_rad": (-limit, limit)},
        sensors={"heading_rad": _COMPASS, "north_m": _TRACK, "east_m": _TRACK},
        given={name: plan[name] for name in ("u_mps", "roll_rad", "pitch_rad")},
        also={"depth_m": plan["depth_m"]},
        skipped=vehicle.skipped,
        pieces=vehicle.pieces,
    )


def _float(vehicle: Vehicle, rng: np.random.Generator) -> Experiment:
    plant, time = vehicle.plant, vehicle.time
    targets = np.stack([rng.permutation(_DEEP), rng.permutation(_SHALLOW)], axis=1).ravel()
    at = np.minimum((time / time[-1] * targets.size).astype(int), targets.size - 1)
    return Experiment(
        time,
        {"depth_m": float(targets[-1])},
        float_depth_pid(plant),
        wanted={"depth_m": targets[at]},
        limits={"piston_m": (plant.hull.piston_low, plant.hull.piston_high)},
        sensors={"depth_m": _PRESSURE},
        from_depth={"temperature_C": summer_lake},
        skipped=vehicle.skipped,
        pieces=vehicle.pieces,
    )


def _torpedo(vehicle: Vehicle, rng: np.random.Generator) -> Experiment:
    plant = vehicle.plant
    drawn, cruise, limits = draw_manoeuvres(plant, rng, float(vehicle.time[-1]), _FINS), find_cruise(plant), {}
    for name in steered(plant):
        limit = float(command_limits(plant)[plant.inputs.index(name)])
        limits[name] = (-limit, limit)
    level = dict(zip(plant.family.states, cruise.state.tolist(), strict=False))
    noise = torpedo_noise(1.0)
    return Experiment(
        drawn.time,
        {**level, **drawn.start},
        Excited(autopilot(load_vehicle(vehicle.preset)), drawn.signals, plant.dt),
        wanted=drawn.wanted,
        limits=limits,
        sensors={name: noise[sensor] for sensor, outputs in SENSORS.items() for name in outputs},
        skipped=vehicle.skipped,
        pieces=vehicle.pieces,
    )


_VEHICLES = (
    Vehicle("ganeshblue", 1.0, 1000.0, _glider, ("r_radps",), 20),
    Vehicle("qiandao_float", 0.7, 1400.0, _float, ("depth_rate_mps",), 4),
    Vehicle("npsauv", 0.5, 1000.0, _torpedo, ("q_radps", "r_radps"), 4),
    # its yaw is unstable: the noise of the first readings alone causes errors of 50 deg and more in 120 s
    Vehicle(
        "remus100", 0.2, 400.0, _torpedo, ("q_radps", "r_radps"), 4, window=6.0, settle=2.0, loops=("closed", "exact")
    ),
)
VEHICLES: Mapping[str, Vehicle] = dict(zip(("glider", "float", "npsauv", "remus100"), _VEHICLES, strict=True))
