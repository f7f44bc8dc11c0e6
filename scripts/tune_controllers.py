"""Gains of the PID and S-plane loops of vehicles, tuned by simulation and written to a file.

    python -m scripts.tune_controllers --out gains.toml

Each loop starts from gains that follow from the vehicle (see `first_gains`) and is then changed, by Nelder and Mead's
simplex on the logarithms, for the least cost over the same steps of the targets on three plants: the vehicle, and two
with every main coefficient 20 % up or down and the actuators off their zero, all with sensor noise. The cost is the
time integral of the error over the step, plus overshoot, plus travel of the command. Same seed, same file.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize

from auv_gym.channels import set_point_of
from auv_gym.cli.options.console import progress_bar, table
from auv_gym.model import Diverged
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.plant.cruise import command_limits, find_cruise, find_helm
from auv_gym.plant.float_engine import find_engine
from controllers.autopilots import autopilot
from controllers.gains import Gains, Loops, read_gains, write_gains
from controllers.pid import heading_pid
from controllers.trials.settling import step_response
from controllers.trials.trial import NOISE, Steps, at_rest, level_flight, run_trial
from identification.pages.drawing import shown_values

TABLE_4 = {"heading": (0.9, 1.7, 0.0024), "depth": (2.3, 2.4, 0.00006), "speed": (0.8, 0.1, 0.02)}  # Xu et al. 2013
BESIDES = {"npsauv": (4.0,)}  # s, sample times besides a preset's own; paper 1 samples npsauv so
PUBLISHED = "heu_torpedo"  # the vehicle that Table 4 is for
PITCH_LIMIT = 0.35  # rad
BOW_SHARE = -1.0  # bow planes against stern planes: a moment without a force
CHANGE = 0.2  # of the main coefficients
OFF = 0.05  # of an actuator's range, by which it is off its zero
VERTICAL = ("hull.heave.uw", "hull.pitch.uw", "hull.pitch.uq", "parts.stern_plane.moment")
SEGMENT = 30.0  # s per time scale of the vehicle; two make a run
OVERSHOOT, TRAVEL = 10.0, 0.15  # weights: of overshoot over the step, of full travels of the command
EVALUATIONS = 40  # of the cost, per loop
BAND = 0.05  # of the step, or the sensor's noise if that is more: settled
_FAILED = 1e6
_FACTORS = 0.7  # natural logarithm of the first changes of the gains
# what is tuned together, for one channel
_LOOPS = {
    "pid": {"u_mps": ("speed",), "heading_rad": ("heading",), "depth_m": ("pitch", "depth")},
    "s_plane": {"u_mps": ("speed",), "heading_rad": ("heading",), "depth_m": ("depth",)},
}
_GAINS = ("proportional", "integral", "derivative", "error_scale", "rate_scale")


Start = tuple[np.ndarray, np.ndarray]


class Bench(NamedTuple):
    """A vehicle's trial: plants, the first being the vehicle itself, and where each starts; steps of the targets.

    held: the targets where they do not move.  duration: of a run, s.  scale: the vehicle's time scale, s.
    """

    plants: tuple[Plant, ...]
    starts: tuple[Start, ...]
    steps: Steps
    held: Mapping[str, float]
    duration: float
    scale: float
    seed: int


class Reached(NamedTuple):
    """What a loop reached on the vehicle itself, in its channel's unit: first the step, then as in `settling.Step`."""

    vehicle: str
    dt: float
    kind: str
    channel: str
    step: float
    settling_time: float
    overshoot: float
    swing: float


