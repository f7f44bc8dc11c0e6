"""The common parts of panels: a title line with readings, and a frame with axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from auv_gym.rendering.sheet import GRID, INK, PANEL, QUIET, Box, Colour, Sheet

TITLE = 28.0  # height of the title line, pixels
_LEFT, _BELOW = 44.0, 34.0  # room for the ticks, pixels
_SIZE = 13.0


def draw_title(
    sheet: Sheet, area: Box, title: str, note: str = "", readings: Sequence[tuple[str, str, Colour]] = ()
) -> None:
    """Write a title and a grey note at the left, and readings (label, value, colour of the value) at the right."""
    y, x = area.top + 12.0, area.right
    used = sheet.text((area.left, y), title, INK, _SIZE, bold=True)
    sheet.text((area.left + used + 10.0, y), note, QUIET, 11.0)
    for label, value, colour in reversed(readings):
        x -= sheet.text((x, y), value, colour, _SIZE, "right", bold=True) + 6.0
        x -= sheet.text((x, y), label, QUIET, _SIZE, "right") + 18.0


def frame(area: Box) -> Box:
    """The part of a panel inside its title and ticks."""
    return Box(area.left + _LEFT, area.top + TITLE, area.right, area.bottom - _BELOW)


def draw_axes(
    sheet: Sheet, box: Box, across: Iterable[tuple[float, str]], down: Iterable[tuple[float, str]], name: str
) -> None:
    """Draw a frame's background, and its grid at pixels x (across) and y (down) with texts; name: of the lower axis."""
    sheet.box(box, PANEL)
    for x, text in across:
        sheet.line([(x, box.top), (x, box.bottom)], GRID)
        sheet.text((x, box.bottom + 11.0), text, QUIET, 11.0, "centre")
    for y, text in down:
        sheet.line([(box.left, y), (box.right, y)], GRID)
        sheet.text((box.left - 6.0, y), text, QUIET, 11.0, "right")
    sheet.text((box.middle[0], box.bottom + 26.0), name, QUIET, 11.0, "centre")
