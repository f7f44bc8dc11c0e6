"""Turning circles, zigzags and depth changes of the vehicles in six degrees of freedom, measured and drawn.

    python -m scripts.manoeuvres --out figures

Terms are those of IMO resolution MSC.137(76), annex, section 4.2, and of ITTC 7.5-04-02-01 (2017), section 2.2; the
midship point is the origin of the body axes. A vehicle starts in steady level flight. In a turning circle and a zigzag
its stern plane keeps the depth, in a depth change its rudder keeps the heading, both by the regulators of the
environments; bow planes stay at zero.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import degrees, inf, pi, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from auv_gym.cli.options.console import steps_bar
from auv_gym.envs.tasks import HELD_PITCH
from auv_gym.model import Diverged, check_finite
from auv_gym.param import replace_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.plant.cruise import Cruise, command_limits, find_cruise, find_helm
from auv_gym.records.record import Record

DT = 0.02  # s; a quick vehicle turns 0.3 deg meanwhile, and a zigzag's rudder may come so much late
START_DEPTH = 20.0  # m
DEPTH_STEP = 10.0  # m
ZIGZAGS = (10, 20)  # deg of rudder and of heading
SIDES = {"starboard": 1, "port": -1}
LONGEST = 400.0  # lengths travelled, at the approach speed, after which a run counts as stuck
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

    speed_kept: over the approach speed.  drift: positive where the bow points into the turn.  roll: starboard down.
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
    """A change of depth: 10 to 90 %, s; for good within 5 %, s; overshoot, share; largest pitch, rad; last error, m."""

    rise_time: float
    settling_time: float
    overshoot: float
    largest_pitch: float
    steady_error: float


class Result(NamedTuple):
    """What a vehicle did: turns by side, zigzags by angle in deg, and the record of each run by its name."""

    trial: Trial
    turns: Mapping[str, Turn]
    zigzags: Mapping[int, Zigzag]
    depth_change: DepthChange
    runs: Mapping[str, Record]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the manoeuvres, print their quantities, draw them into a folder."""
    parser = argparse.ArgumentParser(description="Turning circles, zigzags and depth changes, measured and drawn.")
    parser.add_argument(
        "--vehicle", nargs="+", metavar="NAME", help="presets or vehicle files (default: all presets in six degrees)"
    )
    parser.add_argument("--speed", type=float, help="approach speed, m/s (default: at the vehicle's design command)")
    parser.add_argument("--out", type=Path, help="folder for the pictures (PNG); default: no pictures")
    parser.add_argument("--json", action="store_true", help="print the quantities as JSON, in SI units")
    given = parser.parse_args(argv)
    names, written = given.vehicle or presets(), []
    try:
        with steps_bar(len(names) * (4 + len(ZIGZAGS)) + 1) as advance:
            results = [manoeuvre(name, given.speed, advance) for name in names]
            compared = compare(results) if given.speed is None else []
            if given.out is not None:
                from scripts.manoeuvre_pictures import draw

                advance("pictures")
                written = draw(results, given.out)
    except (ValueError, OSError, ImportError, Diverged) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps({result.trial.plant.name: as_json(result) for result in results}, indent=2))
    else:
        console = Console(highlight=False)
        console.print(_quantity_table(results))
        if compared:
            console.print(_comparison_table(compared))
    for path in written:
        print(f"Written to {path}", file=sys.stderr)
    return 0


def presets() -> list[str]:
    """The presets in six degrees of freedom."""
    return [name for name in list_vehicles() if load_vehicle(name).family.kind == "body"]


# The approach, and runs from it


def approach(vehicle: str, speed: float | None = None) -> Trial:
    """A vehicle in level flight at a speed, m/s, or at its design command; raises where it cannot fly so."""
    plant = load_vehicle(vehicle, dt=DT)
    if plant.family.kind != "body":
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
        command = drive.design * speed / cruise.speed  # speed goes nearly with the command in all propulsion laws
        if command > drive.limit:
            break
        plant = replace_at(plant, {"parts.propeller.design": command})
        cruise = find_cruise(plant)
    raise ValueError(f"{plant.name!r} cannot approach at {speed:g} m/s: its propulsion ends at {drive.limit:g}.")


def stern_plane(trial: Trial, x: np.ndarray, depth: float) -> float:
    """The stern plane that makes for a depth, by the regulator of the environments; pitch stays within HELD_PITCH."""
    cruise, k = trial.cruise, trial.cruise.plane_gains
    farthest = HELD_PITCH * abs(k[2] / k[3])
    away = min(max(x[DEPTH] - depth, -farthest), farthest)
    off = k[0] * (x[W] - cruise.state[W]) + k[1] * x[Q] + k[2] * (x[PITCH] - cruise.state[PITCH]) + k[3] * away
    return cruise.commands[find_helm(trial.plant).plane] - off


def course_rudder(trial: Trial, x: np.ndarray) -> float:
    """The rudder that keeps heading zero, by the regulator of the environments."""
    k = trial.cruise.rudder_gains
    return trial.cruise.commands[find_helm(trial.plant).rudder] - (
        k[0] * (x[V] - trial.cruise.state[V]) + k[1] * x[R] + k[2] * x[HEADING]
    )