def main(argv: Sequence[str] | None = None) -> int:
    """Tune the gains of vehicles, write them into a file, print what they reach."""
    parser = argparse.ArgumentParser(description="Tune the gains of PID and S-plane loops by simulation.")
    parser.add_argument("--vehicle", nargs="+", metavar="NAME", help="presets or vehicle files (default: all presets)")
    parser.add_argument("--dt", type=float, help="sample time, s (default: the vehicle's; npsauv also 4 s)")
    parser.add_argument("--seed", type=int, default=0, help="of noise and changed coefficients (default 0)")
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, help="of the cost, per loop (default 40)")
    parser.add_argument("--s-plane", action="store_true", help="S-plane loops too (default: those of heu_torpedo)")
    parser.add_argument("--out", type=Path, default=Path("gains.toml"), help="entries of others stay in it")
    given = parser.parse_args(argv)
    try:
        plants = [
            load_vehicle(name, dt=dt)
            for name in given.vehicle or list_vehicles()
            for dt in ([given.dt] if given.dt or given.vehicle else [None, *BESIDES.get(name, ())])
        ]
        kept = read_gains(given.out) if given.out.exists() else ()
        reached: list[Reached] = []
        with progress_bar() as show:
            for i, plant in enumerate(plants):
                bench = bench_of(plant, given.seed)
                gains = tuned(
                    bench,
                    given.evaluations,
                    lambda share, text, i=i: show((i + share) / len(plants), text),
                    given.s_plane,
                )
                reached += measured(bench, gains)
                kept = (*(e for e in kept if (e.vehicle, e.dt) != (gains.vehicle, gains.dt)), gains)
                write_gains(kept, given.out)
    except (ValueError, Diverged) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    Console(highlight=False).print(_reached_table(reached))
    print(f"Written to {given.out}", file=sys.stderr)
    return 0


def tuned(bench: Bench, evaluations: int, show: Callable[[float, str], None], s_plane: bool = False) -> Gains:
    """The gains of a bench's vehicle, after so many evaluations for each loop; s_plane: with those of that law."""
    gains = _all_rounded(first_gains(bench.plants[0], s_plane))
    plan = [(kind, name) for kind in gains.loops for name in _LOOPS[kind] if name in bench.steps]
    for i, (kind, name) in enumerate(plan):

        def told(done: int, text: str = f"{gains.vehicle} {kind} {name}", i: int = i) -> None:
            show((i + done / evaluations) / len(plan), text)

        gains = _improved(bench, gains, kind, name, evaluations, told)
    return gains


def bench_of(plant: Plant, seed: int) -> Bench:
    """The trial of a vehicle: steps that fit its size, changed plants drawn from the seed."""
    tuning, rng = tuning_of(plant), np.random.default_rng(seed)
    paths = [*plant.family.coefficients, *(path for path in tuning.besides if path in list_paths(plant))]
    offsets, plants = tuning.offsets(plant), [plant]
    for side in (1.0, -1.0):
        factors = 1.0 + CHANGE * rng.choice([-1.0, 1.0], len(paths))
        changed = {path: value_at(plant, path) * factor for path, factor in zip(paths, factors.tolist(), strict=True)}
        plants.append(replace_at(plant, {**changed, **{path: side * value for path, value in offsets.items()}}))
    trial = tuning.trial(plant)
    starts = tuple(trial.start(plant) for plant in plants)
    return Bench(tuple(plants), starts, trial.steps, trial.held, trial.duration, trial.scale, seed)


def first_gains(plant: Plant, s_plane: bool = False) -> Gains:
    """Gains to start from: a hull's by its linear-quadratic regulators, others' by their lags and engines."""
    loops, bow_share = tuning_of(plant).first(plant, s_plane)
    return Gains(plant.name, plant.dt, bow_share, loops)


def cost(bench: Bench, gains: Gains, kind: str, name: str) -> float:
    """What the loop of a channel costs, the mean over the plants; large where a run leaves the finite numbers."""
    total, controller = 0.0, autopilot(bench.plants[0], kind, gains=gains)
    for i, plant in enumerate(bench.plants):
        rng = np.random.default_rng([bench.seed, i])
        try:
            run = run_trial(plant, controller, _trial(bench, name), bench.duration, start=bench.starts[i], rng=rng)
        except (Diverged, OverflowError):
            return _FAILED
        total += _cost_of(run, bench, name)
    return min(total / len(bench.plants), _FAILED)


