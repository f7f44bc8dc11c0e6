"""The available vehicle files, their headings and their text, without the physics, which takes long to load."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from auv_gym.param import did_you_mean


@dataclass(frozen=True)
class Heading:
    """The heading of a vehicle file; dt: s."""

    family: str
    title: str
    dt: float


def list_preset_headings() -> dict[str, Heading]:
    """The headings of the presets by name."""
    found = {}
    for name, path in _presets().items():
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        found[name] = Heading(content["family"], content["title"], float(content["dt_s"]))
    return found


def find_vehicle(name: str | os.PathLike) -> tuple[str, str]:
    """The text of a preset or a vehicle file (TOML), and its name for errors; raises ValueError if there is none."""
    presets = _presets()
    if not isinstance(name, str | os.PathLike):
        raise ValueError(f"A vehicle is the name of a preset ({', '.join(presets)}) or a .toml file, got {name!r}.")
    text = os.fspath(name)
    if text in presets:
        return _text(presets[text]), text
    if not text.endswith(".toml"):
        hint = did_you_mean(text, presets)
        raise ValueError(f"No vehicle {text!r}. {hint}Presets: {', '.join(presets)}; or give a .toml file.")
    path = Path(text)
    if not path.is_file():
        raise ValueError(f"No vehicle file {text!r}: give a path to a TOML file or one of {', '.join(presets)}.")
    return _text(path), path.name


def _presets() -> Mapping[str, Path]:
    folder = files("auv_gym") / "vehicles" / "presets"
    paths = (Path(str(item)) for item in folder.iterdir() if item.name.endswith(".toml"))
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"Cannot read vehicle file {path.name}: {error}. Give a TOML file in UTF-8.") from None
