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
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import as_json, diagnose
from scripts.studies.runs import read_json, write_json

REFUSED = "refused"


def diagnose_folder(folder: Path) -> dict:
    """The diagnosis as plain data with its `seconds`; verdict "refused" and a reason if it raises."""
    frame = read_json(folder / "frame.json")
    record, plant = Record.load(folder / "log.nc"), load_vehicle(folder / "vehicle.toml")
    start = perf_counter()
    try:
        said = as_json(diagnose(record, plant, window=frame["window"], settle=frame["settle"]))
    except (ValueError, Diverged) as error:
        said = {"verdict": REFUSED, "reason": str(error)}
    return said | {"seconds": perf_counter() - start}


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose each folder."""
    for name in sys.argv[1:] if argv is None else argv:
        write_json(Path(name) / "diagnosis.json", diagnose_folder(Path(name)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
