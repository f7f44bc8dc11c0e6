"""How figures of reports are drawn: colours and style, time axes, thinned lines, inline SVG.

Needs the extra `render`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from io import StringIO
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.extra import how_to_install
from auv_gym.records.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's palette is safe for common colour blindness; before and after also differ in line style.
INK, QUIET, GRID = "#22303c", "#5b6b78", "#d9e0e6"
MEASURED, BEFORE, AFTER, INPUT, COMMAND = "#22303c", "#d55e00", "#0072b2", "#00785a", "#8a97a3"
POINTS = 1200  # of a line across the page; longer lines are thinned
WIDTH = 9.6  # inches; the page is as wide at 100 points per inch
STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.titlecolor": INK,
    "axes.titlepad": 4.0,
    "axes.labelcolor": QUIET,
    "axes.labelsize": 9.0,
    "axes.edgecolor": "#aab5bf",
    "axes.linewidth": 0.8,
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": "#aab5bf",
    "ytick.color": "#aab5bf",
    "xtick.labelcolor": QUIET,
    "ytick.labelcolor": QUIET,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "legend.labelcolor": INK,
    "lines.solid_capstyle": "round",
    "text.color": INK,
    "svg.fonttype": "none",
    "svg.hashsalt": "auv-gym",
    "path.simplify": True,
}


def require_render() -> None:
    """Raise ImportError, with the command that installs them, if matplotlib or jinja2 is missing."""
    try:
        import jinja2  # noqa: F401
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ImportError(
            f"The report needs matplotlib and jinja2, and {error.name or 'one of them'} is not installed; "
            f"{how_to_install('render')}."
        ) from error


def svg(draw: Callable[[], Figure], name: str, label: str) -> str:
    """The SVG element of a figure, ready to be put into a page: without namespaces or a size of its own.

    name: prefix of its ids, different for each figure of a page.  label: text for screen readers.
    """
    require_render()
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    with matplotlib.rc_context(STYLE):
        figure = draw()
        text = StringIO()
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        FigureCanvasSVG(figure).print_svg(text, metadata=nothing)
    return _inline(text.getvalue(), name, label)


def shown_values(name: str, values: np.ndarray) -> np.ndarray:
    """The values of a channel for display: angles and their rates in degrees, volumes in millilitres."""
    unit = channel(name).unit
    if unit == "m3":
        return 1e6 * np.asarray(values)
    return np.rad2deg(values) if unit in ("rad", "rad/s") else np.asarray(values)


def unit_label(name: str) -> str:
    """The unit of `shown_values`."""
    unit = channel(name).unit
    return "mL" if unit == "m3" else unit.replace("rad", "deg")


def quantity_label(name: str) -> str:
    """`heading, deg`: the words for a channel, with its unit if it has one."""
    return with_unit(channel(name).label, name)


def with_unit(words: str, name: str) -> str:
    """Words for a quantity, followed by the unit in which a channel is drawn, if it has one."""
    unit = unit_label(name)
    return words if unit in ("", "1") else f"{words}, {unit}"


def thinned(values: np.ndarray, most: int, cuts: Sequence[int] | np.ndarray = ()) -> np.ndarray:
    """Indices that keep the shape of a long line: the smallest and the largest value of each bucket.

    cuts: indices at which a new line begins.  The index `values.size` marks the end of a line.
    """
    parts = np.split(np.arange(values.size), np.asarray(cuts, dtype=int))
    bucket = int(np.ceil(2.0 * values.size / most))
    kept = []
    for part in parts:
        if bucket > 2 and part.size > 2:
            inner = []
            for piece in np.array_split(part, max(part.size // bucket, 1)):
                safe = np.where(np.isfinite(values[piece]), values[piece], values[piece][0])
                inner += sorted({piece[np.argmin(safe)], piece[np.argmax(safe)]})
            part = np.unique([part[0], *inner, part[-1]])
        kept += [part, [values.size]]
    return np.concatenate(kept).astype(int)


class Clock:
    """Time of a record's samples along a figure, in a unit that suits its length, from 0.

    times: (n,).  size: s in the unit.  cuts: where segments begin.  Segments whose times overlap or lie far apart
    follow one another closely.
    """

    def __init__(self, record: Record):
        time, segments = record.time, record.segments
        gaps = np.array([time[b.start] - time[a.stop - 1] for a, b in pairwise(segments)])
        elapsed = time - time[0]
        self.closed_up = bool(gaps.size and (np.any(gaps <= 0.0) or gaps.sum() > record.duration_s))
        if self.closed_up:
            shift, pause = 0.0, 0.02 * record.duration_s
            for part in segments:
                elapsed[part] = time[part] - time[part.start] + shift
                shift = elapsed[part.stop - 1] + pause
        unit, self.size = next((u, s) for u, s, longest in _TIME_UNITS if elapsed[-1] <= longest)
        self.times = elapsed / self.size
        self.cuts = np.array([part.start for part in segments[1:]], dtype=int)
        self.label = f"time, {unit}" + (" (segments one after another, pauses shortened)" if self.closed_up else "")


_TIME_UNITS = (("s", 1.0, 900.0), ("min", 60.0, 5.0 * 3600.0), ("h", 3600.0, np.inf))


def new_figure(height: float) -> Figure:
    """An empty figure across the page, `height` inches tall."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    figure.patch.set_alpha(0.0)
    return figure


