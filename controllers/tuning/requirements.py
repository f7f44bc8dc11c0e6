"""Requirements on loops, and the distance of a loop from them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import NamedTuple

from auv_gym.param import did_you_mean


class Quantity(NamedTuple):
    """A quantity computed for each loop: words for display, unit, and whether more is better."""

    title: str
    unit: str
    upward: bool

    @property
    def label(self) -> str:
        """The words with the unit: `gain margin, dB`."""
        return f"{self.title}, {self.unit}" if self.unit else self.title


QUANTITIES: Mapping[str, Quantity] = {
    "gain_margin_db": Quantity("gain margin", "dB", True),
    "phase_margin_deg": Quantity("phase margin", "deg", True),
    "delay_margin_s": Quantity("delay margin", "s", True),
    "sensitivity_peak": Quantity("sensitivity peak", "", False),
    "overshoot_percent": Quantity("overshoot", "%", False),
    "settling_s": Quantity("settling time", "s", False),
    "rms_error_percent": Quantity("RMS error", "%", False),
    "saturation_percent": Quantity("saturation", "%", False),
}
# It guarantees a phase margin of at least 29 deg, and allows a gain increase of 6 dB or a decrease of 3.5 dB.
# Source: Astrom and Hagglund 2006, Advanced PID Control, sec. 4.6
USUAL = ("sensitivity_peak<=2",)
_FORM = re.compile(r"\s*(?:(\w+)\.)?(\w+)\s*(<=|>=)\s*(\S+)\s*")
_MOST = 10.0  # of the requirement, largest distance of a loop that counts


@dataclass(frozen=True)
class Requirement:
    """A limit of a quantity, for the loop of a channel, or for all loops if the channel is empty."""

    quantity: str
    limit: float
    channel: str = ""

    def __str__(self) -> str:
        sign = ">=" if self.upward else "<="
        return f"{self.channel}{'.' * bool(self.channel)}{self.quantity}{sign}{self.limit:g}"

    @property
    def upward(self) -> bool:
        """Whether the quantity has to be above the limit."""
        return QUANTITIES[self.quantity].upward

    @property
    def words(self) -> str:
        """The requirement for display: `sensitivity peak ≤ 2`."""
        known = QUANTITIES[self.quantity]
        return f"{known.title} {'≥' if known.upward else '≤'} {self.limit:g} {known.unit}".strip()

    def is_met(self, value: float) -> bool:
        return value >= self.limit if self.upward else value <= self.limit

    def excess(self, value: float) -> float:
        """The distance of a value beyond the limit, relative to it; negative if the requirement is met."""
        beyond = (self.limit - value) if self.upward else (value - self.limit)
        return beyond / max(abs(self.limit), 1e-9)

    def shortfall(self, value: float) -> float:
        """The distance of a value from the limit, relative to it; 0 if the requirement is met."""
        if self.is_met(value):
            return 0.0
        short = self.excess(value)
        return min(short, _MOST) if isfinite(short) else _MOST


def parse_requirements(texts: Sequence[str], channels: Sequence[str]) -> tuple[Requirement, ...]:
    """Requirements such as "phase_margin_deg>=45" or "depth_m.overshoot_percent<=10"; raises for other texts."""
    found = []
    for text in texts:
        parts = _FORM.fullmatch(text)
        try:
            channel, quantity, sign, limit = parts.groups() if parts else ("", "", "", "")
            value = float(limit)
        except ValueError:
            quantity = ""
        if not quantity or not isfinite(value):
            raise ValueError(
                f"A requirement needs QUANTITY>=NUMBER or QUANTITY<=NUMBER, such as 'phase_margin_deg>=45', or for one "
                f"loop 'depth_m.overshoot_percent<=10', got {text!r}. Put it in quotes, since > redirects in a shell."
            )
        if quantity not in QUANTITIES:
            raise ValueError(
                f"No quantity {quantity!r} in {text!r}. {did_you_mean(quantity, QUANTITIES)}Quantities: "
                f"{', '.join(QUANTITIES)}."
            )
        if channel and channel not in channels:
            raise ValueError(
                f"No loop {channel!r} in {text!r}. {did_you_mean(channel, channels)}Loops: {', '.join(channels)}."
            )
        if (sign == ">=") != QUANTITIES[quantity].upward:
            other = ">=" if QUANTITIES[quantity].upward else "<="
            raise ValueError(f"{quantity} needs {other}, got {text!r}: turn the sign.")
        found.append(Requirement(quantity, value, channel or ""))
    return tuple(found)


def worst(quantity: str, values: Sequence[float]) -> float:
    """The worst of several values of a quantity."""
    if not values:
        return inf
    return min(values) if QUANTITIES[quantity].upward else max(values)
