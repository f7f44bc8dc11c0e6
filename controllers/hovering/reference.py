"""Smooth reference from a vehicle's pose to its target, within speeds and accelerations that it can follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controllers.hovering.dynamics import POSE
from controllers.tracking import error_of


class Way(NamedTuple):
    """Position, speed and acceleration of a reference by channel of a pose, and which are controlled, (6,) each."""

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    steered: np.ndarray


@dataclass(frozen=True, eq=False)
class Pace:
    """The dynamics of a reference in each channel of a pose, (6,) each.

    frequency: rad/s, of a critically damped second-order system, while speeds are below `fastest` and accelerations
    below `hardest`.  Source: Fossen 2021, sec. 12.1.1 (reference models with velocity saturation).
    """

    frequency: np.ndarray
    fastest: np.ndarray
    hardest: np.ndarray

    def begin(self) -> Way:
        none = np.zeros(6)
        return Way(none, none, none, np.zeros(6, dtype=bool))

    def advance(self, way: Way, pose: np.ndarray, wanted: np.ndarray, known: np.ndarray, dt: float) -> Way:
        """The reference one sample later; channels that were not controlled before start from the vehicle's pose.

        pose, wanted: NaN without a reading or a target; such a channel is not controlled.  known: the pose with guesses
        for missing values.
        """
        steered = np.isfinite(pose) & np.isfinite(wanted)
        went_on = steered & way.steered
        position = np.where(went_on, way.position, known)
        speed = np.where(went_on, way.speed, 0.0)
        away = np.array([error_of(n, a, b) for n, a, b in zip(POSE, wanted, position, strict=True)])
        aimed = _within(0.5 * self.frequency * np.where(steered, away, 0.0), self.fastest)
        acceleration = _within(2.0 * self.frequency * (aimed - speed), self.hardest)
        speed = np.where(steered, speed + dt * acceleration, 0.0)
        return Way(position + dt * speed, speed, np.where(steered, acceleration, 0.0), steered)


def _within(values: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Values of a pose's channels within their limits; north and east are scaled together, for a straight path."""
    found = np.clip(values, -most, most)
    found[:2] = values[:2] * min(1.0, min(most[:2]) / max(float(np.hypot(*values[:2])), 1e-300))
    return found