def grid(figure: Figure, count: int, columns: int) -> list:
    """The first `count` panels of a figure with `columns` columns."""
    rows = (count + columns - 1) // columns
    panels = figure.subplots(rows, columns if count > 1 else 1, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    return list(panels[:count])


def band(axes, lags: np.ndarray, bound: float | np.ndarray) -> None:
    """Draw the band around zero that noise stays in, one step beyond the lags on either side."""
    step = lags[1] - lags[0] if lags.size > 1 else 1.0
    wide = np.r_[lags[0] - step, lags, lags[-1] + step]
    edge = np.pad(np.broadcast_to(bound, lags.shape), 1, mode="edge")
    axes.fill_between(wide, -edge, edge, color="#d3dae0", zorder=1.2, linewidth=0, label="95 % band of noise")


def line(axes, times: np.ndarray, values: np.ndarray, cuts, points: int = POINTS, **look) -> None:
    """Draw a line through (times, values), thinned, that is broken before each index in `cuts`."""
    keep = thinned(values, points, cuts)
    axes.plot(np.append(times, np.nan)[keep], np.append(values, np.nan)[keep], **look)


def downwards(axes, name: str) -> None:
    """Invert the y axis for depth, which grows downwards."""
    if name == "depth_m":
        axes.invert_yaxis()


def patch(colour: str):
    """A coloured square for a legend."""
    from matplotlib.patches import Patch

    return Patch(facecolor=colour, edgecolor="#b9c4cd", linewidth=0.6)


def nearest_turns(angle: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Angles, rad, shifted by whole turns to lie within half a turn of others, where these are known."""
    turns = np.round((beside - angle) / (2.0 * np.pi))
    return angle + 2.0 * np.pi * np.where(np.isfinite(turns), turns, 0.0)


def compass_ticks(axes) -> None:
    """Label a continuous heading with compass degrees, if it covers at most two turns."""
    from matplotlib.ticker import FuncFormatter, MultipleLocator

    low, high = axes.get_ylim()
    if high - low > 800.0:
        axes.set_title(
            axes.get_title(loc="left").replace("heading, deg", "heading, deg (turns counted on)"), loc="left"
        )
        return
    step = next(s for s in (5, 10, 15, 30, 45, 90, 180) if (high - low) / s <= 6)
    axes.yaxis.set_major_locator(MultipleLocator(step))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value % 360.0:g}"))


def _inline(text: str, name: str, label: str) -> str:
    """The SVG element alone, with its own ids, two decimals in its paths and a label for screen readers."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", text, flags=re.DOTALL)
    # matplotlib derives ids of clip paths from memory addresses; numbers make the page reproducible
    for count, made in enumerate(dict.fromkeys(re.findall(r'\bid="([pm][0-9a-f]{10})"', text))):
        text = text.replace(made, f"c{count}")
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace("url(#", f"url(#{name}-").replace('xlink:href="#', f'href="#{name}-')
    text = re.sub(r' d="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), text)
    box = re.search(r'viewBox="[^"]*"', text)
    assert box is not None
    escaped = label.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    head = f'<svg {box[0]} role="img" aria-label="{escaped}">'
    return head + text[text.index(">") + 1 :].strip()
