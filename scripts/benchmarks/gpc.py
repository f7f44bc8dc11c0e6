"""Time of one predictive control step.

The plan has 30 samples with 10 moves of two planes, for the NPS AUV on its own linear form, within limits of the
planes, their rates and the pitch. The depth target steps up and down, so that limits become active. The output is the
median and the 99th percentile of the time of a whole step and of its quadratic program, the time of scipy's SLSQP for
the same programs in the same run, and the largest difference between the first moves of the two plans.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from math import radians
from time import perf_counter
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize

from auv_gym.models.linear import linearise
from auv_gym.plant import load_vehicle
from controllers.predictive.gpc import Gpc
from controllers.predictive.program import Program, solver

_HOLD = 40  # samples between steps of the target
_COMPARED = 20  # programs that the slower solver solves, too


_TIMED = {"step": "one step", "program": "its program, DAQP", "other": "its program, SLSQP"}


class Timing(NamedTuple):
    """Seconds of each step, of its program alone, and of the other solver; largest relative difference of moves."""

    step: np.ndarray
    program: np.ndarray
    other: np.ndarray
    difference: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    parser.add_argument("--steps", type=int, default=2000, help="samples of the run (default: %(default)s)")


def measure(arguments: argparse.Namespace) -> dict[str, float]:
    """Median and 99th percentile of each time, us, and the largest difference of the moves."""
    if arguments.steps < 1:
        raise ValueError(f"--steps needs 1 or more, got {arguments.steps}.")
    solver()
    timings(min(arguments.steps, 100))  # warms the caches of the processor and of numpy
    found = timings(arguments.steps)
    numbers = {}
    for name in _TIMED:
        seconds = getattr(found, name)
        numbers |= {f"{name}_us": 1e6 * np.median(seconds), f"{name}_us_99": 1e6 * np.percentile(seconds, 99)}
    return {**{name: float(value) for name, value in numbers.items()}, "difference": found.difference}


def timings(steps: int) -> Timing:
    """Timings of a run of `steps` samples in closed loop with the model itself."""
    model = linearise(load_vehicle("npsauv"), outputs=("depth_m", "pitch_rad"), dt=1.0)
    gpc = Gpc(
        model,
        weights={"depth_m": 0.4, "pitch_rad": 1.0},
        horizon=30,
        moves=10,
        input_limits=dict.fromkeys(model.inputs, (-0.349, 0.349)),
        rate_limits=dict.fromkeys(model.inputs, 0.1),
        output_limits={"pitch_rad": (-radians(5.0), radians(5.0))},
        nominal={"pitch_rad": 0.0},
    )
    program, goals = gpc.program, np.array([0.0, 0.0])
    whole, alone, other, apart = np.empty(steps), np.empty(steps), [], 0.0
    x, state = model.initial(np.zeros(2)), gpc.start()
    for k in range(steps):
        y = model.output(x)
        reading = {"depth_m": y[0], "pitch_rad": y[1], "dt_s": model.dt}
        goals[0] = 10.0 if k // _HOLD % 2 else 25.0
        begin = perf_counter()
        command, state = gpc.act(state, reading, {"depth_m": goals[0]})
        whole[k] = perf_counter() - begin
        s = np.concatenate([np.asarray(state.estimate), goals, goals])
        begin = perf_counter()
        moves = program.solve(s)
        alone[k] = perf_counter() - begin
        if k % max(steps // _COMPARED, 1) == 0 and moves is not None:
            begin = perf_counter()
            same = by_slsqp(program, s)
            other.append(perf_counter() - begin)
            apart = max(apart, float(np.abs(same[0] - moves[0]).max() / program.unit.max()))
        x = model.step(x, np.array([command[name] for name in model.inputs]))
    return Timing(whole, alone, np.array(other), apart)


def by_slsqp(program: Program, s: np.ndarray) -> np.ndarray:
    """The moves that scipy finds for a program, in the inputs' units, shape (moves, m)."""
    slope, size = program.slope @ s, program.hessian.shape[0]
    shift = program.bound_slope @ s
    upper, lower = program.upper[size:] + shift, program.lower[size:] + shift
    rows = np.vstack([program.rows, -program.rows])
    ends = np.concatenate([upper, -lower])
    result = minimize(
        lambda x: 0.5 * x @ program.hessian @ x + slope @ x,
        np.zeros(size),
        jac=lambda x: program.hessian @ x + slope,
        bounds=list(zip(program.lower[:size], program.upper[:size])),
        constraints={"type": "ineq", "fun": lambda x: ends - rows @ x, "jac": lambda x: -rows},
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
    )
    return result.x.reshape(-1, program.unit.size) * program.unit


def show(numbers: Mapping[str, float]) -> None:
    """Print the times, and the difference between the two solvers."""
    table = Table("", "median, us", "99 %, us")
    for name, words in _TIMED.items():
        table.add_row(words, f"{numbers[f'{name}_us']:.0f}", f"{numbers[f'{name}_us_99']:.0f}")
    console = Console()
    console.print(table)
    console.print(
        f"DAQP takes {100.0 * numbers['program_us'] / numbers['step_us']:.0f} % of a step and "
        f"1/{numbers['other_us'] / numbers['program_us']:.0f} of SLSQP's time; their first moves differ by at "
        f"most {numbers['difference']:.1e} of a plane's range."
    )
