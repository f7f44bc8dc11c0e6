"""Predictive control of a vehicle for its targets, by its own linear form."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf, radians, sqrt
from typing import Any

import numpy as np

from auv_gym.cruise import command_limits, find_cruise, find_helm
from auv_gym.engine import find_engine
from auv_gym.linear import linearise
from auv_gym.plant import Plant, without_effects
from controllers.controller import Controller
from controllers.gpc import Gpc
from controllers.loops import Joint
from controllers.scheduled import Scheduled
from controllers.trial import NOISE

PITCH_LIMIT = radians(20.0)  # beyond, depth no longer follows pitch in proportion
# errors that matter as much as half an input's range moved in a sample
_DEPTH_ERROR = 0.5  # lengths
_ANGLE_ERROR = 0.15  # rad, of heading, or of pitch where that has a target
_TRIM_ERROR = 1.0  # rad, of pitch, where there are bow planes to hold the depth without it
_SPEED_ERROR = 0.1  # of the cruise speed
_TURN = 0.3  # rad of heading a length
# a hull that is not stable in yaw turns on by itself where it has lost speed and the rudder no longer holds it
_CAREFUL_TURN = 0.2
_CAREFUL_LENGTHS = 4.0  # of the way, while the reference nears the target
_STABLE = 1.0 + 1e-6  # largest pole
# change of the disturbances while a torpedo goes its length, of the limits of inputs and outputs, that the filters
# reckon with: what the linear form leaves out of a vehicle that pitches, turns and slows down
_DRIFTS = {"pitch": 0.03, "yaw": 0.03, "surge": 0.007}
_OFFSET_DRIFT = 0.003
_SAMPLES = 3.0  # while a torpedo goes its length: the horizon is then ten lengths
_ENGINE_SAMPLES = 15.0  # in the time of a float's engine, half the horizon


def gpc_autopilot(
    plant: Plant,
    targets: Sequence[str] | None = None,
    *,
    dt: float | None = None,
    pitch_limit: float | None = None,
    **settings: Any,
) -> Controller:
    """Predictive control on `linearise(plant)`: depth, heading and speed of a torpedo, each by a Gpc of its own.

    Planes hold the depth within pitch_limit, rad, default 20 degrees either side of trim; rudder and propulsion do the
    rest; fins are turned further where it goes slower.  A glider's rudder holds its heading, a float's engine its
    depth.  One motion each, as at cruise they do not act on each other at first order.
    targets: some of these channels, default all; `pitch_rad` in the place of depth.  dt: s between plans, a multiple of
    the plant's, with which the filters go; default a third of the time for a torpedo's length, a fifteenth of a float's
    engine's time.  settings: further ones of every Gpc.
    """
    kind = plant.family.kind
    makers = {
        "body": {
            "depth_m": _torpedo_depth,
            "heading_rad": _torpedo_heading,
            "u_mps": _torpedo_speed,
            "pitch_rad": _torpedo_pitch,
        },
        "glider": {"heading_rad": _glider_heading},
        "float": {"depth_m": _float_depth},
    }.get(kind)
    if makers is None:
        raise ValueError(f"gpc_autopilot knows torpedoes, gliders and floats, got a vehicle of kind {kind!r}.")
    names = tuple(name for name in makers if name != "pitch_rad") if targets is None else tuple(targets)
    unknown = [name for name in names if name not in makers]
    if unknown or not names:
        raise ValueError(
            f"gpc_autopilot of {plant.name!r} needs targets among {', '.join(makers)}, got "
            f"{', '.join(unknown) or 'none'}."
        )
    if pitch_limit is not None:
        if kind != "body" or not 0.0 < pitch_limit < radians(85.0):
            raise ValueError(f"gpc_autopilot needs a pitch_limit of a torpedo, 0 to 1.48 rad, got {pitch_limit!r}.")
        if "depth_m" in names:
            settings = {**settings, "pitch_limit": pitch_limit}
    settings = {"every": _samples(plant, dt), **settings}
    made = [makers[name](plant, settings) for name in names]
    return made[0] if len(made) == 1 else Joint(tuple(made))


def _torpedo_depth(plant: Plant, settings: dict[str, Any]) -> Controller:
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


def _torpedo_pitch(plant: Plant, settings: dict[str, Any]) -> Controller:
    planes = (plant.inputs[find_helm(plant).plane],)
    model = linearise(plant, planes, ("pitch_rad",), states=("w_mps", "q_radps", "pitch_rad"))
    return _by_fins(plant, model, settings, weights={"pitch_rad": 1.0 / _ANGLE_ERROR})


def _torpedo_heading(plant: Plant, settings: dict[str, Any]) -> Controller:
    model = linearise(plant, (plant.inputs[find_helm(plant).rudder],), ("heading_rad", "r_radps"))
    rate = 1.0 / _length_time(plant)
    stable = np.abs(model.poles()).max() < _STABLE
    fastest = (_TURN if stable else _CAREFUL_TURN) * rate
    return _by_fins(
        plant,
        model,
        settings,
        weights={"heading_rad": 1.0 / _ANGLE_ERROR},
        output_limits={"r_radps": (-fastest, fastest)},
        reference_time=0.0 if stable else _CAREFUL_LENGTHS / rate,
    )


def _torpedo_speed(plant: Plant, settings: dict[str, Any]) -> Gpc:
    model = linearise(plant, (plant.inputs[find_helm(plant).drive],))
    cruise = plant.hull.length / _length_time(plant)
    return _gpc(plant, model, settings, weights={"u_mps": 1.0 / (_SPEED_ERROR * cruise)})


def _by_fins(plant: Plant, model, settings: dict[str, Any], **fields: Any) -> Scheduled:
    """Plans with the fins as they act in cruise, carried out with what they do at the present speed."""
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
    return Gpc(model, **{"input_limits": ranges, "rate_limits": rates, "noise": noise, "drift": drift, **fields, **own})


def _glider_heading(plant: Plant, settings: dict[str, Any]) -> Gpc:
    limit = plant.hull.rudder_limit
    return Gpc(
        linearise(plant, outputs=("heading_rad",)),
        weights={"heading_rad": 1.0 / _ANGLE_ERROR},
        input_limits={"rudder_rad": (-limit, limit)},
        **settings,
    )


def _float_depth(plant: Plant, settings: dict[str, Any]) -> Gpc:
    engine = find_engine(plant)
    low, high = engine.middle - engine.half, engine.middle + engine.half
    return Gpc(
        linearise(plant, outputs=("depth_m",)),
        weights={"depth_m": 1.0 / (engine.speed * engine.time / 3.0)},
        input_limits={engine.channel: (low, high)},
        rate_limits={engine.channel: engine.rate} if engine.rate < inf else {},
        **settings,
    )


def _samples(plant: Plant, dt: float | None) -> int:
    """Samples of the plant from one plan to the next."""
    wanted = plant.dt if dt is None else dt
    if dt is None and plant.family.kind == "body":
        wanted = _length_time(plant) / _SAMPLES
    elif dt is None and plant.family.kind == "float":
        wanted = find_engine(plant).time / _ENGINE_SAMPLES
    samples = max(round(wanted / plant.dt), 1)
    if dt is not None and abs(samples * plant.dt - dt) > 1e-6 * dt:
        raise ValueError(f"gpc_autopilot needs dt a multiple of the {plant.dt:g} s of {plant.name!r}, got {dt!r}.")
    return samples


@lru_cache(maxsize=16)
def _length_time(plant: Plant) -> float:
    """Seconds in which a torpedo goes its length in cruise."""
    return plant.hull.length / find_cruise(plant).speed
