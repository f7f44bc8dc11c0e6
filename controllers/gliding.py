"""Autopilots of flying gliders: to a depth, and in yos to a waypoint in a current, as operators fly them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import asin, atan2, cos, remainder, sin, tau

from auv_gym.plant import Plant
from auv_gym.plant.flying import Flight, battery_for, turning_input
from controllers.controller import check_targets, reading_of, target_of, time_step

_STEEPEST = 0.9  # of the speed; largest component that a heading may use to compensate for a cross current
_SOFT = 2.0  # samples in which a heading error is to vanish


@dataclass(frozen=True)
class GlideToDepth:
    """Engine and pitch in proportion to the distance from the wanted depth, within `band` m of it; no memory.

    neutral, half: m^3, the engine's volume at rest and its range about it.  pitch: rad, the steepest.
    steered: the glider whose battery sets the pitch, None if pitch itself is commanded.
    """

    neutral: float
    half: float
    pitch: float
    band: float
    steered: Plant | None = None

    targets = ("depth_m",)

    @property
    def commands(self) -> tuple[str, ...]:
        return ("buoyancy_volume_m3", "pitch_rad" if self.steered is None else "battery_position_m")

    def start(self) -> None:
        return None

    def act(
        self, state: None, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], None]:
        """Readings: depth_m.  Target: depth_m."""
        below = target_of(self, "depth_m", target) - reading_of(self, "depth_m", reading)
        check_targets(self, target)
        share = min(max(below / self.band, -1.0), 1.0)
        engine, pitch = self.neutral - share * self.half, -share * self.pitch
        moved = pitch if self.steered is None else battery_for(self.steered, pitch, engine)
        return dict(zip(self.commands, (engine, moved), strict=True)), None


@dataclass(frozen=True)
class YoPilot:
    """The operators' rule: yos between the surface and a depth, on a heading that compensates for the last current.

    plant: the steered glider.  neutral, lift: m^3, the engine's volume at rest and its deviation from it in flight.
    pitch: rad, of dives and climbs.  apogee: m, start of a climb.  surface: m, start of the next dive.
    flight: steady flight of a dive, which gives the turn rate by roll or fin.  The memory is whether it climbs.
    """

    plant: Plant
    neutral: float
    lift: float
    pitch: float
    apogee: float
    surface: float
    flight: Flight

    targets = ("north_m", "east_m", "depth_m")

    @property
    def commands(self) -> tuple[str, ...]:
        return ("buoyancy_volume_m3", "battery_position_m", turning_input(self.plant)[0])

    def start(self) -> bool:
        return False

    def act(
        self, state: bool, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], bool]:
        """Readings: depth_m, heading_rad, north_m, east_m, dt_s, and the current if known.  Target: a place.

        The target's depth is ignored.
        """
        check_targets(self, target)
        depth, own = (reading_of(self, name, reading) for name in ("depth_m", "heading_rad"))
        to_north, to_east = (
            target_of(self, name, target) - reading_of(self, name, reading) for name in ("north_m", "east_m")
        )
        climbing = depth > self.surface if state else depth >= self.apogee
        side = 1.0 if climbing else -1.0
        engine = self.neutral + side * self.lift
        course = atan2(to_east, to_north)
        north, east = (reading.get(f"current_{name}_mps", 0.0) for name in ("north", "east"))
        across = (east * cos(course) - north * sin(course)) / (self.flight.speed * cos(self.flight.path))
        heading = course - asin(min(max(across, -_STEEPEST), _STEEPEST))
        turn = remainder(heading - own, tau) / (_SOFT * time_step(reading))
        moved = (engine, battery_for(self.plant, side * self.pitch, engine), self._turned(turn, side))
        return dict(zip(self.commands, moved, strict=True)), climbing

    def _turned(self, turn: float, side: float) -> float:
        """The fin angle, or the battery's angle, rad, for a turn rate, rad/s."""
        s, (name, limit) = self.plant.parameters.steering, turning_input(self.plant)
        if name == "rudder_rad":
            angle = turn / (self.flight.speed * s.turn_rudder)
        else:
            sine = turn / (self.flight.speed * s.turn_roll * -side * abs(self.flight.attack))
            angle = (asin(min(max(sine, -1.0), 1.0)) - s.roll) / s.roll_mass
        return min(max(angle, -limit), limit)
