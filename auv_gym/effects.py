"""Every physical effect that a vehicle may have, each neutral by default.

An effect at its neutral value is the identity, bit for bit, and shows at first order when it leaves it, so that
switching, fitting or probing one changes numbers in the packed vector and nothing else. The compiled functions that
apply them are in `physics`. Probes are the smallest changes worth detecting in a heading log of ten minutes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

from auv_gym.param import param


@dataclass(frozen=True)
class ActuatorEffects:
    """What can happen to an angle command on its way to the fin.

    Order: gain and offset, deadband, backlash, dead time, saturation, then lag and rate limit.
    """

    offset: float = param(0.0, "rad", "rudder offset", bounds=(-0.5, 0.5), probe=0.010)
    gain: float = param(1.0, "1", "rudder gain", bounds=(0.05, 5.0), probe=0.10)
    deadband: float = param(0.0, "rad", "rudder deadband (half width)", bounds=(0.0, 0.5), probe=0.015)
    backlash: float = param(0.0, "rad", "rudder backlash (full width)", bounds=(0.0, 0.5), probe=0.03)
    dead_time: float = param(0.0, "s", "rudder dead time", bounds=(0.0, 20.0), probe=0.5)
    lost_travel: float = param(0.0, "rad", "rudder saturates early, by", bounds=(0.0, 1.0), probe=0.04)
    lag: float = param(0.0, "s", "rudder lag (time constant)", bounds=(0.0, 60.0), probe=0.5)
    slowness: float = param(0.0, "s/rad", "rudder rate limit, as time per angle", bounds=(0.0, 200.0), probe=2.0)


@dataclass(frozen=True)
class YawEffects:
    """Yaw moments that a first model of heading leaves out; positive turns the bow to starboard."""

    moment: float = param(0.0, "N m", "constant yaw moment", bounds=(-50.0, 50.0), probe=0.004)
    roll_moment: float = param(0.0, "N m/rad", "yaw moment from roll", bounds=(-100.0, 100.0), probe=0.10)
    speed_squared: float = param(0.0, "1", "rudder effectiveness with speed squared", bounds=(-3.0, 3.0), probe=0.15)
    quadratic_damping: float = param(0.0, "N m s^2/rad^2", "quadratic yaw damping", bounds=(0.0, 1e5), probe=16.0)


@dataclass(frozen=True)
class CompassEffects:
    """Errors of the measured heading: lag of the needle's field, then constant bias."""

    bias: float = param(0.0, "rad", "compass bias", bounds=(-pi, pi), probe=0.02)
    lag: float = param(0.0, "s", "compass lag (time constant)", bounds=(0.0, 60.0), probe=0.5)
    deviation_sin: float = param(0.0, "rad", "compass deviation, sine of heading", bounds=(-0.9, 0.9), probe=0.035)
    deviation_cos: float = param(0.0, "rad", "compass deviation, cosine of heading", bounds=(-0.9, 0.9), probe=0.035)


@dataclass(frozen=True)
class CurrentEffects:
    """Steady velocity of the water over ground."""

    north: float = param(0.0, "m/s", "steady current to the north", bounds=(-3.0, 3.0), probe=0.01)
    east: float = param(0.0, "m/s", "steady current to the east", bounds=(-3.0, 3.0), probe=0.01)


@dataclass(frozen=True)
class GliderEffects:
    """All effects of the heading family."""

    rudder: ActuatorEffects = field(default_factory=ActuatorEffects)
    yaw: YawEffects = field(default_factory=YawEffects)
    compass: CompassEffects = field(default_factory=CompassEffects)
    current: CurrentEffects = field(default_factory=CurrentEffects)
