"""Numbers by name that stay in an array until somebody reads them: an info costs little where nobody looks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import final

import numpy as np


@final
class Named(Mapping[str, float]):
    """A read-only mapping from names to floats, equal to a dict of the same items.

    Whoever makes one sets `index`, name to place, and `numbers`, an array which is kept and not copied: a constructor
    in Python would take twice the time, and a step makes five of these.
    """

    __slots__ = ("index", "numbers")
    index: Mapping[str, int]
    numbers: np.ndarray

    def __getitem__(self, name: str) -> float:
        return self.numbers.item(self.index[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.index)

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return repr(dict(self))
