"""The error for a missing package that one of the extras installs."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def needs(what: str, extra: str) -> Generator[None]:
    """Raise an error that names the extra if an import in the block fails; what: `Training needs stable-baselines3`."""
    try:
        yield
    except ImportError as error:
        raise ImportError(f"{what} ({error}): pip install 'auv-gym[{extra}]'.") from error
