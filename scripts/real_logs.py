"""Measured logs, each diagnosed with a vehicle and nothing else but a depth limit: verdict, names, error, time.

    python -m scripts.real_logs --out real
    python -m scripts.real_logs --data DIR --out real

The logs of three Slocum gliders come with dbdreader; DIR has others in `mermaid/` and `auv690/`, which are left out
where they are not there.  Each log's diagnosis is kept in the folder, and is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from auv_gym.channels import channel
from auv_gym.cli.options.console import errors, output
from auv_gym.plant import load_vehicle
from auv_gym.records.density import read_profiles, with_density
from auv_gym.records.reading import read_record
from auv_gym.writing import replacing, writable_folder
from identification.diagnosis import diagnose
from identification.diagnosis.result_files import as_json
from identification.diagnosis.wording import interval, quantity
from scripts.studies.harness import Sheet
from scripts.studies.runs import write_json


@dataclass(frozen=True)
class Log:
    """A measured log, the vehicle that it is of, and the least depth at which it is used, m.

    file: below the data's folder; empty for what is bundled.  profile: of the water's density, there too.
    """

    name: str
    vehicle: str
    file: str = ""
    least_depth: float = 0.0
    profile: str = ""


_DRIFT, _PROFILES = "mermaid/free_drift_dives.csv", "mermaid/ctd_profiles_1dbar.csv"
LOGS = (
    Log("slocum:ammonite", "slocum", least_depth=10.0),
    Log("slocum:amadeus", "slocum", least_depth=10.0),
    Log("slocum:sebastian", "slocum", least_depth=10.0),
    Log("MERMAID, free drift", "mermaid", _DRIFT),
    Log("MERMAID, free drift, density known", "mermaid", _DRIFT, profile=_PROFILES),
    Log("MERMAID, fixed point", "mermaid", "mermaid/fixed_point_february_dives.csv"),
    Log("VT 690", "vt690", "auv690/auv690_2022-07-28_part1_10Hz.csv", least_depth=1.5),
)
HEADS = (
    *("log", "samples", "verdict", "effects (95 % interval), share of the halves"),
    *("error as given, refitted, with effects", "s"),
)


def diagnosed(log: Log, data: Path | None) -> dict:
    """A log's diagnosis as plain data, with the `seconds` of each step; raises ValueError where it cannot be made."""
    record = read_record(log.name if not log.file else str((data or Path()) / log.file))
    if log.least_depth > 0.0:
        record = record.select(record["depth_m"] > log.least_depth)
    if log.profile:
        record = with_density(record, read_profiles((data or Path()) / log.profile))
    found = diagnose(record, load_vehicle(log.vehicle), source=log.name)
    return as_json(found) | {"seconds": dict(found.seconds), "samples": len(record)}


def row_of(log: Log, said: dict) -> list[str]:
    """What the table says of a log."""
    groups = {path: [p for p in group if p != path] for group in said["tied"] for path in group}
    names = []
    for e in said["effects"]:
        size = f"{quantity(e['value'], e['unit'])} ({interval(tuple(e['ci95']), e['unit'])})"
        share = "" if e["frequency"] is None else f", {100.0 * e['frequency']:.0f} %"
        names.append(f"`{e['path']}` {size}{share}" + "".join(f", or `{p}`" for p in groups.get(e["path"], ())))
    stages = [said["error"][name] for name in ("as_given", "before", "after")]
    sizes = [
        f"{channel(name).label} " + ", ".join(quantity(stage[name]["rmse"], channel(name).unit) for stage in stages)
        for name in stages[0]
    ]
    verdict = said["verdict"] + (", something left" if said["unexplained"] and said["verdict"] != "unexplained" else "")
    seconds = f"{sum(said['seconds'].values()):.0f}"
    return [log.name, str(said["samples"]), verdict, "; ".join(names), "; ".join(sizes), seconds]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder of measured logs")
    parser.add_argument("--out", type=Path, required=True, help="folder for what was found, and for real_logs.md")
    parser.add_argument("--only", default="", help="logs whose name contains this")
    args = parser.parse_args(argv)
    folder, rows = writable_folder(args.out), []
    for log in (one for one in LOGS if args.only in one.name):
        if log.file and not ((args.data or Path()) / log.file).exists():
            errors.print(f"{log.name} is left out: {log.file} is not in {args.data or 'a folder given by --data'}.")
            continue
        kept = folder / f"{log.name.replace(':', '_').replace(', ', '_').replace(' ', '_')}.json"
        if not kept.exists():
            errors.print(f"diagnosing {log.name}")
            write_json(kept, diagnosed(log, args.data))
        rows.append(row_of(log, json.loads(kept.read_text(encoding="utf-8"))))
    text = Sheet("real_logs", "Measured logs", HEADS, rows).markdown()
    with replacing(folder / "real_logs.md") as aside:
        aside.write_text(text, encoding="utf-8")
    output.print(text, markup=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
