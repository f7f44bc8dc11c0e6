"""Speed of a plant's free runs, compiled and in plain Python."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from math import ceil
from pathlib import Path

import numpy as np

from auv_gym.compiled import JIT
from auv_gym.param import replace_at
from auv_gym.plant import Plant, Runs, load_vehicle
from auv_gym.records.record import Record

PLAIN_SAMPLES, COMPILED_SAMPLES = 100, 5000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    parser.add_argument("--vehicle", default="slocum", help="glider preset or vehicle file (default: slocum)")
    parser.add_argument("--repeats", type=int, default=7, help="runs of which the fastest counts (default: 7)")
    parser.add_argument("--alone", action="store_true", help="time the rollout in this process only, without a ratio")


def measure(arguments: argparse.Namespace) -> dict[str, float]:
    """Times of a free run per RK4 step and of a step called from Python, and the ratio to plain Python."""
    if arguments.repeats < 1:
        raise ValueError(f"--repeats needs 1 or more, got {arguments.repeats}.")
    plant = load_vehicle(arguments.vehicle)
    if arguments.alone:
        samples = COMPILED_SAMPLES if JIT else PLAIN_SAMPLES
        return {"rollout_ns_per_rk4_step": _ns_per_rk4_step(plant, samples, arguments.repeats)}
    plain = in_plain_python("rollout", "--vehicle", arguments.vehicle, "--repeats", str(min(arguments.repeats, 3)))
    compiled = _ns_per_rk4_step(plant, COMPILED_SAMPLES, arguments.repeats)
    effects = {"effects.rudder.lag": 1.0, "effects.rudder.dead_time": 0.5 * plant.dt, "effects.compass.lag": 1.0}
    x, u = plant.initial(np.zeros(len(plant.outputs))), np.array([plant.constants.get(n, 0.1) for n in plant.inputs])
    return {
        "plain_over_compiled": plain["rollout_ns_per_rk4_step"] / compiled,
        "rollout_ns_per_rk4_step": compiled,
        "rollout_with_effects_ns_per_rk4_step": _ns_per_rk4_step(
            replace_at(plant, effects), COMPILED_SAMPLES, arguments.repeats
        ),
        "plain_rollout_ns_per_rk4_step": plain["rollout_ns_per_rk4_step"],
        "step_from_python_us": _shortest(lambda: _steps(plant, x, u, 1000), arguments.repeats) / 1000 * 1e6,
    }


def in_plain_python(*command: str) -> dict[str, float]:
    """The results of a command of `scripts.benchmark`, in a process of its own with nothing compiled."""
    done = subprocess.run(
        [sys.executable, "-m", "scripts.benchmark", *command, "--alone", "--json"],
        env={**os.environ, "AUV_GYM_JIT": "0", "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise ValueError(f"The benchmark in plain Python failed: {done.stderr.strip()}")
    return json.loads(done.stdout)


def _ns_per_rk4_step(plant: Plant, samples: int, repeats: int) -> float:
    k = np.arange(samples)
    columns = {"rudder_rad": 0.3 * np.sign(np.sin(0.1 * k)), "pitch_rad": 0.4 * np.sin(0.03 * k)}
    record = Record.from_arrays(plant.dt * k, columns)
    runs = Runs.over(plant, record, record.segments)
    starts = np.zeros((1, 1, len(plant.family.states)))
    vectors = plant.vector[None, :]
    seconds = _shortest(lambda: plant.run_many(runs, vectors, starts), repeats)
    return seconds / ((samples - 1) * ceil(plant.dt / plant.longest_step - 1e-9)) * 1e9


def _steps(plant: Plant, x: np.ndarray, u: np.ndarray, count: int) -> None:
    for _ in range(count):
        x = plant.step(x, u)


def _shortest(run: Callable[[], object], repeats: int) -> float:
    """Shortest time of a call, s, after a first one that is not counted because it may compile."""
    run()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return min(seconds)
