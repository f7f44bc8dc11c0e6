"""Optional parts of a result: a failure is reported beside the result and never loses it."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Failure:
    """A part of a result that could not be made.

    what: the part, in words that begin a sentence.  why: the error, and where it was raised.
    """

    what: str
    why: str

    @property
    def text(self) -> str:
        """The failure as a sentence."""
        return f"{self.what} could not be made: {self.why}. The other results do not depend on it."


class Extras:
    """Parts of a result that are attempted one by one; `failures` holds those that failed."""

    def __init__(self) -> None:
        self.failures: list[Failure] = []

    def attempt(self, what: str, make: Callable[[], T], otherwise: T) -> T:
        """The return value of `make`; if it raises, the failure is recorded and `otherwise` is returned."""
        try:
            return make()
        except Exception as error:  # any error at all: the result may have taken hours of search and must not be lost
            failure = Failure(what, _why(error))
            if failure not in self.failures:
                self.failures.append(failure)
            return otherwise


def _why(error: Exception) -> str:
    """An error in one line; an unexpected one also says where it was raised."""
    text = str(error).rstrip(".") or type(error).__name__
    if isinstance(error, ValueError | ImportError | OSError):
        return text
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {text} ({Path(place.filename).name}, line {place.lineno})"
