"""What the laws of control of one channel share: the error, its rate, the command that holds a target, and limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf, isfinite, pi

from auv_gym.channels import channel

Points = tuple[tuple[float, float], ...]


def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi), rad."""
    return (angle + pi) % (2.0 * pi) - pi


def error_of(name: str, target: float, measured: float) -> float:
    """Target minus measured; of an angle, the short way round."""
    return wrapped(target - measured) if channel(name).angle else target - measured


def filtered_rate(
    name: str,
    rate_name: str,
    reading: Mapping[str, float],
    last: float | None,
    rate: float,
    filter_time: float,
) -> float:
    """The rate of a channel through a first-order filter: as measured where it is, else differences of readings.

    rate_name: the channel that measures it, or "".  last: the reading before (None: there is none).  rate: the filtered
    rate before.  filter_time: s.
    """
    dt = reading["dt_s"]
    measured = reading.get(rate_name, inf) if rate_name else inf
    if isfinite(measured):
        return measured if last is None else (filter_time * rate + dt * measured) / (filter_time + dt)
    if last is None:
        return 0.0
    return (filter_time * rate + error_of(name, reading[name], last)) / (filter_time + dt)


def holding_command(steady: Points, target: float, neutral: float) -> float:
    """The command that holds a target: between (target, command) points a straight line; neutral without points."""
    if not steady:
        return neutral
    if target <= steady[0][0]:
        return steady[0][1]
    for (low, at_low), (high, at_high) in pairwise(steady):
        if target <= high:
            return at_low + (at_high - at_low) * (target - low) / (high - low)
    return steady[-1][1]


def limited(wanted: float, last: float, middle: float, limit: float, most: float) -> float:
    """The command within middle +- limit and at most `most` away from the last one."""
    command = min(max(wanted, middle - limit), middle + limit)
    return min(max(command, last - most), last + most)


def check_loop(
    law: str,
    channels: Sequence[str],
    filter_time: float,
    limit: float,
    rate_limit: float,
    neutral: float,
    middle: float,
    steady: Points,
) -> None:
    """Raises where a law of control cannot work with these channels, times and limits."""
    if not limit > 0.0 or not rate_limit > 0.0:
        raise ValueError(f"{law} needs positive limits, got limit {limit:g} and rate_limit {rate_limit:g}.")
    if not abs(neutral - middle) <= limit:
        raise ValueError(
            f"{law} needs neutral within its limits, {middle:g} +- {limit:g}, got {neutral!r}: move middle or widen "
            "limit."
        )
    if not 0.0 <= filter_time < inf:
        raise ValueError(f"{law} needs filter_time >= 0 s, got {filter_time}.")
    if any(not low < high for (low, _), (high, _) in pairwise(steady)):
        raise ValueError(f"{law} needs the points of `steady` in the order of their targets, got {steady!r}.")
    for name in channels:
        channel(name)  # raises on an unknown one
