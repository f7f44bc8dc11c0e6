"""How fast the compiled code is, as ratios within one run: `python -m scripts.benchmark COMMAND`.

Timings are the best of several repeats: what disturbs a run only ever makes it longer.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from math import ceil
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from auv_gym.compiled import JIT
from auv_gym.param import replace_at
from auv_gym.plant import Plant, Runs, load_vehicle
from auv_gym.records.record import Record
from scripts import benchmark_env, benchmark_identification, benchmark_kernel, benchmark_recursion, benchmark_rl

PLAIN_SAMPLES = 100
COMPILED_SAMPLES = 5000


def main(argv: Sequence[str] | None = None) -> int:
    """Run one benchmark and print its numbers, as a table or with --json as one JSON object."""
    parser = argparse.ArgumentParser(prog="benchmark", description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    rollout = commands.add_parser("rollout", help="free runs of a plant, compiled against plain Python")
    rollout.add_argument("--vehicle", default="slocum", help="glider preset or vehicle file (default: slocum)")
    rollout.add_argument("--repeats", type=_count, default=7, help="runs of which the fastest counts (default: 7)")
    rollout.add_argument("--alone", action="store_true", help="time the rollout in this process only, without a ratio")
    rollout.set_defaults(measure=_rollout)
    env = commands.add_parser("env", help="environments, one and many, beside others, and their start")
    benchmark_env.add_arguments(env)
    env.set_defaults(measure=benchmark_env.measure)
    recursion = commands.add_parser(
        "recursion", help="updates of a float's diving model, compiled against plain Python"
    )
    benchmark_recursion.add_arguments(recursion)
    recursion.set_defaults(measure=_recursion)
    identification = commands.add_parser("identification", help="linear identification, beside other packages")
    benchmark_identification.add_arguments(identification)
    identification.set_defaults(measure=benchmark_identification.measure, show=benchmark_identification.show)
    kernel = commands.add_parser("kernel", help="kernel regression, beside scikit-learn")
    benchmark_kernel.add_arguments(kernel)
    kernel.set_defaults(measure=benchmark_kernel.measure, show=benchmark_kernel.show)
    learning = commands.add_parser("rl", help="PPO in our environments, beside Gymnasium's pendulum")
    benchmark_rl.add_arguments(learning)
    learning.set_defaults(measure=benchmark_rl.measure)
    for command in commands.choices.values():
        command.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args(argv)
    try:
        numbers = arguments.measure(arguments)
    except ValueError as error:
        parser.error(str(error))
    if arguments.json:
        print(json.dumps(numbers, indent=2))
    elif "show" in arguments:
        arguments.show(numbers)
    else:
        _print(arguments.command, numbers)
    return 0


def _rollout(arguments: argparse.Namespace) -> dict[str, float]:
    """Times of a free run per RK4 step and of a step called from Python, and the ratio to plain Python."""
    plant = load_vehicle(arguments.vehicle)
    if arguments.alone:
        samples = COMPILED_SAMPLES if JIT else PLAIN_SAMPLES
        return {"rollout_ns_per_rk4_step": _ns_per_rk4_step(plant, samples, arguments.repeats)}
    plain_repeats = min(arguments.repeats, 3)
    command = ["rollout", "--alone", "--json", "--vehicle", arguments.vehicle, "--repeats", str(plain_repeats)]
    plain = _in_plain_python(command)["rollout_ns_per_rk4_step"]
    compiled = _ns_per_rk4_step(plant, COMPILED_SAMPLES, arguments.repeats)
    effects = {"effects.rudder.lag": 1.0, "effects.rudder.dead_time": 0.5 * plant.dt, "effects.compass.lag": 1.0}
    x, u = plant.initial(np.zeros(len(plant.outputs))), np.array([plant.constants.get(n, 0.1) for n in plant.inputs])
    return {
        "plain_over_compiled": plain / compiled,
        "rollout_ns_per_rk4_step": compiled,
        "rollout_with_effects_ns_per_rk4_step": _ns_per_rk4_step(
            replace_at(plant, effects), COMPILED_SAMPLES, arguments.repeats
        ),
        "plain_rollout_ns_per_rk4_step": plain,
        "step_from_python_us": _best(lambda: _steps(plant, x, u, 1000), arguments.repeats) / 1000 * 1e6,
    }


def _recursion(arguments: argparse.Namespace) -> dict[str, float]:
    """Rates of the recursions over a record and sample by sample, and the ratio to plain Python."""
    compiled = benchmark_recursion.measure(arguments)
    if arguments.alone:
        return compiled
    command = ["recursion", "--alone", "--json", "--samples", "400", "--repeats", str(min(arguments.repeats, 3))]
    plain = _in_plain_python(command)
    return {"plain_over_compiled": compiled[benchmark_recursion.RATED] / plain[benchmark_recursion.RATED], **compiled}


def _ns_per_rk4_step(plant: Plant, samples: int, repeats: int) -> float:
    k = np.arange(samples)
    columns = {"rudder_rad": 0.3 * np.sign(np.sin(0.1 * k)), "pitch_rad": 0.4 * np.sin(0.03 * k)}
    record = Record.from_arrays(plant.dt * k, columns)
    runs = Runs.over(plant, record, record.segments)
    starts = np.zeros((1, 1, len(plant.family.states)))
    vectors = plant.vector[None, :]
    seconds = _best(lambda: plant.run_many(runs, vectors, starts), repeats)
    return seconds / ((samples - 1) * ceil(plant.dt / plant.longest_step - 1e-9)) * 1e9


def _steps(plant: Plant, x: np.ndarray, u: np.ndarray, count: int) -> None:
    for _ in range(count):
        x = plant.step(x, u)


def _best(run: Callable[[], object], repeats: int) -> float:
    """Shortest time of a call, s, after one that is not counted because it may compile."""
    run()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def _in_plain_python(command: list[str]) -> dict[str, float]:
    """What this program measures in a process of its own with nothing compiled."""
    done = subprocess.run(
        [sys.executable, "-m", "scripts.benchmark", *command],
        env={**os.environ, "AUV_GYM_JIT": "0", "PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise ValueError(f"The benchmark in plain Python failed: {done.stderr.strip()}")
    return json.loads(done.stdout)


def _print(title: str, numbers: dict[str, float]) -> None:
    table = Table(title=title)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    for name, value in numbers.items():
        table.add_row(name.replace("_", " "), f"{value:,.3g}" if value < 1e3 else f"{value:,.0f}")
    Console().print(table)


def _count(text: str) -> int:
    count = int(text)
    if count < 1:
        raise ValueError
    return count


if __name__ == "__main__":
    raise SystemExit(main())
