"""A torpedo on a mission, by independent code: no compiled physics, and no effects or controllers of the project.

Newton and Euler in body axes about the origin, Euler angles, RK4 at 50 Hz.  Loops of a few lines follow legs and depths
by the sensors' readings, ten times a second.  Gusts push the vehicle, accelerations that decay in seconds, and a swell:
on each axis an oscillator driven by white noise.  Sensors as on such vehicles: a Doppler log at half the rate with
blank samples in between, and sometimes longer gaps; a compass noisier than the inclinometers; depth to a centimetre.
In some logs the compass wanders, and the loops follow it; in some the Doppler log oscillates with waves that move
nothing else.
"""

from __future__ import annotations

from functools import partial
from math import cos, exp, pi, sin, sqrt

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.cruise import find_cruise
from auv_gym.records.record import Record
from scripts.blind.own_forces import Hull, stepped
from scripts.blind.own_rov import logged, rates

STEP, EVERY = 0.02, 5  # s, and steps to a sample
TILT, HEADING, RATE, SPEED, DEPTH = 0.15 * pi / 180.0, 0.4 * pi / 180.0, 0.2 * pi / 180.0, 0.02, 0.01
WANDERING = 30.0  # s, correlation time of the compass's lasting errors
SWINGING = 5.0  # s, period of those of a Doppler log; they stay in phase for as long as the swell
BLANK = 0.02  # share of the Doppler log's readings that are lost
PUSHES = np.array([0.02, 0.02, 0.02, 0.02, 0.01, 0.01])  # m/s^2 and rad/s^2, RMS of gusts and swell of strength 1
LASTING, PERIOD, DAMPING = 3.0, 6.0, 0.05  # s, the gusts' correlation time; s, the swell's period, and its damping


