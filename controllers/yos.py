"""Yos of a glider in six degrees of freedom, by its engine and the position and angle of its battery.

It is a body moved by its volume and masses, see `auv_gym.plant.gliding`; for gliders that fly by a polar, see
`controllers.gliding`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2

from controllers.controller import check_targets, reading_of, target_of, time_step
from controllers.tracking import wrapped

_UNDER_WAY = 0.4  # of the engine's way from neutral; below this, a glider hardly moves and is not steered


@dataclass(frozen=True)
class Leg:
    """The parameters of a dive or a climb.

    volume: of the engine, m^3.  slide: position of the battery for the pitch, m.  pitch: set point, rad.
    per_pitch: proportional gain, m of battery position per rad of pitch error.  per_turn: proportional gain, rad of
    battery angle per rad of heading error, negative if a negative angle turns to starboard.  angle: largest one, rad.
    """

    volume: float
    slide: float
    pitch: float
    per_pitch: float
    per_turn: float
    angle: float


@dataclass(frozen=True)
class YoMemory:
    """Memory of a Yo: whether it climbs, the rate-limited engine volume, m^3 (None: unknown), error sums, rad s."""

    climbing: bool = False
    engine: float | None = None
    pitch_sum: float = 0.0
    heading_sum: float = 0.0


@dataclass(frozen=True)
class Yo:
    """The operators' rule: yos between two depths, on a heading or towards a place, with the battery by two PI loops.

    The engine reverses at the depths `top` and `apogee`, m. The pitch set point follows the volume of the engine,
    because a glider that raises its bow while it is still heavy stalls. The sign of the turn follows it, too. Both
    integrals are clamped against windup, and the integral of the heading error restarts in each dive and climb.
    channels: of engine, battery position and battery angle.  dive, climb: see `Leg`.  rate: of the engine, m^3/s.  low,
    high: limits of the battery's position, m.  pitch_time, heading_time: s, integral times.
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
        """Readings: depth_m, pitch_rad, heading_rad, dt_s, and north_m and east_m to fly to a place.

        target: heading_rad, or a place, whose depth is ignored; without either, the battery stays upright.
        """
        check_targets(self, target)
        dt, depth = time_step(reading), reading_of(self, "depth_m", reading)
        climbing = depth > self.top if state.climbing else depth >= self.apogee
        told = self.climb.volume if climbing else self.dive.volume
        engine = told if state.engine is None else state.engine
        engine += min(max(told - engine, -self.rate * dt), self.rate * dt)
        neutral = 0.5 * (self.dive.volume + self.climb.volume)
        share = (engine - neutral) / (self.climb.volume - neutral)  # -1 in a dive, 1 in a climb
        leg = self.climb if share > 0.0 else self.dive

        middle = 0.5 * (self.dive.slide + self.climb.slide)
        wanted = share * self.climb.pitch if share > 0.0 else -share * self.dive.pitch
        error = wanted - reading_of(self, "pitch_rad", reading)
        base = middle + abs(share) * (leg.slide - middle) + leg.per_pitch * error
        slide, pitch_sum = _clamped(
            base, leg.per_pitch / self.pitch_time, state.pitch_sum, error, dt, self.low, self.high
        )

        heading = self._heading(reading, target)
        angle, heading_sum = 0.0, 0.0
        if heading is not None and abs(share) > _UNDER_WAY:
            error = wrapped(heading - reading_of(self, "heading_rad", reading))
            angle, heading_sum = _clamped(
                leg.per_turn * error,
                leg.per_turn / self.heading_time,
                state.heading_sum,
                error,
                dt,
                -leg.angle,
                leg.angle,
            )
        command = dict(zip(self.channels, (told, slide, angle), strict=True))
        return command, YoMemory(climbing, engine, pitch_sum, heading_sum)

    def _heading(self, reading: Mapping[str, float], target: Mapping[str, float]) -> float | None:
        """The wanted heading, rad: the given one, or that of the place."""
        if "heading_rad" in target or "north_m" not in target:
            return target.get("heading_rad")
        north, east = (
            target_of(self, name, target) - reading_of(self, name, reading) for name in ("north_m", "east_m")
        )
        return atan2(east, north)


def _clamped(
    base: float, gain: float, total: float, error: float, dt: float, low: float, high: float
) -> tuple[float, float]:
    """A command with its integral part within its limits, and the sum, held while it would exceed a limit."""
    summed = total + error * dt
    wanted = base + gain * summed
    beyond = (wanted > high and gain * error > 0.0) or (wanted < low and gain * error < 0.0)
    return min(max(wanted, low), high), total if beyond else summed