def measured(bench: Bench, gains: Gains) -> list[Reached]:
    """What each loop reaches on the vehicle itself, with noise, in the first step of its target."""
    result = []
    for kind in gains.loops:
        controller, plant = autopilot(bench.plants[0], kind, gains=gains), bench.plants[0]
        for name in bench.steps:
            rng = np.random.default_rng([bench.seed, len(bench.plants)])
            run = run_trial(plant, controller, _trial(bench, name), bench.duration, start=bench.starts[0], rng=rng)
            part, target = next(_segments(run, name))
            size = target - float(run[name][part][0])
            band = max(BAND * abs(size), NOISE[name])
            step = step_response(run["time_s"][part], run[name][part], target, band)
            result.append(
                Reached(gains.vehicle, gains.dt, kind, name, size, step.settling_time, step.overshoot, step.swing)
            )
    return result


def _trial(bench: Bench, name: str) -> Steps:
    """The targets of a channel's trial: speed moves alone, because a sharp turn costs more of it than a step."""
    return {
        other: steps if (other == "u_mps") == (name == "u_mps") else [(0.0, bench.held[other])]
        for other, steps in bench.steps.items()
    }


def _cost_of(run: Mapping[str, np.ndarray], bench: Bench, name: str) -> float:
    plant, total = bench.plants[0], 0.0
    command, span = tuning_of(plant).moved_by(plant, name)
    for part, target in _segments(run, name):
        values = run[name][part]
        size = target - values[0]
        error = np.abs(values - target).sum() * plant.dt / bench.scale
        beyond = max(float(((values - target) / size).max()), 0.0)
        total += (error + TRAVEL * np.abs(np.diff(run[command][part])).sum() / span * abs(size)) / abs(size)
        total += OVERSHOOT * beyond
    return float(total)


def _segments(run: Mapping[str, np.ndarray], name: str) -> Iterator[tuple[slice, float]]:
    """Where each target stands that is apart from the value before, and the target."""
    wanted = run[set_point_of(name)]
    edges = [0, *(np.flatnonzero(np.diff(wanted)) + 1).tolist(), wanted.size]
    for begin, end in pairwise(edges):
        if abs(wanted[begin] - run[name][begin]) > 1e-9:
            yield slice(begin, end), float(wanted[begin])


def _improved(bench: Bench, gains: Gains, kind: str, name: str, evaluations: int, told: Callable[[int], None]) -> Gains:
    places = [
        (loop, key)
        for loop in _LOOPS[kind][name]
        if loop in gains.loops[kind]
        for key in _GAINS
        if gains.loops[kind][loop].get(key, 0.0) != 0.0
    ]
    done = 0

    def at(logarithms: np.ndarray) -> Gains:
        loops = {loop: dict(settings) for loop, settings in gains.loops[kind].items()}
        for (loop, key), logarithm in zip(places, logarithms.tolist(), strict=True):
            loops[loop][key] = _rounded(loops[loop][key] * np.exp(logarithm))
        return replace(gains, loops={**gains.loops, kind: loops})

    def costs(logarithms: np.ndarray) -> float:
        nonlocal done
        done += 1
        told(min(done, evaluations))
        # an integral that runs away in the logarithm is as good as none, and is not worth the search
        return cost(bench, at(logarithms), kind, name) + 0.01 * float(np.square(logarithms).sum())

    simplex = np.vstack([np.zeros(len(places)), _FACTORS * np.eye(len(places))])
    found = minimize(
        costs,
        simplex[0],
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-3},
    )
    return at(found.x)


class Trial(NamedTuple):
    """Steps of the targets, targets that stand, s of a run, s of the vehicle's time scale, and where a run starts."""

    steps: Steps
    held: Mapping[str, float]
    duration: float
    scale: float
    start: Callable[[Plant], Start]


First = tuple[Mapping[str, Loops], float]  # loops by law, and what bow planes take of the stern planes' command


