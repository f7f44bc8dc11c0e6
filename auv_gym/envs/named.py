"""Numbers by name that stay in an array until somebody reads them: an info costs little where nobody looks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import final

import numpy as np


@final
class Named(Mapping[str, float]):
    """A read-only mapping from names to floats, equal to a dict of the same items.

    index: name to place in `values`.  The array is kept, not copied.
    """

    __slots__ = ("_index", "_values")

    def __init__(self, index: Mapping[str, int], values: np.ndarray):
        self._index = index
        self._values = values

    def __getitem__(self, name: str) -> float:
        return self._values.item(self._index[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._index)

    def __len__(self) -> int:
        return len(self._index)

    def __repr__(self) -> str:
        return repr(dict(self))
