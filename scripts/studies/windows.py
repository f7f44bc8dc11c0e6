"""Whether what a diagnosis names survives another length and phase of the windows, and holds in each half of a log.

    python -m scripts.blind_benchmark --cases 60 --seed 80 --kind one --kind one_wrong --out blind
    python -m scripts.studies.windows blind/seed_80 --jobs 2 --out windows

Only cases of the folder count whose log was diagnosed as `named` and whose effects are all at least four times as large
as the log would just show. A run that is repeated with the same `--out` goes on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from auv_gym.cli.options.console import errors, output, table
from auv_gym.model import Diverged
from auv_gym.param import spec_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import as_json, diagnose
from scripts.blind.scoring import same_names
from scripts.blind.sealing import log_folder, read_truth, truth_folder
from scripts.blind.tables import wilson
from scripts.studies.runs import Failure, read_json, results_of

TIMES = 4.0  # detectable sizes
LENGTHS = (0.6, 0.8, 1.2, 1.5)  # of the windows, over the usual one
PHASES = (0.25, 0.5)  # of a window, by which the log begins later


def variants(record: Record, window: float) -> Iterator[tuple[str, Record, float | None]]:
    """The log in other windows, shifted by a part of one, and each of its halves; by name.

    With the length of the windows, s; None for the usual one.
    """
    for length in LENGTHS:
        yield f"windows of {length:g}", record, length * window
    for phase in PHASES:
        begin = record.time[0] + phase * window
        yield f"from {phase:g} window on", record.between(begin, np.inf), None
    middle = 0.5 * (record.time[0] + record.time[-1])
    yield "first half", record.between(-np.inf, middle), None
    yield "second half", record.between(middle, np.inf), None


def attempt(folder: Path, number: int) -> dict[str, Any]:
    """What is named in each variant of a log, and whether that is what was named in the whole."""
    log = log_folder(folder, number)
    frame, whole = read_json(log / "frame.json"), read_json(log / "diagnosis.json")
    record, plant = Record.load(log / "log.nc"), load_vehicle(log / "vehicle.toml")
    found = {}
    for name, own, window in variants(record, whole["error"]["window_s"]):
        try:
            said = as_json(diagnose(own, plant, window=window, settle=frame["settle"]))
        except (ValueError, Diverged) as error:
            found[name] = {"verdict": "refused", "named": [], "same": False, "held": False, "reason": str(error)}
        else:
            own = {"verdict": said["verdict"], "named": sorted(e["path"] for e in said["effects"])}
            found[name] = own | {"same": same_names(said, whole, tied=False), "held": same_names(said, whole)}
    return {"number": number, "vehicle": read_truth(truth_folder(folder, number))["case"]["vehicle"], "variants": found}


def counted(folder: Path) -> list[int]:
    """The cases whose logs were `named`, and whose effects are large."""
    found = []
    for log in sorted((folder / "logs").glob("*/diagnosis.json")):
        sealed = truth_folder(folder, int(log.parent.name))
        truth, true = read_truth(sealed), load_vehicle(sealed / "vehicle.toml")
        away = {path: abs(value - spec_at(true, path).neutral) for path, value in truth["effects"].items()}
        large = away and all(away[path] >= TIMES * least for path, least in truth["detectable"].items())
        if large and not truth["cause"] and read_json(log)["verdict"] == "named":
            found.append(int(log.parent.name))
    return found


def shares(found: Sequence[Mapping[str, Any]]) -> Table:
    """For each variant, how many logs had the same names in it, with a 95 % interval, and what the others had."""
    made = table(
        "Names in other windows and parts of a log", "variant", "same names>", "95 %>", "or tied with them>", "others"
    )
    for name in (*found[0]["variants"], "all") if found else ():
        own = [v for one in found for n, v in one["variants"].items() if name in (n, "all")]
        same = sum(v["same"] for v in own)
        low, high = wilson(same, len(own))
        held = sum(v["held"] for v in own)
        others = sorted(v["verdict"] for v in own if not v["held"])
        words = ", ".join(f"{v} {others.count(v)}" for v in dict.fromkeys(others))
        made.add_row(name, f"{same} of {len(own)}", f"{100 * low:.0f} to {100 * high:.0f} %", str(held), words)
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="of a seed of the blind benchmark, such as blind/seed_80")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--out", type=Path, required=True, help="folder that keeps a file for each log")
    args = parser.parse_args(argv)
    if args.jobs < 1:
        parser.error("--jobs must be positive")
    if not (args.folder / "logs").is_dir():
        parser.error(f"{args.folder} has no logs: give a folder of a seed that scripts.blind_benchmark has written")
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    args.out.mkdir(parents=True, exist_ok=True)
    numbers = counted(args.folder)
    kept = [args.out / f"{number:05d}.json" for number in numbers]
    found = []
    for one in results_of(attempt, [(args.folder, number) for number in numbers], args.jobs, "logs", kept):
        if isinstance(one, Failure):
            errors.print(one.reason)
        else:
            found.append(one)
    output.print(shares(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
