"""The blind side of the benchmark: diagnoses logs, given nothing but a folder with a log and a vehicle file each.

    python -m scripts.blind.diagnosing FOLDER ...

A folder holds log.nc, vehicle.toml and frame.json (window and settle, s); diagnosis.json joins them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

from auv_gym.model import Diverged
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from identification.diagnosis import as_json, diagnose

REFUSED = "refused"


def diagnose_folder(folder: Path) -> dict:
    """What the diagnosis says, as plain data with its `seconds`; verdict "refused" and a reason where it raises."""
    frame = json.loads((folder / "frame.json").read_text())
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
        said = diagnose_folder(Path(name))
        with replacing(Path(name) / "diagnosis.json") as new:
            new.write_text(json.dumps(said, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
