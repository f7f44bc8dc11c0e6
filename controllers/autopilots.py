"""The controller of a vehicle for all of its targets, from tuned gains and the vehicle's own limits and signs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from auv_gym.param import did_you_mean
from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import Cruise, command_limits, find_cruise, find_helm, resting_commands
from auv_gym.plant.float_engine import find_engine
from controllers.composed.loops import Cascade, Joint, Mirrored, commands_of
from controllers.controller import Controller
from controllers.gains import Gains, NoGains, gains_for
from controllers.pid import Pid
from controllers.s_plane import SPlane
from controllers.tracking import Points

KINDS = ("pid", "s_plane", "gpc")
TARGETS = {"body": ("depth_m", "heading_rad", "u_mps"), "glider": ("heading_rad",), "float": ("depth_m",)}
_POINTS = 9  # of the steady speeds at commands from rest to the limit
_FASTEST = 20.0  # m/s


def autopilot(plant: Plant, kind: str = "pid", targets: Sequence[str] | None = None, **settings: Any) -> Controller:
    """The controller of a vehicle for its targets; all that it needs of the vehicle it takes from the plant.

    kind: "pid", "s_plane" or "gpc".  targets: channels, by default depth, heading and speed of a torpedo, a glider's
    heading, a float's depth; `pitch_rad` in the place of depth.  settings: of `pid_autopilot`, `s_plane_autopilot` or
    `gpc_autopilot`.  A channel without a target is left alone.
    """
    if kind == "pid":
        return pid_autopilot(plant, targets, **settings)
    if kind == "s_plane":
        return s_plane_autopilot(plant, targets, **settings)
    if kind == "gpc":
        from controllers.predictive.gpc_autopilot import gpc_autopilot  # needs a solver

        chosen = {} if targets is None else {"targets": tuple(targets)}
        return gpc_autopilot(plant, **chosen, **settings)
    raise ValueError(f"No autopilot of kind {kind!r}. {did_you_mean(kind, KINDS)}Kinds: {', '.join(KINDS)}.")


def usual_autopilot(plant: Plant) -> Controller:
    """The PID autopilot where gains are tuned for the vehicle; else predictive control, which needs none."""
    try:
        return autopilot(plant)
    except NoGains:
        return autopilot(plant, "gpc")


def pid_autopilot(
    plant: Plant,
    targets: Sequence[str] | None = None,
    *,
    dt: float | None = None,
    pitch_limit: float | None = None,
    gains: str | os.PathLike | Gains | None = None,
) -> Controller:
    """PID loops with the gains tuned for the vehicle: depth by way of pitch, heading, speed; a float's depth.

    dt: s between calls, default the plant's.  pitch_limit: rad, in place of the tuned one.  gains: a file, or the
    gains themselves.  Raises where there are none for this vehicle and time.
    """
    chosen = _targets(plant, targets, also=("pitch_rad",) if plant.family.kind == "body" else ())
    known = gains if isinstance(gains, Gains) else gains_for(plant.name, plant.dt if dt is None else dt, gains)
    if plant.family.kind == "glider":
        return Pid(**_settings(known, "pid", "heading"), limit=plant.hull.rudder_limit)
    if plant.family.kind == "float":
        return _engine_pid(plant, known)
    cruise, limits, helm = _cruise(plant), command_limits(plant), find_helm(plant)
    rudder, plane, propulsion = (float(cruise.commands[i]) for i in (helm.rudder, helm.plane, helm.drive))
    pitch = Pid(
        **_settings(known, "pid", "pitch"),
        measured="pitch_rad",
        command=plant.inputs[helm.plane],
        rate_measured="q_radps",
        limit=float(limits[helm.plane]),
        neutral=plane,
    )
    loops: dict[str, Controller] = {
        "heading_rad": Pid(
            **_settings(known, "pid", "heading"),
            command=plant.inputs[helm.rudder],
            rate_measured="r_radps",
            limit=float(limits[helm.rudder]),
            neutral=rudder,
        ),
        "u_mps": Pid(
            **_settings(known, "pid", "speed"),
            measured="u_mps",
            command=plant.inputs[helm.drive],
            limit=0.5 * float(limits[helm.drive]),
            middle=0.5 * float(limits[helm.drive]),
            neutral=propulsion,
            steady=steady_speeds(plant),
        ),
        "pitch_rad": pitch,
    }
    if "depth_m" in chosen:
        settings = _settings(known, "pid", "depth")
        if pitch_limit is not None:
            settings["limit"] = pitch_limit
        level = min(
            max(float(cruise.state[plant.family.states.index("pitch_rad")]), -settings["limit"]), settings["limit"]
        )
        outer = Pid(**settings, measured="depth_m", command="pitch_rad", neutral=level)
        loops["depth_m"] = Cascade(outer, pitch)
    return _joined(plant, [loops[name] for name in chosen], known)


def s_plane_autopilot(
    plant: Plant,
    targets: Sequence[str] | None = None,
    *,
    dt: float | None = None,
    gains: str | os.PathLike | Gains | None = None,
) -> Controller:
    """S-plane loops of a torpedo, each from one channel straight to one command, as Xu et al. 2013 have them.

    dt: s between calls, default the plant's.  gains: a file, or the gains themselves.  Raises where there are none for
    this vehicle and time.
    """
    if plant.family.kind != "body":
        raise ValueError(
            f"S-plane control is there for vehicles in six degrees of freedom, got {plant.name!r} of family "
            f"{plant.family.name!r}: take kind 'pid'."
        )
    chosen = _targets(plant, targets)
    known = gains if isinstance(gains, Gains) else gains_for(plant.name, plant.dt if dt is None else dt, gains)
    cruise, limits, helm = _cruise(plant), command_limits(plant), find_helm(plant)
    rudder, plane, propulsion = (float(cruise.commands[i]) for i in (helm.rudder, helm.plane, helm.drive))
    to_starboard, to_nose_up = (float(np.sign(gain)) for gain in (cruise.rudder_gains[2], cruise.plane_gains[2]))
    loops = {
        "heading_rad": SPlane(
            **_settings(known, "s_plane", "heading"),
            command=plant.inputs[helm.rudder],
            span=to_starboard * float(limits[helm.rudder]),
            rate_measured="r_radps",
            limit=float(limits[helm.rudder]),
            neutral=rudder,
        ),
        "depth_m": SPlane(
            **_settings(known, "s_plane", "depth"),
            span=-to_nose_up * float(limits[helm.plane]),
            measured="depth_m",
            command=plant.inputs[helm.plane],
            limit=float(limits[helm.plane]),
            neutral=plane,
        ),
        "u_mps": SPlane(
            **_settings(known, "s_plane", "speed"),
            span=0.5 * float(limits[helm.drive]),
            measured="u_mps",
            command=plant.inputs[helm.drive],
            limit=0.5 * float(limits[helm.drive]),
            middle=0.5 * float(limits[helm.drive]),
            neutral=propulsion,
            steady=steady_speeds(plant),
        ),
    }
    return _joined(plant, [loops[name] for name in chosen], known)


def steady_speeds(plant: Plant) -> Points:
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


@lru_cache(maxsize=16)
def _cruise(plant: Plant) -> Cruise:
    return find_cruise(plant)  # a tenth of a second


def _engine_pid(plant: Plant, gains: Gains) -> Pid:
    engine = find_engine(plant)
    return Pid(
        **_settings(gains, "pid", "depth"),
        measured="depth_m",
        command=engine.channel,
        limit=engine.half,
        rate_limit=engine.rate,
        middle=engine.middle,
        neutral=float(plant.hull.piston_neutral) if engine.channel == "piston_m" else 0.0,
    )


def _joined(plant: Plant, loops: Sequence[Controller], gains: Gains) -> Controller:
    """The loops side by side; the bow planes share the work of the stern planes where they are to."""
    source, *mirrors = plant.family.body.by_role()["pitch"]
    shared = list(loops)
    if mirrors and gains.bow_share != 0.0:
        shared = [
            Mirrored(loop, gains.bow_share, source=source, command=mirrors[0]) if source in commands_of(loop) else loop
            for loop in loops
        ]
    return Joint(tuple(shared))


def _targets(plant: Plant, targets: Sequence[str] | None, also: tuple[str, ...] = ()) -> tuple[str, ...]:
    known = TARGETS[plant.family.kind]
    chosen = known if targets is None else tuple(targets)
    for name in chosen:
        if name not in (*known, *also):
            raise ValueError(
                f"An autopilot of {plant.name!r} has no loop for {name!r}. {did_you_mean(name, (*known, *also))}"
                f"Targets: {', '.join((*known, *also))}."
            )
    if not chosen or len(set(chosen)) < len(chosen) or {"depth_m", "pitch_rad"} <= set(chosen):
        raise ValueError(
            f"An autopilot needs targets of their own, got {', '.join(chosen) or 'none'}: name each once, and depth_m "
            "or pitch_rad, which move the same plane."
        )
    return chosen


def _settings(gains: Gains, kind: str, loop: str) -> dict[str, Any]:
    try:
        return dict(gains.loops[kind][loop])
    except KeyError:
        there = ", ".join(f"{k}.{name}" for k, loops in gains.loops.items() for name in loops)
        raise ValueError(
            f"The gains of {gains.vehicle!r} at {gains.dt:g} s have no {kind}.{loop}, but {there or 'nothing'}: add it "
            "to the gains that you give, or choose other targets or another kind."
        ) from None
