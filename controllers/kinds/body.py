"""Autopilots of vehicles in six degrees of freedom: depth by pitch, heading and speed, with fins and drive."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import radians, sqrt
from typing import Any

import numpy as np

from auv_gym.models.linear import linearise
from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import Cruise, command_limits, command_ranges, find_cruise, find_helm, resting_commands
from controllers.composed.loops import Cascade, Joint, Mirrored, commanded_inputs
from controllers.composed.scheduled import Scheduled
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.kinds import ANGLE_ERROR, ControlKind, Ranges
from controllers.pid import Pid
from controllers.predictive.gpc import Gpc
from controllers.s_plane import SPlane
from controllers.tracking import Points
from controllers.trials.trial import NOISE

_POINTS = 9  # number of steady speeds, at commands from rest to the limit
_FASTEST = 20.0  # m/s
PITCH_LIMIT = radians(20.0)  # above this, depth no longer follows pitch in proportion
# errors with the same cost as half an input's range moved in a sample
_DEPTH_ERROR = 0.5  # lengths
_TRIM_ERROR = 1.0  # rad, of pitch, if bow planes can hold the depth without pitch
_SPEED_ERROR = 0.1  # of the cruise speed
_TURN = 0.3  # rad of heading per length
# a hull that is unstable in yaw keeps turning when it has lost speed and the rudder no longer holds it
_CAREFUL_TURN = 0.2
_CAREFUL_LENGTHS = 4.0  # of the way, in which the reference approaches the target
_STABLE = 1.0 + 1e-6  # magnitude of the largest pole
# change of the disturbances, as shares of the limits of inputs and outputs, while a torpedo travels its length; assumed
# by the filters for what the linear form neglects when a vehicle pitches, turns and slows down
_DRIFTS = {"pitch": 0.03, "yaw": 0.03, "surge": 0.007}
_OFFSET_DRIFT = 0.003
_SAMPLES = 3.0  # per torpedo length travelled; the horizon is then ten lengths


def _pid(plant: Plant, targets: tuple[str, ...], gains: Gains, pitch_limit: float | None) -> Controller:
    """Depth by pitch, heading, speed."""
    cruise, limits, helm = _cruise(plant), command_limits(plant), find_helm(plant)
    rudder, plane, propulsion = (float(cruise.commands[i]) for i in (helm.rudder, helm.plane, helm.drive))
    pitch = Pid(
        **gains.law("pid", "pitch"),
        measured="pitch_rad",
        command=plant.inputs[helm.plane],
        rate_measured="q_radps",
        limit=float(limits[helm.plane]),
        neutral=plane,
    )
    loops: dict[str, Controller] = {
        "heading_rad": Pid(
            **gains.law("pid", "heading"),
            command=plant.inputs[helm.rudder],
            rate_measured="r_radps",
            limit=float(limits[helm.rudder]),
            neutral=rudder,
        ),
        "u_mps": Pid(
            **gains.law("pid", "speed"),
            measured="u_mps",
            command=plant.inputs[helm.drive],
            limit=0.5 * float(limits[helm.drive]),
            middle=0.5 * float(limits[helm.drive]),
            neutral=propulsion,
            steady=steady_speed_commands(plant),
        ),
        "pitch_rad": pitch,
    }
    if "depth_m" in targets:
        settings = gains.law("pid", "depth")
        if pitch_limit is not None:
            settings["limit"] = pitch_limit
        level = min(
            max(float(cruise.state[plant.family.states.index("pitch_rad")]), -settings["limit"]), settings["limit"]
        )
        outer = Pid(**settings, measured="depth_m", command="pitch_rad", neutral=level)
        loops["depth_m"] = Cascade(outer, pitch)
    return _joined(plant, [loops[name] for name in targets], gains)


def _s_plane(plant: Plant, targets: tuple[str, ...], gains: Gains) -> Controller:
    """Loops from one channel directly to one command, as in Xu et al. 2013."""
    cruise, limits, helm = _cruise(plant), command_limits(plant), find_helm(plant)
    rudder, plane, propulsion = (float(cruise.commands[i]) for i in (helm.rudder, helm.plane, helm.drive))
    to_starboard, to_nose_up = (float(np.sign(gain)) for gain in (cruise.rudder_gains[2], cruise.plane_gains[2]))
    loops = {
        "heading_rad": SPlane(
            **gains.law("s_plane", "heading"),
            command=plant.inputs[helm.rudder],
            span=to_starboard * float(limits[helm.rudder]),
            rate_measured="r_radps",
            limit=float(limits[helm.rudder]),
            neutral=rudder,
        ),
        "depth_m": SPlane(
            **gains.law("s_plane", "depth"),
            span=-to_nose_up * float(limits[helm.plane]),
            measured="depth_m",
            command=plant.inputs[helm.plane],
            limit=float(limits[helm.plane]),
            neutral=plane,
        ),
        "u_mps": SPlane(
            **gains.law("s_plane", "speed"),
            span=0.5 * float(limits[helm.drive]),
            measured="u_mps",
            command=plant.inputs[helm.drive],
            limit=0.5 * float(limits[helm.drive]),
            middle=0.5 * float(limits[helm.drive]),
            neutral=propulsion,
            steady=steady_speed_commands(plant),
        ),
    }
    return _joined(plant, [loops[name] for name in targets], gains)


def steady_speed_commands(plant: Plant) -> Points:
    """Forward speeds, m/s, and the propulsion commands that hold them on a level straight course, without effects."""
    clean, helm = without_effects(plant), find_helm(plant)
    actuators, highest = len(clean.family.actuators), float(command_limits(clean)[helm.drive])
    depth = clean.family.states.index("depth_m")
    points = [(0.0, 0.0)]
    for command in np.linspace(0.0, highest, _POINTS)[1:]:
        commands = resting_commands(clean)
        commands[helm.drive] = command
        low, high = 0.0, _FASTEST
        for _ in range(40):
            x = np.zeros(len(clean.states))
            x[0], x[depth] = 0.5 * (low + high), 1e3  # far below any wave
            for at in (len(clean.family.states), x.size - actuators):
                x[at : at + actuators] = commands[:actuators]
            gains = float(clean.step(x, commands)[0]) > x[0]
            low, high = (x[0], high) if gains else (low, x[0])
        points.append((float(0.5 * (low + high)), float(command)))
    return tuple(points)


def _joined(plant: Plant, loops: Sequence[Controller], gains: Gains) -> Controller:
    """The loops side by side; the bow planes share the work of the stern planes if required."""
    source, *mirrors = plant.family.body.by_role()["pitch"]
    shared = list(loops)
    if mirrors and gains.bow_share != 0.0:
        shared = [
            Mirrored(loop, gains.bow_share, source=source, command=mirrors[0])
            if source in commanded_inputs(loop)
            else loop
            for loop in loops
        ]
    return Joint(tuple(shared))


def _plan_depth(plant: Plant, settings: dict[str, Any]) -> Controller:
    model = linearise(plant, outputs=("depth_m", "pitch_rad"))
    trim = float(model.output_offset[1])
    limit = settings.get("pitch_limit", PITCH_LIMIT)
    weights = {"depth_m": 1.0 / (_DEPTH_ERROR * plant.hull.length)}
    if len(model.inputs) > 1:
        weights["pitch_rad"] = 1.0 / _TRIM_ERROR
    return _by_fins(
        plant,
        model,
        settings,
        weights=weights,
        output_limits={"pitch_rad": (trim - limit, trim + limit)},
        nominal={"pitch_rad": trim} if len(model.inputs) > 1 else {},
    )


def _plan_pitch(plant: Plant, settings: dict[str, Any]) -> Controller:
    planes = (plant.inputs[find_helm(plant).plane],)
    model = linearise(plant, planes, ("pitch_rad",), states=("w_mps", "q_radps", "pitch_rad"))
    return _by_fins(plant, model, settings, weights={"pitch_rad": 1.0 / ANGLE_ERROR})


def _plan_heading(plant: Plant, settings: dict[str, Any]) -> Controller:
    model = linearise(plant, (plant.inputs[find_helm(plant).rudder],), ("heading_rad", "r_radps"))
    rate = 1.0 / _length_time(plant)
    stable = np.abs(model.poles()).max() < _STABLE
    fastest = (_TURN if stable else _CAREFUL_TURN) * rate
    return _by_fins(
        plant,
        model,
        settings,
        weights={"heading_rad": 1.0 / ANGLE_ERROR},
        output_limits={"r_radps": (-fastest, fastest)},
        reference_time=0.0 if stable else _CAREFUL_LENGTHS / rate,
    )


def _plan_speed(plant: Plant, settings: dict[str, Any]) -> Gpc:
    model = linearise(plant, (plant.inputs[find_helm(plant).drive],))
    cruise = plant.hull.length / _length_time(plant)
    return _gpc(plant, model, settings, weights={"u_mps": 1.0 / (_SPEED_ERROR * cruise)})


def _by_fins(plant: Plant, model, settings: dict[str, Any], **fields: Any) -> Scheduled:
    """Plans with fins as in cruise, with the angles scaled to the present speed."""
    limits = dict(zip(plant.inputs, command_limits(plant).tolist()))
    plans = _gpc(plant, model, settings, **fields)
    return Scheduled(plans, plant.hull.length / _length_time(plant), {name: limits[name] for name in model.inputs})


def _gpc(plant: Plant, model, settings: dict[str, Any], **fields: Any) -> Gpc:
    limits, body = command_limits(plant), plant.family.body
    role_of = {name: role for role, names in body.by_role().items() for name in names}
    view = plant.family.view(without_effects(plant).derived)
    walk = sqrt(plant.dt / _length_time(plant))
    rates, ranges = {}, {}
    drift = {name: walk * _OFFSET_DRIFT * high for name, (_, high) in fields.get("output_limits", {}).items()}
    for name in model.inputs:
        at = plant.inputs.index(name)
        limit, (_, _, slowness) = float(limits[at]), plant.family.hooks.actuator_times(at, view)
        ranges[name] = (0.0 if role_of[name] == "surge" else -limit, limit)
        drift[name] = walk * _DRIFTS[role_of[name]] * limit
        if slowness > 0.0:
            rates[name] = 1.0 / slowness
    own = {key: value for key, value in settings.items() if key != "pitch_limit"}
    noise = {name: NOISE[name] for name in model.outputs}
    first: dict[str, Any] = {"input_limits": ranges, "rate_limits": rates, "noise": noise, "drift": drift}
    return Gpc(model, **(first | fields | own))


def _every(plant: Plant) -> float:
    return _length_time(plant) / _SAMPLES


def _ranges(plant: Plant) -> Ranges:
    ranges = {name: (float(low), float(high)) for name, (low, _, high) in zip(plant.inputs, command_ranges(plant))}
    drive = plant.inputs[find_helm(plant).drive]
    return ranges | {drive: (0.0, ranges[drive][1])}


@lru_cache(maxsize=16)
def _cruise(plant: Plant) -> Cruise:
    return find_cruise(plant)  # takes a tenth of a second


@lru_cache(maxsize=16)
def _length_time(plant: Plant) -> float:
    """Seconds in which a torpedo travels its length in cruise."""
    return plant.hull.length / find_cruise(plant).speed


KIND = ControlKind(
    targets=("depth_m", "heading_rad", "u_mps"),
    plans={"depth_m": _plan_depth, "heading_rad": _plan_heading, "u_mps": _plan_speed, "pitch_rad": _plan_pitch},
    pid=_pid,
    s_plane=_s_plane,
    ranges=_ranges,
    every=_every,
    alternatives=(("depth_m", "pitch_rad"),),
)
