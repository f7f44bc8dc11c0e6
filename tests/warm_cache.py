"""Compile what simulates and fits the presets, once, shared among the cores.

    python -m tests.warm_cache

The processes of a test run would each compile the same programs; with these in the cache a run from a bare machine
takes minutes less.  Programs that are in the cache already are only loaded.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

import gymnasium
import numpy as np
from rich.console import Console
from rich.progress import Progress

from auv_gym.envs.registration import ENVIRONMENTS
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.family import Family
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors
from scripts.frozen_rollouts import roll_out
from tests.presets import SIMULATED, UNCOMPILED


def main(argv: Sequence[str] | None = None) -> int:
    """Compile the programs of all presets, or of some."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("vehicles", nargs="*", metavar="VEHICLE", help="presets (default: one of each kind)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: one per core)")
    given = parser.parse_args(argv)
    unknown = sorted({*given.vehicles} - {*list_vehicles()})
    if unknown or given.jobs < 1:
        parser.error(
            f"--jobs needs a number from 1 up, got {given.jobs}"
            if not unknown
            else f"no preset {', '.join(unknown)}: one of {', '.join(list_vehicles())}"
        )
    names, begun = given.vehicles or one_of_each(), time.monotonic()
    console = Console(stderr=True, highlight=False)
    with (
        ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool,
        Progress(console=console, transient=True) as progress,
    ):
        bar = progress.add_task("compiling", total=len(names))
        for done in as_completed([pool.submit(warm, name) for name in names]):
            done.result()
            progress.advance(bar)
    print(f"Programs of {', '.join(names)} are in the cache ({time.monotonic() - begun:.0f} s).", file=sys.stderr)
    return 0


def one_of_each() -> list[str]:
    """A preset for each program: vehicles of the same parts share one.  What takes longest, with most states, first.

    Without programs that slow tests alone need.
    """
    found: dict[str, tuple[int, str]] = {}
    for name in sorted({*list_vehicles()} - {*UNCOMPILED}):
        family = load_vehicle(name).family
        found.setdefault(program_of(family), (-len(family.states), name))
    return [name for _, name in sorted(found.values())]


def program_of(family: Family) -> str:
    """What vehicles of the same parts share."""
    return family.program or family.kind


def warm(name: str) -> None:
    """Simulate a preset, step its environment, and filter what it did if it has an autopilot: tests fit no other."""
    gc.set_threshold(50_000, 20, 20)  # a compiler makes so many objects: at the default this is a tenth of its time
    plant = load_vehicle(name)
    record = flown(plant)
    if name in SIMULATED:
        plant.run(record, record.segments, plant.initial(np.zeros(len(plant.outputs)))[None])
        return
    step_environment(program_of(plant.family))
    if plant.family.body is not None and not plant.family.body.piloted:
        return
    problem = PredictionErrors(plant, record, record.segments)
    point = problem.point(plant.vector, problem.better_noise(problem.first_point(), 1)[0])
    problem.columns_of(point, moves_of(plant.coefficients[:1]))


def step_environment(program: str) -> None:
    """A step of the first registered environment whose vehicle has a program, alone and in a vector; or none."""
    for task in ENVIRONMENTS:
        env = gymnasium.make(task)
        if program_of(env.unwrapped.plant.family) == program:
            vector = gymnasium.make_vec(task, num_envs=2)
            for one, space in ((env, env.action_space), (vector, vector.action_space)):
                one.reset(seed=0)
                one.step(space.sample())
            return


def flown(plant: Plant) -> Record:
    """A record of a vehicle under its autopilot, with noise on its readings."""
    rollout = roll_out(plant)
    columns = dict(zip(rollout.channels, rollout.values.T, strict=True))
    rng, read = np.random.default_rng(0), {}
    for name in plant.outputs:
        values = columns[f"output {name}"]
        read[name] = values + rng.normal(size=values.size) * max(1e-3 * float(np.ptp(values)), 1e-6)
    told = {name: columns[f"input {name}"] for name in plant.inputs}
    return Record.from_arrays(plant.dt * np.arange(len(rollout.values)), {**told, **read})


if __name__ == "__main__":
    sys.exit(main())