def cruised(
    plant: Plant,
    rng: np.random.Generator,
    duration: float = 300.0,
    push: float = 0.5,
    swell: float = 0.5,
    wander: float = 0.0,
    swing: float = 0.0,
) -> Record:
    """A log of a torpedo at 10 Hz; push, swell: strength of gusts and swell, over `PUSHES`.

    wander, swing: RMS of the lasting errors of compass, rad, and Doppler log, m/s.
    Simulated effects: `effects.current`, `effects.load.net_buoyancy`, of the fins `offset`, `lost` and `lag`,
    `effects.gyros.bias_r` and `effects.dvl_ground.misalignment`.  Raises ValueError if the run ends early.
    """
    own, parts = plant.effects, plant.parts
    flows, hull = np.array([own.current.north, own.current.east, 0.0]), Hull.of(plant)
    fins = [(parts.rudder, own.rudder), (parts.stern_plane, own.stern_plane)]
    lags = np.array([*(part.lag + effect.lag for part, effect in fins), parts.propeller.lag])
    keeps, fades = np.exp(-STEP / np.maximum(lags, 1e-9)), exp(-STEP / LASTING)
    offsets, left = np.array([e.offset for _, e in fins]), np.array([*(1.0 - e.lost for _, e in fins), 1.0])
    mass, omega = np.linalg.inv(hull.inverse), 2.0 * pi / PERIOD
    x, gust, wave, rows = np.zeros(12), np.zeros(6), np.zeros((2, 6)), []
    x[2], x[6:9] = 8.0, find_cruise(plant).state[:3]
    compass, doppler = wander * rng.standard_normal() if wander else 0.0, np.zeros((2, 3))
    loops, held = Loops(plant, rng, x[2]), np.array([0.0, 0.0, parts.propeller.design])
    command = held
    for k in range(int(duration / STEP)):
        if k % EVERY == 0:
            seen = _read(plant, x, k // EVERY, rng, compass, swing * doppler[0])
            command = loops.act(k * STEP, seen[1], seen[2], seen[-1])
            rows.append([k * STEP, *seen, *command])
        told = command.copy()
        told[:2] = np.clip(told[:2] + offsets, -loops.limits, loops.limits)  # fins stop at their limits
        held = told + keeps * (held - told)
        gust = fades * gust + sqrt(1.0 - fades * fades) * rng.standard_normal(6)
        wave = _swung(wave, omega, rng)
        pushed = mass @ (PUSHES * (push * gust + swell * wave[0]))
        if wander:
            compass += -STEP / WANDERING * compass + wander * sqrt(2.0 * STEP / WANDERING) * rng.standard_normal()
        if swing:
            doppler = _swung(doppler, 2.0 * pi / SWINGING, rng)
        x = stepped(partial(_rates, hull, flows, own.load.net_buoyancy, pushed, held * left), x, STEP)
        if not (abs(x[4]) < 1.2 and x[2] > 0.0):
            raise ValueError(f"The run of {plant.name} was cut short after {k * STEP:.0f} s: lower push or swell.")
    return logged(plant, rows, plant.inputs)


def _swung(wave: np.ndarray, omega: float, rng: np.random.Generator) -> np.ndarray:
    """Oscillators driven by white noise, one step later: values of deviation 1 and their rates, (2, n)."""
    kick = sqrt(4.0 * DAMPING * omega**3 * STEP) * rng.standard_normal(wave.shape[1])
    rate = wave[1] + kick - STEP * (2.0 * DAMPING * omega * wave[1] + omega**2 * wave[0])
    return np.array([wave[0] + STEP * rate, rate])


def _rates(
    hull: Hull, current: np.ndarray, up: float, pushed: np.ndarray, fins: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """dx/dt; up: net buoyancy, N.  pushed: a wrench.  State: see `scripts.blind.own_rov.rates`."""
    roll, pitch = x[3:5].tolist()
    lifted = np.array([sin(pitch), -cos(pitch) * sin(roll), -cos(pitch) * cos(roll), 0.0, 0.0, 0.0])
    return rates(hull, current, x, pushed + up * lifted, fins)


class Loops:
    """Random targets for leg and depth, and loops that follow them by noisy readings."""

    def __init__(self, plant: Plant, rng: np.random.Generator, depth: float):
        rudder, plane, self._usual = plant.parts.rudder, plant.parts.stern_plane, plant.parts.propeller.design
        self._rng, self._leg, self._level, self._heading, self._depth = rng, 0.0, 0.0, 0.0, depth
        self._sides, self.limits = np.sign([rudder.moment, plane.moment]), np.array([rudder.limit, plane.limit])
        self._speed, self._sums, self._turns, self._before = self._usual, np.zeros(2), np.zeros(2), np.zeros(2)

    def act(self, time: float, pitch: float, heading: float, depth: float) -> np.ndarray:
        """Rudder, stern plane, rad, and the propulsion's command."""
        rng, step = self._rng, STEP * EVERY
        if time >= self._leg:
            self._leg = time + rng.uniform(25.0, 70.0)
            self._heading += rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.6)
            if rng.random() < 0.4:
                self._speed = self._usual * rng.uniform(0.75, 1.15)
        if time >= self._level:
            self._level = time + rng.uniform(40.0, 90.0)
            self._depth = float(np.clip(self._depth + rng.uniform(-4.0, 4.0), 4.0, 20.0))
        now = np.array([heading, pitch])
        if time > 0.0:
            self._turns += 0.3 * (_wrapped(now - self._before) / step - self._turns)
        self._before = now
        wanted = float(np.clip(-0.12 * (self._depth - depth), -0.3, 0.3))
        errors = np.array([float(_wrapped(self._heading - heading)), wanted - pitch])
        self._sums = np.clip(self._sums + step * np.array([0.02, 0.06]) * np.clip(errors, -0.3, 0.3), -0.2, 0.2)
        told = self._sides * (np.array([0.8, 0.9]) * errors - np.array([1.2, 1.0]) * self._turns + self._sums)
        return np.r_[np.round(np.clip(told, -self.limits, self.limits), 4), round(self._speed, 3)]


def _wrapped(angle):
    return (angle + pi) % (2.0 * pi) - pi


def _read(
    plant: Plant, x: np.ndarray, row: int, rng: np.random.Generator, compass: float, doppler: np.ndarray
) -> list[float]:
    """Attitude, rates, speeds over ground and depth, as measured; compass, doppler: lasting errors."""
    angles = x[3:6] + np.array([TILT, TILT, HEADING]) * rng.standard_normal(3)
    angles[2] = _wrapped(angles[2] + compass)
    spins = x[9:12] + RATE * rng.standard_normal(3) + [0.0, 0.0, plant.effects.gyros.bias_r]
    turn, (u, v, w) = plant.effects.dvl_ground.misalignment, x[6:9]
    speeds = np.array([cos(turn) * u + sin(turn) * v, cos(turn) * v - sin(turn) * u, w])
    speeds += SPEED * rng.standard_normal(3) + doppler
    if row % 2 or rng.random() < BLANK:
        speeds[:] = np.nan
    depth = round(float(x[2] + DEPTH * rng.standard_normal()), 2)
    return [*np.round(angles, 4), *np.round(spins, 4), *np.round(speeds, 3), depth]
