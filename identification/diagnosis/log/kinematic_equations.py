"""Kinematic equations that relate sensors to each other, integrated and linearised in each sensor effect; no forces.

Each equation says: a measured angle, position or integrated speed, minus its value computed from other sensors, equals
a constant for each block plus the sum of effects times their columns plus noise.  Source: Fossen 2021, sec. 2.2 (Euler
rates).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.physics.frames import euler_rates, velocity_ned
from auv_gym.records.attitude import ANGLES, from_angles, interpolated_angles, turns_far, unrolled
from auv_gym.records.record import Record

GROUND, WATER = ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), ("u_mps", "v_mps", "w_mps")
SPAN = 1.0  # s, over which a measured angle or depth is differenced: short beside lags, long beside noise
_POSITION = ("north_m", "east_m", "depth_m")
_CURRENT = tuple(f"effects.current.{name}" for name in ("north", "east", "down"))
_CLOCK = "effects.clock.rate"
_SHEAR = ("effects.current.shear_north", "effects.current.shear_east")  # defined from the surface down


@dataclass(frozen=True, eq=False)
class Equation:
    """One signal compared with others: their difference, and the derivative of it with respect to each effect.

    title: words, `heading against gyros`.  rest: the difference, (n,).  columns: effect path to (n,), d rest / d
    effect.
    """

    title: str
    rest: np.ndarray
    columns: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Motion:
    """Signals of a record at its samples and, averaged, at the midpoints of its intervals; missing ones are zero.

    held: inputs, which stay constant from one sample to the next.
    """

    record: Record
    held: tuple[str, ...]

    def has(self, *names: str) -> bool:
        return all(self.record.has(name) for name in names)

    def at(self, name: str) -> np.ndarray:
        return self.record[name] if self.record.has(name) else np.zeros(len(self.record))

    @cached_property
    def far(self) -> bool:
        """Whether the measured attitude turns so far that its angles cannot be averaged or differenced."""
        return self.has(*ANGLES) and turns_far(self.record["roll_rad"], self.record["pitch_rad"])

    @cached_property
    def _turned_halfway(self) -> np.ndarray:
        time = self.record.time
        return interpolated_angles(0.5 * (time[1:] + time[:-1]), time, self.record.matrix(ANGLES))

    def middle(self, name: str) -> np.ndarray:
        """The signal at the midpoints of the intervals, (n - 1,)."""
        if name in ANGLES and self.far:
            return self._turned_halfway[:, ANGLES.index(name)]
        values = self.at(name)
        return values[:-1] if name in self.held else 0.5 * (values[1:] + values[:-1])

    def integral(self, rates: np.ndarray) -> np.ndarray:
        """Running integral of rates given at the midpoints of the intervals, zero at the first sample; shape (n,)."""
        return np.r_[0.0, np.cumsum(rates * np.diff(self.record.time))]

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """Values averaged over about `SPAN`, as the slope of their running integral."""
        return self.slope(self.integral(0.5 * (values[1:] + values[:-1])))

    def slope(self, values: np.ndarray) -> np.ndarray:
        """Rate of change at the samples by central differences over about `SPAN`, shorter at the ends."""
        time, reach = self.record.time, max(round(0.5 * SPAN / self.record.sample_interval), 1)
        rows = np.arange(len(values))
        before, after = np.maximum(rows - reach, 0), np.minimum(rows + reach, len(values) - 1)
        return (values[after] - values[before]) / (time[after] - time[before])


def segment_equations(record: Record, held: Sequence[str]) -> list[Equation]:
    """The equations that the channels of one segment allow."""
    m = Motion(record, tuple(held))
    found = []
    if m.far:
        found += _turns(m)
    elif m.has("roll_rad", "pitch_rad") or m.has("heading_rad", "r_radps"):
        found += _attitude(m)
    tracks = [(names, sensor) for names, sensor in ((GROUND, "dvl_ground"), (WATER, "dvl_water")) if m.has(names[0])]
    if m.has("heading_rad"):
        for names, sensor in tracks:
            found += _track(m, names, sensor)
        if len(tracks) == 2 and m.has(*GROUND, *WATER):
            found += _ground_and_water(m)
    elif m.has("pitch_rad"):
        for names, sensor in tracks:
            found += [e for e in _track(m, names, sensor) if e.title.startswith("depth")]
    return found


def _attitude(m: Motion) -> list[Equation]:
    """Roll, pitch and heading against gyros."""
    roll, pitch = m.middle("roll_rad"), m.middle("pitch_rad")
    p, q, r = (m.middle(name) for name in ("p_radps", "q_radps", "r_radps"))
    s, c, level, t = np.sin(roll), np.cos(roll), np.cos(pitch), np.tan(pitch)
    rolling, nodding, yawing = euler_rates(p, q, r, roll, pitch)
    turning = yawing * level
    rates = {
        # rate; its change per unit of bias in p, q, r; per unit of misalignment; per unit of roll bias
        "roll": (rolling, (-1.0 + 0.0 * s, -t * s, -t * c), -q + t * s * p, -t * nodding),
        "pitch": (nodding, (0.0 * s, -c, s), c * p, turning),
        "heading": (yawing, (0.0 * s, -s / level, -c / level), s * p / level, -nodding / level),
    }
    needs = {"roll": ("p_radps",), "pitch": ("q_radps",), "heading": ("r_radps",)}
    found = []
    for name, (rate, biases, turned, rolled) in rates.items():
        if not m.has(f"{name}_rad", *needs[name]):
            continue
        angle = m.at(f"{name}_rad")
        expected = m.integral(rate)
        columns = {f"effects.gyros.bias_{axis}": m.integral(b) for axis, b in zip("pqr", biases, strict=True)}
        columns["effects.gyros.scale"] = columns[_CLOCK] = -expected
        columns["effects.gyros.lag"] = np.r_[rate[:1], 0.5 * (rate[1:] + rate[:-1]), rate[-1:]]
        if m.has("p_radps", "q_radps"):
            columns["effects.gyros.misalignment"] = m.integral(turned)
        columns["effects.inclinometer.roll_bias"] = m.integral(rolled)
        if name == "heading":
            # from the gyros: with the compass's own noise in them, these columns would seem to explain it
            smooth = expected + np.mean(angle - expected)
            columns["effects.compass.lag"] = -m.slope(expected)
            columns["effects.compass.deviation_sin"] = np.sin(smooth)
            columns["effects.compass.deviation_cos"] = np.cos(smooth)
        found.append(Equation(f"{name} against gyros", angle - expected, columns))
    return found


def _turns(m: Motion) -> list[Equation]:
    """Turns of the measured attitude about the body axes against gyros, for a vehicle that passes the vertical."""
    turned = unrolled(from_angles(*m.record.matrix(ANGLES).T))
    p, q, r = (m.middle(name) for name in ("p_radps", "q_radps", "r_radps"))
    axes = (("bow", "p", p, -q), ("starboard", "q", q, p), ("downward", "r", r, 0.0 * r))
    found = []
    for k, (axis, symbol, rate, across) in enumerate(axes):
        if not m.has(f"{symbol}_radps"):
            continue
        expected = m.integral(rate)
        columns = {f"effects.gyros.bias_{symbol}": -m.integral(np.ones(len(rate)))}
        columns |= dict.fromkeys(("effects.gyros.scale", _CLOCK), -expected)
        columns["effects.gyros.lag"] = np.r_[rate[:1], 0.5 * (rate[1:] + rate[:-1]), rate[-1:]]
        if m.has("p_radps", "q_radps"):
            columns["effects.gyros.misalignment"] = m.integral(across)
        found.append(Equation(f"turns about the {axis} axis against gyros", turned[:, k] - expected, columns))
    return found


def _turned(m: Motion, v: np.ndarray) -> np.ndarray:
    """Body vectors, (3, n - 1), rotated into north, east and down by the measured attitude."""
    return np.stack(velocity_ned(*v, *(m.middle(name) for name in ("roll_rad", "pitch_rad", "heading_rad"))))


def _track(m: Motion, names: Sequence[str], sensor: str) -> list[Equation]:
    """North, east and depth against speed over ground or, with the current, speed through the water."""
    v = np.stack([m.middle(name) for name in names])
    velocity = _turned(m, v)
    heading, unit = m.middle("heading_rad"), np.eye(3)[:, :, None] * np.ones(v.shape[1])
    # change of the velocity when the vehicle turns about the vertical, and about its level athwartships axis
    swing = np.stack([-velocity[1], velocity[0], 0.0 * heading])
    across = np.stack([np.cos(heading) * velocity[2], np.sin(heading) * velocity[2], 0.0 * heading])
    across[2] = -(np.cos(heading) * velocity[0] + np.sin(heading) * velocity[1])
    effect = f"effects.{sensor}"
    full = m.has(*names)
    rates = {f"{effect}.bias_{axis}": -_turned(m, unit[k]) for k, axis in enumerate("uvw") if m.has(names[k])}
    rates[f"{effect}.scale"] = -velocity
    if full:
        rates[f"{effect}.misalignment"] = _turned(m, np.stack([-v[1], v[0], 0.0 * v[0]]))
    changes = np.stack([np.diff(m.at(name)) for name in names]) / np.diff(m.record.time)
    rates[f"{effect}.lag"] = _turned(m, changes)
    if sensor == "dvl_water":
        depth = m.middle("depth_m")
        rates |= {path: unit[k] for k, path in enumerate(_CURRENT)}
        rates |= {path: unit[k] * depth for k, path in enumerate(_SHEAR) if m.has("depth_m")}
    rates["effects.compass.bias"] = -swing
    rates["effects.compass.deviation_sin"] = -np.sin(heading) * swing
    rates["effects.compass.deviation_cos"] = -np.cos(heading) * swing
    if not m.far:  # a heading that passes the vertical swings round, however little the vehicle turns
        rates["effects.compass.lag"] = np.gradient(heading, np.arange(heading.size)) / np.diff(m.record.time) * swing
    if m.has("pitch_rad"):
        rates["effects.inclinometer.pitch_bias"] = -across
    found = []
    for k, name in enumerate(_POSITION):
        if not m.has(name) or (name == "depth_m" and not m.has("pitch_rad")):
            continue
        expected = m.integral(velocity[k])
        columns = {path: m.integral(rate[k]) for path, rate in rates.items()} | {_CLOCK: -expected}
        if name == "depth_m":
            columns["effects.depth.scale"] = expected
            columns["effects.depth.lag"] = -m.slope(m.at(name))
        title = f"{name[:-2]} against speed {'over ground' if sensor == 'dvl_ground' else 'through the water'}"
        found.append(Equation(title, m.at(name) - expected, columns))
    return found


def _ground_and_water(m: Motion) -> list[Equation]:
    """Speed over ground against speed through the water, integrated, in body axes."""
    found, eye = [], np.eye(3)
    ones = np.ones(len(m.record) - 1)
    # the rows of the rotation are unit currents to the north, east and down in body axes
    columns_of = [_turned(m, eye[:, k][:, None] * ones) for k in range(3)]
    g, w = (np.stack([m.middle(name) for name in names]) for names in (GROUND, WATER))
    both = 0.5 * (g + w)  # if each used its own speed, a scale would cancel the noise as well
    for k, axis in enumerate("uvw"):
        columns = {path: m.integral(columns_of[k][j]) for j, path in enumerate(_CURRENT)}
        if m.has("depth_m"):
            columns |= {path: m.integral(columns_of[k][j] * m.middle("depth_m")) for j, path in enumerate(_SHEAR)}
        for sensor, names, sign in (("dvl_ground", GROUND, 1.0), ("dvl_water", WATER, -1.0)):
            effect, own = f"effects.{sensor}", m.smooth(m.at(names[k]))
            columns[f"{effect}.bias_{axis}"] = sign * m.integral(ones)
            columns[f"{effect}.scale"] = sign * m.integral(both[k])
            columns[f"{effect}.lag"] = -sign * (own - own[0])
            if axis != "w":
                columns[f"{effect}.misalignment"] = sign * m.integral(both[1] if axis == "u" else -both[0])
        found.append(Equation(f"{axis} over ground against {axis} through the water", m.integral(g[k] - w[k]), columns))
    return found
