"""C(v)v + D(v)v of a torpedo's hull along measured runs: the training data of its machine.

In M dv/dt = known forces - C(v)v - D(v)v, the plant gives weight, buoyancy, fins, propulsion and effects, so v minus
the integral of inv(M) times these is as smooth as the motion: a switched fin, which no smoother could follow through
noise, is in the integral.  The slope of this difference, times -M, gives the forces.  Roll and pitch are treated alike,
with the rates of turn as their known part.
The remainder becomes smoother still, and easier to tell from noise, if lift and damping, proportional to |u| times each
velocity, are fitted to the forces found and added to the known part; other forces stay in the slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, sqrt
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from auv_gym.compiled import bind
from auv_gym.physics.frames import compiled_euler_rates, quaternion_of
from auv_gym.plant import Plant
from auv_gym.plant.rollout import scratch_for
from auv_gym.records.record import Record, records_of
from auv_gym.vehicles import Family
from auv_gym.vehicles.body.learned_hull import VELOCITIES, LearnedHull, trend_terms
from identification.kernel_machines.hull.smoothing import Smoothness, smoothed, smoothness_of
from identification.linear.regressors import Series

READINGS = (*VELOCITIES, "roll_rad", "pitch_rad")
SPLINE = 5  # degree of the curves through smoothed samples
FEWEST = 20  # samples of a segment
ENDS = 3  # least number of samples at either end of a segment, where slopes are one-sided
STEEPEST = 1.5  # rad; Euler angles end at 1.57
PASSES, SETTLED = 8, 0.01  # most passes; relative change of the forces at which they end
_NODE = 0.5 - sqrt(3.0) / 6.0  # two-point Gauss rule: its nodes lie inside a step, where no actuator switches
_INNER = np.array([[0.25, 0.25 - sqrt(3.0) / 6.0], [0.25 + sqrt(3.0) / 6.0, 0.25]])  # integrals up to the nodes
_LONG = 1e6  # s, after which an actuator has reached its command


@dataclass(frozen=True, eq=False)
class HullTargets:
    """Samples of the forces on a hull, at velocities without their noise.

    velocities: (n, 6), u v w p q r, m/s and rad/s.  forces: (n, 6), C(v)v + D(v)v, N and N m.  time: (n,), s since the
    segment began.  segment: (n,), counted over all records.  noise: (8,), estimated standard deviation of READINGS.
    ends: samples left out at either end of every segment.
    """

    velocities: np.ndarray
    forces: np.ndarray
    time: np.ndarray
    segment: np.ndarray
    noise: np.ndarray
    ends: int

    def __len__(self) -> int:
        return len(self.time)


def hull_targets(plant: Plant, records: Sequence[Record]) -> HullTargets:
    """The forces on the hull of a plant along its records, whatever its own hull gives; raises if they are unsuitable.

    records: READINGS, the commands, and heading and depth if the plant's effects depend on them; velocities through the
    water, evenly sampled.  The actuators are at their commands when a segment begins.
    """
    _check_plant(plant)
    runs = _runs(plant, records)
    bare = replace(plant, learned=LearnedHull.silent())
    mass = np.array(bare.family.view(bare.derived).computed.mass)
    curves, found = _smoothed(runs)
    ends = ENDS
    law = np.zeros((_features(np.zeros((1, 6))).shape[1], 6))
    forces = np.zeros((0, 6))
    for number in range(PASSES):
        for run, curve in zip(runs, curves, strict=True):
            run.integrate(bare, curve, np.linalg.solve(mass, law.T).T)
        curves, found = _smoothed(runs)
        if number == 1:  # first pass with known forces: noise can be told from them without the law
            ends = max(ENDS, ceil(max(s.width for s in found[:6])))
            if not any(run.time.size > 2 * ends for run in runs):
                raise ValueError(
                    f"The records are too noisy for segments as short as {max(r.time.size for r in runs)} samples: "
                    f"{ends} at either end would be left out. Use longer segments."
                )
        before = forces
        velocities = np.concatenate([run.inside(run.states(curve), ends) for run, curve in zip(runs, curves)])[:, :6]
        slopes = np.concatenate([run.inside(curve(run.time, 1), ends) for run, curve in zip(runs, curves)])[:, :6]
        forces = _features(velocities) @ law - slopes @ mass.T
        if number < 1:
            continue
        if number > 1 and np.all(np.std(forces - before, axis=0) <= SETTLED * np.std(forces, axis=0)):
            break
        if number + 1 < PASSES:
            law = np.linalg.lstsq(_features(velocities), forces, rcond=1e-8)[0]
    return HullTargets(
        velocities,
        forces,
        np.concatenate([run.inside(run.time, ends) for run in runs]),
        np.concatenate([run.inside(np.full(run.time.size, number), ends) for number, run in enumerate(runs)]),
        np.array([smoothness.noise for smoothness in found]),
        ends,
    )


@dataclass(eq=False)
class _Run:
    """One segment: readings (n, 8) at times (n,), and the known motion between them.

    nodes: (m,) times of the Gauss rule.  actuators: (m, 4), heading and depth: (m,), there.
    known, known_at_nodes: integral of the known rates, (n, 8) and (m, 8).
    """

    time: np.ndarray
    readings: np.ndarray
    pieces: int
    nodes: np.ndarray
    actuators: np.ndarray
    inputs: np.ndarray
    heading: np.ndarray
    depth: np.ndarray
    known: np.ndarray
    known_at_nodes: np.ndarray

    def states(self, curve: BSpline) -> np.ndarray:
        """Readings without noise, (n, 8)."""
        return curve(self.time) + self.known

    def integrate(self, bare: Plant, curve: BSpline, law: np.ndarray) -> None:
        """Renew the known integral along the states of a curve; law: rates of the velocities per feature, to remove."""
        states = curve(self.nodes) + self.known_at_nodes
        steepest = float(np.abs(states[:, 7]).max())
        if steepest > STEEPEST:
            raise ValueError(
                f"The forces on a hull need pitch within {np.degrees(STEEPEST):.0f} deg, where roll and heading have a "
                f"meaning, got {np.degrees(steepest):.0f} deg: leave that part of the record out."
            )
        rates = np.empty((self.nodes.size, 8))
        scratch = np.empty(bare.family.scratch)
        known_rates(bare.family)(
            states, self.actuators, self.inputs, self.heading, self.depth, bare.derived, scratch, rates
        )
        rates[:, :6] -= _features(states[:, :6]) @ law
        step = (self.time[1] - self.time[0]) / self.pieces
        pairs = rates.reshape(-1, 2, 8)
        total = np.concatenate([np.zeros((1, 8)), np.cumsum(0.5 * step * pairs.sum(axis=1), axis=0)])
        self.known = total[:: self.pieces]
        inner = step * np.einsum("ij,njc->nic", _INNER, pairs)
        self.known_at_nodes = (total[:-1, None] + inner).reshape(-1, 8)

    def inside(self, rows: np.ndarray, ends: int) -> np.ndarray:
        """The rows of samples without those near an end."""
        return rows[ends : max(len(rows) - ends, ends)]


def _smoothed(runs: Sequence[_Run]) -> tuple[list[BSpline], list[Smoothness]]:
    """Noise-free curves through the readings minus the known part, and the estimated smoothness of each channel."""
    rests = [run.readings - run.known for run in runs]
    found = [smoothness_of([rest[:, c] for rest in rests]) for c in range(len(READINGS))]
    columns = [np.column_stack([smoothed(rest[:, c], s) for c, s in enumerate(found)]) for rest in rests]
    return [make_interp_spline(run.time, rest, k=SPLINE) for run, rest in zip(runs, columns, strict=True)], found


def _features(velocities: np.ndarray) -> np.ndarray:
    """Terms of the law that supports the smoothing, (n, 7)."""
    return np.column_stack([np.ones(len(velocities)), trend_terms(velocities)])


view: Any  # names that `bind` fills in the template below
derivative: Any


@lru_cache
def known_rates(family: Family) -> Any:
    """The compiled rates of u v w p q r roll pitch, (n, 8), of a family at states (n, 8)."""
    return bind(_known_rates, family.program, view=family.view, derivative=family.hooks.derivative)


def _known_rates(states, actuators, inputs, heading, depth, derived, scratch, rates):
    p = view(derived)
    z, dz = np.zeros(14), np.empty(14)
    for i in range(states.shape[0]):
        for k in range(6):
            z[k] = states[i, k]
        roll, pitch, q, r = states[i, 6], states[i, 7], states[i, 4], states[i, 5]
        z[8] = depth[i]
        z[9], z[10], z[11], z[12] = quaternion_of(roll, pitch, heading[i])
        derivative(z, actuators[i], inputs[i], p, dz, scratch)
        for k in range(6):
            rates[i, k] = dz[k]
        rates[i, 6], rates[i, 7], _ = compiled_euler_rates(states[i, 3], q, r, roll, pitch)


def _check_plant(plant: Plant) -> None:
    if plant.family.body is None:
        raise ValueError(
            f"The forces on a hull need a vehicle in six degrees of freedom, got {plant.name!r} of family "
            f"{plant.family.name!r}."
        )
    if plant.family.view(plant.derived).computed.has_moving_water != 0.0:
        raise ValueError(
            f"The forces on a hull need water that is still or flows steadily, got {plant.name!r} with waves or shear: "
            "set effects.waves and the shear of effects.current to zero."
        )


def _runs(plant: Plant, records: Sequence[Record]) -> list[_Run]:
    records = records_of("HullLsSvm.fit", records)
    optional = [name for name in plant.inputs if name in plant.constants]
    if len({tuple(record.has(name) for name in optional) for record in records}) > 1:
        raise ValueError(f"The records must have {', '.join(optional)} all or none: leave it out with record.without.")
    commanded = [name for name in plant.inputs if name not in optional or records[0].has(name)]
    computed = plant.family.view(plant.derived).computed
    turns = computed.has_environment != 0.0 or computed.has_tether != 0.0
    others = ("heading_rad", "depth_m") if turns else ()
    series = Series.of(records, commanded, (*READINGS, *others), "The hull's forces")
    shortest = min(len(part) for part in series.y)
    if shortest < FEWEST:
        raise ValueError(
            f"The forces on a hull need segments of at least {FEWEST} samples, got one of {shortest}: leave it out."
        )
    pieces = ceil(series.dt / plant.longest_step - 1e-9)
    runs = []
    for commands, measured in zip(series.u, series.y, strict=True):
        inputs = np.empty((len(commands), len(plant.inputs)))
        for column, name in enumerate(plant.inputs):
            inputs[:, column] = commands[:, commanded.index(name)] if name in commanded else plant.constants[name]
        time = series.dt * np.arange(len(commands))
        starts = (time[:-1, None] + series.dt / pieces * np.arange(pieces)).ravel()
        nodes = (starts[:, None] + series.dt / pieces * np.array([_NODE, 1.0 - _NODE])).ravel()
        heading, depth = (np.interp(nodes, time, column) for column in (measured[:, 8:] if turns else _zeros(time)).T)
        still = np.zeros((time.size, 8)), np.zeros((nodes.size, 8))
        actuators = _positions(plant, inputs, series.dt, pieces)
        held = np.repeat(inputs[:-1], 2 * pieces, axis=0)
        runs.append(_Run(time, measured[:, :8], pieces, nodes, actuators, held, heading, depth, *still))
    return runs


def _zeros(time: np.ndarray) -> np.ndarray:
    return np.zeros((time.size, 2))


def _positions(plant: Plant, inputs: np.ndarray, dt: float, pieces: int) -> np.ndarray:
    """Positions of the actuators at the nodes of every sample but the last, ((n - 1) 2 pieces, 4).

    The plant's own step moves them from node to node, and moves nothing else.
    """
    step = dt / pieces
    legs = step * np.array([_NODE, *[1.0 - 2.0 * _NODE, 2.0 * _NODE] * pieces])
    legs[-1] = step * _NODE
    fine = replace(plant, dt=float(legs.min()))  # so that the state keeps enough commands for every dead time
    at, work = len(plant.family.states), scratch_for(plant.family)
    x, count = np.zeros(len(fine.states)), len(plant.family.actuators)
    x[at : at + count] = x[at + count : at + 2 * count] = inputs[0][:count]
    begins = np.concatenate([_LONG * np.arange(1.0 - fine.history, 0.0), _starts(legs, len(inputs) - 1)])
    for _ in range(fine.history):
        fine.programs.step(
            x, inputs[0], np.append(_LONG * np.arange(1.0 - fine.history, 1.0), _LONG), 0.0, fine.derived, work
        )
    ages, found, call = np.empty(fine.history + 1), np.empty((len(inputs) - 1, legs.size, count)), 0
    for k in range(len(inputs) - 1):
        for leg, duration in enumerate(legs):
            ages[:-1] = begins[call : call + fine.history] - begins[call + fine.history - 1]
            ages[-1] = duration
            fine.programs.step(x, inputs[k], ages, 0.0, fine.derived, work)
            found[k, leg] = x[at : at + count]
            call += 1
    return np.ascontiguousarray(found[:, :-1].reshape(-1, count))


def _starts(legs: np.ndarray, samples: int) -> np.ndarray:
    """Times at which the legs of all samples begin."""
    within = np.concatenate([[0.0], np.cumsum(legs[:-1])])
    return (legs.sum() * np.arange(samples)[:, None] + within).ravel()
