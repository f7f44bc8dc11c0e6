"""Memory-mapped files, and decompression of the chunks of ROS logs."""

from __future__ import annotations

import bz2
import mmap
from pathlib import Path

LARGEST_CHUNK = 1 << 30  # bytes; recorders write less than a hundredth of this


class Damaged(Exception):
    """Raised for bytes that are not a record of the format, or a chunk that cannot be decompressed."""


def mapped(path: Path) -> mmap.mmap:
    """The bytes of a file, mapped into memory; raises ValueError if it is empty or cannot be opened."""
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:
        raise ValueError(f"{path} is empty (0 bytes): copy it again.") from error
    except OSError as error:
        raise ValueError(f"Cannot read {path}: {error.strerror}.") from error


def unpacked(chunk: bytes, compression: bytes, size: int) -> bytes:
    """The content of a compressed chunk that states its size; raises Damaged if it cannot be decompressed."""
    if size > LARGEST_CHUNK:
        raise Damaged
    try:
        if compression == b"bz2":
            return bz2.BZ2Decompressor().decompress(chunk, max_length=size)
        if compression == b"lz4":
            from lz4.frame import LZ4FrameDecompressor

            return LZ4FrameDecompressor().decompress(chunk, max_length=size)
        if compression == b"zstd":
            from zstandard import ZstdDecompressor

            with ZstdDecompressor().stream_reader(chunk) as stream:
                return stream.read(size)
    except Exception as error:  # the possible exceptions have no common base
        raise Damaged from error
    raise Damaged
