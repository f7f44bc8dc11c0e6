"""Axes that stay fixed while a run grows: limits and ticks on round numbers, and numbers as text."""

from __future__ import annotations

from math import ceil, floor, log10

import numpy as np

SMALL = {"m": ("mm", 1e3), "m3": ("mL", 1e6)}  # units for actuators, by the unit of their channel

_MINUS = "\N{MINUS SIGN}"


def round_step(least: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is not below `least`."""
    power = 10.0 ** floor(log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1.0 - 1e-9))


def ticks(low: float, high: float, step: float) -> np.ndarray:
    """The multiples of a step from low to high."""
    return step * np.arange(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)


def outward(low: float, high: float, step: float) -> tuple[float, float]:
    """The range extended to multiples of a step."""
    return step * floor(low / step + 1e-9), step * ceil(high / step - 1e-9)


def number(value: float, decimals: int = 0, *, signed: bool = False) -> str:
    """A number with a true minus sign and no negative zero; signed: with a plus sign above zero."""
    text = f"{abs(value):.{decimals}f}"
    if float(text) == 0.0:
        return text
    return (_MINUS if value < 0.0 else "+" if signed else "") + text


def tick_text(value: float, step: float) -> str:
    """A tick with as many decimals as its step."""
    return number(value, max(0, -floor(log10(step) + 1e-9)))


def shortest(value: float) -> str:
    """A number to two decimals, without trailing zeros."""
    text = number(value, 2)
    return text.rstrip("0").rstrip(".")


def distance_text(metres: float) -> str:
    """A distance to about three digits, in m or km."""
    return f"{metres / 1000.0:.1f} km" if metres >= 1000.0 else f"{metres:.0f} m"
