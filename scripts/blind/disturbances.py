"""Causes outside the library of effects, as numbers over time and state; each is absent at size 0."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np


@dataclass(frozen=True)
class Tripping:
    """Drag that is larger by the factor 1 + more from when a speed has exceeded `high` until it is below `low`."""

    more: float
    low: float
    high: float

    def tripped(self, before: bool, speed: float) -> bool:
        return speed > self.low if before else speed > self.high

    def factor(self, tripped: bool) -> float:
        return 1.0 + self.more * tripped


@dataclass(frozen=True)
class Sticking:
    """An actuator that moves only if its command is `stiction` away, and not at all while it is jammed.

    jams: (n, 2), s, beginnings and ends.
    """

    stiction: float
    jams: np.ndarray

    @classmethod
    def draw(
        cls, rng: np.random.Generator, duration: float, stiction: float, spacing: float, longest: float
    ) -> Sticking:
        """A jam about every `spacing` s, of half to all of `longest` s."""
        begin = np.arange(0.4 * spacing, duration, spacing)
        begin = begin + rng.uniform(0.0, 0.4, begin.size) * spacing
        return cls(stiction, np.stack([begin, begin + longest * rng.uniform(0.5, 1.0, begin.size)], axis=1))

    def position(self, held: float, command: float, time: float) -> float:
        """The effective command, given the one held before."""
        if np.any((self.jams[:, 0] <= time) & (time < self.jams[:, 1])):
            return held
        return command if abs(command - held) >= self.stiction else held


@dataclass(frozen=True)
class Slack:
    """A line that acts as a spring when stretched beyond `slack`: stiffness, N/m; slack, m."""

    stiffness: float
    slack: float

    def pull(self, distance: float) -> float:
        """Tension, N, rounded off within a tenth of a metre of the end of the slack."""
        stretch = distance - self.slack
        return self.stiffness * (0.1 * np.log1p(exp(min(10.0 * stretch, 700.0))) if stretch < 3.0 else stretch)


def slipped(time: np.ndarray, rng: np.random.Generator, size: float, spacing: float) -> np.ndarray:
    """Stamps of a clock whose rate is wrong by up to `size`, with a new error about every `spacing` s; time: rising."""
    edges = np.arange(time[0], time[-1] + 2.0 * spacing, spacing) + rng.uniform(-0.3, 0.3) * spacing
    rates = size * rng.uniform(0.5, 1.0, edges.size) * rng.choice([-1.0, 1.0], edges.size)
    gained = np.concatenate([[0.0], np.cumsum(rates[:-1] * np.diff(edges))])
    return time + np.interp(time, edges, gained) - np.interp(time[0], edges, gained)


def lopsided(told: float, side: float) -> float:
    """The motion of an actuator that is stronger to the positive side by this share, and weaker to the other."""
    return told * (1.0 + side * float(np.sign(told)))


@dataclass(frozen=True)
class Around:
    """The surroundings of a vehicle, and its faults; None: absent.

    side: see `lopsided`.
    """

    side: float = 0.0
    sticking: Sticking | None = None
    tripping: Tripping | None = None
    tether: Slack | None = None
