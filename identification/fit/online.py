"""The Kalman filter of a vehicle, fed sample by sample in constant time and memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.compiled import OPEN, bind, ready
from auv_gym.physics.pushes import fade, misreads, shove
from auv_gym.plant import Plant
from auv_gym.plant.rollout import scratch_for
from identification.fit.kalman import read_row, to_next_row

# Bound for each family: its programs.
step: Any = OPEN
read: Any = OPEN


def pushed_step(x, push, inputs, ages, kicks, longest_step, derived, work):
    """Step the vehicle by one sample, in place, with pushes before and after it, see `plant.rollout.rollout`."""
    duration = ages[ages.shape[0] - 1]
    shove(x, push, kicks, 1, duration)
    step(x, inputs, ages, longest_step, derived, work)
    shove(x, push, kicks, 2, duration)


def one_sample(
    measured, moves, varies, inputs, x, push, root, ages, longest_step, derived, work,
    places, columns, angles, probes, kicks, pushed, deviations, times, turns, variances,
    fading, gains, whiten, innovations, y, room,
):  # fmt: skip
    """Step the filter by one sample, by `inputs` held since the sample before, and correct it by the readings.

    moves: False at a first sample, which is only read.  varies: whether to linearise the vehicle here for the gains (N,
    C); otherwise they are held, and the root of the covariance stays as it is.
    x: full state; push: (D,); root: (N, N), transposed.  places: (N - D,), of the live states in x.  columns: (C,) of
    the channels among the outputs; angles: (C,) bool.  pushed: (D,), indices of the live states that accelerations
    push.
    fading: growth factor of the live states' deviations at each sample.  measured: outputs, NaN where nothing is.
    innovations: (C,), of unit variance, NaN there.  y: outputs before the correction, without lasting sensor errors.
    room: work, (10 + 3 N + D + C, max(N + D, len(x), C, outputs)).
    """
    size, count = places.shape[0], columns.shape[0]
    total = size + push.shape[0]
    mean, forcing, column, gain, error = room[0, :total], room[1], room[2, :total], room[3, :total], room[4, :count]
    moved, reflector, share_of, unit = room[5], room[6], room[7, :total], room[8, :count]
    other = room[9]
    onward, wide = room[10 : 10 + total, :size], room[10 + total : 10 + 2 * total + push.shape[0], :total]
    slopes = room[10 + 3 * total : 10 + 3 * total + count, :total]
    mean[:] = 0.0
    if moves:
        duration = ages[ages.shape[0] - 1]
        if varies:
            for j in range(size):
                for i in range(x.shape[0]):
                    other[i] = x[i]
                other[places[j]] += probes[j]
                pushed_step(other[: x.shape[0]], push, inputs, ages, kicks, longest_step, derived, work)
                for i in range(size):
                    onward[j, i] = other[places[i]]
        pushed_step(x, push, inputs, ages, kicks, longest_step, derived, work)
        if varies:
            for j in range(size):
                for i in range(size):
                    onward[j, i] = (onward[j, i] - x[places[i]]) / probes[j]
            for d in range(push.shape[0]):
                for i in range(size):
                    onward[size + d, i] = duration * kicks[d, 1] * onward[pushed[d], i]
                onward[size + d, pushed[d]] += duration * kicks[d, 2]
            forcing[:] = 0.0
            for n in range(total):
                for i in range(size):
                    root[n, i] *= fading
            pushes = (forcing, duration, deviations, times, turns)
            to_next_row(root, mean, onward, *pushes, wide, moved, reflector, share_of)
        for d in range(push.shape[0]):
            other[d] = np.exp(-duration / times[d])
        fade(push, other, kicks, duration)
    read(x, derived, y)
    finite = np.empty(count, dtype=np.bool_)
    for c in range(count):
        error[c] = measured[columns[c]] - y[columns[c]]
    for d in range(push.shape[0]):
        if misreads(kicks[d]) >= 0:
            for c in range(count):
                if misreads(kicks[d]) == columns[c]:
                    error[c] -= push[d]
    for c in range(count):
        finite[c] = np.isfinite(error[c])
        if not finite[c]:
            error[c] = 0.0
        elif angles[c]:
            error[c] = (error[c] + np.pi) % (2.0 * np.pi) - np.pi
    if varies:
        slopes[:, :] = 0.0
        for j in range(size):
            before = x[places[j]]
            x[places[j]] = before + probes[j]
            read(x, derived, other)
            x[places[j]] = before
            for c in range(count):
                slopes[c, j] = (other[columns[c]] - y[columns[c]]) / probes[j]
        for d in range(push.shape[0]):
            if misreads(kicks[d]) >= 0:
                for c in range(count):
                    if misreads(kicks[d]) == columns[c]:
                        slopes[c, size + d] = 1.0
        gains[:, :] = 0.0
        whiten[:, :] = 0.0
        innovations[:] = 0.0
        unit[:] = 1.0
        read_row(root, mean, slopes, error, finite, unit, variances, column, gain, gains, whiten, innovations)
    else:
        for c in range(count):
            innovations[c] = 0.0
            for m in range(c + 1):
                innovations[c] += whiten[c, m] * error[m]
            for i in range(total):
                mean[i] += gains[i, c] * error[c]
    for c in range(count):
        if not finite[c]:
            innovations[c] = np.nan
    for i in range(size):
        x[places[i]] += mean[i]
    for d in range(push.shape[0]):
        push[d] += mean[size + d]


_BOUND: dict[str, Any] = {}


def _program(plant: Plant) -> Any:
    """The compiled filter of a family."""
    name = plant.family.program or plant.family.kind
    if name not in _BOUND:
        own = {"step": plant.programs.step, "read": plant.programs.read}
        moving = bind(pushed_step, name, inline=False, **own)
        _BOUND[name] = bind(one_sample, name, inline=False, pushed_step=moving, **own)
    return _BOUND[name]


@dataclass(frozen=True, eq=False)
class FilterPlan:
    """The settings of an online filter: a vehicle and its noises, from a fit to a log.

    live: (n,), the filtered states, among those of the family and its sensors.  shared: (n,), which of them are unknown
    constants.  first: (F,), initial values of states that no channel measures; spread: (n,), their deviations.
    memory: samples after which readings have lost their weight (Sorenson and Sacks 1971): without it, a filter without
    accelerations would rely on its model alone, whose smallest error accumulates.
    gains: (N, C) and whiten: (C, C), of a filter with steady gains; None if they are not known yet.
    """

    plant: Plant
    channels: tuple[str, ...]
    live: np.ndarray
    shared: np.ndarray
    first: np.ndarray
    spread: np.ndarray
    probes: np.ndarray
    kicks: np.ndarray
    deviations: np.ndarray
    times: np.ndarray
    variances: np.ndarray
    memory: float
    gains: np.ndarray | None = None
    whiten: np.ndarray | None = None


class OnlineFilter:
    """The filter with its state, at the latest sample.

    Its gains are those of the vehicle linearised at its state; if the plan has gains, these are held after its memory.
    innovations: (C,), of unit variance, NaN where nothing was measured, by gains (N, C) and whiten (C, C).  x: the full
    state, states: those of the family in it; inputs: the latest held ones.
    """

    def __init__(self, plan: FilterPlan):
        self.plan, self._since, self._holds, self._seen = plan, -1.0, False, 0
        plant, family, count = plan.plant, plan.plant.family, len(plan.channels)
        size, pushes = len(plan.live) + len(plan.times), len(plan.times)
        sensors_at = len(family.states) + 2 * len(family.actuators)
        self._places = np.where(plan.live < len(family.states), plan.live, sensors_at - len(family.states) + plan.live)
        self._columns = np.array([plant.outputs.index(name) for name in plan.channels])
        self._stepped = [plant.inputs.index(name) for name in family.stepped]
        self._program, self._ages = ready(_program(plant)), plant.ages.copy()
        self.x, self._push, self._root = np.zeros(len(plant.states)), np.zeros(pushes), np.zeros((size, size))
        self.states = self.x[: len(family.states)]
        self.gains, self.whiten = np.zeros((size, count)), np.zeros((count, count))
        self.innovations, self.inputs = np.zeros(count), np.zeros(len(plant.inputs))
        numbers = (
            self._places, self._columns, np.array([channel(name).angle for name in plan.channels]), plan.probes,
            np.ascontiguousarray(plan.kicks), self._pushed(plan),
            plan.deviations, plan.times, np.ascontiguousarray(plan.kicks[:, 3]), plan.variances,
            np.sqrt(1.0 + 1.0 / plan.memory),
        )  # fmt: skip
        width = max(size + pushes, len(plant.states), count, len(plant.outputs))
        room = np.zeros((10 + 3 * size + pushes + count, width))
        made = (self.gains, self.whiten, self.innovations, np.zeros(len(plant.outputs)), room)
        model = (self._ages, plant.longest_step, plant.derived, scratch_for(family))
        self._arrays = (self.inputs, self.x, self._push, self._root, *model, *numbers, *made)

    @staticmethod
    def _pushed(plan: FilterPlan) -> np.ndarray:
        """Indices of the live states that accelerations push, (D,); 0 for sensor errors, which push none."""
        return np.where(plan.kicks[:, 0] < 0.0, 0, np.searchsorted(plan.live, plan.kicks[:, 0].astype(int)))

    def begin(self, inputs: np.ndarray, measured: np.ndarray, keep: bool = False) -> None:
        """Start from the outputs of a sample, with the actuators where the inputs put them.

        keep: whether unknown constant states keep their values and precision.
        """
        plan, plant, solid = self.plan, self.plan.plant, len(self.plan.live)
        known, states = plant.initial(measured), plan.first.copy()
        for i, name in enumerate(plant.family.states):
            names = [c for c in (name, plant.family.nearly.get(name)) if c in plan.channels]
            if any(np.isfinite(measured[plant.outputs.index(c)]) for c in names):
                states[i] = known[i]
        spread, before = np.sqrt((self._root**2).sum(axis=0))[:solid], self.x[self._places]
        self.x[:] = plant.settled(states, inputs)
        self._push[:] = 0.0
        held = plan.shared & keep
        self.x[self._places[held]] = before[held]
        self._root[:] = np.diag(np.r_[np.where(held, spread, plan.spread), plan.deviations])
        self.inputs[:] = inputs
        self._since, self._holds, self._seen = self._since if keep else 0.0, False, 0
        self._program(measured, False, True, *self._arrays)

    def step(self, inputs: np.ndarray, measured: np.ndarray, duration: float) -> bool:
        """Step by one sample of `duration` s in which inputs were held; return whether its innovations count.

        measured: the outputs at its end.  Innovations within the first settling time do not count.  After a step of an
        input that moves in steps, the filter starts again, as a fit does.
        """
        if self._since < 0.0 or (self._stepped and any(inputs[i] != self.inputs[i] for i in self._stepped)):
            self.begin(inputs, measured, keep=self._since >= 0.0)
            return False
        self.inputs[:] = inputs
        self._ages[-1] = duration
        self._since += duration
        settled = self._since > self.plan.plant.settle
        self._seen += 1
        if self.plan.gains is not None and self._seen > self.plan.memory and not self._holds:
            self.gains[:], self.whiten[:], self._holds = self.plan.gains, self.plan.whiten, True
        self._program(measured, True, not self._holds, *self._arrays)
        return settled
