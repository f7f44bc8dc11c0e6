"""Numbers by name that stay in an array until somebody reads them: an info costs little where nobody looks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import final

import numpy as np


@final
class Named(Mapping[str, float]):
    """A read-only mapping from names to floats, equal to a dict of the same items; see `named`."""

    __slots__ = ("_index", "_values")
    _index: Mapping[str, int]
    _values: np.ndarray

    def __getitem__(self, name: str) -> float:
        return self._values.item(self._index[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._index)

    def __len__(self) -> int:
        return len(self._index)

    def __repr__(self) -> str:
        return repr(dict(self))


def named(groups: tuple[tuple[str, Mapping[str, int]], ...], values: np.ndarray) -> dict[str, Named]:
    """Groups of numbers by their names, each group with the places of its names in `values`, which is not copied."""
    found = {}
    for group, index in groups:
        found[group] = one = Named()  # without a constructor in Python, which would take twice the time
        one._index, one._values = index, values
    return found
