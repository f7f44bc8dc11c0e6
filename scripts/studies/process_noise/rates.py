"""Shares and means with their 95 % intervals, as text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from scripts.blind.tables import exact_interval

NONE = "-"


def rate(hits: Sequence[bool]) -> str:
    """A share, %, with its exact interval."""
    if not hits:
        return NONE
    low, high = exact_interval(sum(hits), len(hits))
    return f"{100.0 * np.mean(hits):.1f} ({100.0 * low:.1f} to {100.0 * high:.1f})"


def mean(values: Sequence[float]) -> str:
    """A mean with the interval of Student's t."""
    if not values:
        return NONE
    middle = float(np.mean(values))
    if len(values) < 2:
        return f"{middle:.2f}"
    half = float(stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return f"{middle:.2f} ({middle - half:.2f} to {middle + half:.2f})"