def fly(
    trial: Trial,
    steer: Callable[[np.ndarray, float], float],
    depth: float,
    duration: float,
    enough: Callable[[np.ndarray, int], bool] = lambda x, orders: False,
) -> Record:
    """The record of a run from the approach, at START_DEPTH and heading north; the stern plane makes for `depth`.

    steer: rudder command from the state and the command before.  enough: of the state and the number of times that
    the rudder has changed sides, ends the run.
    """
    plant, cruise = trial.plant, trial.cruise
    limits, size, helm = command_limits(plant), cruise.state.size, find_helm(plant)
    fins = [helm.rudder, helm.plane]
    x = np.zeros(len(plant.states))
    x[:size] = cruise.state
    x[DEPTH] = START_DEPTH
    commands = cruise.commands.copy()
    for at in (size, size + commands.size, x.size - commands.size):  # positions, play, last command
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


def manoeuvre(vehicle: str, speed: float | None = None, advance: Callable[[str], None] = lambda text: None) -> Result:
    """Everything a vehicle is made to do; advance: is told of each run before it begins."""
    advance(f"{vehicle}: approach")
    trial, runs = approach(vehicle, speed), {}
    for side, sign in SIDES.items():
        advance(f"{vehicle}: turn to {side}")
        runs[f"turn to {side}"] = turning_circle(trial, sign * trial.plant.parts.rudder.limit)
    for angle in ZIGZAGS:
        advance(f"{vehicle}: zigzag {angle}/{angle}")
        runs[f"zigzag {angle}/{angle}"] = zigzag(trial, radians(angle))
    advance(f"{vehicle}: depth change")
    runs["depth change"] = depth_change(trial)
    return Result(
        trial,
        {side: turn_of(runs[f"turn to {side}"]) for side in SIDES},
        {angle: zigzag_of(runs[f"zigzag {angle}/{angle}"], radians(angle)) for angle in ZIGZAGS},
        depth_change_of(runs["depth change"]),
        runs,
    )


def turning_circle(trial: Trial, order: float) -> Record:
    """One and a half turns with a rudder order, rad, positive to starboard."""
    rudder = _to_starboard(trial) * order
    run = fly(trial, lambda x, before: rudder, START_DEPTH, _longest(trial), lambda x, _: abs(x[HEADING]) >= 3.0 * pi)
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
    if angle > 1.01 * limit:  # vt690 has 19.996 deg
        raise ValueError(
            f"{trial.plant.name!r} has {degrees(limit):.3g} deg of rudder, a zigzag needs {degrees(angle):.3g}."
        )
    run = fly(trial, steer, START_DEPTH, _longest(trial), lambda x, orders: orders == 4)
    if executes(run).size < 5:
        raise ValueError(
            f"{trial.plant.name!r} does not come back from {degrees(angle):.3g} deg of heading within {LONGEST:g} "
            "lengths: its rudder does not check the yaw."
        )
    return run


def depth_change(trial: Trial) -> Record:
    """A dive by DEPTH_STEP."""
    duration = DEPTH_STEP / (0.15 * trial.cruise.speed) + 20.0 * trial.length / trial.cruise.speed
    run = fly(trial, lambda x, before: course_rudder(trial, x), START_DEPTH + DEPTH_STEP, duration)
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


def turn_of(run: Record) -> Turn:
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


def zigzag_of(run: Record, angle: float) -> Zigzag:
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


# a quantity's name, its limit for ships over 100 m in MSC.137(76), section 5.3 (at L/V below 10 s), digits, values
Quantity = tuple[str, str, int, Callable[[Result], list[float]]]


