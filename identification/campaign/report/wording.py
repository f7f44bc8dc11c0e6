"""Wording of runs, settings and amounts on the page of a campaign."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from identification.campaign.index import Row
from identification.pages.drawing import shown_values, unit_label
from identification.pages.page import number, percent


def grid_cell_label(cell: Mapping[str, Any]) -> str:
    """The grid's values of a run with shortened keys (last two parts): `rudder.offset = 0.05`; empty without a grid."""
    return ", ".join(f"{'.'.join(key.split('.')[-2:])} = {setting_text(value)}" for key, value in cell.items())


def setting_text(value: Any) -> str:
    """A setting's value as text; a list in brackets."""
    if isinstance(value, list | tuple):
        return f"({', '.join(map(setting_text, value))})"
    return f"{value:g}".replace("-", "−") if isinstance(value, float) else str(value)


def run_of(row: Row) -> str:
    """A run in words: its id, cell and seed."""
    return ", ".join(part for part in (f"Run {row.id}", grid_cell_label(row.cell), f"seed {row.seed}") if part)


def counted(count: int, word: str) -> str:
    """`1 run`, `no run`, `4 runs`."""
    return f"{count or 'no'} {word}{'s' * (count > 1)}"


def duration(seconds: float) -> str:
    """A duration in a suitable unit."""
    size, unit = (3600.0, "h") if seconds > 2.0 * 3600.0 else (60.0, "min") if seconds > 300.0 else (1.0, "s")
    return f"{number(seconds / size)} {unit}"


def median(values: Iterable[float | None]) -> float:
    """The median of the values that are numbers."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else float("nan")


def spread(values: Sequence[float], name: str) -> tuple[str, str]:
    """`0.41 m` and `0.30 to 0.66`: median and range of amounts of a channel."""
    unit = unit_label(name)
    shown = list(map(float, shown_values(name, np.asarray(values, dtype=float))))
    return _summed(shown, lambda value: f"{number(value)} {unit}")


def percents(given: Sequence[float | None]) -> tuple[str, str]:
    """Median and range of percentages."""
    return _summed([value for value in given if value is not None], percent)


def table_has_ranges(rows: Sequence[Sequence[str | tuple[str, str]]]) -> bool:
    """Whether any cell of a table's rows has a range below its median."""
    return any(isinstance(cell, tuple) and bool(cell[1]) for row in rows for cell in row)


def left_out(count: int, words: str) -> str:
    """A remark on what a table leaves out; empty if it shows everything."""
    return f"{count} {words}" if count > 0 else ""


def _summed(values: Sequence[float], told: Callable[[float], str]) -> tuple[str, str]:
    if not values:
        return "–", ""
    low, high = (told(value) for value in (min(values), max(values)))
    return told(float(np.median(values))), f"{low.partition(' ')[0]} to {high.partition(' ')[0]}" if low != high else ""
