"""Autopilots of a glider in six degrees of freedom: yos on a heading or to a place, with gains from steady glides."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np

from auv_gym.models.linear import linearise
from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import command_ranges
from auv_gym.plant.gliding import PITCH, engine_half, find_masses, neutral_volume, steady_glide
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.kinds import ControlKind, Ranges
from controllers.yos import Leg, Yo

_PLACE = ("north_m", "east_m", "depth_m")
_TOP, _APOGEE = 12.0, 48.0  # m, limits of its yos: in the usual 60 m of water, this leaves room for the pump
_LIFT = 0.75  # of the engine's range to either side
_SMALL = 0.05  # rad, of pitch and of the battery's angle, over which steady glides give slopes
_ROLL = 0.35  # rad, the steepest roll of a turn: a climbing Seawing tips over at twice that
_SETTLE = 30.0  # s, in which a heading error is to vanish
_SHARE = 0.5  # of the battery displacement that would remove a pitch error in steady motion


def _placed(
    plant: Plant,
    targets: tuple[str, ...],
    dt: float | None,
    *,
    top: float = _TOP,
    apogee: float = _APOGEE,
    lift: float = _LIFT,
    pitch: float = PITCH,
    gains: Gains | None = None,
) -> Controller:
    """The autopilot of yos; top, apogee: m, start of dives and climbs.  lift: share of the engine.  pitch: rad.

    Gains follow from steady glides and the linearisation about the dive.
    """
    if gains is not None:
        raise ValueError(f"The gains of {plant.name!r} follow from its steady glides: leave out gains=.")
    if set(targets) != {"heading_rad"} and set(targets) != set(_PLACE):
        raise ValueError(
            f"An autopilot of {plant.name!r} flies yos on heading_rad, or to north_m, east_m and depth_m together: "
            f"name either, got {', '.join(targets)}."
        )
    if not (0.0 < top < apogee and 0.0 < lift <= 1.0 and 0.1 <= pitch <= 1.2):
        raise ValueError(
            f"Yos need 0 < top < apogee in m, lift from 0 to 1 and pitch from 0.1 to 1.2 rad, got {top!r}, {apogee!r}, "
            f"{lift!r} and {pitch!r}."
        )
    masses, depth = find_masses(plant), 0.5 * (top + apogee)
    neutral, half = neutral_volume(plant, depth), lift * engine_half(plant, depth)
    ranges = command_ranges(plant)
    dive, climb = (_leg(plant, neutral + side * half, side * pitch, depth) for side in (-1.0, 1.0))
    clean = without_effects(plant)
    _, _, slowness = plant.family.hooks.actuator_times(masses.volume, plant.family.view(clean.derived))
    glide = steady_glide(plant, dive.volume, dive.pitch, depth)
    slide = plant.inputs[masses.slide]
    # its slowest motions except a drift of position, s: control slower than these needs only the steady slope
    poles = linearise(plant, [slide], ["pitch_rad"], at=(glide.state, glide.commands)).poles()
    slowest = plant.dt / -log(float(np.abs(poles).max()))
    return Yo(
        channels=(plant.inputs[masses.volume], slide, plant.inputs[masses.turn]),
        dive=dive,
        climb=climb,
        top=top,
        apogee=apogee,
        rate=1.0 / slowness if slowness > 0.0 else np.inf,
        low=float(ranges[masses.slide, 0]),
        high=float(ranges[masses.slide, 2]),
        pitch_time=slowest,
        heading_time=4.0 * _SETTLE,
    )


def _leg(plant: Plant, volume: float, pitch: float, depth: float) -> Leg:
    """A dive or climb, with gains from the change of steady glides with pitch and with the battery's angle.

    Heading integrates the turn; its gain is that of Skogestad 2003, J. Process Control 13, table 1, which gives the
    closed loop the time constant _SETTLE.
    """
    masses = find_masses(plant)
    straight = steady_glide(plant, volume, pitch, depth)
    steeper = steady_glide(plant, volume, pitch + _SMALL, depth)
    turning = steady_glide(plant, volume, pitch, depth, _SMALL)
    place, further = (float(g.commands[masses.slide]) for g in (straight, steeper))
    roll_at = plant.family.states.index("roll_rad")
    turn, roll = (turning.turn - straight.turn) / _SMALL, (turning.state[roll_at] - straight.state[roll_at]) / _SMALL
    if turn == 0.0:
        raise ValueError(
            f"{plant.name!r} does not turn with {plant.inputs[masses.turn]} at a pitch of {pitch:.3g} rad: it needs a "
            "mass that is off its axis, and wings, or another pitch."
        )
    most = float(command_ranges(plant)[masses.turn, 2])
    return Leg(
        volume=volume,
        slide=place,
        pitch=pitch,
        per_pitch=_SHARE * (further - place) / _SMALL,
        per_turn=1.0 / (turn * _SETTLE),
        angle=min(most, _ROLL / max(abs(roll), 1e-9)),
    )


def _ranges(plant: Plant) -> Ranges:
    low, _, high = command_ranges(plant).T
    return {name: (float(a), float(b)) for name, a, b in zip(plant.family.actuators, low, high, strict=True)}


def _on_board(plant: Plant, targets: tuple[str, ...]) -> Controller:
    return _placed(plant, targets, None)


KIND = ControlKind(
    targets=("heading_rad",),
    asked=_PLACE,
    plans=dict[str, Any](),
    placed=_placed,
    on_board=_on_board,
    ranges=_ranges,
)