def quantities() -> list[Quantity]:
    """What the table has in its rows; two values are those of the turns to starboard and to port."""
    table: list[Quantity] = [
        ("approach speed, m/s", "", 2, lambda r: [r.trial.cruise.speed]),
        ("**turning circle**, rudder, deg", "", 0, lambda r: [degrees(r.trial.plant.parts.rudder.limit)]),
        ("advance, lengths", "4.5", 2, lambda r: [t.advance / r.trial.length for t in r.turns.values()]),
        ("transfer, lengths", "", 2, lambda r: [t.transfer / r.trial.length for t in r.turns.values()]),
        (
            "tactical diameter, lengths",
            "5",
            2,
            lambda r: [t.tactical_diameter / r.trial.length for t in r.turns.values()],
        ),
        ("steady radius, lengths", "", 2, lambda r: [t.radius / r.trial.length for t in r.turns.values()]),
        ("steady over approach speed", "", 2, lambda r: [t.speed_kept for t in r.turns.values()]),
        ("yaw rate, deg/s", "", 1, lambda r: [abs(degrees(t.yaw_rate)) for t in r.turns.values()]),
        ("drift angle, deg", "", 1, lambda r: [degrees(t.drift) for t in r.turns.values()]),
        ("roll, deg", "", 1, lambda r: [degrees(t.roll) for t in r.turns.values()]),
        ("largest depth error, m", "", 2, lambda r: [t.depth_error for t in r.turns.values()]),
    ]
    for angle, (way, first, second) in {10: ("2.5", "10", "25"), 20: ("", "25", "")}.items():

        def of(r: Result, angle: int = angle) -> Zigzag:
            return r.zigzags[angle]

        table += [
            (f"**zigzag {angle}/{angle}**, {angle} deg after, s", "", 1, lambda r, of=of: [of(r).initial_time]),
            (f"{angle} deg after, lengths", way, 2, lambda r, of=of: [of(r).initial_way / r.trial.length]),
            ("first overshoot, deg", first, 1, lambda r, of=of: [degrees(of(r).first_overshoot)]),
            ("second overshoot, deg", second, 1, lambda r, of=of: [degrees(of(r).second_overshoot)]),
            ("period, s", "", 1, lambda r, of=of: [of(r).period]),
        ]
    return [
        *table,
        (f"**{DEPTH_STEP:g} m deeper**, 10 to 90 %, s", "", 1, lambda r: [r.depth_change.rise_time]),
        ("within 5 % after, s", "", 1, lambda r: [r.depth_change.settling_time]),
        ("overshoot, %", "", 1, lambda r: [100.0 * r.depth_change.overshoot]),
        ("largest pitch, deg", "", 1, lambda r: [degrees(r.depth_change.largest_pitch)]),
        ("error at the end, m", "", 2, lambda r: [r.depth_change.steady_error]),
    ]


def rows(results: Sequence[Result]) -> list[list[str]]:
    """The table as text: the quantity, a column for each vehicle, the limit for ships; equal values once."""

    def text(values: list[float], digits: int) -> str:
        return " / ".join(dict.fromkeys(f"{round(value, digits) + 0.0:.{digits}f}" for value in values))

    return [
        [name, *(text(values(result), digits) for result in results), limit]
        for name, limit, digits, values in quantities()
    ]


def compare(results: Sequence[Result]) -> list[list[str]]:
    """Rows of vehicle, quantity, value here, published value and its source, for what is known of these vehicles."""
    known = {result.trial.plant.name: result for result in results}
    table = []
    if "vt690" in known:
        turns = known["vt690"].turns
        rate, kept = (np.mean([abs(getattr(t, name)) for t in turns.values()]) for name in ("yaw_rate", "speed_kept"))
        log = "a log of the vehicle; speed is over ground, in a current of 0.2 m/s"
        table += [
            ["vt690", "yaw rate with 20 deg of rudder, deg/s", f"{degrees(rate):.1f}", "9.4", log],
            ["vt690", "speed in that turn over speed before", f"{kept:.2f}", "0.90 (1.36 over 1.51 m/s)", log],
        ]
    if "heu_torpedo" in known:
        trial = known["heu_torpedo"].trial
        width = 2.0 * turn_of(turning_circle(trial, radians(5.0))).radius
        table.append(
            [
                "heu_torpedo",
                "width of the circle with 5 deg of rudder, m",
                f"{width:.0f}",
                "more than 60, up to 70",
                "Xu et al. 2013, ticks of the axes of figures 9 and 10; there it dives meanwhile",
            ]
        )
    # found in a reprint without its references: the trials of SPC-III beside a vehicle of its size with a screw
    radii = [t.radius / r.trial.length for r in results for t in r.turns.values()]
    table.append(
        [
            "all",
            "steady radius with full rudder, lengths",
            f"{min(radii):.1f} to {max(radii):.1f}",
            "2.5",
            "another propeller-driven vehicle, 45 deg of rudder at 1.1 m/s, in trials of the SPC-III robotic fish",
        ]
    )
    return table


def as_json(result: Result) -> dict[str, Any]:
    """The quantities of a vehicle in SI units, by manoeuvre."""
    trial = result.trial
    return {
        "length_m": trial.length,
        "speed_mps": trial.cruise.speed,
        "rudder_rad": trial.plant.parts.rudder.limit,
        "turning_circle": {side: turn._asdict() for side, turn in result.turns.items()},
        "zigzag": {f"{angle}/{angle}": zigzag._asdict() for angle, zigzag in result.zigzags.items()},
        "depth_change": result.depth_change._asdict(),
    }


# What is printed


def _quantity_table(results: Sequence[Result]) -> Table:
    table = Table(title="Manoeuvres (turns: to starboard / to port)", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("quantity")
    for result in results:
        table.add_column(result.trial.plant.name, justify="right")
    table.add_column("ships (IMO)", justify="right")
    for name, *values in rows(results):
        first = "**" in name
        table.add_row(name.replace("**", "") if first else f"  {name}", *values)
    return table


def _comparison_table(compared: Sequence[Sequence[str]]) -> Table:
    table = Table(title="Beside what is published", title_justify="left", box=SIMPLE_HEAD)
    for head in ("vehicle", "quantity", "here", "there", "source"):
        table.add_column(head)
    for row in compared:
        table.add_row(*row)
    return table


if __name__ == "__main__":
    sys.exit(main())
