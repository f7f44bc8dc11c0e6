"""Which slips of sign, unit, column, clock or thruster are noticed, each made in a clean log of each vehicle.

    python -m scripts.studies.slips --seeds 1 --jobs 2 --out slips
    python -m scripts.studies.slips --vehicle vt690 --seed 2

A slip counts as noticed if a doubt about the log states it, or lists it as another slip with the same result.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.plausibility import Doubt, log_doubts
from identification.diagnosis.log.slips import Slip, possible_slips, undone
from identification.diagnosis.log.thruster_slips import thruster_slips
from identification.experiments.missions import mission_of, run_mission
from identification.fit.windows import free_run_windows
from scripts.studies.harness import Found, Sheet, Study

VEHICLES = (
    "ganeshblue",
    "slocum",
    "qiandao_float",
    "mermaid",
    "npsauv",
    "remus100",
    "vt690",
    "seaglider",
    "bluerov",
    "bluerov2_heavy",
)
LAKE = {"target_depths": [60.0, 20.0, 50.0, 10.0, 40.0, 5.0], "duration": 1500.0}  # if both can be chosen
DURATION, WINDOW = 200.0, 25.0  # s, lengths of a log of a hull and its parts and of its windows


def attempt(vehicle: str, seed: int) -> list[dict[str, Any]]:
    """The unchanged log, "", and the log with each slip in turn: the slip, and the doubts raised."""
    plant = load_vehicle(vehicle)
    record = log_of(plant, seed)
    found = []
    for slip in (None, *possible_slips(record, plant), *thruster_slips(record, plant)):
        raised = doubts(slipped(record, slip, plant) if slip else record, plant)
        said = [text for doubt in raised for text in (doubt.text, *doubt.instead)]
        found.append({"slip": slip.text if slip else "", "doubts": said})
    return found


def slipped(record: Record, slip: Slip, plant: Plant) -> Record:
    """The record with a slip in it, as read from a file with this slip."""
    undoing = replace(
        slip,
        factors=tuple(1.0 / f for f in slip.factors),
        offset=-slip.offset / slip.factors[0] if slip.factors else 0.0,
        clock=1.0 / slip.clock,
    )
    wrong = undone(record, undoing, plant)
    segments = wrong.dataset["segment"].values
    read = {name: wrong.readings(name) for name in wrong.names}
    found = Record.from_arrays(wrong.time, {name: wrong[name] for name in wrong.names}, segments)
    return found.with_readings({name: held for name, held in read.items() if not held.all()})


def right(found: dict[str, Any]) -> bool:
    """Whether the slip was noticed; for a clean log, whether nothing was."""
    return found["slip"] in found["doubts"] if found["slip"] else not found["doubts"]


def log_of(plant: Plant, seed: int = 1) -> Record:
    """A clean log of the vehicle's standard experiment."""
    settings: dict[str, Any] = {}
    if plant.family.body is not None:
        settings = {"duration": DURATION}
    elif set(LAKE) <= set(mission_of(plant).settings):
        settings = LAKE
    return run_mission(plant, np.random.default_rng(seed), **settings)


def doubts(record: Record, plant: Plant) -> Sequence[Doubt]:
    """The doubts about a log in windows of its vehicle's length, or shorter ones for a hull and parts."""
    seconds = plant.window if plant.family.body is None else WINDOW
    return log_doubts(record, plant, free_run_windows(plant, record, seconds))


def sheets(found: Found) -> list[Sheet]:
    """A row for each vehicle; in a file, every slip of every log."""
    rows, every = [], []
    for vehicle, runs in found.runs.items():
        made = [one for of in runs.values() for one in of if one["slip"]]
        doubted = sum(not right(one) for of in runs.values() for one in of if not one["slip"])
        missed = "; ".join(dict.fromkeys(one["slip"] for one in made if not right(one)))
        noticed = f"{sum(map(right, made))} of {len(made)}"
        rows.append([vehicle, str(len(runs)), str(doubted), noticed, missed])
        for seed, of in runs.items():
            every += [[vehicle, str(seed), one["slip"], "; ".join(one["doubts"]), str(right(one))] for one in of]
    heads = ("vehicle", "logs>", "clean, doubted>", "slips noticed>", "missed")
    return [
        Sheet("vehicles", "Slips noticed, one at a time", heads, rows),
        Sheet("slips", "Every slip", ("vehicle", "seed", "slip", "doubts", "right"), every, printed=False),
    ]


STUDY = Study(__doc__ or "", attempt, VEHICLES, sheets, first_seed=1, one_of="vehicle", doing="logs")

if __name__ == "__main__":
    sys.exit(STUDY.main())
