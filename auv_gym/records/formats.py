"""The readable formats of logs, found by entry points, and the format of a given file."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from shlex import quote

from auv_gym.param import did_you_mean
from auv_gym.records.log import Format

GROUP = "auv_gym.readers"
_HEAD = 4096  # bytes
_PACKED = {
    ".gz": "gunzip", ".bz2": "bunzip2", ".xz": "unxz", ".zst": "unzstd", ".zip": "unzip", ".7z": "7z x",
    ".tar": "tar xf", ".tgz": "tar xf",
}  # fmt: skip


@cache
def formats() -> tuple[Format, ...]:
    """All formats, by name; other packages add theirs under the entry point group `auv_gym.readers`."""
    return _loaded()[0]


@cache
def _loaded() -> tuple[tuple[Format, ...], str]:
    """The formats, and a text on other packages' readers that cannot be imported; these do not affect the others."""
    found, broken = [], []
    for entry in entry_points(group=GROUP):
        try:
            found.append(entry.load())
        except Exception as error:  # any error that a foreign module may raise on import
            broken.append(f"The reader {entry.name} ({entry.value}) cannot be imported: {error!r}.")
    return tuple(sorted(found, key=lambda one: (one.general, one.name.lower()))), " ".join(broken)


def known_endings() -> str:
    """The endings of all formats in words, each once, with all formats that use it."""
    named: dict[tuple[str, ...], list[str]] = {}
    for ending in dict.fromkeys(ending for found in formats() for ending in found.endings or ("a folder",)):
        names = tuple(found.name for found in formats() if ending in (found.endings or ("a folder",)))
        named.setdefault(names, []).append(ending)
    return ", ".join(f"{', '.join(endings)} ({' or '.join(names)})" for names, endings in named.items())


def format_of(path: Path) -> Format:
    """The format of a file or folder; raises ValueError if there is none, or if it cannot be opened."""
    head = _head(path)
    ending = path.suffix.lower()
    of_ending = [found for found in formats() if ending in found.endings or _has_ending(path, found)]
    own = [found for found in of_ending if not found.general]
    general = [found for found in formats() if found.general and not own]
    for found in (*own, *(found for found in formats() if not found.general), *general):
        if found.recognises(path, head):
            return found
    if path.is_dir():
        raise ValueError(
            f"{path} is a folder, and not itself a log, as a ROS 2 bag with its metadata.yaml is: give the path of "
            "one log file in it."
        )
    if of_ending:
        names = " or ".join(dict.fromkeys(found.name for found in of_ending))
        raise ValueError(
            f"{path} ends in {ending!r} ({names}), but its content is something else: it begins with {_shown(head)}. "
            "Check its ending, or copy or export it again."
        )
    if ending in _PACKED:
        raise ValueError(f"{path} is packed. Unpack it first: {_PACKED[ending]} {quote(str(path))}")
    raise ValueError(
        f"{path} ends in {ending!r}, which is no known format. Save it as CSV, or give one of these: "
        f"{known_endings()}. {_loaded()[1]}".rstrip()
    )


def check_file(path: Path) -> None:
    """Raise ValueError unless there is a file or folder that can be opened and is not empty."""
    if not path.exists():
        near = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise ValueError(f"There is no file {path}. {did_you_mean(path.name, near)}Give the path of a log.")
    if path.is_dir():
        return
    try:
        empty = path.stat().st_size == 0
        path.open("rb").close()
    except OSError as error:
        raise ValueError(f"Cannot read {path}: {error.strerror}.") from error
    if empty:
        raise ValueError(f"{path} is empty (0 bytes): copy or download it again.")


def _head(path: Path) -> bytes:
    check_file(path)
    if path.is_dir():
        return b""
    with path.open("rb") as file:
        return file.read(_HEAD)


def _has_ending(path: Path, found: Format) -> bool:
    return any(path.name.lower().endswith(ending) for ending in found.endings)


def _shown(head: bytes) -> str:
    start = head[:16].splitlines()[0] if head[:16].strip() else head[:16]
    if start.isascii() and start.decode("ascii").isprintable():
        return repr(start.decode("ascii"))
    return "only zeros" if not any(head) else f"the bytes {start[:8].hex(' ')}"
