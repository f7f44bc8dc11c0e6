"""What is required of loops, and how far a loop is from it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from auv_gym.param import did_you_mean

# what is known of each loop -> unit, and whether more is better
QUANTITIES: Mapping[str, tuple[str, bool]] = {
    "gain_margin_db": ("dB", True),
    "phase_margin_deg": ("deg", True),
    "delay_margin_s": ("s", True),
    "sensitivity_peak": ("", False),
    "overshoot_percent": ("%", False),
    "settling_s": ("s", False),
    "rms_error_percent": ("%", False),
    "saturation_percent": ("%", False),
}
# with it the phase margin is 29 deg at least, and the gain may rise by 6 dB and fall by 3.5 dB.
# Source: Astrom and Hagglund 2006, Advanced PID Control, sec. 4.6
USUAL = ("sensitivity_peak<=2",)
_FORM = re.compile(r"\s*(?:(\w+)\.)?(\w+)\s*(<=|>=)\s*(\S+)\s*")
_MOST = 10.0  # of what is required, that a loop is from it


@dataclass(frozen=True)
class Requirement:
    """A limit of a quantity of the loop of a channel, or of all loops where channel is empty."""

    quantity: str
    limit: float
    channel: str = ""

    def __str__(self) -> str:
        sign = ">=" if self.upward else "<="
        return f"{self.channel}{'.' * bool(self.channel)}{self.quantity}{sign}{self.limit:g}"

    @property
    def upward(self) -> bool:
        """Whether the quantity has to be above the limit."""
        return QUANTITIES[self.quantity][1]

    def is_met(self, value: float) -> bool:
        return value >= self.limit if self.upward else value <= self.limit

    def shortfall(self, value: float) -> float:
        """How far a value is from the limit, over it; 0 where it is met."""
        if self.is_met(value):
            return 0.0
        short = abs(self.limit - value) / max(abs(self.limit), 1e-9)
        return min(short, _MOST) if isfinite(short) else _MOST


def parse_requirements(texts: Sequence[str], channels: Sequence[str]) -> tuple[Requirement, ...]:
    """Requirements such as "phase_margin_deg>=45" or "depth_m.overshoot_percent<=10"; raises on what is none."""
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
                f"A requirement needs QUANTITY>=NUMBER or <=, such as phase_margin_deg>=45, with a channel before it "
                f"where it is for one loop, depth_m.overshoot_percent<=10; got {text!r}."
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
        if (sign == ">=") != QUANTITIES[quantity][1]:
            other = ">=" if QUANTITIES[quantity][1] else "<="
            raise ValueError(f"{quantity} needs {other}, got {text!r}: turn the sign.")
        found.append(Requirement(quantity, value, channel or ""))
    return tuple(found)


def worst(quantity: str, values: Sequence[float]) -> float:
    """The worst of several values of a quantity."""
    if not values:
        return inf
    return min(values) if QUANTITIES[quantity][1] else max(values)
