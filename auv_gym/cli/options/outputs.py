"""Checks of what a command is to write, before any work: no input is overwritten, nor a file of another kind."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

Given = str | Path | None
Kind = tuple[str, Callable[[Path], bool]]  # what a command writes, in words, and whether a file is one


def check_output(
    option: str,
    out: Path,
    inputs: Mapping[str, Given | Iterable[Given]],
    kind: Kind | None = None,
    results: Sequence[str] = (),
) -> None:
    """Raise ValueError if an output is one of the command's inputs, or an existing file of another kind.

    Also if a file cannot be written there.

    inputs: by the option that they were given with, or "" for an argument.  kind: None if any file may be replaced.
    results: the names of the files that are written if the output is a folder.
    """
    files = [out / name for name in results] if results else [out]
    for file in files:
        for given_with, given in inputs.items():
            for one in [given] if given is None or isinstance(given, (str, Path)) else given:
                if one is not None and _same(file, Path(one)):
                    source = f"which was given with {given_with}" if given_with else "which the command is to read"
                    place = "folder" if results else "name"
                    raise ValueError(f"{option} {out} would overwrite {one}, {source}: give another {place}.")
    if not results:
        _check_folder(option, out.parent)
    if kind is None or results or not out.is_file() or out.stat().st_size == 0:
        return
    words, is_one = kind
    if not is_one(out):
        raise ValueError(
            f"{option} {out} would overwrite a file that is not {words}: give another name, or remove the file first."
        )


def _check_folder(option: str, folder: Path) -> None:
    """Raise ValueError if a file cannot be written into a folder; the folder is not made for a file alone."""
    from auv_gym.writing import writable_folder

    if not folder.exists():
        raise ValueError(f"{option} names the folder {folder}, which does not exist: create it first.")
    writable_folder(folder)


def begins_with(*heads: bytes) -> Callable[[Path], bool]:
    """A check of whether a file begins with one of these bytes."""

    def check(path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(max(map(len, heads))).startswith(heads)

    return check


def is_mapping(path: Path) -> bool:
    """Whether a file can be a mapping from columns to channels."""
    from auv_gym.records.mapping import is_known, load_mapping

    try:
        names = load_mapping(path)
    except ValueError:
        return False
    known = [is_known(target.name, None) for target in names.targets.values()]
    known += [is_known(name, None) for name in names.constants]
    # a mapping to be filled in has comments only
    return any(known) if known else path.read_bytes().lstrip().startswith(b"#") or bool(names.left_out)


def is_vehicle(path: Path) -> bool:
    """Whether a file can be a vehicle file."""
    return "family" in _toml(path)


def is_gains(path: Path) -> bool:
    """Whether a file can be one of controllers' gains."""
    content = _toml(path)
    return set(content) == {"vehicle"} and isinstance(content["vehicle"], list)


def is_simulated(path: Path) -> bool:
    """Whether a file can be a record that `auv-gym simulate` wrote: under our names and in SI, or saved as a record."""
    from auv_gym.channels import SEGMENT_COLUMNS, conversion

    if path.suffix.lower() == ".nc":
        from auv_gym.records.reading import is_saved_record

        return is_saved_record(path)
    with path.open("rb") as file:
        names = file.readline(65536).decode("utf-8", errors="replace").rstrip("\r\n").split(",")
    names = names[names[0] in SEGMENT_COLUMNS :]
    try:
        return names[:1] == ["time_s"] and all(conversion(name).channel.name == name for name in names)
    except ValueError:
        return False


def _toml(path: Path) -> dict[str, object]:
    import tomllib

    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _same(one: Path, other: Path) -> bool:
    """Whether two paths are of the same existing file, links included."""
    return one.is_file() and other.is_file() and os.path.samefile(one, other)
