"""A torpedo's manoeuvres by independent code, with causes outside the library.

Euler angles, its own RK4 step, no compiled physics and no effects; autopilot and manoeuvres are the project's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits, find_cruise
from auv_gym.records.record import Record
from controllers.autopilots import autopilot
from controllers.composed.excited import Excited
from identification.experiments.manoeuvres import draw_manoeuvres, steered
from scripts.blind.disturbances import Around, Slack, lopsided
from scripts.blind.own_forces import Hull, angle_rates, cross, stepped, turned

_SUBSTEPS = 2
SENSORS = {  # the outputs of each, in the order of a reading
    "inclinometer": ("roll_rad", "pitch_rad"),
    "compass": ("heading_rad",),
    "gyros": ("p_radps", "q_radps", "r_radps"),
    "dvl_water": ("u_mps", "v_mps", "w_mps"),
    "dvl_ground": ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"),
    "position": ("north_m", "east_m"),
    "depth": ("depth_m",),
}
FOLLOW = 20.0  # s, time constant with which a boat above follows the vehicle


def own_manoeuvres(
    plant: Plant,
    around: Around,
    rng: np.random.Generator,
    duration: float,
    excitation: float,
    noise: Mapping[str, float],
) -> Record:
    """A record like those of `steer`; noise: standard deviation by sensor.  Raises ValueError if it ends early."""
    return manoeuvred(plant, Body(Hull.of(plant), around), rng, duration, excitation, noise)


class Moving(Protocol):
    """The replacement of a torpedo in manoeuvres."""

    def start(self, states: np.ndarray) -> np.ndarray:
        """The initial state x, from the vehicle's first twelve."""

    def reading(self, x: np.ndarray, time: float) -> dict[str, float]:
        """The noise-free readings of the sensors."""

    def onward(self, x: np.ndarray, told: np.ndarray, time: float, duration: float) -> np.ndarray:
        """The state `duration` s later, the vehicle's twelve first; told: rudder, plane, propulsion."""


def manoeuvred(
    plant: Plant,
    body: Moving,
    rng: np.random.Generator,
    duration: float,
    excitation: float,
    noise: Mapping[str, float],
) -> Record:
    """A record of the replacement of a torpedo, see `own_manoeuvres`."""
    drawn = draw_manoeuvres(plant, rng, duration, excitation)
    names = steered(plant)
    limits = command_limits(plant)[[plant.inputs.index(name) for name in names]]
    controller = Excited(autopilot(plant), drawn.signals, plant.dt)
    memory, rows = controller.start(), []
    first = np.array(find_cruise(plant).state[:12])
    first[0], first[8], first[11] = drawn.start["u_mps"], drawn.start["depth_m"], drawn.start["heading_rad"]
    x = body.start(first)
    deviations = np.array([noise[sensor] for sensor, outputs in SENSORS.items() for _ in outputs])
    for k, time in enumerate(drawn.time):
        true = body.reading(x, float(time))
        seen = dict(zip(true, np.array(list(true.values())) + deviations * rng.standard_normal(len(true)), strict=True))
        wanted = {name: float(values[k]) for name, values in drawn.wanted.items()}
        command, memory = controller.act(memory, {**seen, "dt_s": plant.dt}, wanted)
        told = np.clip([command[name] for name in names], -limits, limits)
        rows.append([*seen.values(), *told, *wanted.values()])
        x = body.onward(x, told, float(time), plant.dt)
        if not np.isfinite(x).all() or abs(x[10]) > 1.4 or x[8] < 0.0:
            raise ValueError(f"The run of {plant.name} was cut short after {time:g} s: lower the disturbance.")
    columns = (*(name for outputs in SENSORS.values() for name in outputs), *names)
    targets = tuple(name.rpartition("_")[0] + "_cmd_" + name.rpartition("_")[2] for name in drawn.wanted)
    channels = dict(zip((*columns, *targets), np.array(rows).T, strict=True))
    return Record.from_arrays(drawn.time, channels, attrs={"source": "simulated", "vehicle": plant.name})


