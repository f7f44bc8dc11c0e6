"""How often a diagnosis names the effect in a log, without knowing the truth.

For each vehicle, effect and seed, a simulated log is written to one file and the truth to another. The diagnosis gets
the log and the vehicle without the effect, and writes its verdict before the truth is read. Effects that no log of that
kind can show (`hidden` in `scripts.blind.kinds`) are left out unless requested; for these the diagnosis must neither
name anything nor claim that it would have detected them.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from auv_gym.param import replace_at, spec_at
from auv_gym.records.record import Record
from identification.diagnosis import as_json, diagnose
from identification.experiments.missions import run_mission
from scripts.blind.kinds import effects_of, kind_of, known
from scripts.studies.runs import Failure, results_of

CLEAN = "none"
SIZE = 3.0  # probes
VEHICLES = ("slocum", "ganeshblue", "qiandao_float", "mermaid")


def write_log(folder: Path, vehicle: str, effect: str, seed: int) -> None:
    """Write log.nc, the standard experiment of the vehicle's kind with its settings, and truth.json with the truth."""
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
    """Write verdict.json from log.nc and the vehicle alone."""
    diagnosis = diagnose(Record.load(folder / "log.nc"), known(vehicle))
    (folder / "verdict.json").write_text(json.dumps(as_json(diagnosis)))


def judge(folder: Path) -> dict:
    """The truth next to the verdict: whether it is right, and other named effects.

    For an effect that no such log shows, a verdict is right if it names nothing and does not call this size detectable.
    """
    truth = json.loads((folder / "truth.json").read_text())
    verdict = json.loads((folder / "verdict.json").read_text())
    named = [e["path"] for e in verdict["effects"]]
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
    return {
        "right": effect in named or effect in tied,
        "named": sorted(named),
        "verdict": verdict["verdict"],
        "beside": beside,
    }


def one(job: tuple[str, str, int]) -> dict:
    """Write, diagnose and judge one log."""
    vehicle, effect, seed = job
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_log(folder, vehicle, effect, seed)
        diagnose_log(folder, vehicle)
        return {"seed": seed, **judge(folder)}


def study(vehicles: Sequence[str], effects: Sequence[str] | None, seeds: Sequence[int], jobs: int = 1) -> list[dict]:
    """A row for each vehicle and effect: numbers of logs and of right verdicts, and other names."""
    asked = [(vehicle, effect) for vehicle in vehicles for effect in effects or [CLEAN, *effects_of(vehicle)]]
    done = iter(results_of(one, [((*pair, seed),) for pair in asked for seed in seeds], jobs, "logs"))
    return [_row(vehicle, effect, list(islice(done, len(seeds)))) for vehicle, effect in asked]


def _row(vehicle: str, effect: str, results: Sequence[dict | Failure]) -> dict:
    judged = []
    for result in results:
        if isinstance(result, Failure):
            raise ValueError(f"{vehicle}, {effect}: {result.reason}")
        judged.append(result)
    return {
        "effect": effect,
        "logs": len(judged),
        "right": sum(result["right"] for result in judged),
        "misses": [
            {name: result[name] for name in ("seed", "verdict", "named")}
            for result in judged
            if not result["right"] or result.get("beside")
        ],
    }
