"""Writing of files as a whole or not at all, by a temporary file that is renamed; and folders to write to.

Folders are made early, so that an unwritable one is refused before the work.
"""

from __future__ import annotations

import json
import os
import secrets
import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any

_made: list[Path] = []  # the folders that `writable_folder` made in this process


@contextmanager
def replacing(path: str | os.PathLike) -> Generator[Path]:
    """A new empty file beside `path`, to be written in the block; it is renamed to `path` when the block ends normally.

    If the block raises, the old file stays and the new one is removed. Raises ValueError if the system refuses to
    write.  Use: `with replacing(path) as new: new.write_text(text, encoding="utf-8")`.
    """
    target = Path(path)
    # a unique name for each writer, so that of two processes each writes a whole file
    aside = target.with_name(f".{target.name}.{secrets.token_hex(6)}.part")
    try:
        aside.open("x").close()
        yield aside
        aside.replace(target)
    except OSError as error:
        raise ValueError(
            f"Cannot write {path}: {error.strerror or error}. Choose a folder that exists and is writable."
        ) from error
    finally:
        aside.unlink(missing_ok=True)


def check_ending(path: str | os.PathLike, ending: str, what: str) -> None:
    """Raise if a file's name ends otherwise than its format: other programs would take it for another one."""
    if Path(path).suffix.lower() != ending:
        raise ValueError(f"{what} ends in {ending}, got {Path(path).name!r}: rename it.")


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write text to a file, whole or not at all; raises ValueError as `replacing` does."""
    with replacing(path) as new:
        new.write_text(text, encoding="utf-8")


def write_json(path: str | os.PathLike, content: Any) -> None:
    """Write plain data as JSON, indented by one space, whole or not at all; raises ValueError as `replacing` does."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def quoted(text: str) -> str:
    """A text as a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON's escapes are TOML's, except for DEL


def finite(content: Any) -> Any:
    """Plain data with None in place of numbers that JSON does not have."""
    if isinstance(content, Mapping):
        return {key: finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    if isinstance(content, float):
        return float(content) if isfinite(content) else None
    return content


def writable_folder(folder: str | os.PathLike) -> Path:
    """The folder, made if need be; raises ValueError if nothing can be written into it."""
    out = Path(folder)
    try:
        _made.extend(path for path in (*reversed(out.parents), out) if not path.exists())
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=out):
            pass
    except OSError as error:
        raise ValueError(
            f"Cannot write into {out}: {'it is a file' if out.is_file() else error.strerror or error}. Give another "
            "folder."
        ) from None
    return out


@contextmanager
def no_empty_folders() -> Generator[None]:
    """When the block ends, remove the folders that `writable_folder` made in it and that are empty."""
    _made.clear()
    try:
        yield
    finally:
        while _made:
            with suppress(OSError):  # the folder is not empty, or was never made
                _made.pop().rmdir()
