"""Simulated manoeuvres of vehicles in six degrees of freedom under their autopilot, with excitation at the fins."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians

import numpy as np

from auv_gym.envs.task_env import TaskEnv
from auv_gym.param import check_number, replace_at
from auv_gym.plant import Plant, check_vehicle
from auv_gym.plant.cruise import command_limits, find_cruise, find_helm
from auv_gym.records.record import Record
from controllers.autopilots import usual_autopilot
from controllers.composed.excited import Excited
from controllers.controller import Controller
from identification.experiments.driving import drive
from identification.experiments.excitation import check_generator, make_signal, set_point_steps

NOISE = {  # standard deviations of the other sensors
    "inclinometer": radians(0.2),
    "gyros": radians(0.1),  # rad/s
    "dvl_water": 0.01,  # m/s
    "dvl_ground": 0.01,  # m/s
    "position": 1.0,  # m
}
_DEPTHS, _DEPTH_STEP = (8.0, 22.0), (1.0, 4.0)  # lengths
_SPEEDS, _SPEED_STEP = (0.7, 1.0), (0.1, 0.25)  # shares of cruise speed
_TURN = (radians(20.0), radians(70.0))
_HOLD = (20.0, 45.0)  # lengths travelled between changes of a set point
_CLOCK = 2.0  # lengths travelled in a bit of the excitation


def steer(
    plant: Plant,
    *,
    rng: np.random.Generator,
    controller: Controller | None = None,
    duration: float = 600.0,
    compass_noise: float = radians(0.5),
    depth_noise: float = 0.02,
    excitation: float = 0.15,
) -> Record:
    """Simulate a torpedo that follows random steps of heading, depth and speed, with a PRBS added to rudder and plane.

    The controller (default `usual_autopilot`) acts on noisy readings. Everything is drawn before the run, so that a
    seed gives the same experiment whatever the plant's effects; it starts in cruise.  excitation: amplitude relative to
    the stop of a fin.  Noises are white, given by standard deviations: compass_noise rad, depth_noise m, others see
    NOISE; if the plant's own `effects.sampling` has noise, that noise is used.
    Raises ValueError for other vehicles, or if the run is cut short.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import steer
        >>> log = steer(load_vehicle("remus100"), rng=np.random.default_rng(0), duration=30)
        >>> len(log), log.names[:3]
        (301, ('roll_rad', 'pitch_rad', 'heading_rad'))
    """
    check_vehicle("steer", plant)
    check_generator("steer", rng)
    check_number("duration", duration, "s", above=0.0)
    if plant.family.body is None:
        raise ValueError(
            f"steer needs a vehicle in six degrees of freedom, got {plant.name!r} of family {plant.family.name!r}."
        )
    drawn = draw_manoeuvres(plant, rng, duration, excitation)
    noise = {**NOISE, "compass": compass_noise, "depth": depth_noise}
    own = plant.effects.sampling
    noisy = {f"effects.sampling.{s}.noise": v for s, v in noise.items() if getattr(own, s).noise == 0.0}
    env = TaskEnv(
        "Depth",
        replace_at(plant, noisy),
        actions=steered(plant),
        duration=duration,
    )
    loop = usual_autopilot(plant) if controller is None else controller
    targets = {name: _steps(drawn.time, values) for name, values in drawn.wanted.items()}
    run = drive(
        env, Excited(loop, drawn.signals, plant.dt), seed=int(rng.integers(2**31)), targets=targets, start=drawn.start
    )
    if run.reason:
        raise ValueError(
            f"The run of {plant.name} was cut short: {run.reason}. Check its effects, or lower excitation."
        )
    return run.record


def steered(plant: Plant) -> tuple[str, str, str]:
    """The inputs that steer a vehicle in yaw, steer it in pitch, and drive it."""
    helm = find_helm(plant)
    return plant.inputs[helm.rudder], plant.inputs[helm.plane], plant.inputs[helm.drive]


@dataclass(frozen=True, eq=False)
class Manoeuvres:
    """Drawn manoeuvres: initial values and set points of heading, depth and speed, (n,) by channel, and fin signals."""

    time: np.ndarray
    start: dict[str, float]
    wanted: dict[str, np.ndarray]
    signals: dict[str, np.ndarray]


def draw_manoeuvres(plant: Plant, rng: np.random.Generator, duration: float, excitation: float) -> Manoeuvres:
    """Steps of heading, depth and speed, with a PRBS at rudder and plane; excitation: amplitude over a fin's stop."""
    cruise, limits = find_cruise(plant), command_limits(plant)
    length, lap = plant.hull.length, plant.hull.length / cruise.speed  # s
    time = plant.dt * np.arange(round(duration / plant.dt) + 1)
    hold = (_HOLD[0] * lap, _HOLD[1] * lap)
    first = {
        "heading_rad": float(rng.uniform(-pi, pi)),
        "depth_m": float(rng.uniform(0.4, 0.6)) * (_DEPTHS[0] + _DEPTHS[1]) * length,
        "u_mps": cruise.speed,
    }
    sizes = {
        "heading_rad": _TURN,
        "depth_m": (_DEPTH_STEP[0] * length, _DEPTH_STEP[1] * length),
        "u_mps": (_SPEED_STEP[0] * cruise.speed, _SPEED_STEP[1] * cruise.speed),
    }
    drawn = {
        name: set_point_steps(time, rng, start=start, hold=hold, step=sizes[name]) for name, start in first.items()
    }
    wanted = {
        "heading_rad": drawn["heading_rad"],
        "depth_m": _between(_DEPTHS, length, drawn["depth_m"]),
        "u_mps": _between(_SPEEDS, cruise.speed, drawn["u_mps"]),
    }
    clock = max(round(_CLOCK * lap / plant.dt), 2) * plant.dt
    signals = {
        name: make_signal("prbs", time.size, plant.dt, rng, amplitude=excitation * float(limits[i]), clock_s=clock)
        for i, name in ((plant.inputs.index(name), name) for name in steered(plant)[:2])
    }
    return Manoeuvres(time, first, wanted, signals)


def _between(band: tuple[float, float], unit: float, values: np.ndarray) -> np.ndarray:
    """The values mirrored at the edges of a band, so that steps keep their size."""
    low, width = band[0] * unit, (band[1] - band[0]) * unit
    return low + np.abs((values - low + width) % (2.0 * width) - width)


def _steps(time: np.ndarray, values: np.ndarray) -> list[tuple[float, float]]:
    changes = np.r_[0, np.flatnonzero(np.diff(values)) + 1]
    return [(float(time[k]), float(values[k])) for k in changes]
