"""Gliders' dives: fitted on some, judged on others, by the vertical velocity that steady flight makes of them.

    python -m scripts.studies.glider_dives --data DIR --out dives

DIR has the files of `seaglider/`; gliders whose files are not there are left out.  Below 30 m, away from pumping and
inflections, the vertical velocity of the model is compared with the differenced depth: with the constants that the
first fitted dive states, with their coefficients refitted, and with what the diagnosis names.  The judged dives are
seen by nothing before.  A second table has their depth-averaged currents beside the operators' own.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auv_gym.cli.options.console import errors, output
from auv_gym.model import inputs_of
from auv_gym.plant import Plant
from auv_gym.plant.currents import dive_currents
from auv_gym.plant.record_check import described, needs_of
from auv_gym.plant.stated import vehicle_from_dive
from auv_gym.records.reading import open_log, read_record
from auv_gym.records.record import Record
from auv_gym.writing import replacing, writable_folder
from identification.diagnosis import Diagnosis, diagnose
from identification.diagnosis.wording import interval, quantity
from scripts.studies.harness import Sheet

LEAST_DEPTH = 30.0  # m

CURRENTS = ("dive", "as stated, m/s north and east>", "with effects>", "operators>")


@dataclass(frozen=True)
class Split:
    """Dives of a glider, as files in `seaglider/`: those that are fitted, and those that judge."""

    glider: str
    fitted: tuple[str, ...]
    judged: tuple[str, ...]

    @property
    def words(self) -> str:
        return f"{', '.join(dive_of(f) for f in self.fitted)} on {', '.join(dive_of(f) for f in self.judged)}"


def dive_of(file: str) -> str:
    """The number of a dive, as the file's name has it."""
    return str(int(file.partition(".")[0].partition("_")[0][4:]))


def both_ways(glider: str, names: Sequence[str]) -> tuple[Split, Split]:
    """Every other dive fitted, and the reverse."""
    return Split(glider, tuple(names[0::2]), tuple(names[1::2])), Split(glider, tuple(names[1::2]), tuple(names[0::2]))


SPLITS = (
    *both_ways("SG561", [f"p561000{k}.nc" for k in (2, 3, 4, 5)]),
    *both_ways("SG171", [f"p1710{k}.nc" for k in (100, 101, 102, 103)]),
    *both_ways("SG005", ["p0050003_20080606.nc", "p0050004_20080607.nc"]),
)
HEADS = (
    *("glider", "fitted, judged", "samples", "as stated, cm/s>", "refitted>", "with effects>"),
    *("named (95 % interval)", "mean velocity, cm/s", "s>"),
)


def vertical_velocities(plant: Plant, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Of the model at the measured depths, and of the differenced depth, m/s, at the samples of a record."""
    family, inputs, depth = plant.family, inputs_of(plant, record), record["depth_m"]
    heated = family.actuators.index("temperature_C")
    view, slopes, found = family.view(plant.derived), np.empty(family.integrated), np.full(len(record), np.nan)
    between = {n: record[n] for n in family.interpolated if record.has(n)}
    for name, values in between.items():  # at the sample itself
        inputs[:, family.inputs.index(name)] = values
    shaped, memory, z = np.empty(2), np.empty(2), np.zeros(family.integrated)
    for k in range(len(record)):
        memory[:] = inputs[k, :2]
        family.hooks.shape(inputs[k], memory, view, shaped)
        shaped[heated] = inputs[k, heated]
        z[0] = depth[k]
        family.hooks.derivative(z, shaped, inputs[k], view, slopes, np.empty(1))
        found[k] = slopes[0]
    logged = np.concatenate([np.gradient(depth[s], record.time[s]) for s in record.segments])
    return found, logged


def velocity_error(plant: Plant, record: Record) -> float:
    """RMS of the vertical velocity, model less differenced depth, m/s."""
    model, logged = vertical_velocities(plant, record)
    return float(np.sqrt(np.mean((model - logged) ** 2)))


def used(plant: Plant, files: Sequence[Path]) -> Record:
    """The dives as one record, below 30 m; raises ValueError where they cannot be read."""
    record = read_record(list(files), None, needs_of(plant))
    return record.select(record["depth_m"] > LEAST_DEPTH)


def named(found: Diagnosis) -> str:
    """The effects with their intervals, and what each is tied with."""
    words = []
    for effect in found.effects:
        told = effect.coefficient or effect
        ties = "".join(f", or `{path}`" for path in effect.tied_with if path != effect.path)
        words.append(f"`{told.path}` {quantity(told.value, told.unit)} ({interval(told.ci95, told.unit)}){ties}")
    return "; ".join(words) or found.verdict


def rows_of(split: Split, data: Path) -> tuple[list[str], list[list[str]]]:
    """A line of the table, and one for the current of each judged dive."""
    fitted = [data / file for file in split.fitted]
    plant = vehicle_from_dive(fitted[0])
    found = diagnose(used(plant, fitted), plant, source=split.glider)
    judged = described(plant, used(plant, [data / file for file in split.judged]))
    stages = (found.given.plant, found.before.plant, found.after.plant if found.changed else found.before.plant)
    sizes = [f"{100.0 * velocity_error(stage, judged):.2f}" for stage in stages]
    logged = vertical_velocities(plant, judged)[1]
    rising, sinking = (float(np.mean(logged[side])) for side in (logged < 0.0, logged > 0.0))
    seconds = f"{sum(found.seconds.values()):.0f}"
    mean = f"{100.0 * sinking:.1f} down, {-100.0 * rising:.1f} up"
    currents = [
        [
            f"{split.glider}, {dive_of(file)}",
            *(current_of(stage, data / file) for stage in stages[::2]),
            own_current(data / file),
        ]
        for file in split.judged
    ]
    return [split.glider, split.words, str(len(judged)), *sizes, named(found), mean, seconds], currents


def current_of(plant: Plant, file: Path) -> str:
    """The depth-averaged current of a dive, by a plant and GPS."""
    found = dive_currents(plant, described(plant, read_record(file, None, needs_of(plant))))
    return ", ".join(f"{c.north:.3f} {c.east:.3f}" for c in found) or "-"


def own_current(file: Path) -> str:
    """The depth-averaged current that the operators state for a dive."""
    known = open_log(file).attrs
    if "current_north_mps" not in known:
        return "-"
    return f"{known['current_north_mps']:.3f} {known['current_east_mps']:.3f}"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of measured logs")
    parser.add_argument("--out", type=Path, required=True, help="folder for glider_dives.md")
    parser.add_argument("--only", default="", help="gliders whose name contains this")
    args = parser.parse_args(argv)
    folder, rows, currents = writable_folder(args.out), [], []
    data = args.data / "seaglider"
    for split in (one for one in SPLITS if args.only.upper() in one.glider):
        missing = [file for file in (*split.fitted, *split.judged) if not (data / file).exists()]
        if missing:
            errors.print(f"{split.glider} is left out: {', '.join(missing)} not in {data}.")
            continue
        errors.print(f"{split.glider}, {split.words}")
        row, own = rows_of(split, data)
        rows.append(row)
        currents += own
    text = Sheet("glider_dives", "RMS error of the vertical velocity on judged dives", HEADS, rows).markdown()
    text += Sheet("currents", "Depth-averaged currents of judged dives", CURRENTS, sorted(currents)).markdown()
    with replacing(folder / "glider_dives.md") as aside:
        aside.write_text(text, encoding="utf-8")
    output.print(text, markup=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
