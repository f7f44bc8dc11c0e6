"""A command that switches in response to the vehicle: zigzag manoeuvres, bang-bang control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, NamedTuple

from auv_gym.channels import channel, wrap
from controllers.composed.loops import commanded_inputs, targets_of
from controllers.controller import Controller


class RelayState(NamedTuple):
    """Memory of the controller, centre of the channel's oscillation (None: unknown), and side, 1, -1, or 0."""

    controller: Any
    middle: float | None
    side: int


@dataclass(frozen=True)
class Relay:
    """A controller with a relay: one command switches sides when a channel leaves a band.

    command: +amplitude about `neutral` until `measured` is `band` above its middle, then -amplitude until it is as far
    below.  amplitude: negative if a positive command lowers the channel.
    follow: whether the middle is the target of the channel; otherwise it is its first reading.
    Without a finite reading nothing changes.
    Source: IMO resolution MSC.137(76), annex, 4.2.2 (zigzag); Astrom and Hagglund 2006, sec. 8.4 (relay).

    Example:

        >>> from controllers import Pid, Relay
        >>> relay = Relay(Pid(1.0), "rudder_rad", "heading_rad", amplitude=0.2, band=0.1)
        >>> command, memory = relay.act(relay.start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 0.0})
        >>> command["rudder_rad"]
        0.2
    """

    controller: Controller
    command: str
    measured: str
    amplitude: float
    band: float
    neutral: float = 0.0
    follow: bool = False

    def __post_init__(self) -> None:
        for name in (self.command, self.measured):
            channel(name)  # raises if it is unknown
        if not isfinite(self.amplitude) or self.amplitude == 0.0 or not isfinite(self.neutral):
            raise ValueError(
                f"Relay needs an amplitude other than 0 and a finite neutral command, got {self.amplitude!r} and "
                f"{self.neutral!r}."
            )
        if not 0.0 <= self.band < inf:
            raise ValueError(f"Relay needs band >= 0, in the unit of {self.measured}, got {self.band!r}.")

    @property
    def targets(self) -> tuple[str, ...]:
        own = (self.measured,) if self.follow else ()
        return tuple(dict.fromkeys((*targets_of(self.controller), *own)))

    @property
    def commands(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*commanded_inputs(self.controller), self.command)))

    def start(self) -> RelayState:
        return RelayState(self.controller.start(), None, 0)

    def act(
        self, state: RelayState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], RelayState]:
        command, inner = self.controller.act(state.controller, reading, target)
        if self.measured not in reading or (self.follow and self.measured not in target):
            raise ValueError(
                f"Relay switches by {self.measured}, which is not {'told' if self.measured in reading else 'read'}: "
                f"readings are {', '.join(reading)}, targets {', '.join(target) or 'none'}."
            )
        value, middle, side = reading[self.measured], state.middle, state.side
        if self.follow:
            middle = target[self.measured]
        elif middle is None and isfinite(value):
            middle = value
        if middle is not None and isfinite(value):
            away = value - middle
            away = float(wrap(away)) if channel(self.measured).angle else away
            if side == 0:
                side = -1 if away > self.band else 1
            elif side * away >= self.band:
                side = -side
        return {**command, self.command: self.neutral + side * self.amplitude}, RelayState(inner, middle, side)


def zigzag(controller: Controller, angle: float, *, to_starboard: int = 1, heading: float | None = None) -> Relay:
    """The zigzag angle/angle, rad: rudder to one side until the heading has changed as much, then to the other.

    to_starboard: the sign of a rudder that turns the bow to starboard.  heading: change of heading at which the rudder
    is reversed, rad, default `angle`.  The controller holds the rest, such as depth and speed.

    Example:

        >>> from math import radians
        >>> from controllers import Pid, zigzag
        >>> test = zigzag(Pid(1.0), radians(10))
        >>> command, memory = test.act(test.start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 0.0})
        >>> round(command["rudder_rad"], 3)
        0.175
    """
    if to_starboard not in (1, -1) or not angle > 0.0:
        raise ValueError(f"zigzag needs an angle > 0 rad and to_starboard 1 or -1, got {angle!r} and {to_starboard!r}.")
    return Relay(controller, "rudder_rad", "heading_rad", to_starboard * angle, angle if heading is None else heading)
