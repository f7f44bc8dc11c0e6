"""The error of a package that one of the extras would bring."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def needs(what: str, extra: str) -> Generator[None]:
    """Imports in the block fail with an error that names the extra; what: `Training needs stable-baselines3`."""
    try:
        yield
    except ImportError as error:
        raise ImportError(f"{what} ({error}): pip install 'auv-gym[{extra}]'.") from error
