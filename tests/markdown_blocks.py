"""The fenced blocks of a Markdown file, with what its comments say of them.

`<!-- not run: REASON -->` before a block: it is listed, not run.  `<!-- slow -->`: run with the tests marked slow.
`<!-- setup` ... `-->`: Python that the reader does not see, run before what follows.  A block `text` right after one
that is run is what that one prints.  A block with `title="FILE"` is written to that file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_PARTS = re.compile(
    r"^<!-- setup\n(?P<setup>.*?)^-->$"
    r"|^ *<!-- (?P<mark>not run: [^\n]*?|slow) -->$"
    r"|^(?P<indent> *)```(?P<info>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
_SHELL = ("sh", "bash", "")


@dataclass(frozen=True)
class Block:
    """kind: setup, python, sh, toml, text or another language; printed: what it has to print, if anything is said."""

    kind: str
    text: str
    line: int
    title: str = ""
    mark: str = ""
    printed: str | None = None

    @property
    def runs(self) -> bool:
        return self.kind in ("setup", "python", "sh") and not self.mark.startswith("not run")

    @property
    def slow(self) -> bool:
        return self.mark == "slow"

    @property
    def commands(self) -> list[str]:
        """The lines of a shell block, continued ones joined, without comments."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def blocks_of(markdown: str) -> list[Block]:
    """All blocks in order."""
    found: list[Block] = []
    mark, end = "", -1
    for part in _PARTS.finditer(markdown):
        line = markdown.count("\n", 0, part.start()) + 1
        between = markdown[end : part.start()].strip() if end >= 0 else "-"
        if part["setup"] is not None:
            found.append(Block("setup", part["setup"], line))
        elif part["mark"]:
            mark = part["mark"]
            continue
        else:
            language, title = _info(part["info"])
            text = "".join(row.removeprefix(part["indent"]) for row in part["text"].splitlines(keepends=True))
            if language == "text" and found and found[-1].runs and not between:
                last = found.pop()
                found.append(Block(last.kind, last.text, last.line, last.title, last.mark, text))
            else:
                found.append(Block(language, text, line, title, mark))
        mark, end = "", part.end()
    return found


def _info(info: str) -> tuple[str, str]:
    language = info.split(" ")[0].strip()
    title = re.search(r'title="([^"]+)"', info)
    return "sh" if language in _SHELL else language, title[1] if title else ""
