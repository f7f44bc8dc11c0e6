"""Autopilots: the controller of a vehicle for all of its targets, from tuned gains and the vehicle's own limits."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from math import radians
from typing import Any

from auv_gym.param import check_names, did_you_mean
from auv_gym.plant import Plant, check_vehicle
from controllers.composed.loops import Joint
from controllers.controller import Controller
from controllers.gains import Gains, Loops, NoGains, gains_for
from controllers.kinds import KINDS, ControlKind

LAWS = ("pid", "s_plane", "gpc")


def autopilot(plant: Plant, kind: str = "pid", targets: Sequence[str] | None = None, **settings: Any) -> Controller:
    """Make a vehicle's controller for its targets, with limits, signs and trim taken from the plant.

    kind: "pid", "s_plane" or "gpc".  targets: channels, by default depth, heading and speed of a torpedo, a glider's
    heading, a float's depth, position and heading of a vehicle that hovers; `pitch_rad` may replace a torpedo's depth.
    settings: of `pid_autopilot`, `s_plane_autopilot` or `gpc_autopilot`.  A channel without a target is not controlled.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from controllers import autopilot
        >>> pilot = autopilot(load_vehicle("remus100"), targets=["heading_rad", "depth_m"])
        >>> pilot.commands
        ('rudder_rad', 'stern_plane_rad')
    """
    check_vehicle("autopilot", plant)
    if targets is not None:
        check_names("targets", targets)
    if kind == "pid":
        return pid_autopilot(plant, targets, **settings)
    if kind == "s_plane":
        return s_plane_autopilot(plant, targets, **settings)
    if kind == "gpc":
        return gpc_autopilot(plant, targets, **settings)
    raise ValueError(f"No autopilot of kind {kind!r}. {did_you_mean(kind, LAWS)}Kinds: {', '.join(LAWS)}.")


def usual_autopilot(plant: Plant) -> Controller:
    """The PID autopilot if gains are tuned for the vehicle; otherwise predictive control, which needs none.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from controllers import usual_autopilot
        >>> usual_autopilot(load_vehicle("slocum")).command
        'rudder_rad'
    """
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
    **own: Any,
) -> Controller:
    """PID loops with the gains tuned for the vehicle: depth by pitch, heading, speed; a float's depth.

    dt: s between calls, default the plant's.  pitch_limit: rad, instead of the tuned one.  gains: a file, or the gains
    themselves.  Raises if there are none for this vehicle and sample time.
    A vehicle that hovers needs no gains: they follow from its model and from its own settings, see `controllers.kinds`;
    given gains hold such settings by axis.
    """
    kind = KINDS.of(plant.family)
    _check_pitch_limit(plant, kind, pitch_limit)
    chosen = _targets(plant, targets, kind)
    if kind.placed is not None:
        tuned = None if gains is None else _gains(plant, dt, gains)
        return kind.placed(plant, chosen, dt, gains=tuned, **own)
    if own or kind.pid is None:
        raise TypeError(f"pid_autopilot of {plant.name!r} does not take {', '.join(own)}")
    return kind.pid(plant, chosen, _gains(plant, dt, gains), pitch_limit)


def s_plane_autopilot(
    plant: Plant,
    targets: Sequence[str] | None = None,
    *,
    dt: float | None = None,
    gains: str | os.PathLike | Gains | None = None,
) -> Controller:
    """S-plane loops of a torpedo, each from one channel directly to one command, as in Xu et al. 2013.

    dt: s between calls, default the plant's.  gains: a file, or the gains themselves.  Raises if there are none for
    this vehicle and sample time.
    """
    kind = KINDS.of(plant.family)
    if kind.s_plane is None:
        raise ValueError(
            f"S-plane control is there for vehicles in six degrees of freedom, got {plant.name!r} of family "
            f"{plant.family.name!r}: take kind 'pid'."
        )
    return kind.s_plane(plant, _targets(plant, targets, kind, kind.targets), _gains(plant, dt, gains))


def gpc_autopilot(
    plant: Plant,
    targets: Sequence[str] | None = None,
    *,
    dt: float | None = None,
    pitch_limit: float | None = None,
    gains: str | os.PathLike | Gains | None = None,
    **settings: Any,
) -> Controller:
    """Predictive control on `linearise(plant)`: depth, heading and speed of a torpedo, each by its own Gpc.

    Planes hold the depth within pitch_limit, rad, default 20 degrees either side of trim; rudder and propulsion control
    the rest; fins are deflected more at lower speed.  A glider's rudder holds its heading, a float's engine its depth.
    Each motion has its own controller, since at cruise they are decoupled at first order.
    targets: some of these channels, default all; `pitch_rad` may replace depth.  dt: s between plans, a multiple of the
    plant's, at which the filters run; default a third of the time for a torpedo's length, a fifteenth of the time of a
    float's engine.  gains: a file, or the gains themselves, with settings of each channel's Gpc.  settings: further
    ones of every Gpc.
    """
    kind = KINDS.of(plant.family)
    makers = kind.plans
    if not makers:
        raise ValueError(f"There is no predictive control of vehicles like {plant.name!r}: take kind 'pid'.")
    names = kind.targets if targets is None else tuple(targets)
    unknown = [name for name in names if name not in makers]
    if unknown or not names:
        raise ValueError(
            f"gpc_autopilot of {plant.name!r} needs targets among {', '.join(makers)}, got "
            f"{', '.join(unknown) or 'none'}."
        )
    _check_pitch_limit(plant, kind, pitch_limit)
    if pitch_limit is not None and "depth_m" in names:
        settings = {**settings, "pitch_limit": pitch_limit}
    settings = {"every": _samples(plant, kind.every, dt), **settings}
    tuned: Loops = {} if gains is None else _gains(plant, None, gains).loops.get("gpc", {})
    if kind.joined is None:
        made = [makers[name](plant, {**tuned.get(name, {}), **settings}) for name in names]
        return made[0] if len(made) == 1 else Joint(tuple(made))
    shared = {name: settings.pop(name) for name in kind.shared if name in settings}
    names = tuple(dict.fromkeys((*names, *kind.held(plant))))
    return kind.joined(plant, [makers[name](plant, {**tuned.get(name, {}), **settings}) for name in names], **shared)


def _samples(plant: Plant, every: Callable[[Plant], float], dt: float | None) -> int:
    """The number of the plant's samples between plans."""
    samples = max(round((every(plant) if dt is None else dt) / plant.dt), 1)
    if dt is not None and abs(samples * plant.dt - dt) > 1e-6 * dt:
        raise ValueError(f"gpc_autopilot needs dt a multiple of the {plant.dt:g} s of {plant.name!r}, got {dt!r}.")
    return samples


