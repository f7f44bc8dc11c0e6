"""Measured logs, each diagnosed with a vehicle and nothing else but a depth limit: verdict, names, error, time.

    python -m scripts.real_logs --out real
    python -m scripts.real_logs --data DIR --out real

The logs of three Slocum gliders come with dbdreader; DIR has others in `mermaid/`, `auv690/` and `bluerov2016/`, which
are left out where they are not there; of the last, a second table has the fit percent of free runs of the rates.  Each
log's diagnosis is kept in the folder, and is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auv_gym.channels import channel
from auv_gym.cli.options.console import errors, output
from auv_gym.model import Diverged
from auv_gym.plant import load_vehicle
from auv_gym.records.density import read_profiles, with_density
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from auv_gym.writing import replacing, writable_folder
from identification.diagnosis import diagnose
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.log.parts import Part, parts_of
from identification.diagnosis.result_files import as_json
from identification.diagnosis.wording import interval, quantity
from identification.fit.validation import free_runs, joined_runs
from scripts.studies.harness import Sheet
from scripts.studies.runs import write_json


@dataclass(frozen=True)
class Log:
    """A measured log, the vehicle that it is of, and the least depth at which it is used, m.

    file: below the data's folder; empty for what is bundled.  profile: of the water's density, there too.
    step: s, to which it is thinned; 0 for none.  horizons: s, of the free runs that the second table has.
    """

    name: str
    vehicle: str
    file: str = ""
    least_depth: float = 0.0
    profile: str = ""
    step: float = 0.0
    horizons: tuple[float, ...] = ()


def _bag(name: str) -> Log:
    """A log of the BlueROV of 2016, at about the rate at which its thrusters are commanded anew."""
    return Log(
        f"BlueROV, {name.split('_2016')[0]}", "bluerov", f"bluerov2016/{name}.bag", step=0.05, horizons=(2.0, 3.0)
    )


_DRIFT, _PROFILES = "mermaid/free_drift_dives.csv", "mermaid/ctd_profiles_1dbar.csv"
LOGS = (
    Log("slocum:ammonite", "slocum", least_depth=10.0),
    Log("slocum:amadeus", "slocum", least_depth=10.0),
    Log("slocum:sebastian", "slocum", least_depth=10.0),
    Log("MERMAID, free drift", "mermaid", _DRIFT),
    Log("MERMAID, free drift, density known", "mermaid", _DRIFT, profile=_PROFILES),
    Log("MERMAID, fixed point", "mermaid", "mermaid/fixed_point_february_dives.csv"),
    Log("VT 690", "vt690", "auv690/auv690_2022-07-28_part1_10Hz.csv", least_depth=1.5),
    _bag("pitch_roll_1_2016-04-18-13-11-33"),
    _bag("yaw_1_2016-04-18-13-44-26"),
    _bag("test1_roll_pitch_2016-04-04-15-11-53"),
    _bag("test1_t1_lock_t2_2016-04-04-14-24-09"),
    _bag("sinDepthA03F01_2016-05-25-09-38-17"),
)
HEADS = (
    *("log", "samples", "verdict", "effects (95 % interval), share of the halves"),
    *("error as given, refitted, with effects", "s"),
)


FIT_HEADS = ("log", "run, s>", "signal", "as given, %>", "refitted, %>", "with effects, %>", "samples>")
RATES = ("p_radps", "q_radps", "r_radps")


def diagnosed(log: Log, data: Path | None) -> dict:
    """A log's diagnosis as plain data, with the `seconds` of each step; raises ValueError where it cannot be made."""
    plant = load_vehicle(log.vehicle)  # makes its channels known, so that rows before their first value are left out
    record = read_record(log.name if not log.file else str((data or Path()) / log.file))
    if log.step:
        record = record.resample(log.step)
    if log.least_depth > 0.0:
        record = record.select(record["depth_m"] > log.least_depth)
    if log.profile:
        record = with_density(record, read_profiles((data or Path()) / log.profile))
    found = diagnose(record, plant, source=log.name)
    fits = {f"{horizon:g}": fit_percents(found, horizon) for horizon in log.horizons}
    return as_json(found) | {"seconds": dict(found.seconds), "samples": len(record), "fits": fits}


def fit_percents(d: Diagnosis, horizon: float) -> dict[str, list[float]]:
    """Of each rate, fit percent as given, refitted and with effects in free runs over so many s, and samples.

    Each part of the log is foretold by a vehicle that was fitted, and whose effects were chosen, without it; NaN where
    its runs do not stay finite.
    """
    parts = parts_of(d.given.plant, d.record, len(d.windows))
    windows = [_windows(d.record, part, horizon + d.settle) for part in parts]
    found: dict[str, list[float]] = {name: [] for name in RATES}
    samples = 0
    for stage in (d.given, d.before, d.after):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                flown = [free_runs(p, d.record, own, d.settle) for p, own in zip(stage.without, windows, strict=True)]
        except Diverged:
            percents = dict.fromkeys(RATES, np.nan)
        else:
            scores = joined_runs(flown).scores(d.record)
            percents, samples = {n: scores[n].fit_percent for n in RATES}, scores[RATES[0]].samples
        for name in RATES:
            found[name].append(percents[name])
    return {name: [*values, samples] for name, values in found.items()}


def _windows(record: Record, part: Part, seconds: float) -> list[slice]:
    """A part in windows of exactly these s, one after the other; a shorter rest is left out."""
    size = round(seconds / record.sample_interval) + 1  # the last row is so many s after the first
    return [slice(a, a + size) for piece in part for a in range(piece.start, piece.stop - size + 1, size)]


def fit_rows(log: Log, said: dict) -> list[list[str]]:
    """What the second table says of a log."""
    return [
        [log.name, horizon, channel(name).label, *(f"{v:.0f}" for v in values)]
        for horizon, by_rate in said["fits"].items()
        for name, values in by_rate.items()
    ]


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
    folder, rows, fits = writable_folder(args.out), [], []
    for log in (one for one in LOGS if args.only in one.name):
        if log.file and not ((args.data or Path()) / log.file).exists():
            errors.print(f"{log.name} is left out: {log.file} is not in {args.data or 'a folder given by --data'}.")
            continue
        kept = folder / f"{log.name.replace(':', '_').replace(', ', '_').replace(' ', '_')}.json"
        if not kept.exists():
            errors.print(f"diagnosing {log.name}")
            write_json(kept, diagnosed(log, args.data))
        said = json.loads(kept.read_text(encoding="utf-8"))
        rows.append(row_of(log, said))
        fits += fit_rows(log, said) if log.horizons else []
    text = Sheet("real_logs", "Measured logs", HEADS, rows).markdown()
    if fits:
        text += "\n" + Sheet("fits", "Free runs of rates over unseen parts", FIT_HEADS, fits).markdown()
    with replacing(folder / "real_logs.md") as aside:
        aside.write_text(text, encoding="utf-8")
    output.print(text, markup=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
