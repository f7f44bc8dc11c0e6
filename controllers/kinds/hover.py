"""Autopilots of vehicles that hover by thrusters: position, depth, heading, and roll and pitch if possible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import pi, sqrt
from typing import Any

import numpy as np
from scipy.linalg import expm

from auv_gym.models.linear import StateSpace
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_ranges
from controllers.allocation import AXES, allocation_of
from controllers.composed.allocated import Allocated
from controllers.composed.loops import Joint
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.hovering.dynamics import POSE, HoverDynamics
from controllers.hovering.law import HoverPid, pace_of, placed_gains
from controllers.hovering.world import WORLD, InWorldAxes
from controllers.kinds import ANGLE_ERROR, ControlKind, Ranges
from controllers.predictive.gpc import Gpc
from controllers.trials.trial import NOISE

_DAMPING = 1.0  # critical: no overshoot among obstacles
_SLOW = 0.2  # the third pole over the two at the frequency, as in `controllers.pid`
# rad, phase loss by delays where the loop's gain is 1; critically damped, the margin there is 76 degrees without delays
_PHASE = pi / 6.0
# righting frequency times sample; above this, a loop cannot level an oscillation between its samples.  Source: Astrom
# and Wittenmark 1997, Computer-Controlled Systems, sec. 4.3 (0.1 to 0.6)
_SWING = 0.6
_CALLS = 1.5  # samples of command delay: half for being held, one for the rate's smoothing
# errors at which the proportional part alone uses an axis's full authority
_FAR, _TURNED = 0.5, 0.5  # m, rad
_SHARE = 0.5  # of an axis's authority, for the reference: the rest is for what the model does not include
_POSITION_ERROR = 0.1  # m, with the same cost in a plan as half an input's range moved in a sample
_STEPS = 0.2  # of a loop's time, 1 / frequency, between plans; thirty of these make a horizon
_DRIFT = 0.02  # of an axis's authority, random walk of disturbances per second, assumed by the filters
_AXIS_OF: dict[str, int] = {name: i for i, name in enumerate(POSE)}
_NAMES = tuple(name.rpartition("_")[0] for name in AXES)


@lru_cache(maxsize=16)
def _dynamics(plant: Plant, lost: tuple[tuple[str, float], ...] = ()) -> HoverDynamics:
    return HoverDynamics(plant, allocation_of(plant, dict(lost))[0])


def _allocated(plant: Plant, controller: Controller, lost: Mapping[str, float]) -> Allocated:
    allocation, thrusters = allocation_of(plant, lost)
    return Allocated(controller, allocation, thrusters)


def _pid(
    plant: Plant,
    targets: tuple[str, ...],
    dt: float | None,
    *,
    frequency: float | Mapping[str, float] | None = None,
    damping: float | Mapping[str, float] | None = None,
    lost: Mapping[str, float] | None = None,
    gains: Gains | None = None,
) -> Controller:
    """PID by pole placement, without tuned gains.

    frequency: natural frequency of the loops, rad/s, for all axes or by name ("surge" to "yaw"); default what delays
    and thrusters allow.  damping: ratio, likewise; default 1.  lost: shares of thrust by thruster, known to be lost.
    gains: give frequency and damping by axis, unless given as arguments.
    """
    known = dict(lost or {})
    dynamics = _checked(plant, targets, known)
    tuned = {} if gains is None else gains.loops.get("pid", {})
    frequency, damping = (
        {axis: law[key] for axis, law in tuned.items() if key in law} if given is None else given
        for key, given in (("frequency", frequency), ("damping", damping))
    )
    sample = plant.dt if dt is None else dt
    _check_sample(dynamics, sample)
    ratios = _by_axis("damping", "ratio such as 1", damping, np.full(6, _DAMPING))
    chosen = _by_axis("frequency", "number in rad/s", frequency, _frequencies(dynamics, ratios, sample))
    placed = placed_gains(dynamics, chosen, ratios, _SLOW, _SHARE)
    return _allocated(plant, HoverPid(dynamics, placed, targets, _level(dynamics)), known)


def _by_axis(label: str, form: str, given: float | Mapping[str, float], default: np.ndarray) -> np.ndarray:
    """Numbers of the axes, (6,): one for all, or some by name with defaults for the others; raises ValueError."""
    found = default.copy()
    for name, value in (given if isinstance(given, Mapping) else dict.fromkeys(_NAMES, given)).items():
        if name not in _NAMES or not value > 0.0:
            raise ValueError(
                f"{label}= needs a {form} above 0, or such numbers by axis ({', '.join(_NAMES)}), got {name!r}: "
                f"{value!r}."
            )
        found[_NAMES.index(name)] = value
    return found


def _frequencies(dynamics: HoverDynamics, damping: float | np.ndarray, dt: float) -> np.ndarray:
    """Natural frequencies of the axes, rad/s, (6,), that delays and thruster authority allow.

    The gain of a loop of damping ratio z is 1 at its frequency times sqrt(2 z^2 + sqrt(4 z^4 + 1)); there, a delay T
    costs that frequency times T in phase.
    """
    crossing = np.sqrt(2.0 * damping**2 + np.sqrt(4.0 * damping**4 + 1.0))
    quick = _PHASE / (crossing * (_CALLS * dt + dynamics.delay))
    far = np.array([_FAR] * 3 + [_TURNED] * 3)
    strong = np.sqrt(dynamics.authority / (far * np.diag(dynamics.mass)))
    return np.where(strong > 0.0, np.minimum(quick, strong), quick)


def _check_sample(dynamics: HoverDynamics, dt: float) -> None:
    """Raise if the vehicle rights itself too quickly for loops that act every dt, s."""
    righting = float(np.sqrt(np.max(dynamics.stiffness / np.diag(dynamics.mass), initial=0.0)))
    if righting * dt > _SWING:
        raise ValueError(
            f"{dynamics.plant.name!r} swings about level with {righting:.3g} rad/s, so its autopilot must act at least "
            f"every {_SWING / righting:.2g} s, got {dt:g} s: choose a shorter dt."
        )


def _checked(plant: Plant, targets: Sequence[str], lost: Mapping[str, float]) -> HoverDynamics:
    """The dynamics; raises if the thrusters do not serve the axes that the targets need."""
    dynamics = _dynamics(plant, tuple(sorted(lost.items())))
    counts = dynamics.allocation.counts
    for name in targets:
        missing = [axis for axis in _axes_for(name) if axis not in counts]
        if missing:
            raise ValueError(
                f"The thrusters of {plant.name!r}{' that are left' * bool(lost)} do not serve {', '.join(missing)}, "
                f"which {name} takes, but {', '.join(counts) or 'nothing'}: choose other targets."
            )
    return dynamics


def _level(dynamics: HoverDynamics) -> tuple[str, ...]:
    """Roll and pitch, if the thrusters serve them."""
    return tuple(name for name in POSE[3:5] if AXES[_AXIS_OF[name]] in dynamics.allocation.counts)


def _able(plant: Plant) -> tuple[str, ...]:
    counts = _dynamics(plant).allocation.counts
    return tuple(name for name in POSE if all(axis in counts for axis in _axes_for(name)))


def poses_of(plant: Plant) -> tuple[str, ...]:
    """The channels of the pose that the thrusters of a vehicle serve."""
    return _able(plant)


def axis_of(name: str) -> str:
    """The axis that moves a channel of the pose, for a vehicle that heads north: "surge" for `north_m`."""
    return _NAMES[_AXIS_OF[name]]


def dynamics_of(plant: Plant) -> HoverDynamics:
    """The dynamics of a vehicle with all of its thrusters."""
    return _dynamics(plant)


def placed_frequencies(plant: Plant) -> np.ndarray:
    """The default natural frequencies of the axes, rad/s, (6,)."""
    return _frequencies(_dynamics(plant), _DAMPING, plant.dt)


def _axes_for(name: str) -> tuple[str, ...]:
    """The body axes that a channel of the pose needs."""
    return AXES[:2] if name in POSE[:2] else (AXES[_AXIS_OF[name]],)


def _plan(name: str):
    """A function that makes a Gpc of one channel of the pose, which commands a force in world axes or a moment."""

    def make(plant: Plant, settings: dict[str, Any]) -> Gpc:
        dynamics = _checked(plant, (name,), {})
        at = _AXIS_OF[name]
        level = name in POSE[:2]  # north and east share surge and sway: half of each
        axes = [0, 1] if level else [at]
        mass, damping = (float(np.mean(v[axes])) for v in (np.diag(dynamics.mass), dynamics.damping))
        most = float(dynamics.authority[axes].min())
        model = _axis_model(plant.dt, mass, damping, float(dynamics.stiffness[at]), dynamics.delay, name, WORLD[at])
        weight = 1.0 / (_POSITION_ERROR if at < 3 else ANGLE_ERROR)
        fields: dict[str, Any] = {
            "weights": {name: weight},
            "input_limits": {WORLD[at]: (-most, most)},
            "noise": {name: NOISE[name]},
            "drift": {WORLD[at]: _DRIFT * sqrt(plant.dt) * most},
            "nominal": {name: 0.0} if name in POSE[3:5] else {},
        }
        return Gpc(model, **{**fields, **settings})

    return make


def _axis_model(
    dt: float, mass: float, damping: float, stiffness: float, lag: float, output: str, wrench: str
) -> StateSpace:
    """Position and rate of one axis under a lagged force, exact over samples: the counterpart of `linearise`.

    It is linear in the force and not in a command, since the curve of a resting thruster has no slope.
    """
    slow = lag > 0.0
    n = 3 if slow else 2
    rates = np.zeros((n + 1, n + 1))
    rates[0, 1] = 1.0
    rates[1, :2] = -stiffness / mass, -damping / mass
    rates[1, 2] = 1.0 / mass  # the acting force: a state of its own if it lags, otherwise the input
    if slow:
        rates[2, 2:] = -1.0 / lag, 1.0 / lag
    held = expm(rates * dt)
    names = ("position", "rate", "force")[:n]
    return StateSpace(held[:n, :n], held[:n, n:], np.eye(1, n), (wrench,), (output,), dt, states=names)


def _every(plant: Plant) -> float:
    """Time between plans, s: that of the slowest loop that the thrusters serve."""
    dynamics = _dynamics(plant)
    served = [AXES.index(name) for name in dynamics.allocation.counts]
    return _STEPS / float(_frequencies(dynamics, _DAMPING, plant.dt)[served].min())


def _joined(plant: Plant, plans: Sequence[Controller], lost: Mapping[str, float] | None = None) -> Controller:
    """The plans' forces and moments, allocated to the thrusters."""
    known = dict(lost or {})
    dynamics = _dynamics(plant, tuple(sorted(known.items())))
    _check_sample(dynamics, plant.dt)
    pace = pace_of(dynamics, _frequencies(dynamics, _DAMPING, plant.dt), _SHARE)
    return _allocated(plant, InWorldAxes(Joint(tuple(plans)), dynamics, pace, _level(dynamics)), known)


def _ranges(plant: Plant) -> Ranges:
    return {name: (float(low), float(high)) for name, (low, _, high) in zip(plant.inputs, command_ranges(plant))}


KIND = ControlKind(
    targets=("north_m", "east_m", "depth_m", "heading_rad"),
    plans={name: _plan(name) for name in POSE},
    placed=_pid,
    joined=_joined,
    shared=("lost",),
    held=lambda plant: _level(_dynamics(plant)),
    able=_able,
    ranges=_ranges,
    every=_every,
)
