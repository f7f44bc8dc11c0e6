"""The blind side of the benchmark: diagnose logs, given only a folder with a log and a vehicle file for each.

    python -m scripts.blind.diagnosing FOLDER ...

A folder holds log.nc, vehicle.toml and frame.json (window and settle, s); diagnosis.json is added.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

from auv_gym.model import Diverged
from auv_gym.param import list_paths, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import as_json, diagnose
from scripts.studies.runs import read_json, write_json

REFUSED = "refused"


def diagnose_folder(folder: Path) -> dict:
    """The diagnosis as plain data with its `seconds`; verdict "refused" and a reason if it raises.

    `changed` has the parameters, by path, in which the vehicle after the diagnosis differs from the given one.
    """
    frame = read_json(folder / "frame.json")
    record, plant = Record.load(folder / "log.nc"), load_vehicle(folder / "vehicle.toml")
    start = perf_counter()
    try:
        found = diagnose(record, plant, window=frame["window"], settle=frame["settle"])
    except (ValueError, Diverged) as error:
        return {"verdict": REFUSED, "reason": str(error), "seconds": perf_counter() - start}
    after = found.plants["after"]
    moved = {
        path: value_at(after, path) for path in list_paths(plant) if value_at(after, path) != value_at(plant, path)
    }
    return as_json(found) | {"changed": moved, "seconds": perf_counter() - start}


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose each folder."""
    for name in sys.argv[1:] if argv is None else argv:
        write_json(Path(name) / "diagnosis.json", diagnose_folder(Path(name)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
