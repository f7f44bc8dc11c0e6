"""Frozen rollouts: every preset under its autopilot, compared with stored arrays and bit for bit with stored hashes.

    python -m scripts.frozen_rollouts
    python -m scripts.frozen_rollouts --write

A rollout takes a minute, or 60 samples if these are longer. The set points step, a square wave is added to every input,
and nothing is random. States, outputs, inputs and set points are recorded. Hashes cover every sample; 61 samples of
each array are stored. Without --write, the exit status is 1 if a channel differs from the stored one by more than the
tolerance. On another processor or with another mathematical library, rounding may change the hashes; the differences
stay far below the tolerance (3e-14 with every sine and square root moved to the next floating-point number).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from auv_gym.channels import channel
from auv_gym.cli.options.console import table
from auv_gym.compiled import JIT
from auv_gym.model import Diverged, check_finite
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.writing import replacing, write_text
from controllers.autopilots import autopilot
from controllers.composed.loops import targets_of
from controllers.controller import Controller
from controllers.trials.trial import at_rest
from identification.experiments.hovering import Unsteered

FOLDER = Path(__file__).parents[1] / "tests" / "frozen"
TOLERANCE = 1e-10  # of a channel's range
DURATION, SAMPLES = 60.0, 60  # s, and samples, of a rollout: the longer counts; SAMPLES intervals of it are stored
HOLD = 5  # samples between the edges of the first input's square wave; each further input's takes 2 more
# set points by channel: at the beginning, and in the middle third of the run
STEPS: Mapping[str, tuple[float, float]] = {
    "depth_m": (20.0, 21.0),
    "heading_rad": (0.2, 0.6),
    "u_mps": (1.2, 1.4),
    "north_m": (0.0, 1.0),
    "east_m": (0.0, -0.5),
}
# half the height of the square waves, by the unit of the input
SWINGS: Mapping[str, float] = {
    "rad": 0.05,
    "rad/s": 0.01,
    "m/s": 0.05,
    "N": 0.5,
    "V": 0.2,
    "rpm": 50.0,
    "1": 0.05,
    "us": 20.0,
    "m": 0.01,
    "m3": 1e-5,
    "m4": 1e-4,
    "degC": 2.0,
    "kg/m3": 0.1,
    "kg/m4": 0.001,
}

# inputs whose wave keeps its length from when every vehicle had an input for bow planes
PLACES: Mapping[str, int] = {"propeller_rpm": 3, "propeller_V": 3, "speed_cmd_mps": 3}


@dataclass(frozen=True, eq=False)
class Rollout:
    """A rollout of a preset: names of its channels and their values, shape (samples, channels)."""

    vehicle: str
    channels: tuple[str, ...]
    values: np.ndarray

    @property
    def kept(self) -> np.ndarray:
        """The samples that are stored."""
        return self.values[:: (len(self.values) - 1) // SAMPLES]

    def hashes(self) -> dict[str, str]:
        """SHA-256 of every channel's samples, as little-endian doubles."""
        columns = self.values.T.astype("<f8")
        return {
            name: hashlib.sha256(column.tobytes()).hexdigest()
            for name, column in zip(self.channels, columns, strict=True)
        }


@dataclass(frozen=True, eq=False)
class Stored:
    """A stored rollout: hashes by channel, and the samples kept, shape (samples, channels)."""

    hashes: Mapping[str, str]
    kept: np.ndarray


@dataclass(frozen=True)
class Difference:
    """The difference of a channel from the stored one: in bits, and over the stored range; inf if one is absent."""

    channel: str
    same_bits: bool
    relative: float


