"""Logs with an effect in them that the diagnosis is not told of, and how often it names the right one.

For each vehicle, effect and seed a log is simulated and written to a file; the truth goes into another. The diagnosis
sees the log and the vehicle without the effect, writes its verdict, and only then is the truth read. Effects that no
log of that kind can show (`HIDDEN`) are left out unless asked for; the diagnosis must then neither name anything
nor claim that it would have seen them.

    python scripts/blind_logs.py --vehicle slocum --seeds 20 --jobs 2
    python scripts/blind_logs.py --vehicle qiandao_float --effect effects.volume.leak
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import perf_counter

import numpy as np

from auv_gym.param import replace_at, spec_at
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from identification.diagnosis import as_json, diagnose
from identification.experiments.missions import run_mission
from scripts.blind.logs import HIDDEN, dive_settings, effects_of, known, lake_settings

CLEAN = "none"
SIZE = 3.0  # probes
SETTINGS = {"glider": lambda rng: {}, "float_piston": lake_settings, "float_oil": dive_settings}
VEHICLES = ("slocum", "ganeshblue", "qiandao_float", "mermaid")


def write_log(folder: Path, vehicle: str, effect: str, seed: int) -> None:
    """log.nc: the standard experiment of the vehicle's family, with `SETTINGS`; truth.json: what is in it."""
    rng = np.random.default_rng([seed, *effect.encode()])
    plant = known(vehicle)
    value, change = None, 0.0
    if effect != CLEAN:
        spec = spec_at(plant, effect)
        side = rng.choice([-1.0, 1.0]) if spec.bounds[0] < spec.neutral - SIZE * spec.probe else 1.0
        change = SIZE * spec.probe
        value = spec.neutral + side * change
        plant = replace_at(plant, effect, value)
    run_mission(plant, rng, **SETTINGS[plant.family.name](rng)).save(folder / "log.nc")
    hidden = effect in HIDDEN[plant.family.name]
    truth = {"effect": effect, "value": value, "change": change, "hidden": hidden}
    (folder / "truth.json").write_text(json.dumps(truth))


def diagnose_log(folder: Path, vehicle: str) -> None:
    """verdict.json from log.nc and the vehicle alone."""
    diagnosis = diagnose(Record.load(folder / "log.nc"), known(vehicle))
    (folder / "verdict.json").write_text(json.dumps(as_json(diagnosis)))


def judge(folder: Path) -> dict:
    """Truth and verdict side by side: right, other effects named besides, and whether an interval holds the truth.

    Right for an effect that no such log shows is not to claim that this size would have shown, and to name nothing.
    """
    truth = json.loads((folder / "truth.json").read_text())
    verdict = json.loads((folder / "verdict.json").read_text())
    named = {e["path"]: e for e in verdict["effects"]}
    tied = {path for group in verdict["tied"] for path in group}
    effect = truth["effect"]
    if effect == CLEAN:
        return {"right": verdict["verdict"] == "none", "named": sorted(named), "verdict": verdict["verdict"]}
    if truth.get("hidden"):
        claimed = any(d["path"] == effect and (d["size"] or np.inf) <= truth["change"] for d in verdict["detectable"])
        right = not claimed and not named
        return {"right": right, "named": sorted(named), "verdict": verdict["verdict"]}
    groups = [set(group) for group in verdict["tied"] if effect in group]
    beside = [p for p in named if p != effect and not any(p in group for group in groups)]
    result = {"right": effect in named or effect in tied, "exact": effect in named, "named": sorted(named)}
    result |= {"verdict": verdict["verdict"], "beside": beside}
    if effect in named:
        low, high = named[effect]["ci95"]
        result["covered"] = low <= truth["value"] <= high
    return result


def one(job: tuple[str, str, int]) -> tuple[str, str, int, dict, float]:
    """Write, diagnose and judge one log."""
    vehicle, effect, seed = job
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_log(folder, vehicle, effect, seed)
        start = perf_counter()
        diagnose_log(folder, vehicle)
        return vehicle, effect, seed, judge(folder), perf_counter() - start


def study(
    vehicles: Sequence[str], effects: Sequence[str] | None, seeds: Sequence[int], jobs: int, tell=None
) -> list[dict]:
    """A row for each vehicle and effect: how many logs, how many right, which other names were given."""
    rows = []
    work = [
        (vehicle, effect, seed)
        for vehicle in vehicles
        for effect in effects or [CLEAN, *effects_of(vehicle)]
        for seed in seeds
    ]
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with ProcessPoolExecutor(jobs) as pool:
        results = pool.map(one, work, chunksize=1) if jobs > 1 else map(one, work)
        for vehicle, effect, seed, result, seconds in results:
            if not rows or (rows[-1]["vehicle"], rows[-1]["effect"]) != (vehicle, effect):
                rows.append({"vehicle": vehicle, "effect": effect, "logs": 0, "right": 0, "exact": 0, "seconds": 0.0})
                rows[-1] |= {"sized": 0, "covered": 0, "misses": []}
            row = rows[-1]
            row["logs"] += 1
            row["right"] += result["right"]
            row["exact"] += result.get("exact", False)
            row["seconds"] += seconds
            row["sized"] += "covered" in result
            row["covered"] += result.get("covered", False)
            if not result["right"] or result.get("beside"):
                row["misses"].append({"seed": seed, "verdict": result["verdict"], "named": result["named"]})
            if tell and row["logs"] == len(seeds):
                tell(row)
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and print its table; `--json FILE` keeps it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--vehicle", action="append", choices=VEHICLES, help="default: all")
    parser.add_argument("--effect", action="append", help="path of an effect, or 'none' for clean logs; default: all")
    parser.add_argument("--seeds", type=int, default=20, help="logs per effect (default 20)")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--json", type=Path, help="write the rows to this file as well")
    args = parser.parse_args(argv)

    def tell(row):
        line = f"{row['vehicle']:12s} {row['effect']:34s} right {row['right']:3d} / {row['logs']:<3d}"
        print(
            f"{line} exact {row['exact']:3d}  {row['seconds'] / row['logs']:5.2f} s a log  {row['misses'][:3] or ''}",
            flush=True,
        )

    seeds = range(args.first_seed, args.first_seed + args.seeds)
    rows = study(args.vehicle or VEHICLES, args.effect, seeds, args.jobs, tell)
    sized = sum(r["sized"] for r in rows)
    if sized:
        print(f"95 % intervals of exactly named sizes hold the truth in {sum(r['covered'] for r in rows)} of {sized}.")
    if args.json:
        with replacing(args.json) as new:
            new.write_text(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
