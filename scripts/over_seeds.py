"""Many independent runs of a study over processes, with a bar that counts them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from joblib import Parallel, delayed

from auv_gym.cli.options.console import steps_bar

R = TypeVar("R")


def all_of(work: Callable[..., R], tasks: Iterable[tuple], jobs: int, doing: str, what: str) -> list[R]:
    """Results of work(*task), in the order of the tasks; the bar says `doing` and how many of `what` are done."""
    listed = list(tasks)
    found: list[R] = []
    with steps_bar(len(listed)) as advance, Parallel(jobs, return_as="generator") as pool:
        advance(doing)
        for result in pool(delayed(work)(*task) for task in listed):
            found.append(result)
            if len(found) < len(listed):
                advance(f"{doing}: {len(found)} of {len(listed)} {what}")
    return found