class Tuning(NamedTuple):
    """What tuning has to know of a kind of vehicle.

    first: the gains to start from; with those of the S-plane law where that is asked for.  moved_by: the input that
    moves a channel, and its range.  offsets: of the actuators, by path.  besides: coefficients that are changed
    besides those of the family.
    """

    kind: str
    trial: Callable[[Plant], Trial]
    first: Callable[[Plant, bool], First]
    moved_by: Callable[[Plant, str], tuple[str, float]]
    offsets: Callable[[Plant], dict[str, float]]
    besides: tuple[str, ...] = ()


def _hull_trial(plant: Plant) -> Trial:
    cruise, length = find_cruise(plant), plant.hull.length
    scale = max(length / cruise.speed, 3.0 * plant.dt)
    duration, deep = 2.0 * SEGMENT * scale, 20.0 * length
    steps: Steps = {
        "depth_m": [(0.0, deep + 4.0 * length), (0.5 * duration, deep + 3.0 * length)],
        "heading_rad": [(0.0, 0.9), (0.5 * duration, 0.4)],
        "u_mps": [(0.0, 0.8 * cruise.speed), (0.4 * duration, cruise.speed)],
    }
    held = {"depth_m": deep, "heading_rad": 0.0, "u_mps": cruise.speed}
    return Trial(steps, held, duration, scale, lambda plant: level_flight(plant, deep))


def _hull_first(plant: Plant, s_plane: bool) -> First:
    cruise, limits, helm = find_cruise(plant), command_limits(plant), find_helm(plant)
    length, speed = plant.hull.length, cruise.speed
    time = length / speed
    _, turn, rudder = (float(gain) for gain in cruise.rudder_gains)
    _, rate, pitch, depth = (float(gain) for gain in cruise.plane_gains)
    push = 0.5 * float(limits[helm.drive]) / speed
    by_pitch = depth / pitch
    pid = {
        "speed": {"proportional": push, "integral": push / (10.0 * time), "integral_range": 0.3 * speed},
        "heading": _law(rudder, rudder / (20.0 * time), turn, integral_range=0.2),
        "pitch": _law(pitch, pitch / (10.0 * time), rate, integral_range=0.2),
        "depth": _law(by_pitch, by_pitch / (40.0 * time), integral_range=0.5 * length, limit=PITCH_LIMIT),
    }
    loops: dict[str, Loops] = {"pid": pid}
    if s_plane or (plant.name == PUBLISHED and plant.dt < time):
        scales = {
            "speed": (speed, 1.0 * speed / time),
            "heading": _scales("heading", float(limits[helm.rudder]), rudder, turn),
            "depth": _scales("depth", float(limits[helm.plane]), pitch * by_pitch, pitch / speed),
        }
        filters = {"speed": time, "heading": 0.0, "depth": time}
        loops["s_plane"] = {
            name: {
                **dict(zip(("k1", "k2", "k3"), TABLE_4[name], strict=True)),
                "error_scale": scales[name][0],
                "rate_scale": scales[name][1],
                "filter_time": filters[name],
            }
            for name in ("speed", "heading", "depth")
        }
    return loops, BOW_SHARE if len(plant.family.body.by_role()["pitch"]) > 1 else 0.0


def _hull_moved_by(plant: Plant, name: str) -> tuple[str, float]:
    helm = find_helm(plant)
    index = {"heading_rad": helm.rudder, "depth_m": helm.plane, "u_mps": helm.drive}[name]
    limit = float(command_limits(plant)[index])
    return plant.inputs[index], limit if index == helm.drive else 2.0 * limit


def _hull_offsets(plant: Plant) -> dict[str, float]:
    helm, limits, commands = find_helm(plant), command_limits(plant), plant.family.body.commands
    return {f"effects.{commands[at][0].name}.offset": OFF * float(limits[at]) for at in (helm.rudder, helm.plane)}


def _glider_trial(plant: Plant) -> Trial:
    scale = max(3.0 * plant.dt, 10.0)
    duration = 2.0 * SEGMENT * scale
    steps: Steps = {"heading_rad": [(0.0, 0.9), (0.5 * duration, 0.4)]}
    held = {"heading_rad": 0.0}
    return Trial(steps, held, duration, scale, lambda plant: at_rest(plant, held))


