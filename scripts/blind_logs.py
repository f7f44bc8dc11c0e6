"""Logs with an effect in them that the diagnosis is not told of, and how often it names the right one.

For each vehicle, effect and seed a log is simulated and written to a file; the truth goes into another. The diagnosis
sees the log and the vehicle without the effect, writes its verdict, and only then is the truth read. Effects that no
log of that kind can show (`hidden` in `scripts.blind.kinds`) are left out unless asked for; the diagnosis must then
neither name anything nor claim that it would have seen them.

    python -m scripts.blind_logs --vehicle slocum --seeds 20 --jobs 2
    python -m scripts.blind_logs --vehicle qiandao_float --effect effects.volume.leak
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from time import perf_counter

import numpy as np

from auv_gym.param import replace_at, spec_at
from auv_gym.records.record import Record
from identification.diagnosis import as_json, diagnose
from identification.experiments.missions import run_mission
from scripts.blind.kinds import effects_of, kind_of, known
from scripts.studies.harness import positive
from scripts.studies.runs import Failure, results_of, write_json

CLEAN = "none"
SIZE = 3.0  # probes
VEHICLES = ("slocum", "ganeshblue", "qiandao_float", "mermaid")


def write_log(folder: Path, vehicle: str, effect: str, seed: int) -> None:
    """log.nc: the standard experiment of the vehicle's kind, with its settings; truth.json: what is in it."""
    rng = np.random.default_rng([seed, *effect.encode()])
    plant = known(vehicle)
    value, change = None, 0.0
    if effect != CLEAN:
        spec = spec_at(plant, effect)
        side = rng.choice([-1.0, 1.0]) if spec.bounds[0] < spec.neutral - SIZE * spec.probe else 1.0
        change = SIZE * spec.probe
        value = spec.neutral + side * change
        plant = replace_at(plant, effect, value)
    kind = kind_of(plant)
    run_mission(plant, rng, **kind.settings(rng)).save(folder / "log.nc")
    truth = {"effect": effect, "value": value, "change": change, "hidden": effect in kind.hidden}
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


def study(vehicles: Sequence[str], effects: Sequence[str] | None, seeds: Sequence[int], jobs: int = 1) -> list[dict]:
    """A row for each vehicle and effect: how many logs, how many right, which other names were given."""
    asked = [(vehicle, effect) for vehicle in vehicles for effect in effects or [CLEAN, *effects_of(vehicle)]]
    done = iter(results_of(one, [((*pair, seed),) for pair in asked for seed in seeds], jobs, "logs"))
    return [_row(vehicle, effect, list(islice(done, len(seeds)))) for vehicle, effect in asked]


def _row(vehicle: str, effect: str, results: Sequence[list | Failure]) -> dict:
    judged = []
    for result in results:
        if isinstance(result, Failure):
            raise ValueError(f"{vehicle}, {effect}: {result.reason}")
        *_, seed, found, seconds = result
        judged.append({**found, "seed": seed, "seconds": seconds})
    covered = [result["covered"] for result in judged if "covered" in result]
    return {
        "vehicle": vehicle,
        "effect": effect,
        "logs": len(judged),
        "right": sum(result["right"] for result in judged),
        "exact": sum(result.get("exact", False) for result in judged),
        "seconds": sum(result["seconds"] for result in judged),
        "sized": len(covered),
        "covered": sum(covered),
        "misses": [
            {name: result[name] for name in ("seed", "verdict", "named")}
            for result in judged
            if not result["right"] or result.get("beside")
        ],
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and print its table; `--json FILE` keeps it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--vehicle", action="append", choices=VEHICLES, help="default: all")
    parser.add_argument("--effect", action="append", help="path of an effect, or 'none' for clean logs; default: all")
    parser.add_argument("--seeds", type=positive, default=20, help="logs per effect (default 20)")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=positive, default=2, help="processes (default 2)")
    parser.add_argument("--json", type=Path, help="write the rows to this file as well")
    args = parser.parse_args(argv)

    seeds = range(args.first_seed, args.first_seed + args.seeds)
    rows = study(args.vehicle or VEHICLES, args.effect, seeds, args.jobs)
    for row in rows:
        line = f"{row['vehicle']:12s} {row['effect']:34s} right {row['right']:3d} / {row['logs']:<3d}"
        print(f"{line} exact {row['exact']:3d}  {row['seconds'] / row['logs']:5.2f} s a log  {row['misses'][:3] or ''}")
    sized = sum(r["sized"] for r in rows)
    if sized:
        print(f"95 % intervals of exactly named sizes hold the truth in {sum(r['covered'] for r in rows)} of {sized}.")
    if args.json:
        write_json(args.json, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
