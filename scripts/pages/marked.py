"""The text of a page between two marks, which only a program writes."""

from __future__ import annotations


def with_marked(page: str, name: str, text: str) -> str:
    """The page with this text between the marks of that name; raises ValueError if it does not have them."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, _, rest = page.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"The page needs the marks {begin} and {end} around what is written into it.")
    return f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}"
