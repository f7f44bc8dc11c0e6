"""Write the table of the constants that decide a diagnosis (identification/deciding.py) into docs/diagnosis_method.md.

python -m scripts.pages.what_decides
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from identification import deciding
from scripts.pages.marked import with_marked

PAGE = Path(__file__).parents[2] / "docs" / "diagnosis_method.md"
NAME = "table of what decides"


@dataclass(frozen=True)
class Constant:
    """A constant that decides: what it decides, and the source of its value."""

    step: str
    name: str
    value: float
    decides: str
    source: str


def constants() -> Iterator[Constant]:
    """The constants in the order of the module; raises ValueError for one whose text does not give its source."""
    text = Path(deciding.__file__).read_text(encoding="utf-8")
    lines = text.splitlines()
    heads = {n: line[2:].partition(":")[0] for n, line in enumerate(lines, 1) if line.startswith("# ")}
    for node, after in pairwise([*ast.parse(text).body, None]):
        if not isinstance(node, ast.Assign) or not isinstance(node.targets[0], ast.Name):
            continue
        name = node.targets[0].id
        said = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
        decides, found, source = " ".join(str(said).split()).partition(". Source: ")
        if not found:
            raise ValueError(f"{name} in {deciding.__file__} needs a text below it that ends with its source.")
        step = heads[max(n for n in heads if n < node.lineno)]
        yield Constant(step, name, getattr(deciding, name), decides, source.removesuffix("."))


def lines_of_table() -> list[str]:
    """The table in Markdown, with a row for each constant."""
    rows = [f"| {c.step} | `{c.name}` | {c.value:.3g} | {c.decides} | {c.source} |" for c in constants()]
    return ["| step | constant | value | decides | where it comes from |", "|---|---|--:|---|---|", *rows]


def with_table(page: str) -> str:
    """The page with the table between its two marks."""
    return with_marked(page, NAME, "\n".join(lines_of_table()))


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
