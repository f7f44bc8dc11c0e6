"""Options that are numbers: the help of each says its range, and anything else is refused by the same words."""

from __future__ import annotations

from typing import Any

import typer

TIME_STEP = (0.001, 86400)  # s
LENGTH = (0.1, 1e8)  # s
DEPTH = (0, 12000)  # m, deeper than any sea
SEED = (0, 2**32 - 1)  # what torch and stable-baselines3 take


def number(help: str, least: float, most: float) -> Any:
    """An option that takes numbers from `least` to `most`."""
    return _option(help, float, "number", least, most)


def whole_number(help: str, least: int, most: int) -> Any:
    """An option that takes whole numbers from `least` to `most`."""
    return _option(help, int, "whole number", least, most)


def _option(help: str, kind: type[int] | type[float], name: str, least: float, most: float) -> Any:
    words = f"from {least:.10g} to {most:.10g}"

    def read(given: Any) -> int | float:  # also the default, which is no text
        try:
            value = kind(given)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:  # NaN is in no range
            raise typer.BadParameter(f"a {name} {words} is needed, got {given}.")
        return value

    return typer.Option(help=f"{help} Range: {words}.", parser=read, metavar=f"<{kind.__name__}>")
