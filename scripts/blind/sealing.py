"""The folders of a case: the log with the believed vehicle in one, the sealed truth with a fresh log in another."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from auv_gym.plant import save_vehicle
from scripts.blind.cases import Case, Drawn
from scripts.blind.logs import Conditions
from scripts.studies.runs import read_json, write_json


def log_folder(out: Path, number: int) -> Path:
    """The folder with everything that the diagnosis is given."""
    return out / "logs" / f"{number:05d}"


def truth_folder(out: Path, number: int) -> Path:
    return out / "truth" / f"{number:05d}"


def seal(drawn: Drawn, out: Path) -> Path:
    """Write a case into its two folders; return the log's, with log.nc, vehicle.toml and frame.json."""
    case = drawn.case
    log, truth = log_folder(out, case.number), truth_folder(out, case.number)
    log.mkdir(parents=True, exist_ok=True)
    truth.mkdir(parents=True, exist_ok=True)
    drawn.record.save(log / "log.nc")
    save_vehicle(drawn.believed, log / "vehicle.toml")
    write_json(log / "frame.json", {"window": case.window, "settle": case.settle})
    save_vehicle(drawn.true, truth / "vehicle.toml")
    if drawn.fresh is not None:
        drawn.fresh.save(truth / "fresh.nc")
    facts = {
        "case": asdict(case),
        "effects": dict(drawn.effects),
        "detectable": dict(drawn.detectable),
        "wrong": {path: list(pair) for path, pair in drawn.wrong.items()},
        "cause": drawn.cause,
        "size": drawn.size,
        "excess": drawn.excess,
        "attempts": drawn.attempts,
    }
    write_json(truth / "truth.json", facts)
    return log


def read_truth(folder: Path) -> dict[str, Any]:
    """The truth of a case as written by `seal`."""
    return read_json(folder / "truth.json")


def sealed_case(folder: Path) -> Case:
    """The case whose truth a folder has."""
    told = read_truth(folder)["case"]
    return Case(**told | {"conditions": Conditions(**told["conditions"])})