def main(argv: Sequence[str] | None = None) -> int:
    """Compare the rollouts of all presets with the stored ones, or store them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="store the rollouts of today in place of the others")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="over a channel's range (default 1e-10)")
    parser.add_argument("--all", action="store_true", help="list every channel whose bits differ")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of rollouts.npz and rollouts.json")
    given = parser.parse_args(argv)
    if not 0.0 <= given.tolerance < inf:
        parser.error(f"--tolerance needs a number from 0 up, got {given.tolerance}")
    console = Console(highlight=False, width=max(Console().width, 110))
    try:
        rollouts = [roll_out(load_vehicle(name)) for name in list_vehicles()]
        if given.write:
            write(rollouts, given.folder)
            console.print(f"Written to {given.folder}: {', '.join(r.vehicle for r in rollouts)}", markup=False)
            return 0
        found, made_with = compared(rollouts, given.folder)
    except (ValueError, OSError, Diverged) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    console.print(_vehicles_table(found))
    shown = [
        (name, d)
        for name, all_ in found.items()
        for d in all_
        if d.relative > given.tolerance or (given.all and not d.same_bits)
    ]
    if shown:
        console.print(_channels_table(shown))
    changed = sorted({name for name, d in shown if d.relative > given.tolerance})
    if any(not d.same_bits for all_ in found.values() for d in all_) and made_with != versions():
        was, now = ("; ".join(f"{key} {value}" for key, value in v.items()) for v in (made_with, versions()))
        console.print(f"Stored with {was}.\nRun with    {now}.", markup=False)
    if changed:
        console.print(f"Differs by more than {given.tolerance:g} of the range: {', '.join(changed)}.", markup=False)
    return 1 if changed else 0


def roll_out(plant: Plant) -> Rollout:
    """A rollout of a vehicle under its autopilot, with a square wave added at each input. Raises Diverged."""
    n = max(round(DURATION / plant.dt), SAMPLES) + 1
    n += -(n - 1) % SAMPLES  # so that the samples kept are evenly apart
    k = np.arange(n)
    time, middle = plant.dt * k, (3 * k >= n) & (3 * k < 2 * n)
    controller = _controller(plant)
    wanted = {name: np.where(middle, *reversed(_step(name))) for name in targets_of(controller)}
    x, base = at_rest(plant, {"depth_m": STEPS["depth_m"][0], **{name: float(v[0]) for name, v in wanted.items()}})
    added = np.array([_wave(name, i, time) for i, name in enumerate(plant.inputs)]).T
    column = {name: i for i, name in enumerate(plant.inputs)}
    states, outputs = np.empty((n, x.size)), np.empty((n, len(plant.outputs)))
    inputs, memory = np.empty((n, base.size)), controller.start()
    for row in range(n):
        states[row], outputs[row] = x, plant.output(x)
        reading = dict(zip(plant.outputs, outputs[row].tolist(), strict=True))
        target = {name: float(values[row]) for name, values in wanted.items()}
        command, memory = controller.act(memory, {**reading, "dt_s": plant.dt}, target)
        for name, value in command.items():
            if name in column:
                base[column[name]] = value
        inputs[row] = base + added[row]
        x = plant.step(x, inputs[row])
    check_finite(plant.outputs, time, outputs)
    parts: list[tuple[str, Iterable[str], np.ndarray]] = [
        ("state", plant.states, states),
        ("output", plant.outputs, outputs),
        ("input", plant.inputs, inputs),
        ("set point", wanted, np.array([*wanted.values()]).reshape(len(wanted), n).T),
    ]
    names = tuple(f"{part} {name}" for part, those, _ in parts for name in those)
    return Rollout(plant.name, names, np.hstack([values for _, _, values in parts]))


def _controller(plant: Plant) -> Controller:
    """The vehicle's autopilot; for a vehicle without one, a controller that leaves all commands at rest."""
    body = plant.family.body
    return autopilot(plant) if body is None or body.piloted else Unsteered({})