@dataclass(frozen=True, eq=False)
class Body:
    """A hull and its surroundings.

    State: [u v w p q r | north east depth | roll pitch heading | rudder, plane, propulsion | rudder command | tripped |
    boat's north and east], 19 numbers.
    """

    hull: Hull
    around: Around

    def start(self, states: np.ndarray) -> np.ndarray:
        """The initial state, with actuators that have had no command yet."""
        return np.r_[states, np.full(4, np.nan), np.zeros(3)]

    def reading(self, x: np.ndarray, time: float) -> dict[str, float]:
        """The noise-free readings of the sensors."""
        values = [x[9], x[10], x[11], *x[3:6], *x[:3], *x[:3], x[6], x[7], x[8]]
        return dict(zip((name for outputs in SENSORS.values() for name in outputs), map(float, values), strict=True))

    def onward(self, x: np.ndarray, told: np.ndarray, time: float, duration: float) -> np.ndarray:
        """The state `duration` s later."""
        x, h, target = x.copy(), duration / _SUBSTEPS, told.copy()
        if np.isnan(x[12]):  # actuators start at their commands
            x[12:15], x[15] = told, told[0]
        for k in range(_SUBSTEPS):
            t = time + k * h
            held = told[0]
            if self.around.sticking is not None:
                held = x[15] = self.around.sticking.position(x[15], held, t)
            target[0] = lopsided(held, self.around.side)
            if self.around.tripping is not None:
                x[16] = self.around.tripping.tripped(bool(x[16]), abs(x[0]))
            x = stepped(partial(self._rates, target=target), x, h)
            for i, (lag, slowness) in enumerate(self.actuators):
                if lag == 0.0 and slowness == 0.0:
                    x[12 + i] = target[i]
        return x

    @cached_property
    def actuators(self) -> list[tuple[float, float]]:
        """Lag and slowness of rudder, plane and propulsion."""
        tree = self.hull.parts
        drive = tree.propeller
        return [
            (tree.rudder.lag, tree.rudder.slowness),
            (tree.stern_plane.lag, tree.stern_plane.slowness),
            (drive.lag, drive.slowness / drive.limit),
        ]

    def _rates(self, x: np.ndarray, target: np.ndarray) -> np.ndarray:
        dx = np.zeros(x.size)
        fins = x[12:15].copy()
        for i, (lag, slowness) in enumerate(self.actuators):
            if lag == 0.0 and slowness == 0.0:
                fins[i] = target[i]
                continue
            rate = (target[i] - fins[i]) / max(lag, 1e-3)
            fastest = 1.0 / slowness if slowness > 0.0 else np.inf
            dx[12 + i] = min(max(rate, -fastest), fastest)
        nu, turn = x[:6], turned(x[9:12])
        around = self.around
        drag = 1.0 if around.tripping is None else around.tripping.factor(bool(x[16]))
        force = self.hull.force(nu, x[9:12], fins, drag)
        if around.tether is not None:
            force += self._pull(x, turn, around.tether)
            dx[17:19] = (x[6:8] - x[17:19]) / FOLLOW
        dx[:6] = self.hull.inverse @ force
        dx[6:9] = turn @ nu[:3]
        dx[9:12] = angle_rates(x[9:12], nu[3:])
        return dx

    def _pull(self, x: np.ndarray, turn: np.ndarray, tether: Slack) -> np.ndarray:
        """Force and moment of a line from the stern to a boat that follows at the surface."""
        line = np.array([x[17] - x[6], x[18] - x[7], -x[8]])
        distance = float(np.sqrt(line @ line))
        force = turn.T @ (tether.pull(distance) / max(distance, 1.0) * line)
        return np.concatenate([force, cross(np.array([-0.5 * self.hull.tree.length, 0.0, 0.0]), force)])
