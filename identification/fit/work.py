"""The amount of computation of a fit so far, in a unit that is the same on any machine."""

from __future__ import annotations

from threading import Lock

FILTERED = 5  # samples of a vehicle's run that take as long as one row of a filter


class Work:
    """A count of the samples over which the vehicle was run; a filter's row counts as `FILTERED` of them."""

    def __init__(self) -> None:
        self.done, self._lock = 0, Lock()

    def add(self, samples: int) -> None:
        """Count more samples."""
        with self._lock:
            self.done += int(samples)
