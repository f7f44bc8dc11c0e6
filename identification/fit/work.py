"""How much a fit has computed so far, in a unit that is the same on any machine."""

from __future__ import annotations

from threading import Lock

FILTERED = 5  # samples over which a vehicle is run in the time that a filter takes for a row


class Work:
    """A count of the samples over which the vehicle was run; a filter's row counts as `FILTERED` of them."""

    def __init__(self) -> None:
        self.done, self._lock = 0, Lock()

    def add(self, samples: int) -> None:
        """Count more samples."""
        with self._lock:
            self.done += int(samples)
