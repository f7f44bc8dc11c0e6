"""A vehicle with thrusters, driven by hand, by independent code: no compiled physics, and no effects of the project.

Newton and Euler in body axes about the origin, Euler angles, RK4 at 100 Hz; thrust by the vehicle's table of commands
after a lag of these.  A pilot moves two sticks and asks for depths and headings, which loops of a few lines hold.
Sensors as on such vehicles: a Doppler log at half the rate with blank samples in between, and sometimes longer gaps; a
compass noisier than the inclinometers, so that attitudes err about the vertical and about level axes; depth to a
centimetre.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import cos, exp, pi, sin, sqrt

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.thrusters import command_of_thrust, find_thrusters
from auv_gym.records.record import Record
from scripts.blind.own_forces import Hull, angle_rates, cross, skew, stepped, turned

STEP, EVERY = 0.01, 10  # s, and steps to a sample
TILT, HEADING, RATE, SPEED, DEPTH = 0.3 * pi / 180.0, 0.8 * pi / 180.0, 0.3 * pi / 180.0, 0.02, 0.01
BLANK = 0.03  # share of the Doppler log's readings that are lost
PUSHES = np.array([2.0, 2.0, 2.0, 0.1, 0.1, 0.15])  # N and N m, RMS of random pushes of strength 1
LASTING = 1.5  # s, their correlation time


def rates(
    hull: Hull, current: np.ndarray, x: np.ndarray, wrench: np.ndarray, fins: np.ndarray | None = None
) -> np.ndarray:
    """dx/dt of a vehicle under a wrench, N and N m, in water that flows, m/s to the north, east and down.

    State: [north east depth | roll pitch heading | u v w p q r], the velocities over ground.  fins: see `Hull.force`.
    """
    turn, spin = turned(x[3:6]), x[9:12]
    flow = turn.T @ current
    through = x[6:12].copy()
    through[:3] -= flow
    water = hull.water(through, x[3:6]) if fins is None else hull.force(through, x[3:6], fins, 1.0)
    moving = hull.inverse @ (wrench + water)
    moving[:3] -= cross(spin, flow)
    return np.concatenate([turn @ x[6:9], angle_rates(x[3:6], spin), moving])


def driven(plant: Plant, rng: np.random.Generator, duration: float = 300.0, push: float = 0.3) -> Record:
    """A log of a vehicle at 10 Hz; push: strength of random pushes, over `PUSHES`.

    Simulated effects: `effects.current`, of a thruster `lost` and `lag`, `effects.gyros.bias_p` and
    `effects.dvl_ground.misalignment`.  Raises ValueError if it comes near the vertical.
    """
    thrusters, parts, flows = find_thrusters(plant), plant.family.body.thrusters, plant.effects.current
    moved = partial(rates, Hull.of(plant), np.array([flows.north, flows.east, 0.0]))
    lost = np.array([getattr(plant.effects, part.name).lost for part in parts])
    lags = np.array([getattr(plant.parts, p.name).lag + getattr(plant.effects, p.name).lag for p in parts])
    half, whole = (1.0 - np.exp(-share * STEP / lags) for share in (0.5, 1.0))
    allocated, pilot = np.linalg.pinv(thrusters.wrench), Pilot(rng)
    x, held, random = np.zeros(12), np.zeros(len(parts)), np.zeros(6)
    x[2], command, rows = pilot.depth, np.zeros(len(parts)), []
    keeps = exp(-STEP / LASTING)
    for k in range(int(duration / STEP)):
        if k % EVERY == 0:
            thrusts = allocated @ pilot.wrench(k * STEP, x)
            wanted = zip(thrusts.tolist(), thrusters.curves, thrusters.idle.tolist(), strict=True)
            command = np.round(np.clip([command_of_thrust(*one) for one in wanted], -1.0, 1.0), 3)
            rows.append([k * STEP, *_read(plant, x, k // EVERY, rng), *command])
        middle, held = held + half * (command - held), held + whole * (command - held)
        thrust = [np.interp(c, curve[:, 1], curve[:, 0]) for c, curve in zip(middle, thrusters.curves, strict=True)]
        random = keeps * random + push * PUSHES * sqrt(1.0 - keeps * keeps) * rng.standard_normal(6)
        wrench = thrusters.wrench @ ((1.0 - lost) * thrust) + random
        x = stepped(partial(moved, wrench=wrench), x, STEP)
        if not abs(x[4]) < 1.4:
            raise ValueError(f"The run of {plant.name} came near the vertical after {k * STEP:.0f} s.")
    return logged(plant, rows, thrusters.channels)


def logged(plant: Plant, rows: Sequence[Sequence[float]], commands: Sequence[str]) -> Record:
    """A record of rows with time, attitude, rates, speeds over ground, depth and commands."""
    names = (
        "time_s", "roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps",
        "u_dvl_mps", "v_dvl_mps", "w_dvl_mps", "depth_m", *commands,
    )  # fmt: skip
    columns = dict(zip(names, np.array(rows).T, strict=True))
    attrs = {"source": "simulated", "vehicle": plant.name}
    return Record.from_arrays(columns.pop("time_s"), columns, attrs=attrs)


class Pilot:
    """Sticks that change every few seconds, and loops that hold a depth, a heading and a level attitude."""

    def __init__(self, rng: np.random.Generator):
        self._rng, self._next, self._stick = rng, 0.0, np.zeros(2)
        self.depth, self._heading, self._sums = 5.0, 0.0, np.zeros(2)

    def wrench(self, time: float, x: np.ndarray) -> np.ndarray:
        """The demand on the thrusters, N and N m."""
        rng = self._rng
        if time >= self._next:
            self._next = time + rng.uniform(3.0, 9.0)
            self._stick = rng.uniform(-25.0, 25.0, 2) * (rng.random(2) < 0.7)
            if rng.random() < 0.5:
                self._heading += rng.uniform(-1.5, 1.5)
            if rng.random() < 0.4:
                self.depth = float(np.clip(self.depth + rng.uniform(-1.5, 1.5), 2.0, 10.0))
        off = np.array([self.depth - x[2], (self._heading - x[5] + pi) % (2.0 * pi) - pi])
        most = np.array([20.0, 3.0])
        self._sums = np.clip(self._sums + STEP * EVERY * np.array([4.0, 0.5]) * off, -most, most)
        heave = np.clip(40.0 * off[0] - 30.0 * x[8] + self._sums[0], -50.0, 50.0)
        yaw = np.clip(6.0 * off[1] - 2.0 * x[11] + self._sums[1], -8.0, 8.0)
        return np.array([*self._stick, heave, -x[3] - 0.5 * x[9], -x[4] - 0.5 * x[10], yaw])


def _read(plant: Plant, x: np.ndarray, row: int, rng: np.random.Generator) -> list[float]:
    """Attitude, rates, speeds over ground and depth, as measured."""
    level = np.array([TILT, TILT, HEADING]) * rng.standard_normal(3)
    c, s = cos(x[5]), sin(x[5])
    seen = _of_vector(np.array([c * level[0] - s * level[1], s * level[0] + c * level[1], level[2]]))
    angles = _angles(seen @ turned(x[3:6]))
    rates = x[9:12] + RATE * rng.standard_normal(3) + [plant.effects.gyros.bias_p, 0.0, 0.0]
    turn = plant.effects.dvl_ground.misalignment
    u, v, w = x[6:9]
    speeds = np.array([cos(turn) * u + sin(turn) * v, cos(turn) * v - sin(turn) * u, w])
    speeds += SPEED * rng.standard_normal(3)
    if row % 2 or rng.random() < BLANK:
        speeds[:] = np.nan
    return [*angles, *rates, *speeds, float(np.round(x[2] + DEPTH * rng.standard_normal(), 2))]


def _of_vector(v: np.ndarray) -> np.ndarray:
    """The rotation about a small vector, to second order."""
    k = skew(*v.tolist())
    return np.eye(3) + k + 0.5 * k @ k


def _angles(turn: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch and heading of a rotation."""
    return (
        float(np.arctan2(turn[2, 1], turn[2, 2])),
        float(-np.arcsin(np.clip(turn[2, 0], -1.0, 1.0))),
        float(np.arctan2(turn[1, 0], turn[0, 0])),
    )
