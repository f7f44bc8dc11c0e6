"""How the C library keeps memory that was freed."""

from __future__ import annotations

import ctypes

_ARENA_MAX = -8  # of glibc's mallopt


def with_few_heaps() -> bool:
    """Let threads share heaps, of which glibc otherwise gives each its own and keeps what was freed there.

    For a process of our own, before it has threads.  Returns whether the C library has taken note; only glibc can.
    """
    try:
        return bool(ctypes.CDLL(None).mallopt(_ARENA_MAX, 2))
    except (AttributeError, OSError, TypeError):  # another C library, or another system
        return False