def write(rollouts: Sequence[Rollout], folder: Path) -> None:
    """Store rollouts: arrays in rollouts.npz, hashes and versions in rollouts.json."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {r.vehicle: r.kept for r in rollouts}
    with replacing(folder / "rollouts.npz") as new, new.open("wb") as file:
        np.savez_compressed(file, **arrays)
    index = {"made_with": versions(), "vehicles": {r.vehicle: r.hashes() for r in rollouts}}
    write_text(folder / "rollouts.json", json.dumps(index, indent=1) + "\n")


def read(folder: Path = FOLDER) -> tuple[dict[str, Stored], dict[str, str]]:
    """Stored rollouts by vehicle, and the versions that they were made with."""
    if not (folder / "rollouts.json").is_file():
        raise ValueError(f"No rollouts are stored in {folder}: store today's with --write, or give another --folder.")
    index = json.loads((folder / "rollouts.json").read_text(encoding="utf-8"))
    with np.load(folder / "rollouts.npz") as arrays:
        stored = {name: Stored(hashes, arrays[name]) for name, hashes in index["vehicles"].items()}
    return stored, index["made_with"]


def compared(rollouts: Sequence[Rollout], folder: Path) -> tuple[dict[str, list[Difference]], dict[str, str]]:
    """Differences from the stored rollouts, by vehicle, and the versions of these. Raises if the vehicles differ."""
    stored, made_with = read(folder)
    now, then = {r.vehicle for r in rollouts}, set(stored)
    if now != then:
        raise ValueError(
            f"The rollouts in {folder} are not of today's presets. Missing: {', '.join(sorted(now - then)) or 'none'}; "
            f"no longer a preset: {', '.join(sorted(then - now)) or 'none'}. Store today's with --write."
        )
    return {r.vehicle: differences(r, stored[r.vehicle]) for r in rollouts}, made_with


def differences(rollout: Rollout, stored: Stored) -> list[Difference]:
    """The difference of each channel, stored or present, from the stored one."""
    before = dict(zip(stored.hashes, stored.kept.T, strict=True))
    now = dict(zip(rollout.channels, rollout.kept.T, strict=True))
    hashes = rollout.hashes()
    return [
        Difference(name, hashes.get(name) == stored.hashes.get(name), _relative(now.get(name), before.get(name)))
        for name in dict.fromkeys((*before, *now))
    ]


def versions() -> dict[str, str]:
    """The versions on which a rollout's bits depend."""
    packages = {name: version(name) for name in ("numpy", "numba", "llvmlite")}
    return {"python": platform.python_version(), **packages, "machine": platform.machine(), "compiled": str(JIT)}


def _step(name: str) -> tuple[float, float]:
    if name not in STEPS:
        raise ValueError(f"Needed a step for the set point {name}, known are {', '.join(STEPS)}: add it to STEPS.")
    return STEPS[name]


def _wave(name: str, index: int, time: np.ndarray) -> np.ndarray:
    """The addition to an input: a square wave, which is the same on every machine; for a clock, the time."""
    unit = channel(name).unit
    if unit == "s":
        return time
    if unit not in SWINGS:
        raise ValueError(f"Needed a swing for the input {name} in {unit}, known are {', '.join(SWINGS)}: add its unit.")
    half_periods = np.arange(time.size) // (HOLD + 2 * PLACES.get(name, index))
    return SWINGS[unit] * (1.0 - 2.0 * (half_periods % 2))


def _relative(values: np.ndarray | None, stored: np.ndarray | None) -> float:
    """The largest difference over the stored range; for a constant channel, over its size, or 1 for zero."""
    if values is None or stored is None or values.shape != stored.shape:
        return inf
    span = float(np.ptp(stored)) or float(np.abs(stored).max()) or 1.0
    return float(np.abs(values - stored).max()) / span


def _vehicles_table(found: Mapping[str, Sequence[Difference]]) -> Table:
    shown = table(
        "Rollouts against the stored ones", "vehicle!", "channels>", "same bits>", "largest difference / range>", "in"
    )
    for name, all_ in found.items():
        worst = max(all_, key=lambda d: d.relative)
        same = sum(d.same_bits for d in all_)
        shown.add_row(
            name, str(len(all_)), str(same), f"{worst.relative:.2g}", worst.channel if worst.relative > 0.0 else ""
        )
    return shown


def _channels_table(rows: Sequence[tuple[str, Difference]]) -> Table:
    shown = table("Channels that differ", "vehicle!", "difference / range>", "channel")
    for name, difference in rows:
        shown.add_row(name, f"{difference.relative:.2g}", difference.channel)
    return shown


if __name__ == "__main__":
    sys.exit(main())
