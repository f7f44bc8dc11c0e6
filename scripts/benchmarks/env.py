"""Speed of the environments: one, many, and their start, compared with other environments in the same run."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle, islice
from math import ceil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich.progress import Progress

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.compiled import bind
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import command_limits, find_helm
from auv_gym.plant.rollout import bind_family, scratch_for

DT, SUBSTEP = 0.1, 0.02  # s
FLOAT_DT, FLOAT_SUBSTEP = 0.7, 0.14  # s
SINGLE_STEPS = 20_000
CARTPOLES = 1024
ROV_DT = 0.05  # s
TASK, FLOAT_TASK, ROV_TASK = "auv_gym/Depth-v0", "auv_gym/FloatDepth-v0", "auv_gym/StationKeeping-v0"

WORK = 0
vehicle_step: Any
prange: Any


def _advance_all(rows, inputs, ages, longest_step, derived):
    """Advance every row of full states by one sample, on all cores, with nothing but the physics."""
    for i in prange(rows.shape[0]):
        vehicle_step(rows[i], inputs[i], ages, longest_step, derived, np.empty(WORK))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    parser.add_argument("--vehicle", default="remus100", help="torpedo preset or vehicle file (default: remus100)")
    parser.add_argument("--envs", type=int, default=4096, help="environments in the vector (default: 4096)")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of which the fastest counts (default: 5)")
    parser.add_argument("--no-start", action="store_true", help="leave out the times of a start, cold and warm")


def measure(arguments: argparse.Namespace) -> dict[str, float]:
    """Rates of the environments and of others in the same run, and the times of a first step.

    Every round runs everything once, one after the other, and each quantity's best round counts, so that all are
    measured under the same conditions.
    """
    if arguments.envs < 1 or arguments.rounds < 1:
        raise ValueError(f"--envs and --rounds need 1 or more, got {arguments.envs} and {arguments.rounds}.")
    plant = replace(load_vehicle(arguments.vehicle, dt=DT), longest_step=SUBSTEP)
    if plant.family.body is None:
        raise ValueError(f"--vehicle needs a vehicle in six degrees of freedom, got {plant.name!r}.")
    float_plant = replace(load_vehicle("qiandao_float", dt=FLOAT_DT), longest_step=FLOAT_SUBSTEP)
    rov = load_vehicle("bluerov2_heavy", dt=ROV_DT)
    substeps, float_substeps = ceil(DT / SUBSTEP - 1e-9), ceil(FLOAT_DT / FLOAT_SUBSTEP - 1e-9)
    rov_substeps = ceil(ROV_DT / rov.longest_step - 1e-9)
    runs: dict[str, tuple[Callable[[], object], int]] = {
        "single_steps_per_s": _single(gymnasium.make(TASK, vehicle=plant)),
        "vector_steps_per_s": _vector(gymnasium.make_vec(TASK, num_envs=arguments.envs, vehicle=plant)),
        "bare_kernel_steps_per_s": _bare(plant, arguments.envs),
        "float_single_steps_per_s": _single(gymnasium.make(FLOAT_TASK)),
        "float_vector_steps_per_s": _vector(
            gymnasium.make_vec(FLOAT_TASK, num_envs=arguments.envs, vehicle=float_plant)
        ),
        "rov_single_steps_per_s": _single(gymnasium.make(ROV_TASK, vehicle=rov)),
        "rov_vector_steps_per_s": _vector(gymnasium.make_vec(ROV_TASK, num_envs=arguments.envs, vehicle=rov)),
        "pendulum_steps_per_s": _single(gymnasium.make("Pendulum-v1")),
        "cartpoles_steps_per_s": _vector(
            gymnasium.make_vec("CartPole-v1", num_envs=CARTPOLES, vectorization_mode="vector_entry_point")
        ),
    }
    peer = _peer()
    if peer is not None:
        runs["python_vehicle_simulator_steps_per_s"] = peer
    rates = dict.fromkeys(runs, 0.0)
    with Progress(transient=True) as progress:
        task = progress.add_task("environments", total=arguments.rounds * len(runs) + len(runs))
        for run, _ in runs.values():  # compiles
            run()
            progress.advance(task)
        for _ in range(arguments.rounds):
            for name, (run, steps) in runs.items():
                start = time.perf_counter()
                run()
                rates[name] = max(rates[name], steps / (time.perf_counter() - start))
                progress.advance(task)
    numbers = {
        **rates,
        "single_us_per_step": 1e6 / rates["single_steps_per_s"],
        "vector_rk4_substeps_per_s": substeps * rates["vector_steps_per_s"],
        "bare_kernel_rk4_substeps_per_s": substeps * rates["bare_kernel_steps_per_s"],
        "vector_over_bare_kernel": rates["vector_steps_per_s"] / rates["bare_kernel_steps_per_s"],
        "single_over_pendulum": rates["single_steps_per_s"] / rates["pendulum_steps_per_s"],
        "float_vector_rk4_substeps_per_s": float_substeps * rates["float_vector_steps_per_s"],
        "rov_vector_rk4_substeps_per_s": rov_substeps * rates["rov_vector_steps_per_s"],
        "float_single_over_pendulum": rates["float_single_steps_per_s"] / rates["pendulum_steps_per_s"],
    }
    if peer is None:
        print(
            "PythonVehicleSimulator is not installed here (it is not on the package index): left out.", file=sys.stderr
        )
    if not arguments.no_start:
        numbers |= start_times(arguments.vehicle)
    return numbers


def start_times(vehicle: str) -> dict[str, float]:
    """Seconds from a new process to its first step: with nothing compiled, then again, then two workers at once."""
    with tempfile.TemporaryDirectory() as cache:
        cold = _Start(vehicle, cache).wait_for()
        warm = min(_Start(vehicle, cache).wait_for() for _ in range(3))
        workers = [_Start(vehicle, cache) for _ in range(2)]
        shared = max(worker.wait_for() for worker in workers)
    return {"first_step_cold_s": cold, "first_step_warm_s": warm, "first_step_two_workers_s": shared}


class _Start:
    """A process that makes and steps an environment once; `wait_for` returns its import, make and step times, s."""

    def __init__(self, vehicle: str, cache: str):
        code = (
            "import time; t = time.perf_counter()\n"
            "import gymnasium, auv_gym.envs\n"
            f"env = gymnasium.make({TASK!r}, vehicle={vehicle!r})\n"
            "env.reset(seed=0)\n"
            "env.step(env.action_space.sample())\n"
            "print(time.perf_counter() - t)"
        )
        environment = {**os.environ, "AUV_GYM_CACHE": cache, "PYTHONPATH": str(Path(__file__).parents[2])}
        self._process = subprocess.Popen(
            [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def wait_for(self) -> float:
        out, error = self._process.communicate()
        if self._process.returncode:
            raise ValueError(f"A process that makes {TASK} failed: {error.strip()}")
        return float(json.loads(out))


def _single(env: gymnasium.Env) -> tuple[Callable[[], object], int]:
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=0)

    def run() -> None:
        step, reset = env.step, env.reset
        for action in islice(cycle(actions), SINGLE_STEPS):
            _, _, terminated, truncated, _ = step(action)
            if terminated or truncated:
                reset()

    return run, SINGLE_STEPS


def _vector(envs: gymnasium.vector.VectorEnv) -> tuple[Callable[[], object], int]:
    steps = max(2_000_000 // (envs.num_envs * 40), 10)
    actions = envs.action_space.sample()
    envs.reset(seed=0)

    def run() -> None:
        for _ in range(steps):
            envs.step(actions)

    return run, steps * envs.num_envs


def _bare(plant: Plant, count: int) -> tuple[Callable[[], object], int]:
    """The compiled batch alone: the plant's own step over as many states as the vector environment has."""
    family, steps = plant.family, max(2_000_000 // (count * 40), 10)
    known = {"vehicle_step": bind_family(family).step, "WORK": scratch_for(family).size}
    program = bind(_advance_all, family.program or family.kind, parallel=True, **known)
    start = plant.initial(np.zeros(len(plant.outputs)))
    start[0] = 1.0
    rows = np.tile(start, (count, 1))
    draws = np.random.default_rng(0)
    inputs, helm = draws.uniform(-0.5, 0.5, (count, len(plant.inputs))) * command_limits(plant), find_helm(plant)
    inputs[:, helm.drive] = helm.design

    def run() -> None:
        for _ in range(steps):
            program(rows, inputs, plant.ages, plant.longest_step, plant.derived)

    return run, steps * count


def _peer() -> tuple[Callable[[], object], int] | None:
    """PythonVehicleSimulator's remus100, one Euler step of its `dynamics`, if the package is installed."""
    try:
        remus100 = importlib.import_module("python_vehicle_simulator.vehicles").remus100
    except ImportError:
        return None
    vehicle, steps = remus100(), 2000

    def run() -> None:
        eta, nu, actual = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0]), vehicle.nu.copy(), vehicle.u_actual.copy()
        command = np.array([0.05, 0.02, 1000.0])
        for _ in range(steps):
            nu, actual = vehicle.dynamics(eta, nu, actual, command, SUBSTEP)

    return run, steps
