"""Shared parts of single-channel control laws: error, rate, the command that holds a target, and limits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf, isfinite, pi

from auv_gym.channels import channel
from controllers.controller import check_targets, reading_of, target_of, time_step

Points = tuple[tuple[float, float], ...]


def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi), rad."""
    return (angle + pi) % (2.0 * pi) - pi


def error_of(name: str, target: float, measured: float) -> float:
    """Target minus measured; for an angle, the short way round."""
    return wrapped(target - measured) if channel(name).angle else target - measured


def filtered_rate(
    name: str,
    rate_name: str,
    reading: Mapping[str, float],
    last: float | None,
    rate: float,
    filter_time: float,
) -> float:
    """The rate of a channel through a first-order filter, measured or else from differences of readings.

    rate_name: the channel that measures it, or "".  last: the previous reading (None: there is none).  rate: the
    previous filtered rate.  filter_time: s.
    """
    dt = time_step(reading)
    measured = reading.get(rate_name, inf) if rate_name else inf
    if isfinite(measured):
        return measured if last is None else (filter_time * rate + dt * measured) / (filter_time + dt)
    if last is None:
        return 0.0
    return (filter_time * rate + error_of(name, reading[name], last)) / (filter_time + dt)


def holding_command(steady: Points, target: float, neutral: float) -> float:
    """The command that holds a target: linear between (target, command) points; neutral without points."""
    if not steady:
        return neutral
    if target <= steady[0][0]:
        return steady[0][1]
    for (low, at_low), (high, at_high) in pairwise(steady):
        if target <= high:
            return at_low + (at_high - at_low) * (target - low) / (high - low)
    return steady[-1][1]


@dataclass(frozen=True)
class Memory:
    """Memory of a single-channel law: integral part, filtered rate, last reading and command (None: none)."""

    integral: float = 0.0
    rate: float = 0.0
    reading: float | None = None
    command: float | None = None


@dataclass(frozen=True, kw_only=True)
class OneChannel(ABC):
    """A law of one channel by one command, with the shared handling of readings, targets, rates and limits.

    measured: the channel.  filter_time: s, of the rate.  limit: largest command, either side of `middle`.  rate_limit:
    of the command, per s, starting from `neutral`.  neutral: the command without an error, where it starts.
    rate_measured: a channel that measures the rate, used if it is among the readings.  steady: (target, command) points
    instead of `neutral`.
    """

    measured: str = "heading_rad"
    command: str = "rudder_rad"
    filter_time: float = 0.0
    limit: float = inf
    rate_limit: float = inf
    neutral: float = 0.0
    middle: float = 0.0
    rate_measured: str = ""
    steady: Points = ()

    @property
    def targets(self) -> tuple[str, ...]:
        return (self.measured,)

    @property
    def commands(self) -> tuple[str, ...]:
        return (self.command,)

    def start(self) -> Memory:
        return Memory()

    def act(
        self, state: Memory, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], Memory]:
        """The command and the next memory; both stay the same if the reading is not finite."""
        measured = reading_of(self, self.measured, reading)
        last = self.neutral if state.command is None else state.command
        if not isfinite(measured):
            return {self.command: last}, state
        wanted = target_of(self, self.measured, target)
        if len(target) > 1:
            check_targets(self, target)
        error = error_of(self.measured, wanted, measured)
        rate = filtered_rate(self.measured, self.rate_measured, reading, state.reading, state.rate, self.filter_time)
        steady = holding_command(self.steady, wanted, self.neutral)
        command, integral = self._answer(error, rate, steady, last, state.integral, time_step(reading))
        return {self.command: command}, Memory(integral, rate, measured, command)

    @abstractmethod
    def _answer(
        self, error: float, rate: float, steady: float, last: float, integral: float, dt: float
    ) -> tuple[float, float]:
        """The command and the next integral; steady: the command that holds the target, last: the previous one."""

    def _within_limits(self, wanted: float, last: float, dt: float) -> float:
        """The command within its limits, and within the largest change from the last one in dt s."""
        command = min(max(wanted, self.middle - self.limit), self.middle + self.limit)
        return min(max(command, last - self.rate_limit * dt), last + self.rate_limit * dt)

    def _check(self) -> None:
        """Raise if the law cannot work with these channels, times and limits."""
        law, limit, middle = type(self).__name__, self.limit, self.middle
        if not limit > 0.0 or not self.rate_limit > 0.0:
            raise ValueError(f"{law} needs positive limits, got limit {limit:g} and rate_limit {self.rate_limit:g}.")
        if not abs(self.neutral - middle) <= limit:
            raise ValueError(
                f"{law} needs neutral within its limits, {middle:g} +- {limit:g}, got {self.neutral!r}: move middle "
                "or widen limit."
            )
        if not 0.0 <= self.filter_time < inf:
            raise ValueError(f"{law} needs filter_time >= 0 s, got {self.filter_time}.")
        if any(not low < high for (low, _), (high, _) in pairwise(self.steady)):
            raise ValueError(f"{law} needs the points of `steady` in the order of their targets, got {self.steady!r}.")
        for name in (self.measured, self.command, self.rate_measured):
            if name:
                channel(name)  # raises if it is unknown
