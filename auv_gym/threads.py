"""Parallel work in several threads: compiled code releases Python's lock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from auv_gym.compiled import threads

S = TypeVar("S")
T = TypeVar("T")


def side_by_side(run: Callable[[T], S], items: Sequence[T]) -> list[S]:
    """The result of `run` for each item, in their order, run in parallel in as many threads as there are."""
    if len(items) < 2 or threads() == 1:
        return [run(item) for item in items]
    with ThreadPoolExecutor(threads()) as pool:
        return list(pool.map(run, items))