def _check_pitch_limit(plant: Plant, kind: ControlKind, limit: float | None) -> None:
    dives = ("depth_m", "pitch_rad") in kind.alternatives
    if limit is not None and (not dives or not 0.0 < limit < radians(85.0)):
        raise ValueError(
            f"pitch_limit= is for vehicles that dive by pitch, 0 to 1.48 rad, got {limit!r} for {plant.name!r}: leave "
            "it out, or give an angle in between."
        )


def _gains(plant: Plant, dt: float | None, gains: str | os.PathLike | Gains | None) -> Gains:
    return gains if isinstance(gains, Gains) else gains_for(plant.name, plant.dt if dt is None else dt, gains)


def _targets(
    plant: Plant, targets: Sequence[str] | None, kind: ControlKind, followed: tuple[str, ...] | None = None
) -> tuple[str, ...]:
    known = kind.followed if followed is None else followed
    chosen = kind.targets if targets is None else tuple(targets)
    for name in chosen:
        if name not in known:
            raise ValueError(
                f"An autopilot of {plant.name!r} has no loop for {name!r}. {did_you_mean(name, known)}"
                f"Targets: {', '.join(known)}."
            )
    twice = [names for names in kind.alternatives if set(names) <= set(chosen)]
    if not chosen or len(set(chosen)) < len(chosen) or twice:
        either = "".join(f", and {' or '.join(names)}, which move the same plane" for names in kind.alternatives)
        raise ValueError(
            f"An autopilot needs targets of their own, got {', '.join(chosen) or 'none'}: name each once{either}."
        )
    return chosen
