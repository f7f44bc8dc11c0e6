"""An envelope around an experiment: a guard takes over before depth, pitch or speed leave their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from auv_gym.channels import channel, wrap
from controllers.composed.excited import command_without_excitation
from controllers.composed.loops import commanded_inputs, targets_of
from controllers.controller import Controller, time_step


class Track(NamedTuple):
    """The filtered readings of a channel: value, and rate per s."""

    value: float
    rate: float


class EnvelopeState(NamedTuple):
    """Memories of both controllers, tracks by channel, whether the guard acts, why, and the time since all was well."""

    controller: Any
    guard: Any
    tracks: Mapping[str, Track]
    guarding: bool
    causes: frozenset[str]
    calm: float


@dataclass(frozen=True, eq=False)
class Envelope:
    """A controller that switches to a guard when a reading is about to leave its limits.

    limits: (low, high) by channel, of readings and of their prediction for a sample plus `lookahead`, s, ahead.
    release: all channels must be this share of half the range inside their limits for `calm`, s, before the controller
    acts again.  smoothing: s, filter time of value and rate; 0: differences.  rates: channels that measure the rate of
    a limited one, {"pitch_rad": "q_radps"}.  safe: targets of the guard; default the present ones, moved inside.
    Both controllers always get the same inputs, so that two with the same law have the same memory and hand over
    without a bump; a guard with an integral beside a controller without one would wind up.
    Reports `envelope_flag`, 1 while the guard acts, and `envelope_<channel>_flag`, 1 for the channels that caused it.

    Example:

        >>> from controllers import Envelope, Pid
        >>> gentle = Pid(0.2, limit=0.1)
        >>> safe = Envelope(Pid(2.0, limit=0.4), guard=gentle, limits={"roll_rad": (-0.3, 0.3)})
        >>> reading = {"heading_rad": 0.0, "roll_rad": 0.35, "dt_s": 1.0}
        >>> command, memory = safe.act(safe.start(), reading, {"heading_rad": 1.0})
        >>> command["rudder_rad"], command["envelope_flag"]
        (0.1, 1.0)
    """

    controller: Controller
    guard: Controller
    limits: Mapping[str, Sequence[float]]
    release: float = 0.3
    lookahead: float = 3.0
    calm: float = 5.0
    smoothing: float = 1.0
    rates: Mapping[str, str] = field(default_factory=dict)
    safe: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.limits:
            raise ValueError("Envelope needs limits, such as {'depth_m': (5.0, 25.0)}, got none.")
        for name, given in self.limits.items():
            channel(name)  # raises if it is unknown
            low, high = given
            if not -inf < low < high < inf:
                raise ValueError(f"Envelope needs finite limits of {name}, low before high, got {list(given)}.")
        if not 0.0 < self.release < 1.0:
            raise ValueError(f"Envelope needs release between 0 and 1 of half a range, got {self.release!r}.")
        for name in ("lookahead", "calm", "smoothing"):
            if not 0.0 <= getattr(self, name) < inf:
                raise ValueError(f"Envelope needs {name} >= 0 s, got {getattr(self, name)!r}.")
        for name in self.rates:
            if name not in self.limits:
                raise ValueError(f"Envelope has a rate of {name}, which has no limits: {', '.join(self.limits)} have.")
        for name, value in self.safe.items():
            if name in self.limits and not self.limits[name][0] <= value <= self.limits[name][1]:
                raise ValueError(f"Envelope needs a safe target of {name} inside {self.limits[name]}, got {value!r}.")

    @property
    def targets(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*targets_of(self.controller), *targets_of(self.guard))))

    @property
    def commands(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*commanded_inputs(self.controller), *commanded_inputs(self.guard))))

    def start(self) -> EnvelopeState:
        return EnvelopeState(self.controller.start(), self.guard.start(), {}, False, frozenset(), 0.0)

    def act(
        self, state: EnvelopeState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], EnvelopeState]:
        dt = time_step(reading)
        tracks = {name: self._tracked(name, state.tracks.get(name), reading) for name in self.limits}
        horizon = dt + self.lookahead  # the present command is held for a sample
        leaving = frozenset(name for name, track in tracks.items() if self._beyond(name, track, horizon, 1.0))
        inside = not any(self._beyond(name, track, horizon, 1.0 - self.release) for name, track in tracks.items())
        calm = state.calm + dt if inside and state.guarding else 0.0
        guarding = bool(leaving) or (state.guarding and calm < self.calm)
        causes = (state.causes | leaving) if guarding else frozenset()
        if guarding:
            target = {name: self._inside(name, self.safe.get(name, value)) for name, value in target.items()}
        excited, controller = self.controller.act(state.controller, reading, target)
        added = {name: excited.get(f"excitation_{name}", 0.0) for name in target}
        if any(added.values()):
            # the inactive controller gets the same target as the active one, to avoid integrator windup
            if guarding:
                still = {name: value - added[name] for name, value in target.items()}
                excited, controller = self.controller.act(state.controller, reading, still)
            else:
                target = {name: value + added[name] for name, value in target.items()}
        guarded, guard = self.guard.act(state.guard, reading, target)
        command = {**command_without_excitation(excited), **guarded} if guarding else excited
        flags = {"envelope_flag": float(guarding)}
        flags |= {f"envelope_{name}_flag": float(name in causes) for name in self.limits}
        return {**command, **flags}, EnvelopeState(controller, guard, tracks, guarding, causes, calm)

    def _tracked(self, name: str, before: Track | None, reading: Mapping[str, float]) -> Track:
        """The track after a reading, by a filter with two equal poles; extrapolated if the reading is not finite.

        Source: Brookner 1998, Tracking and Kalman Filtering Made Easy, sec. 1.2.7 (critically damped g-h filter).
        """
        if name not in reading:
            raise ValueError(f"Envelope limits {name}, which is not read: readings are {', '.join(reading)}.")
        value, dt = float(reading[name]), float(reading["dt_s"])
        measured = float(reading.get(self.rates[name], np.nan)) if name in self.rates else np.nan
        if before is None:
            return Track(value, measured if isfinite(measured) else 0.0) if isfinite(value) else Track(np.nan, 0.0)
        if not isfinite(before.value):
            return self._tracked(name, None, reading)
        rate = measured if isfinite(measured) else before.rate
        ahead = before.value + rate * dt
        if not isfinite(value) or not dt > 0.0:
            return Track(ahead, rate)
        error = float(wrap(value - ahead)) if channel(name).angle else value - ahead
        kept = exp(-dt / self.smoothing) if self.smoothing > 0.0 else 0.0
        if isfinite(measured):
            return Track(ahead + (1.0 - kept) * error, measured)
        return Track(ahead + (1.0 - kept**2) * error, rate + (1.0 - kept) ** 2 * error / dt)

    def _beyond(self, name: str, track: Track, horizon: float, share: float) -> bool:
        """Whether a track, now or `horizon` s ahead, is outside of this share of half its range about the middle."""
        ahead = track.value + track.rate * horizon
        return any(abs(self._away(name, value)) > share * self._half(name) for value in (track.value, ahead))

    def _inside(self, name: str, value: float) -> float:
        """The nearest target at which the controller may act again."""
        if name not in self.limits:
            return value
        away, half = self._away(name, value), (1.0 - self.release) * self._half(name)
        return value if abs(away) <= half else 0.5 * sum(self.limits[name]) + min(max(away, -half), half)

    def _away(self, name: str, value: float) -> float:
        """The distance of a value from the middle of its limits."""
        away = value - 0.5 * sum(self.limits[name])
        return float(wrap(away)) if channel(name).angle else away

    def _half(self, name: str) -> float:
        low, high = self.limits[name]
        return 0.5 * (high - low)


def guarded_times(time: np.ndarray, flag: np.ndarray) -> list[tuple[float, float]]:
    """The intervals in which a guard acted, s, from a record's times and its `envelope_flag`.

    A flag holds until the next sample.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0.0], np.asarray(flag) > 0.5, [0.0]])))
    return [(float(time[a]), float(time[min(b, len(time) - 1)])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
