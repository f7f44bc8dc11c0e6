"""Channels computed from others: a glider's speed through the water."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

_SPEED_WINDOW: Final = 30.0  # s
_STEEP: Final = np.radians(8.0)  # below this pitch, depth rate over sin(pitch) is mostly noise
_SPEED_RANGE: Final = (0.05, 1.0)  # m/s; a Slocum without thruster glides at 0.2 to 0.5 m/s
_HALVINGS: Final = 60  # bisections of an interval of less than pi, down to rounding


def glide_speed(
    time: np.ndarray,
    depth: np.ndarray,
    pitch: np.ndarray,
    attack: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray | None:
    """Speed through the water, m/s, from the depth rate and the pitch of a glider; None if it never glides.

    -(rate of change of depth) / sin(pitch - attack), with depth rate and pitch averaged over 30 s around a sample.
    Below 8 degrees of pitch and at inflexions, where this is undefined, it is interpolated in time; it is clipped to
    0.05 to 1 m/s.
    attack: function from pitch to the angle of attack of a steady glide, both rad, such as `glide_attack`.  None
    neglects it: since the glide path is about 3 degrees steeper than the pitch, the speed is about 10 % too high, both
    up and down.  Vertical motion of the water adds a further error.
    """
    time, depth, pitch = (np.asarray(a, dtype=float) for a in (time, depth, pitch))
    known = np.isfinite(depth) & np.isfinite(pitch)
    if known.sum() < 3:
        return None
    t, z, angle = time[known], depth[known], pitch[known]
    before, after = (np.clip(time + half, t[0], t[-1]) for half in (-_SPEED_WINDOW / 2, _SPEED_WINDOW / 2))
    travelled = np.concatenate([[0.0], np.cumsum(np.diff(t) * 0.5 * (angle[1:] + angle[:-1]))])
    mean_pitch = (np.interp(after, t, travelled) - np.interp(before, t, travelled)) / (after - before)
    depth_rate = (np.interp(after, t, z) - np.interp(before, t, z)) / (after - before)
    steep = np.abs(mean_pitch) > _STEEP
    path = mean_pitch[steep] if attack is None else mean_pitch[steep] - attack(mean_pitch[steep])
    speed = np.full(time.size, np.nan)
    speed[steep] = -depth_rate[steep] / np.sin(path)
    good = np.flatnonzero(speed > 0.0)
    if good.size < 3:
        return None
    return np.clip(np.interp(time, time[good], speed[good]), *_SPEED_RANGE)


def glide_attack(
    pitch: np.ndarray | float, drag_0: float, drag_2: float, lift_1: float, lift_0: float = 0.0
) -> np.ndarray:
    """Angle of attack, rad, of a steady glide at a pitch, rad; NaN if the drag does not allow so shallow a glide.

    drag_0, drag_2, lift_0, lift_1: of the polar drag = (drag_0 + drag_2 attack^2) V^2, lift = (lift_0 + lift_1 attack)
    V^2, as in the part `Wings`; a common factor does not matter.  Gliding down at a negative pitch, the attack is
    positive; without lift_0, going up mirrors going down.  Of the two glides that a polar allows, the faster one is
    returned, below the attack of the best glide ratio.
    Source: Graver 2005, Underwater Gliders: Dynamics, Control and Design, PhD thesis, Princeton, ch. 4: in equilibrium,
    tan(pitch - attack) = -drag / lift.
    """
    if not (drag_0 > 0.0 and drag_2 > 0.0 and lift_1 > 0.0):
        raise ValueError(
            f"A glide needs drag_0, drag_2 and lift_1 above zero, got {drag_0:g}, {drag_2:g} and {lift_1:g}: give the "
            "coefficients of the whole vehicle."
        )
    pitch = np.asarray(pitch, dtype=float)
    no_lift = -lift_0 / lift_1
    best = np.sqrt(drag_0 / drag_2 + no_lift**2)  # from no_lift to the smallest drag / lift

    def path(beyond: np.ndarray | float) -> np.ndarray:
        """The path angle at an attack this far beyond no_lift."""
        drag = drag_0 + drag_2 * (no_lift + beyond) ** 2
        return -np.sign(beyond) * np.arctan2(drag, lift_1 * np.abs(beyond))

    # on either side, the pitch (path + attack) rises with the attack between no_lift and the best glide
    side = np.where(pitch < no_lift, 1.0, -1.0)
    low, high = np.zeros_like(pitch), np.full_like(pitch, best)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        steeper = side * (path(side * middle) + no_lift + side * middle - pitch) < 0.0
        low, high = np.where(steeper, middle, low), np.where(steeper, high, middle)
    shallowest = path(side * best) + no_lift + side * best
    return np.where(side * (pitch - shallowest) <= 0.0, no_lift + side * 0.5 * (low + high), np.nan)
