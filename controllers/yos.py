"""Yos of a glider in six degrees of freedom, as its operators would have it fly: engine, place and angle of its battery.

A body that its volume and masses move, see `auv_gym.plant.gliding`; `controllers.gliding` has gliders that fly by a
polar.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2

from controllers.tracking import wrapped

_UNDER_WAY = 0.4  # of the engine's way from neutral, below which a glider hardly moves and is not steered


@dataclass(frozen=True)
class Leg:
    """How a dive or a climb is flown.

    volume: m^3, of the engine.  slide: m, where the battery gives the pitch, rad.  per_pitch: m per rad, how far it
    slides for more.  per_turn: rad of the battery's angle per rad of heading error, negative where a turn to starboard
    takes a negative angle.  angle: rad, its largest angle.
    """

    volume: float
    slide: float
    pitch: float
    per_pitch: float
    per_turn: float
    angle: float


@dataclass(frozen=True)
class YoMemory:
    """Memory of a Yo: whether it climbs, m^3 where its engine is by its rate (None: not known), sums of errors, s."""

    climbing: bool = False
    engine: float | None = None
    pitch_sum: float = 0.0
    heading_sum: float = 0.0


@dataclass(frozen=True)
class Yo:
    """The operators' rule: yos between two depths, on a heading or towards a place, with the battery by two PI loops.

    The engine changes over at the depths `top` and `apogee`, m. The pitch set point follows the engine, since a glider
    that is still heavy must not raise its bow. The sign of the turn follows it, too. Both loops clamp their integrals
    against windup, and the heading's starts anew in each dive and climb.
    channels: of engine, place and angle of the battery.  dive, climb: see `Leg`.  rate: m^3/s of the engine.  low,
    high: m, ends of the battery's way.  pitch_time, heading_time: s, integral times.
    """

    channels: tuple[str, str, str]
    dive: Leg
    climb: Leg
    top: float
    apogee: float
    rate: float
    low: float
    high: float
    pitch_time: float
    heading_time: float

    targets = ("heading_rad",)

    @property
    def commands(self) -> tuple[str, ...]:
        return self.channels

    def start(self) -> YoMemory:
        return YoMemory()

    def act(
        self, state: YoMemory, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], YoMemory]:
        """reading: depth_m, pitch_rad, heading_rad, dt_s, for a place north_m and east_m.  target: a heading or a place.

        Without either the glider keeps straight on; the depth of a place is left alone.
        """
        dt, depth = reading["dt_s"], reading["depth_m"]
        climbing = depth > self.top if state.climbing else depth >= self.apogee
        told = self.climb.volume if climbing else self.dive.volume
        engine = told if state.engine is None else state.engine
        engine += min(max(told - engine, -self.rate * dt), self.rate * dt)
        neutral = 0.5 * (self.dive.volume + self.climb.volume)
        share = (engine - neutral) / (self.climb.volume - neutral)  # -1 in a dive, 1 in a climb
        leg = self.climb if share > 0.0 else self.dive

        middle = 0.5 * (self.dive.slide + self.climb.slide)
        wanted = share * self.climb.pitch if share > 0.0 else -share * self.dive.pitch
        error = wanted - reading["pitch_rad"]
        base = middle + abs(share) * (leg.slide - middle) + leg.per_pitch * error
        slide, pitch_sum = _clamped(base, leg.per_pitch / self.pitch_time, state.pitch_sum, error, dt, self.low, self.high)

        heading = self._heading(reading, target)
        angle, heading_sum = 0.0, 0.0
        if heading is not None and abs(share) > _UNDER_WAY:
            error = wrapped(heading - reading["heading_rad"])
            angle, heading_sum = _clamped(
                leg.per_turn * error, leg.per_turn / self.heading_time, state.heading_sum, error, dt, -leg.angle, leg.angle
            )
        command = dict(zip(self.channels, (told, slide, angle), strict=True))
        return command, YoMemory(climbing, engine, pitch_sum, heading_sum)

    def _heading(self, reading: Mapping[str, float], target: Mapping[str, float]) -> float | None:
        """The wanted heading, rad: the one that is asked for, or else that of the place."""
        if "heading_rad" in target or "north_m" not in target:
            return target.get("heading_rad")
        return atan2(target["east_m"] - reading["east_m"], target["north_m"] - reading["north_m"])


def _clamped(
    base: float, gain: float, total: float, error: float, dt: float, low: float, high: float
) -> tuple[float, float]:
    """A command with its integral part within its limits, and the sum, which rests where it would push beyond one."""
    summed = total + error * dt
    wanted = base + gain * summed
    beyond = (wanted > high and gain * error > 0.0) or (wanted < low and gain * error < 0.0)
    return min(max(wanted, low), high), total if beyond else summed