def _glider_first(plant: Plant, s_plane: bool) -> First:
    pid, names = heading_pid(plant), ("proportional", "integral", "derivative", "filter_time", "integral_range")
    return {"pid": {"heading": {name: getattr(pid, name) for name in names}}}, 0.0


def _float_trial(plant: Plant) -> Trial:
    engine = find_engine(plant)
    length, duration = engine.speed * engine.time, SEGMENT * engine.time
    steps: Steps = {"depth_m": [(0.0, 5.0 * length), (0.5 * duration, 4.6 * length)]}
    held = {"depth_m": 4.0 * length}
    return Trial(steps, held, duration, engine.time, lambda plant: at_rest(plant, held))


def _float_first(plant: Plant, s_plane: bool) -> First:
    engine = find_engine(plant)
    time = max(3.0 * plant.dt, 1.5 * engine.half / engine.rate)
    reach = 1.4 * time * engine.speed
    gain = -engine.half / reach
    loop = _law(gain, gain / (7.0 * time), 0.45 * time * gain, filter_time=0.25 * time, integral_range=reach)
    return {"pid": {"depth": loop}}, 0.0


def _float_moved_by(plant: Plant, name: str) -> tuple[str, float]:
    engine = find_engine(plant)
    return engine.channel, 2.0 * engine.half


def _float_offsets(plant: Plant) -> dict[str, float]:
    engine = find_engine(plant)
    return {"effects.volume.offset": OFF * engine.half * engine.volume}


_TUNINGS = (
    Tuning("body", _hull_trial, _hull_first, _hull_moved_by, _hull_offsets, VERTICAL),
    Tuning(
        "glider",
        _glider_trial,
        _glider_first,
        lambda plant, name: ("rudder_rad", 2.0 * plant.hull.rudder_limit),
        lambda plant: {"effects.rudder.offset": OFF * plant.hull.rudder_limit},
    ),
    Tuning("float", _float_trial, _float_first, _float_moved_by, _float_offsets),
)
TUNINGS = {tuning.kind: tuning for tuning in _TUNINGS}


def tuning_of(plant: Plant) -> Tuning:
    """What tuning has to know of a vehicle's kind."""
    return TUNINGS[plant.family.kind]


def _law(proportional: float, integral: float, derivative: float = 0.0, **settings: float) -> dict[str, float]:
    """Settings of a Pid; a derivative of the other sign is left out."""
    law = {"proportional": proportional, "integral": integral}
    if derivative * proportional > 0.0:
        law["derivative"] = derivative
    return {**law, **settings}


def _scales(loop: str, span: float, proportional: float, derivative: float) -> tuple[float, float]:
    """Scales of error and rate with which a small error moves the command as these gains do."""
    k1, k2, _ = TABLE_4[loop]
    return 0.5 * span * k1 / abs(proportional), 0.5 * span * k2 / abs(derivative)


def _all_rounded(gains: Gains) -> Gains:
    loops = {
        kind: {
            loop: {key: _rounded(value) for key, value in law.items() if value != 0.0 or key == "filter_time"}
            for loop, law in of_kind.items()
        }
        for kind, of_kind in gains.loops.items()
    }
    return replace(gains, loops=loops)


def _rounded(value: float) -> float:
    """To four digits: more say nothing, and differ between machines."""
    return float(f"{value:.4g}")


def _reached_table(reached: Sequence[Reached]) -> Table:
    """What the loops reach, in m, deg and m/s."""
    shown = table("", "vehicle!", "dt, s>", "kind!", "channel!", "step>", "settled, s>", "beyond>", "swing>")
    for row in reached:
        step, *others = shown_values(row.channel, np.array([row.step, row.overshoot, row.swing])).tolist()
        settled = f"{row.settling_time:.1f}" if row.settling_time < inf else "never"
        label = row.channel.replace("_rad", "_deg")
        shown.add_row(
            row.vehicle, f"{row.dt:g}", row.kind, label, f"{step:.2f}", settled, *(f"{value:.2f}" for value in others)
        )
    return shown


if __name__ == "__main__":
    sys.exit(main())
