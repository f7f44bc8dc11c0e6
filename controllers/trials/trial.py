"""Closed-loop trials of a controller and a plant with noisy readings, for tuning and testing gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.model import check_finite
from auv_gym.plant import Plant
from auv_gym.plant.cruise import find_cruise
from controllers.controller import Controller

# standard deviations of common sensors: pressure, attitude with a magnetic compass, gyros, Doppler log, positions
NOISE = {
    "north_m": 0.03,
    "east_m": 0.03,
    "depth_m": 0.03,
    "roll_rad": 0.004,
    "pitch_rad": 0.004,
    "heading_rad": 0.009,
    "p_radps": 0.003,
    "q_radps": 0.003,
    "r_radps": 0.003,
    "u_mps": 0.02,
    "depth_rate_mps": 0.01,
}
Steps = Mapping[str, Sequence[tuple[float, float]]]


def level_flight(plant: Plant, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """A torpedo's full state in cruise at a depth, m, heading north, and the inputs that hold it there."""
    cruise = find_cruise(plant)
    x = np.zeros(len(plant.states))
    x[: cruise.state.size] = cruise.state
    x[plant.family.states.index("depth_m")] = depth
    actuators = cruise.commands[: len(plant.family.actuators)]
    sensors_at = cruise.state.size + 2 * actuators.size
    x[cruise.state.size : sensors_at] = np.tile(actuators, 2)
    x[sensors_at + len(plant.family.sensors) :] = np.tile(actuators, plant.history)
    plant.programs.settle(x, plant.derived)
    return x, cruise.commands.copy()


def at_rest(plant: Plant, outputs: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """A state with these outputs, zero otherwise, and the vehicle's inputs without a command."""
    neutral = {"piston_m": getattr(plant.hull, "piston_neutral", 0.0), **plant.constants}
    inputs = np.array([neutral.get(name, 0.0) for name in plant.inputs])
    x = plant.initial(np.array([outputs.get(name, 0.0) for name in plant.outputs]))
    return x, inputs


def run_trial(
    plant: Plant,
    controller: Controller,
    targets: Steps,
    duration: float,
    *,
    start: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator | None = None,
    noise: Mapping[str, float] = NOISE,
) -> dict[str, np.ndarray]:
    """Outputs without noise, inputs, set points, the controller's reports, and `time_s`, of a run of `duration` s.

    targets: by channel, (time s, value) steps, the first at 0.  start: a state, and the inputs for those that the
    controller does not command.  rng: draws the noise, standard deviations by channel; None: no noise.  Raises
    Diverged.
    """
    n = round(duration / plant.dt) + 1
    time = plant.dt * np.arange(n)
    wanted = {name: _held(time, steps) for name, steps in targets.items()}
    spread = np.array([noise.get(name, 0.0) for name in plant.outputs])
    errors = np.zeros((n, spread.size)) if rng is None else spread * rng.standard_normal((n, spread.size))
    column = {name: i for i, name in enumerate(plant.inputs)}
    x, u = start[0].copy(), start[1].copy()
    outputs, inputs, state = np.empty((n, spread.size)), np.empty((n, u.size)), controller.start()
    reports: dict[str, np.ndarray] = {}
    for k in range(n):
        outputs[k] = plant.output(x)
        read = dict(zip(plant.outputs, (outputs[k] + errors[k]).tolist(), strict=True))
        target = {name: float(values[k]) for name, values in wanted.items()}
        command, state = controller.act(state, {**read, "dt_s": plant.dt}, target)
        for name, value in command.items():
            if name in column:
                u[column[name]] = value
            else:
                reports.setdefault(name, np.full(n, np.nan))[k] = value
        if "elapsed_s" in column:
            u[column["elapsed_s"]] = time[k]
        inputs[k] = u
        x = plant.step(x, u)
    check_finite(plant.outputs, time, outputs)
    return {
        "time_s": time,
        **reports,
        **dict(zip(plant.outputs, outputs.T, strict=True)),
        **dict(zip(plant.inputs, inputs.T, strict=True)),
        **{set_point_of(name): values for name, values in wanted.items()},
    }


def _held(time: np.ndarray, steps: Sequence[tuple[float, float]]) -> np.ndarray:
    at, values = np.array([t for t, _ in steps]), np.array([value for _, value in steps])
    return values[np.maximum(np.searchsorted(at, time + 1e-9, side="right") - 1, 0)]
