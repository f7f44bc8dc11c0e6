"""HTML pages of reports: one self-contained file each, with numbers and units formatted for readers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.diagnosis.wording import for_people, typeset
from identification.pages.drawing import require_render, svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page(template: str, content: Mapping[str, Any]) -> str:
    """The text of one HTML page, from a template in `identification/pages/templates` that extends `page.html`.

    Raises ImportError, with the command to run, if the extra `render` is not installed.
    """
    require_render()
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("identification.pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(content).strip() + "\n"


@dataclass(frozen=True)
class Drawing:
    """A figure on the page: its SVG, and the words below it."""

    svg: str
    caption: str


def drawing(svg: str, caption: str) -> Drawing:
    """A figure for a page, from `identification.pages.drawing.svg`, in which all words are escaped."""
    from markupsafe import Markup

    return Drawing(Markup(svg), caption)


def drawn(draw: Callable[[], Figure], name: str, label: str, caption: str) -> Drawing:
    """The figure that `draw` makes, for a page; see `identification.pages.drawing.svg`."""
    return drawing(svg(draw, name, label), caption)


@dataclass(frozen=True)
class Table:
    """A table of texts; the second text of a pair goes below the first in the same cell.

    words: number of leading columns with words.  closing: number of trailing columns with words.
    marked: rows with a problem.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[str | tuple[str, str]]]
    words: int = 1
    caption: str = ""
    marked: Sequence[int] = ()
    closing: int = 0


def number(value: float, digits: int = 3, sign: bool = False) -> str:
    """A number with this many significant digits, without an exponent if it stays short, and with a true minus sign."""
    if not isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    size = int(np.floor(log10(abs(float(f"{value:.{digits - 1}e}")))))
    text = f"{value:.{digits - 1}e}" if not -5 <= size < 6 else f"{value:.{max(digits - 1 - size, 0)}f}"
    text = text if text.startswith("-") or not sign else f"+{text}"
    return text.replace("-", "−")


def amount(value: float, unit: str, sign: bool = False, digits: int = 3) -> str:
    """A value with its unit for display: angles and their rates in degrees, volumes in millilitres."""
    scale, unit = for_people(unit)
    value *= scale
    return typeset(f"{number(value, digits, sign)} {'' if unit == '1' else unit}".strip())


def percent(value: float) -> str:
    """A percentage with as many digits as are meaningful."""
    return f"{number(value) if abs(value) >= 1.0 or not isfinite(value) else f'{value:.2f}'.replace('-', '−')} %"


def chance(p: float) -> str:
    """A probability; small ones are only given as below a limit."""
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"


def span(limits: tuple[float, float], unit: str) -> str:
    """An interval for display."""
    texts = [[amount(limit, unit, digits=digits) for limit in limits] for digits in range(3, 8)]
    low, high = next((pair for pair in texts if pair[0] != pair[1]), texts[0])  # narrow intervals need more digits
    return f"{low.partition(' ')[0]} to {high}"


def both(value: float, unit: str) -> str:
    """An amount, followed by its SI value in brackets if that differs."""
    if for_people(unit)[1] != unit:
        return f"{amount(value, unit)} ({typeset(f'{number(value)} {unit}')})"
    return amount(value, unit)
