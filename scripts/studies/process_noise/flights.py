"""One experiment with a plant that is pushed by accelerations, steered by its controller or by given commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.model import check_finite
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from controllers.controller import Controller


@dataclass(frozen=True, eq=False)
class Experiment:
    """What is drawn before a run, so that it is the same for any disturbance of the vehicle.

    time: (n,), s, evenly spaced.  start: outputs in the first sample, others zero.  wanted: set points, (n,) by
    channel.  limits: lowest and highest command, by the input that the controller commands.  given: independent inputs,
    (n,).  from_depth: an input that follows from the true depth.  also: further logged data.
    sensors: standard deviation of white noise by measured output.  skipped: rows that are not logged, as a log begins
    in mid-mission.  exact: whether the controller gets the true outputs instead of the sensors' readings.
    """

    time: np.ndarray
    start: Mapping[str, float]
    controller: Controller
    wanted: Mapping[str, np.ndarray]
    limits: Mapping[str, tuple[float, float]]
    sensors: Mapping[str, float]
    given: Mapping[str, np.ndarray] = field(default_factory=dict)
    from_depth: Mapping[str, Callable[[float], float]] = field(default_factory=dict)
    also: Mapping[str, np.ndarray] = field(default_factory=dict)
    skipped: int = 0
    pieces: int = 1
    exact: bool = False


@dataclass(frozen=True, eq=False)
class Flight:
    """A run: the log, the sensor noise, and the true velocities, all without the skipped rows.

    commands: (all rows, commands).  noise: (rows, sensors).  pushes: (rows, axes).  states: (rows, axes), velocities.
    """

    record: Record
    commands: np.ndarray
    noise: np.ndarray
    pushes: np.ndarray
    states: np.ndarray


def fly(
    plant: Plant,
    experiment: Experiment,
    axes: tuple[str, ...],
    pushes: np.ndarray,
    normals: np.ndarray,
    commands: np.ndarray | None = None,
) -> Flight:
    """The run of a plant whose velocities `axes` are pushed by accelerations (n, axes), held over each sample.

    normals: (n, sensors), of the sensors' noise.  commands: replace the controller's.  Half of each push acts before a
    piece of the step and half after it (Strang 1968, SIAM J. Numer. Anal. 5).  Raises Diverged.
    """
    e = experiment
    dt, piece = plant.dt, plant.dt / e.pieces
    plant = replace(plant, dt=piece)
    names, time = tuple(e.limits), e.time
    inputs = np.tile([plant.constants.get(name, 0.0) for name in plant.inputs], (time.size, 1))
    for name, values in e.given.items():
        inputs[:, plant.inputs.index(name)] = values
    told = [plant.inputs.index(name) for name in names]
    low, high = np.array(list(e.limits.values())).T
    at = [plant.family.states.index(name) for name in axes]
    seen = [plant.outputs.index(name) for name in e.sensors]
    noise = normals * np.array(list(e.sensors.values()))
    exact, states = np.empty((time.size, len(seen))), np.empty((time.size, len(at)))
    x = plant.initial(np.array([e.start.get(name, 0.0) for name in plant.outputs]))
    memory = e.controller.start()
    for k in range(time.size):
        exact[k], states[k] = plant.output(x)[seen], x[at]
        for name, follow in e.from_depth.items():
            inputs[k, plant.inputs.index(name)] = follow(float(x[plant.family.states.index("depth_m")]))
        if commands is None:
            told_of = exact[k] if e.exact else exact[k] + noise[k]
            reading = dict(zip(e.sensors, told_of.tolist(), strict=True))
            target = {name: float(values[k]) for name, values in e.wanted.items()}
            command, memory = e.controller.act(memory, {**reading, "dt_s": dt}, target)
            inputs[k, told] = np.clip([command[name] for name in names], low, high)
        else:
            inputs[k, told] = commands[k]
        for _ in range(e.pieces):
            x[at] += 0.5 * piece * pushes[k]
            x = plant.step(x, inputs[k])
            x[at] += 0.5 * piece * pushes[k]
    check_finite(tuple(e.sensors), time, exact)
    kept = slice(e.skipped, None)
    logged = (*names, *e.given, *e.from_depth)
    channels = {
        **dict(zip(e.sensors, (exact + noise).T, strict=True)),
        **{name: inputs[:, plant.inputs.index(name)] for name in logged},
        **{set_point_of(name): values for name, values in e.wanted.items()},
        **e.also,
    }
    record = Record.from_arrays(
        time[kept] - time[e.skipped],
        {name: values[kept] for name, values in channels.items()},
        attrs={"source": "simulated", "vehicle": plant.name},
    )
    return Flight(record, inputs[:, told], noise[kept], pushes[kept], states[kept])
