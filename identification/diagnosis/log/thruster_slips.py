"""Slips of thrusters (one reversed, or two exchanged), and which of them a log suggests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from auv_gym.physics.frames import body_axes_of
from auv_gym.plant import Plant
from auv_gym.plant.thrusters import Thrusters, find_thrusters
from auv_gym.records.record import Record
from identification.diagnosis.log.slips import Slip

LIKELY = 3  # number of slips that are tried by fits
_SPAN = 0.2  # s, over which velocities are differenced: longer than a thruster's lag, shorter than the response
_AXES = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
_MOVED = 0.01  # of the largest wrench on an axis; above this, a thruster acts on the axis
_DOWN = np.vectorize(lambda roll, pitch: body_axes_of(0.0, 0.0, 1.0, roll, pitch, 0.0), otypes=(float, float, float))


def thruster_slips(record: Record, plant: Plant) -> Iterator[Slip]:
    """A slip for each thruster that may be reversed, and for each pair that may be exchanged."""
    if plant.family.body is None or not plant.family.body.thrusters:
        return
    thrusters = find_thrusters(plant)
    moved = [n for n, name in enumerate(thrusters.channels) if record.has(name) and np.ptp(record[name]) > 0.0]
    for n in moved:
        name, idle = thrusters.channels[n], float(thrusters.idle[n])
        text = f"{name} acts with the opposite sign: its thruster pushes the other way"
        about = f"turn {name} round about {idle:g}" if idle else f"change the sign of {name}"
        mend = f"{about}, or check the wiring and the propeller of the thruster"
        yield Slip(text, mend, (name,), (-1.0,), offset=2.0 * idle, acts_on=_acts_on(thrusters, record, (n,)))
    for pair in combinations(moved, 2):
        one, other = (thrusters.channels[n] for n in pair)
        if np.array_equal(record[one], record[other]) or np.allclose(
            thrusters.wrench[:, pair[0]], thrusters.wrench[:, pair[1]]
        ):
            continue
        text = f"{one} and {other} look exchanged"
        mend = f"exchange {one} and {other}, or check the wiring of these thrusters"
        yield Slip(text, mend, (one, other), exchanged=True, acts_on=_acts_on(thrusters, record, pair))


def _acts_on(thrusters: Thrusters, record: Record, moved: Sequence[int]) -> tuple[str, ...]:
    """The measured velocities that these thrusters change."""
    size = np.abs(thrusters.wrench)
    acts = np.any(size[:, list(moved)] > _MOVED * size.max(axis=1, keepdims=True), axis=1)
    return tuple(name for name, acting in zip(_AXES, acts, strict=True) if acting and record.has(name))


def likely_slips(slips: Sequence[Slip], record: Record, plant: Plant) -> list[Slip]:
    """The thruster slips that explain a record better than none does, by a regression; the best first.

    Each velocity's change over a short time is regressed on the accelerations that the thrusters cause by the plant's
    masses, on the velocity, its square and the attitude.  The thrusters' part has a non-negative factor of its own, so
    that a wrong thrust curve or inertia does not hide a wrong sign.
    """
    if not slips:
        return []
    thrusters = find_thrusters(plant)
    inverse = np.array(plant.family.view(plant.derived).computed.inverse_mass).reshape(6, 6)
    commands = record.matrix(thrusters.channels)
    changes = [_Change.of(record, name, k) for k, name in enumerate(_AXES) if record.has(name)]

    def left(changed: np.ndarray) -> dict[str, float]:
        pushes = np.stack([_thrusts(thrusters, n, changed[:, n]) for n in range(changed.shape[1])])
        accelerations = inverse @ thrusters.wrench @ pushes
        return {c.name: c.left(accelerations[c.axis]) for c in changes}

    declared, found = left(commands), []
    for number, slip in enumerate(slips):
        places = [thrusters.channels.index(name) for name in slip.channels]
        changed = commands.copy()
        changed[:, places] = commands[:, places[::-1]] if slip.exchanged else slip.offset - commands[:, places]
        undone = left(changed)
        ratio = [undone[n] / declared[n] for n in slip.acts_on if n in declared and declared[n] > 0.0]
        if ratio and np.mean(np.log(ratio)) < 0.0:
            found.append((float(np.sum([np.log(undone[n] / declared[n]) for n in slip.acts_on])), number, slip))
    return [slip for *_, slip in sorted(found, key=lambda item: item[:2])[:LIKELY]]


def _thrusts(thrusters: Thrusters, n: int, commands: np.ndarray) -> np.ndarray:
    """The thrusts of one thruster at commands, N."""
    thrust, at = thrusters.curves[n].T
    order = np.argsort(at, kind="stable")
    return np.interp(commands, at[order], thrust[order])


@dataclass(frozen=True, eq=False)
class _Change:
    """The change of one velocity over `_SPAN`, minus the part predicted from the velocity and the attitude.

    axis: index among the six.  basis: orthonormal columns of the predictors.  change: the remaining change, (n,).
    rows: (n, 2), the first row of each span and the row after its last.
    """

    name: str
    axis: int
    rows: np.ndarray
    basis: np.ndarray
    change: np.ndarray

    @classmethod
    def of(cls, record: Record, name: str, axis: int) -> _Change:
        span = max(round(_SPAN / record.sample_interval), 1)
        first = np.concatenate([np.arange(s.start, s.stop - span) for s in record.segments])
        rows, time, speed = np.column_stack([first, first + span]), record.time, record[name]
        columns = [speed, speed * np.abs(speed), np.ones(len(record))]
        if record.has("roll_rad") and record.has("pitch_rad"):
            columns += _DOWN(record["roll_rad"], record["pitch_rad"])
        basis = np.linalg.qr(np.column_stack([_means(column, rows) for column in columns]))[0]
        change = (speed[rows[:, 1]] - speed[rows[:, 0]]) / (time[rows[:, 1]] - time[rows[:, 0]])
        return cls(name, axis, rows, basis, change - basis @ (basis.T @ change))

    def left(self, acceleration: np.ndarray) -> float:
        """Mean squared error after fitting the thrusters' part with the best factor, m^2/s^4 or rad^2/s^4."""
        push = _means(acceleration, self.rows)
        push = push - self.basis @ (self.basis.T @ push)
        size = float(push @ push)
        factor = max(float(push @ self.change) / size, 0.0) if size > 0.0 else 0.0
        return float(np.mean((self.change - factor * push) ** 2))


def _means(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Means of values over spans of rows; the second row of each pair is not included."""
    sums = np.r_[0.0, np.cumsum(values)]
    return (sums[rows[:, 1]] - sums[rows[:, 0]]) / (rows[:, 1] - rows[:, 0])
