"""A plant in which a fitted model drives some channels, while physics and exact kinematics give the rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import atan2, cos, pi, sin, sqrt
from typing import Any

import numpy as np

from auv_gym.channels import CHANNELS, wrap
from auv_gym.compiled import bind, compiled
from auv_gym.model import Model
from auv_gym.param import did_you_mean
from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of, wrapped
from auv_gym.plant import Plant
from auv_gym.vehicles import Family

VELOCITIES = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
POSES = ("north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad")
_MOTION = (*VELOCITIES, *POSES)

# Placeholders in the template `_carry`, bound for each kind of vehicle.
STATES = INTEGRATED = ACTUATORS = SENSORS = SCRATCH = 0
view: Any = None
enter: Any = None
derivative: Any = None
sense: Any = None


def splice(plant: Plant, model: Model) -> Spliced:
    """A plant in which a model computes the channels that are its outputs; raises if the two do not fit together.

    The model's outputs are body velocities, rates or poses of the plant: true values, which the plant's sensors still
    read. Its inputs are inputs of the plant, or quantities that the plant computes: states or, for other names,
    readings.

    Example:

        >>> from auv_gym import StateSpace, load_vehicle, splice
        >>> turning = StateSpace([[0.9]], [[0.02]], [[1.0]], ("rudder_rad",), ("r_radps",), dt=0.5)
        >>> splice(load_vehicle("remus100", dt=0.5), turning).inputs
        ('rudder_rad', 'stern_plane_rad', 'propeller_rpm')
    """
    return Spliced(plant, model)


@dataclass(frozen=True)
class Spliced:
    """A plant and the model that drives some of its channels, as a Model with the plant's inputs and outputs.

    Velocities that the model does not give follow the plant's dynamics, which use the driven ones. Poses that it does
    not give are integrated from the velocities, so that a model of body rates alone turns and moves the whole vehicle.
    Effects of the plant's dynamics on a driven channel are lost. Second order in dt, in all channels.
    """

    plant: Plant
    model: Model

    def __post_init__(self):
        _check_fit(self.plant, self.model)

    @property
    def driven(self) -> tuple[str, ...]:
        """The channels that the model drives."""
        return tuple(self.model.outputs)

    @property
    def dt(self) -> float:
        return self.plant.dt

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.plant.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.plant.outputs

    @cached_property
    def states(self) -> tuple[str, ...]:
        return (*self.plant.states, *(f"model: {name}" for name in self.model.states))

    @property
    def constants(self) -> dict[str, float]:
        """Values of the inputs that a record may lack."""
        return self.plant.constants

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """A state with these outputs where they are finite, as far as the model can start from them."""
        x = self.plant.initial(y0)
        return self._joined(x, self.model.initial(self._true_values(x, y0)))

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state one sample later, shape (n_states,); u: the plant's inputs in order."""
        before, x_model = self._parted(x)
        u = np.ascontiguousarray(u, dtype=np.float64)
        alone = self.plant.step(before, u)
        x_model = self.model.step(x_model, self._model_inputs(before, u))
        given, layout = self.model.output(x_model), self._layout
        # Repeat the step so that the plant's own dynamics see the driven channels' mean over the sample instead of
        # their start; quantities that depend on them are then of second order, too.
        missed = given - alone[layout.driven]
        start = before.copy()
        start[layout.driven] += 0.5 * np.where(layout.angles, wrap(missed), missed)
        after = self.plant.step(start, u)
        moved = after[layout.position] - start[layout.position]
        after[layout.driven] = given
        _carry_for(self.plant.family)(
            before, after, u, layout.where, layout.is_driven, layout.speed, self.dt, self.plant.derived
        )
        self._meet_waves(after, after[layout.position] - before[layout.position] - moved)
        return np.concatenate([after, x_model])

    def output(self, x: np.ndarray) -> np.ndarray:
        """The outputs as the plant's sensors give them, shape (n_outputs,)."""
        return self.plant.output(self._parted(x)[0])

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state after measuring y (NaN: not measured): both parts are corrected, driven channels by the model."""
        before, x_model = self._parted(x)
        after = self.plant.correct(before, y)
        return self._joined(after, self.model.correct(x_model, self._true_values(after, y)))

    @cached_property
    def _layout(self) -> _Layout:
        return _Layout.of(self.plant, self.model)

    def _parted(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.asarray(x, dtype=float)
        if x.shape != (len(self.states),):
            raise ValueError(f"A state of this model has shape ({len(self.states)},), got {x.shape}: see `initial`.")
        return x[: self._layout.size], x[self._layout.size :]

    def _joined(self, x_plant: np.ndarray, x_model: np.ndarray) -> np.ndarray:
        x = np.concatenate([x_plant, x_model])
        x[self._layout.driven] = self.model.output(x_model)
        return x

    def _true_values(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The model's outputs in a plant's state that was set to y; NaN where y is not finite."""
        measured = np.isfinite(np.asarray(y, dtype=float)[self._layout.readings])
        return np.where(measured, x[self._layout.driven], np.nan)

    def _model_inputs(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.concatenate([u, x, self.plant.output(x)])[self._layout.sources]

    def _meet_waves(self, x: np.ndarray, moved: np.ndarray) -> None:
        """Correct the phase of the waves, in place, for a vehicle that went further by `moved` (north, east), m."""
        if "wave_phase_rad" not in self.plant.family.states:
            return
        waves = self.plant.effects.waves
        if waves.amplitude_cos != 0.0 or waves.amplitude_sin != 0.0:
            # phase = omega t - k x, with k = omega^2/g in deep water
            wavenumber = (2.0 * pi / waves.period) ** 2 / self.plant.hull.gravity
            along = moved[0] * cos(waves.direction) + moved[1] * sin(waves.direction)
            x[self.plant.family.states.index("wave_phase_rad")] -= wavenumber * along


@dataclass(frozen=True, eq=False)
class _Layout:
    """Indices of channels in a plant's state.

    driven, readings: for each output of the model, its index among the plant's states and outputs.  angles: which of
    them are angles.  where, is_driven: for each of _MOTION its index among the states, or -1, and whether the model
    drives it.
    speed: index of the forward speed among the inputs if it is not a state, or -1.  sources: for each input of the
    model, its index in [inputs | states | outputs].  position: of north and east.
    """

    size: int
    driven: np.ndarray
    readings: np.ndarray
    angles: np.ndarray
    where: np.ndarray
    is_driven: np.ndarray
    speed: int
    sources: np.ndarray
    position: np.ndarray

    @classmethod
    def of(cls, plant: Plant, model: Model) -> _Layout:
        states, outputs = plant.family.states, model.outputs
        computed = (*plant.inputs, *plant.states, *plant.outputs)
        return cls(
            size=len(plant.states),
            driven=np.array([states.index(name) for name in outputs], dtype=np.int64),
            readings=np.array([plant.outputs.index(name) for name in outputs], dtype=np.int64),
            angles=np.array([CHANNELS[name].angle for name in outputs]),
            where=np.array([states.index(name) if name in states else -1 for name in _MOTION], dtype=np.int64),
            is_driven=np.array([name in outputs for name in _MOTION]),
            speed=-1 if "u_mps" in states else plant.inputs.index("u_mps"),
            sources=np.array([computed.index(name) for name in model.inputs], dtype=np.int64),
            position=np.array([states.index(name) for name in ("north_m", "east_m")], dtype=np.int64),
        )


def _check_fit(plant: Plant, model: Model) -> None:
    """Raise if this model cannot drive this plant."""
    if not isinstance(plant, Plant):
        raise ValueError(f"splice needs a plant first, got {type(plant).__name__}: see load_vehicle.")
    if not isinstance(model, Model):
        raise ValueError(
            f"splice needs a model second, got {type(model).__name__}: give what a fit returned as .model."
        )
    if abs(model.dt - plant.dt) > 1e-9 * plant.dt:
        raise ValueError(
            f"The model steps {model.dt:g} s at a time and {plant.name} {plant.dt:g} s: fit the model to "
            f"record.resample({plant.dt:g}), or splice it into dataclasses.replace(plant, dt={model.dt:g})."
        )
    computed = (*plant.inputs, *plant.family.states, *plant.outputs)
    for name in model.inputs:
        if name not in computed and name not in plant.states:
            raise ValueError(
                f"The model needs the input {name}, which {plant.name} neither takes nor computes. "
                f"{did_you_mean(name, computed)}It takes {', '.join(plant.inputs)} and computes "
                f"{', '.join(dict.fromkeys(computed[len(plant.inputs) :]))}: fit the model without {name}."
            )
    can = [name for name in _MOTION if name in plant.family.states and name in plant.outputs]
    if not model.outputs:
        raise ValueError(f"The model has no outputs, and splice needs some of {', '.join(can)}: fit one with outputs.")
    for name in model.outputs:
        if name not in can:
            raise ValueError(
                f"The model gives {name}, which it cannot drive in {plant.name}. {did_you_mean(name, can)}"
                f"It can drive {', '.join(can)}: fit the model to record.without([{name!r}])."
            )
    if "r_radps" in model.outputs and getattr(plant.hull, "rudder_heading_rate", 0.0) != 0.0:
        raise ValueError(
            f"The model gives r_radps, but the rudder of {plant.name} also turns the heading by itself: fit the model "
            "to heading_rad, or splice it into replace_at(plant, 'hull.rudder_heading_rate', 0.0)."
        )


@compiled
def turned(roll, pitch, heading, turn):
    """Roll, pitch and heading, rad, of a body with these angles after a rotation by a vector in its own axes.

    turn: rad, shape (3,).  Roll and heading continue from the given ones without jumps by whole turns.
    """
    angle = sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    c = cos(0.5 * angle)
    s = sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    x, y, z = s * turn[0], s * turn[1], s * turn[2]
    e0, e1, e2, e3 = quaternion_of(roll, pitch, heading)
    r11, r12, r13, r21, r22, r23, r31, _, _ = rotation_of(
        e0 * c - e1 * x - e2 * y - e3 * z,
        e0 * x + e1 * c + e2 * z - e3 * y,
        e0 * y - e1 * z + e2 * c + e3 * x,
        e0 * z + e1 * y - e2 * x + e3 * c,
    )
    new_roll, new_pitch, new_heading = euler_angles_of(r11, r12, r13, r21, r22, r23, r31)
    return roll + wrapped(new_roll - roll), new_pitch, heading + wrapped(new_heading - heading)


@compiled
def rotation_between(roll, pitch, heading, new_roll, new_pitch, new_heading, turn):
    """Write the rotation vector, rad, in body axes, from the first attitude to the second into turn.

    It is at most half a turn long.
    """
    a0, a1, a2, a3 = quaternion_of(roll, pitch, heading)
    b0, b1, b2, b3 = quaternion_of(new_roll, new_pitch, new_heading)
    c = a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3
    side = 1.0 if c >= 0.0 else -1.0  # q and -q are one attitude
    turn[0] = side * (a0 * b1 - a1 * b0 - a2 * b3 + a3 * b2)
    turn[1] = side * (a0 * b2 + a1 * b3 - a2 * b0 - a3 * b1)
    turn[2] = side * (a0 * b3 - a1 * b2 + a2 * b1 - a3 * b0)
    s = sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    scale = 2.0 * atan2(s, side * c) / s if s > 0.0 else 2.0
    for i in range(3):
        turn[i] *= scale


@compiled
def travelled(roll, pitch, heading, turn, u, v, w):
    """Displacement north, east, down, m, of a body that moves u v w m in its own axes while these rotate evenly.

    turn: the rotation.  roll, pitch, heading: at the start.  Exact for constant velocities and rates, as in a steady
    turn.
    Source: Murray, Li and Sastry 1994, eq. (2.36).
    """
    x, y, z = turn[0], turn[1], turn[2]
    square = x * x + y * y + z * z
    if square > 1e-4:
        angle = sqrt(square)
        b, c = (1.0 - cos(angle)) / square, (1.0 - sin(angle) / angle) / square
    else:  # series, where the differences above would lose digits
        b, c = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    xu, xv, xw = y * w - z * v, z * u - x * w, x * v - y * u
    u, v, w = (
        u + b * xu + c * (y * xw - z * xv),
        v + b * xv + c * (z * xu - x * xw),
        w + b * xw + c * (x * xv - y * xu),
    )
    e0, e1, e2, e3 = quaternion_of(roll, pitch, heading)
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(e0, e1, e2, e3)
    return r11 * u + r12 * v + r13 * w, r21 * u + r22 * v + r23 * w, r31 * u + r32 * v + r33 * w


def _carry(before, after, inputs, where, is_driven, speed, duration, derived):
    """Put the poses that are not driven, and the sensors' states, into the full state `after`, in place.

    before, after: full states at the ends of a sample, the driven channels set in both.  where, is_driven, speed: see
    _Layout.  The water's contribution to the motion over ground is the mean of both ends.
    """
    p = view(derived)
    motion = np.zeros((2, 12))  # of _MOTION, at both ends
    turning, turned_to = False, False
    for i in range(12):
        if where[i] >= 0:
            motion[0, i], motion[1, i] = before[where[i]], after[where[i]]
        turning = turning or (is_driven[i] and 3 <= i < 6)
        turned_to = turned_to or (is_driven[i] and i >= 9)
    if speed >= 0:
        motion[0, 0] = motion[1, 0] = inputs[speed]
    start, end = motion[0], motion[1]

    turn = 0.5 * duration * (start[3:6] + end[3:6])
    if turning:
        attitude = turned(start[9], start[10], start[11], turn)
        for i in range(3):
            if where[9 + i] >= 0 and not is_driven[9 + i]:
                end[9 + i] = after[where[9 + i]] = attitude[i]
    if turned_to or not turning:
        rotation_between(start[9], start[10], start[11], end[9], end[10], end[11], turn)

    z = np.empty((2, INTEGRATED))
    enter(before[:STATES], z[0])
    if turning or turned_to or is_driven[0] or is_driven[1] or is_driven[2]:
        enter(after[:STATES], z[1])
        u, v, w = 0.5 * duration * (start[:3] + end[:3])
        way = travelled(start[9], start[10], start[11], turn, u, v, w)
        slope, scratch, still = np.empty(INTEGRATED), np.empty(SCRATCH), np.zeros(3)
        water = np.zeros(3)
        for side in range(2):
            actuators = before[STATES : STATES + ACTUATORS] if side == 0 else after[STATES : STATES + ACTUATORS]
            derivative(z[side], actuators, inputs, p, slope, scratch)
            m = motion[side]
            through = travelled(m[9], m[10], m[11], still, m[0], m[1], m[2])
            for i in range(3):
                if where[6 + i] >= 0:
                    water[i] += 0.5 * duration * (slope[where[6 + i]] - through[i])
        for i in range(3):
            if where[6 + i] >= 0 and not is_driven[6 + i]:
                after[where[6 + i]] = start[6 + i] + way[i] + water[i]

    first = STATES + 2 * ACTUATORS
    after[first : first + SENSORS] = before[first : first + SENSORS]
    enter(after[:STATES], z[1])
    sense(z[0], z[1], after[first : first + SENSORS], duration, p)


_BOUND: dict[str, Any] = {}


def _carry_for(family: Family) -> Any:
    """`_carry` for a family; compiled at its first call and found in the cache afterwards."""
    program = family.program or family.kind
    if program not in _BOUND:
        meanings: dict[str, Any] = {
            "STATES": len(family.states),
            "INTEGRATED": family.integrated,
            "ACTUATORS": len(family.actuators),
            "SENSORS": len(family.sensors),
            "SCRATCH": max(family.scratch, 1),
            "view": family.view,
            **{name: getattr(family.hooks, name) for name in ("enter", "derivative", "sense")},
        }
        _BOUND[program] = bind(_carry, program, **meanings)
    return _BOUND[program]
