"""Tuned gains by vehicle and sample time, read from and written to TOML."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from math import isfinite, log
from pathlib import Path
from typing import Any

from auv_gym.writing import quoted, write_text

Loops = Mapping[str, Mapping[str, float]]

_FACTOR = 2.0  # largest ratio of sample times for which one set of gains suffices


@dataclass(frozen=True)
class Gains:
    """The tuned gains of a vehicle's controllers at a sample time, s.

    loops: by kind of controller ("pid", "s_plane") and loop ("heading"), the settings of its law by name.
    bow_share: movement of the bow planes relative to the stern planes, negative if they oppose each other in pitch.
    notes: by kind, findings of a test of these gains, in sentences.
    """

    vehicle: str
    dt: float
    bow_share: float = 0.0
    loops: Mapping[str, Loops] = field(default_factory=dict)
    notes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def law(self, kind: str, loop: str) -> dict[str, Any]:
        """The settings of one law; raises ValueError if these gains have none."""
        try:
            return dict(self.loops[kind][loop])
        except KeyError:
            there = ", ".join(f"{k}.{name}" for k, loops in self.loops.items() for name in loops)
            raise ValueError(
                f"The gains of {self.vehicle!r} at {self.dt:g} s have no {kind}.{loop}, but {there or 'nothing'}: add "
                "it to the gains that you give, or choose other targets or another kind."
            ) from None


class NoGains(ValueError):
    """Raised if there are no gains for a vehicle at any sample time."""


def gains_for(vehicle: str, dt: float, path: str | os.PathLike | None = None) -> Gains:
    """The gains of a vehicle tuned at the nearest sample time, s; raises if none is within a factor of 2.

    path: a file of gains, by default that of the presets.

    Example:

        >>> from controllers import gains_for
        >>> gains_for("remus100", 0.1).loops["pid"]["heading"]
        {'proportional': -1.323, 'integral': -0.07212, 'derivative': -2.228, 'integral_range': 0.2}
    """
    entries = read_gains(path)
    of_vehicle = [entry for entry in entries if entry.vehicle == vehicle]
    near = [entry for entry in of_vehicle if abs(log(entry.dt / dt)) <= log(_FACTOR) + 1e-9]
    if near:
        return min(near, key=lambda entry: abs(log(entry.dt / dt)))
    there = ", ".join(f"{entry.dt:g} s" for entry in of_vehicle)
    have = f"there are some of {', '.join(_names(entries)) or 'none'}."
    if there:
        have = f"there are some at {there}: choose such a sample time."
    raise (ValueError if there else NoGains)(
        f"No gains of {vehicle!r} within a factor of {_FACTOR:g} of a sample time of {dt:g} s; {have} "
        "Begin with those of a similar vehicle, gains=gains_for('remus100', 0.1), or give a file of gains for yours: "
        f"`auv-gym tune VEHICLE.toml --dt {dt:g} --out gains.toml` makes one."
    )


def read_gains(path: str | os.PathLike | None = None) -> tuple[Gains, ...]:
    """Read all entries of a gains file, by default that of the presets; raises an error that says what is wrong.

    Example:

        >>> from controllers import read_gains
        >>> [entry.dt for entry in read_gains() if entry.vehicle == "remus100"]
        [0.1]
    """
    origin = "of the presets" if path is None else os.fspath(path)
    try:
        content = files("controllers").joinpath("gains.toml").read_text("utf-8") if path is None else _text(path)
        entries = tomllib.loads(content).get("vehicle", [])
        return tuple(_entry(entry) for entry in entries)
    except (tomllib.TOMLDecodeError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(
            f"File of gains {origin} cannot be used: {error}. It needs [[vehicle]] tables with name, dt_s and tables "
            "such as [vehicle.pid.heading], as `controllers.gains.write_gains` makes them."
        ) from None


def write_gains(entries: Sequence[Gains], path: str | os.PathLike) -> None:
    """Write entries, ordered by vehicle and sample time; aside first, then renamed.

    Example:

        >>> from controllers import gains_for, read_gains, write_gains
        >>> write_gains([gains_for("remus100", 0.1)], "gains.toml")
        >>> [entry.vehicle for entry in read_gains("gains.toml")]
        ['remus100']
    """
    lines = [
        "# Gains of controllers, by vehicle and sample time, as `write_gains` makes them; see docs/controllers.md.",
        "",
    ]
    for entry in sorted(entries, key=lambda e: (e.vehicle, e.dt)):
        lines += ["[[vehicle]]", f"name = {quoted(entry.vehicle)}"]
        lines += [f"dt_s = {entry.dt!r}", f"bow_share = {entry.bow_share!r}"]
        for kind, loops in entry.loops.items():
            for loop, settings in loops.items():
                lines += ["", f"[vehicle.{kind}.{loop}]"]
                lines += [f"{key} = {float(value)!r}" for key, value in settings.items()]
        if entry.notes:
            lines += ["", "[vehicle.notes]"]
        for kind, notes in entry.notes.items():
            lines += [f"{kind} = [", *(f"    {quoted(note)}," for note in notes), "]"]
        lines.append("")
    write_text(path, "\n".join(lines))


def with_gains(entries: Sequence[Gains], gains: Gains) -> tuple[Gains, ...]:
    """Entries updated with these gains; other laws for the same vehicle and sample time are kept."""
    same = [e for e in entries if (e.vehicle, e.dt) == (gains.vehicle, gains.dt)]
    loops = {law: of_law for entry in same for law, of_law in entry.loops.items()} | dict(gains.loops)
    notes = {law: of_law for entry in same for law, of_law in entry.notes.items() if law not in gains.loops}
    notes |= gains.notes
    return (*(e for e in entries if e not in same), replace(gains, loops=loops, notes=notes))


def _entry(content: Mapping) -> Gains:
    loops = {
        kind: {name: {key: float(value) for key, value in loop.items()} for name, loop in of_kind.items()}
        for kind, of_kind in content.items()
        if isinstance(of_kind, Mapping) and kind != "notes"
    }
    notes = {kind: tuple(map(str, texts)) for kind, texts in content.get("notes", {}).items()}
    entry = Gains(str(content["name"]), float(content["dt_s"]), float(content.get("bow_share", 0.0)), loops, notes)
    if not (isfinite(entry.dt) and entry.dt > 0.0):
        raise ValueError(f"dt_s of {entry.vehicle!r} must be positive, got {entry.dt!r}")
    return entry


def _text(path: str | os.PathLike) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"it cannot be read ({error})") from None


def _names(entries: Sequence[Gains]) -> list[str]:
    return sorted({entry.vehicle for entry in entries})
