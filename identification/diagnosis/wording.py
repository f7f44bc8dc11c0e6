"""Sizes and intervals of a diagnosis in words for readers."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from auv_gym.channels import channel


def quantity(value: float, unit: str, figures: int = 3) -> str:
    """A number with its unit and so many figures for display: angles in degrees, volumes in millilitres."""
    if not np.isfinite(value):
        return "not detectable"
    scale, unit = for_people(unit)
    value *= scale
    long = 10.0 ** min(figures, 3) <= abs(value) < 1e6
    digits = f"{value:.{max(figures - 4, 0)}f}" if long else f"{value:{'#' * (figures > 3)}.{figures}g}"
    return typeset(f"{digits} {'' if unit == '1' else unit}".strip())


def typeset(text: str) -> str:
    """The text with powers as superscript digits."""
    for plain, raised in (("^2", "²"), ("^3", "³"), ("^4", "⁴")):
        text = text.replace(plain, raised)
    return text


def for_people(unit: str) -> tuple[float, str]:
    """The factor that converts numbers to the unit for display, and that unit."""
    if unit in ("rad", "rad/s", "rad/s^2"):
        return float(np.rad2deg(1.0)), unit.replace("rad", "deg")
    if unit == "m3" or unit.startswith("m^3"):  # unit of a channel, or of a parameter
        return 1e6, unit.replace("m^3", "mL", 1).replace("m3", "mL", 1)
    return 1.0, unit


def interval(limits: tuple[float, float], unit: str) -> str:
    """A 95 % interval with its unit, angles in degrees for people."""
    return " to ".join(ends(limits, unit))


def ends(limits: tuple[float, float], unit: str) -> tuple[str, str]:
    """Both ends of a range, with enough digits to differ; the second one has the unit."""
    low, high = (quantity(v, unit, _figures(limits, unit)) for v in limits)
    return low.split(" ")[0], high


def inside(value: float, limits: tuple[float, float], unit: str) -> str:
    """A size with its unit and as many figures as the ends of its interval."""
    return quantity(value, unit, _figures(limits, unit))


def _figures(limits: tuple[float, float], unit: str) -> int:
    """The fewest figures, from 3 to 7, in which the ends of a range differ; 3 if they never do."""
    return next((n for n in range(3, 8) if len({quantity(v, unit, n) for v in limits}) > 1), 3)


def at_most(value: float, limits: tuple[float, float], neutral: float) -> str:
    """The prefix "up to " or "down to " for a size that is the end of its interval farther from neutral, or nothing."""
    near = min(limits, key=lambda end: abs(end - neutral))
    if value not in limits or abs(near - neutral) >= abs(value - neutral):
        return ""
    return "up to " if value > neutral else "down to "


def sized(title: str, size: str, limits: str, *more: str) -> str:
    """A title with its size and interval in words; a remark in brackets in the title moves beside the interval."""
    name, _, remark = title.removesuffix(")").partition(" (")
    told = [f"95 % interval {limits}", *more, *([remark] if remark else [])]
    return f"{name}, {size} ({', '.join(told)})"


def accelerations(process: Mapping[str, tuple[float, float]]) -> str:
    """Random accelerations or drifts in words: by velocity or position, the deviation and the correlation time, s."""
    rates = {"m/s": "m/s^2", "rad/s": "rad/s^2", "m": "m/s"}
    return _random(process, lambda unit: rates.get(unit, f"{unit}/s"))


def lasting_errors(errors: Mapping[str, tuple[float, float]]) -> str:
    """Correlated sensor errors in words: by channel, the deviation and the correlation time, s."""
    return _random(errors, lambda unit: unit)


def _random(noises: Mapping[str, tuple[float, float]], unit_of: Callable[[str], str]) -> str:
    """Correlated noises in words; unit_of: the unit of a deviation, given the channel's unit."""
    told = []
    for name, (size, time) in noises.items():
        known = channel(name)
        deviation = quantity(size, unit_of(known.unit or ""))
        told.append(f"{known.label} {deviation} RMS with a correlation time of {quantity(time, 's')}")
    return "; ".join(told)


def short(title: str) -> str:
    """A title without the remark in brackets."""
    return title.partition(" (")[0]


def capital(text: str) -> str:
    """A text with a capital first letter, to begin a sentence; `thruster_2` and `auv-gym` stay as they are."""
    first = text.partition(" ")[0]
    return text if "_" in first or first == "auv-gym" else f"{text[:1].upper()}{text[1:]}"
