"""The error for a missing package that one of the extras installs, and how to install it."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager


def how_to_install(extra: str) -> str:
    """What to type for an extra, from the clone, since no package index has auv-gym."""
    return f"in the clone of auv-gym: pip install '.[{extra}]'"


@contextmanager
def needs(what: str, extra: str) -> Generator[None]:
    """Raise an error that names the extra if an import in the block fails; what: `Training needs stable-baselines3`."""
    try:
        yield
    except ImportError as error:
        raise ImportError(f"{what} ({error}); {how_to_install(extra)}.") from error
