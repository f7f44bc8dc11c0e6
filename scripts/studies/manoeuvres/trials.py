"""Turning circles, zigzags and depth changes: runs from a steady approach, and their quantities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from itertools import pairwise
from math import degrees, inf, pi, radians
from typing import NamedTuple

import numpy as np

from auv_gym.envs.tasks import HELD_PITCH
from auv_gym.model import check_finite
from auv_gym.param import replace_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.plant.cruise import Cruise, command_limits, find_cruise, find_helm
from auv_gym.records.record import Record

DT = 0.02  # s; a fast vehicle turns 0.3 deg in it, by which a zigzag's rudder may be late
START_DEPTH = 20.0  # m
DEPTH_STEP = 10.0  # m
ZIGZAGS = (10, 20)  # deg of rudder and of heading
SIDES = {"starboard": 1, "port": -1}
LONGEST = 400.0  # lengths travelled, at the approach speed, after which a run is stopped
V, W, Q, R, DEPTH, PITCH, HEADING = 1, 2, 4, 5, 8, 10, 11  # of the states that the torpedo families share


class Trial(NamedTuple):
    """A vehicle and its approach: steady, straight and level."""

    plant: Plant
    cruise: Cruise

    @property
    def length(self) -> float:
        return self.plant.hull.length


class Turn(NamedTuple):
    """A turning circle: lengths in m, angles in rad; from `radius` on, means over the last half turn.

    speed_kept: over the approach speed.  drift: positive if the bow points into the turn.  roll: starboard down.
    depth_error: the largest, m.
    """

    advance: float
    transfer: float
    tactical_diameter: float
    radius: float
    speed_kept: float
    yaw_rate: float
    drift: float
    roll: float
    depth_error: float


class Zigzag(NamedTuple):
    """A zigzag: time s and way m from the first execute to the second; overshoots, rad; second to fourth execute, s."""

    initial_time: float
    initial_way: float
    first_overshoot: float
    second_overshoot: float
    period: float


class DepthChange(NamedTuple):
    """A change of depth: rise time, s; settling time, s; overshoot, share; largest pitch, rad; final error, m.

    Rise is from 10 to 90 %, settling within 5 %.
    """

    rise_time: float
    settling_time: float
    overshoot: float
    largest_pitch: float
    steady_error: float


class Result(NamedTuple):
    """The results of a vehicle: turns by side, zigzags by angle in deg, and the record of each run by its name."""

    trial: Trial
    turns: Mapping[str, Turn]
    zigzags: Mapping[int, Zigzag]
    depth_change: DepthChange
    runs: Mapping[str, Record]


def presets() -> list[str]:
    """The presets in six degrees of freedom with fins and propulsion."""
    plants = {name: load_vehicle(name) for name in list_vehicles()}
    return [name for name, plant in plants.items() if plant.family.body is not None and plant.family.body.steered]


# The approach, and runs from it


def approach(vehicle: str, speed: float | None = None) -> Trial:
    """A vehicle in level flight at a speed, m/s, or at its design command; raises if it cannot fly like that."""
    plant = load_vehicle(vehicle, dt=DT)
    if plant.family.body is None:
        raise ValueError(f"The manoeuvres need a vehicle in six degrees of freedom, got {plant.name!r}.")
    cruise = find_cruise(plant)
    if speed is None:
        return Trial(plant, cruise)
    if not 0.0 < speed < inf:
        raise ValueError(f"--speed needs a number above 0 m/s, got {speed!r}.")
    for _ in range(60):
        drive = plant.parts.propeller
        if abs(cruise.speed - speed) < 1e-4 * speed:
            return Trial(plant, cruise)
        command = drive.design * speed / cruise.speed  # speed is nearly proportional to the command in all laws
        if command > drive.limit:
            break
        plant = replace_at(plant, {"parts.propeller.design": command})
        cruise = find_cruise(plant)
    raise ValueError(f"{plant.name!r} cannot approach at {speed:g} m/s: its propulsion ends at {drive.limit:g}.")


def stern_plane(trial: Trial, x: np.ndarray, depth: float) -> float:
    """The stern plane command towards a depth, by the regulator of the environments; pitch stays within HELD_PITCH."""
    cruise, k = trial.cruise, trial.cruise.plane_gains
    farthest = HELD_PITCH * abs(k[2] / k[3])
    away = min(max(x[DEPTH] - depth, -farthest), farthest)
    off = k[0] * (x[W] - cruise.state[W]) + k[1] * x[Q] + k[2] * (x[PITCH] - cruise.state[PITCH]) + k[3] * away
    return cruise.commands[find_helm(trial.plant).plane] - off


def course_rudder(trial: Trial, x: np.ndarray) -> float:
    """The rudder command for heading zero, by the regulator of the environments."""
    k = trial.cruise.rudder_gains
    return trial.cruise.commands[find_helm(trial.plant).rudder] - (
        k[0] * (x[V] - trial.cruise.state[V]) + k[1] * x[R] + k[2] * x[HEADING]
    )


def record_of(
    trial: Trial,
    steer: Callable[[np.ndarray, float], float],
    depth: float,
    duration: float,
    enough: Callable[[np.ndarray, int], bool] = lambda x, orders: False,
) -> Record:
    """The record of a run from the approach, at START_DEPTH and heading north; the stern plane steers to `depth`.

    steer: rudder command from the state and the last command.  enough: of the state and the number of times that the
    rudder has changed sides, ends the run.
    """
    plant, cruise = trial.plant, trial.cruise
    limits, size, helm = command_limits(plant), cruise.state.size, find_helm(plant)
    fins = [helm.rudder, helm.plane]
    x = np.zeros(len(plant.states))
    x[:size] = cruise.state
    x[DEPTH] = START_DEPTH
    commands = cruise.commands.copy()
    for at in (size, size + commands.size, x.size - commands.size):  # positions, backlash, last command
        x[at : at + commands.size] = commands
    states, inputs, orders, before = [], [], 0, 0.0
    for _ in range(round(duration / plant.dt) + 1):
        rudder = steer(x, before)
        orders += before * rudder < 0.0
        before = rudder
        commands[fins] = rudder, stern_plane(trial, x, depth)
        commands[fins] = np.clip(commands[fins], -limits[fins], limits[fins])
        states.append(x[:size])
        inputs.append(commands.copy())
        if enough(x, orders):
            break
        x = plant.step(x, commands)
    names = (*plant.family.states, *plant.inputs)
    time, values = plant.dt * np.arange(len(states)), np.hstack([np.array(states), np.array(inputs)])
    check_finite(names, time, values)
    return Record.from_arrays(time, {n: column for n, column in zip(names, values.T) if n != "wave_phase_rad"})


@cache
def manoeuvres(vehicle: str, speed: float | None) -> Result:
    """All manoeuvres of a vehicle."""
    trial = approach(vehicle, speed)
    full = trial.plant.parts.rudder.limit
    runs = {f"turn to {side}": turning_circle(trial, sign * full) for side, sign in SIDES.items()}
    runs |= {f"zigzag {angle}/{angle}": zigzag(trial, radians(angle)) for angle in ZIGZAGS}
    runs["depth change"] = depth_change(trial)
    return Result(
        trial,
        {side: turning_circle_quantities(runs[f"turn to {side}"]) for side in SIDES},
        {angle: zigzag_quantities(runs[f"zigzag {angle}/{angle}"], radians(angle)) for angle in ZIGZAGS},
        depth_change_of(runs["depth change"]),
        runs,
    )


def turning_circle(trial: Trial, order: float) -> Record:
    """One and a half turns with a rudder order, rad, positive to starboard."""
    rudder = _to_starboard(trial) * order
    run = record_of(
        trial, lambda x, before: rudder, START_DEPTH, _longest(trial), lambda x, _: abs(x[HEADING]) >= 3.0 * pi
    )
    if abs(run["heading_rad"][-1]) < 3.0 * pi:
        raise ValueError(
            f"{trial.plant.name!r} does not turn round with {degrees(order):.3g} deg of rudder within "
            f"{LONGEST:g} lengths: give it more."
        )
    return run


def zigzag(trial: Trial, angle: float) -> Record:
    """A zigzag up to its fifth execute, first to starboard, with this much rudder and heading, rad."""
    rudder = _to_starboard(trial) * angle

    def steer(x: np.ndarray, before: float) -> float:
        if abs(x[HEADING]) >= angle:
            return -rudder if x[HEADING] > 0.0 else rudder
        return before or rudder

    limit = trial.plant.parts.rudder.limit
    if angle > 1.01 * limit:  # vt690 reaches 19.996 deg
        raise ValueError(
            f"{trial.plant.name!r} has {degrees(limit):.3g} deg of rudder, a zigzag needs {degrees(angle):.3g}."
        )
    run = record_of(trial, steer, START_DEPTH, _longest(trial), lambda x, orders: orders == 4)
    if executes(run).size < 5:
        raise ValueError(
            f"{trial.plant.name!r} does not come back from {degrees(angle):.3g} deg of heading within {LONGEST:g} "
            "lengths: its rudder does not check the yaw."
        )
    return run


def depth_change(trial: Trial) -> Record:
    """A dive by DEPTH_STEP."""
    duration = DEPTH_STEP / (0.15 * trial.cruise.speed) + 20.0 * trial.length / trial.cruise.speed
    run = record_of(trial, lambda x, before: course_rudder(trial, x), START_DEPTH + DEPTH_STEP, duration)
    gone = run["depth_m"].max() - START_DEPTH
    if gone < 0.95 * DEPTH_STEP:
        raise ValueError(
            f"{trial.plant.name!r} comes {gone:.1f} of {DEPTH_STEP:g} m deeper in {duration:.0f} s at "
            f"{trial.cruise.speed:.2f} m/s: approach faster."
        )
    return run


def _to_starboard(trial: Trial) -> float:
    """The sign of a rudder angle that turns the bow to starboard; yaw moments are positive to starboard."""
    return 1.0 if trial.plant.parts.rudder.moment > 0.0 else -1.0


def _longest(trial: Trial) -> float:
    return LONGEST * trial.length / trial.cruise.speed


# Quantities of a run


def turning_circle_quantities(run: Record) -> Turn:
    """The quantities of a turning circle, of 270 deg or more, whose rudder is put over at the first sample."""
    heading = run["heading_rad"] - run["heading_rad"][0]
    side = 1.0 if heading[-1] > 0.0 else -1.0
    if side * heading[-1] < 1.5 * pi:
        raise ValueError(f"A turning circle needs 270 deg of heading, got {degrees(abs(heading[-1])):.0f}: run longer.")
    course = run["heading_rad"][0]
    north, east = (run[name] - run[name][0] for name in ("north_m", "east_m"))
    ahead = np.cos(course) * north + np.sin(course) * east
    aside = side * (np.cos(course) * east - np.sin(course) * north)
    at_90, at_180 = (_crossing(side * heading, k * pi / 2.0) for k in (1, 2))
    tail = slice(int(_crossing(side * heading, side * heading[-1] - pi)), None)
    way = _way(run)
    seconds = run.time[-1] - run.time[tail][0]
    speed = np.sqrt(run["u_mps"] ** 2 + run["v_mps"] ** 2 + run["w_mps"] ** 2)
    turned = abs(heading[-1] - heading[tail][0])
    samples = np.arange(heading.size)
    return Turn(
        advance=float(np.interp(at_90, samples, ahead)),
        transfer=float(np.interp(at_90, samples, aside)),
        tactical_diameter=float(np.interp(at_180, samples, aside)),
        radius=float((way[-1] - way[tail][0]) / turned),
        speed_kept=float(speed[tail].mean() / speed[0]),
        yaw_rate=float(side * turned / seconds),
        drift=float(np.arctan2(-side * run["v_mps"][tail].mean(), run["u_mps"][tail].mean())),
        roll=float(run["roll_rad"][tail].mean()),
        depth_error=float(np.abs(run["depth_m"] - run["depth_m"][0]).max()),
    )


def zigzag_quantities(run: Record, angle: float) -> Zigzag:
    """The quantities of a zigzag with this much heading, rad, that goes to its fourth execute or beyond."""
    at = executes(run)
    if at.size < 4:
        raise ValueError(f"A zigzag needs 4 executes for its quantities, got {at.size}: run longer.")
    heading, time = run["heading_rad"] - run["heading_rad"][0], run.time
    overshoots = [float(np.abs(heading[a : b + 1]).max() - angle) for a, b in pairwise(at[1:4])]
    return Zigzag(
        initial_time=float(time[at[1]] - time[at[0]]),
        initial_way=float(_way(run)[at[1]]),
        first_overshoot=overshoots[0],
        second_overshoot=overshoots[1],
        period=float(time[at[3]] - time[at[1]]),
    )


def executes(run: Record) -> np.ndarray:
    """The samples at which the rudder is put over: the first, and where its command changes sides."""
    return np.append(0, np.flatnonzero(np.diff(np.sign(run["rudder_rad"])) != 0.0) + 1)


def depth_change_of(run: Record) -> DepthChange:
    """The quantities of a depth change by DEPTH_STEP from the depth of the first sample."""
    time, done = run.time, (run["depth_m"] - run["depth_m"][0]) / DEPTH_STEP
    if done.max() < 0.95:
        raise ValueError(f"A depth change needs {DEPTH_STEP:g} m, got {DEPTH_STEP * done.max():.1f} m: run longer.")
    start, end = (np.interp(_crossing(done, share), np.arange(done.size), time) for share in (0.1, 0.9))
    outside = np.flatnonzero(np.abs(done - 1.0) > 0.05)
    pitch = run["pitch_rad"]
    return DepthChange(
        rise_time=float(end - start),
        settling_time=float(time[min(outside[-1] + 1, time.size - 1)] - time[0]),
        overshoot=float(max(done.max() - 1.0, 0.0)),
        largest_pitch=float(pitch[np.abs(pitch).argmax()]),
        steady_error=float(DEPTH_STEP * (done[-1] - 1.0)),
    )


def _way(run: Record) -> np.ndarray:
    """The way travelled in the horizontal plane up to each sample, m."""
    steps = np.hypot(np.diff(run["north_m"]), np.diff(run["east_m"]))
    return np.append(0.0, np.cumsum(steps))


def _crossing(values: np.ndarray, level: float) -> float:
    """The fractional sample at which values reach a level for the first time."""
    k = int(np.argmax(values >= level))
    return k if k == 0 else k - 1 + (level - values[k - 1]) / (values[k] - values[k - 1])
