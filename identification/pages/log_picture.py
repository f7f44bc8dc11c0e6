"""A first picture of a log: all recognised signals over time, grouped by quantity or unit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from auv_gym.records.first_look import FirstLook
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from identification.pages.drawing import (
    STYLE,
    Clock,
    compass_ticks,
    downwards,
    line,
    nearest_turns,
    new_figure,
    require_render,
    shown_values,
    unit_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PANELS, MOST_LINES = 16, 6
_COLOURS = ("#22303c", "#d55e00", "#0072b2", "#00785a", "#cc79a7", "#8a97a3")


def draw_log(look: FirstLook, path: str | Path) -> None:
    """Write a picture of a log's signals over time as .png, .svg or .pdf; it is written aside, then renamed.

    Raises ValueError if nothing was recognised, or for another ending; ImportError without the extra `render`.
    """
    require_render()
    ending = Path(path).suffix.lower().lstrip(".")
    if ending not in ("png", "svg", "pdf"):
        raise ValueError(f"A picture is written as .png, .svg or .pdf, got {Path(path).name!r}: change its ending.")
    if look.record is None:
        raise ValueError(f"Nothing was recognised in {look.path.name} that could be drawn: write a mapping first.")
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with matplotlib.rc_context(STYLE), replacing(path) as new:
        figure = _figure(look.record, f"{look.path.name}: {look.format}")
        figure.patch.set_alpha(1.0)
        FigureCanvasAgg(figure)
        figure.savefig(new, format=ending, dpi=120)


def panels(record: Record) -> list[tuple[str, list[str]]]:
    """Signals that belong together, with the title of their panel: one quantity with its set point, or one unit."""
    rest = [n for n in record.names if not n.startswith("quaternion_") and np.isfinite(record[n]).any()]
    found: list[tuple[str, list[str]]] = []

    def take(title: str, names: list[str]) -> None:
        names = [name for name in names if name in rest]
        for first in range(0, len(names), MOST_LINES):
            found.append((title, names[first : first + MOST_LINES]))
        rest[:] = [name for name in rest if name not in names]

    take("heading", ["heading_rad", "heading_cmd_rad", "course_rad"])
    take("depth", ["depth_m", "depth_cmd_m"])
    take("roll and pitch", ["roll_rad", "pitch_rad", "pitch_cmd_rad"])
    for kind, title in (("motion", "motion"), ("input", "inputs"), ("command", "commands"), ("auxiliary", "others")):
        for unit in dict.fromkeys(channel(name).unit for name in rest if channel(name).kind == kind):
            take(title, [n for n in rest if channel(n).kind == kind and channel(n).unit == unit])
    return found[:MOST_PANELS]


def _figure(record: Record, title: str) -> Figure:
    shown = panels(record)
    figure = new_figure(1.25 * len(shown) + 0.7)
    figure.suptitle(title.replace("$", r"\$"), fontsize=10.5, x=0.01, ha="left")
    clock = Clock(record)
    rows = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (heading, names) in zip(rows, shown, strict=True):
        for colour, name in zip(_COLOURS, names, strict=False):
            values = record[name]
            if names[0] == "heading_rad" != name:
                values = nearest_turns(values, record["heading_rad"])
            values = shown_values(name, values)
            style = "steps-post" if channel(name).held else "default"
            line(
                axes,
                clock.times,
                values,
                clock.cuts,
                color=colour,
                lw=0.9,
                label=name.replace("$", r"\$"),
                drawstyle=style,
            )
        axes.set_title(heading, loc="left")
        unit = unit_label(names[0])
        axes.set_ylabel("" if unit == "1" else unit)
        downwards(axes, names[0])
        if names[0] == "heading_rad":
            compass_ticks(axes)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7.5)
    rows[-1].set_xlabel(clock.label)
    return figure
