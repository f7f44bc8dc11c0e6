"""What the commands print with: the two consoles, tables, and a progress bar."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from itertools import count
from time import monotonic

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

output = Console(highlight=False)
errors = Console(stderr=True, highlight=False)


_SELDOM = 30.0  # s, between lines on a long step's progress where no bar can be drawn


@contextmanager
def progress_bar() -> Generator[Callable[[float, str], None]]:
    """A callable of fraction and text that draws a bar on stderr; a line now and then where that is no terminal."""
    if not errors.is_terminal:
        yield _seldom_told()
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(bar_width=30), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=errors, transient=True) as bars:
        task = bars.add_task("", total=1.0)
        yield lambda fraction, text: bars.update(task, completed=fraction, description=text)


def _seldom_told() -> Callable[[float, str], None]:
    """Lines of time, fraction and text, so that a log shows that a long run goes on."""
    began = told = monotonic()

    def show(fraction: float, text: str) -> None:
        nonlocal told
        now = monotonic()
        if now - told >= _SELDOM:
            told = now
            minutes, seconds = divmod(int(now - began), 60)
            errors.print(f"{minutes}:{seconds:02d} min, {100.0 * fraction:.0f} %: {text}", markup=False)

    return show


@contextmanager
def steps_bar(total: int) -> Generator[Callable[[str], None]]:
    """A bar that is told what begins now, of so many things one after the other."""
    with progress_bar() as show:
        begun = count()
        yield lambda text: show(next(begun) / total, text)


def table(title: str, *columns: str) -> Table:
    """A table with these columns; a name that ends in '>' is set to the right, one in '>' or '!' is never wrapped."""
    table = Table(title=title, title_justify="left", title_style="bold", header_style="bold", box=SIMPLE_HEAD)
    for column in columns:
        name, right, whole = column.rstrip(">!"), column.endswith(">"), column.endswith((">", "!"))
        table.add_column(name, justify="right" if right else "left", overflow="fold", no_wrap=whole)
    return table
