"""Which slips of sign, unit, column and clock are noticed: each is made in turn in a clean log of each vehicle.

    python -m scripts.slip_study --seeds 1 --jobs 2
    python -m scripts.slip_study --vehicle vt690 --seed 2

A slip counts as noticed where the doubt raised is this one, or names it as what would do the same.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from auv_gym.cli.options.console import table
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.plausibility import Doubt, doubts_of
from identification.diagnosis.log.slips import Slip, slipped, slips_of
from identification.experiments.missions import run_mission
from identification.fit.windows import free_run_windows
from scripts.over_seeds import all_of

VEHICLES = ("ganeshblue", "slocum", "qiandao_float", "mermaid", "npsauv", "remus100", "vt690")
DIVES = {"target_depths": [60.0, 20.0, 50.0, 10.0, 40.0, 5.0], "duration": 1500.0}
DURATION, WINDOW = 200.0, 25.0  # s, of a torpedo's log and of its windows


@dataclass(frozen=True)
class Attempt:
    """A slip made in a log, or none (""), and the doubts that were raised."""

    vehicle: str
    seed: int
    slip: str
    doubts: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether the slip was noticed; of a clean log, whether nothing was."""
        return self.slip in self.doubts if self.slip else not self.doubts


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print its table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--vehicle", choices=VEHICLES, help="default: all")
    parser.add_argument("--seeds", type=int, default=1, help="logs of each vehicle (default %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="the first of them (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print every attempt as JSON")
    given = parser.parse_args(argv)
    try:
        vehicles = (given.vehicle,) if given.vehicle else VEHICLES
        attempts = study(vehicles, range(given.seed, given.seed + given.seeds), given.jobs)
    except ValueError as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps([asdict(a) | {"right": a.right} for a in attempts], indent=1))
    else:
        Console(highlight=False, width=max(Console().width, 120)).print(_table(attempts))
    return 0


def study(vehicles: Sequence[str], seeds: Sequence[int], jobs: int = 1) -> list[Attempt]:
    """Every slip in a log of each vehicle and seed, after the log as it is."""
    if not seeds or jobs < 1:
        raise ValueError(f"Needed --seeds and --jobs of at least 1, got {len(seeds)} and {jobs}.")
    tasks = []
    for vehicle in vehicles:
        plant = load_vehicle(vehicle)
        for seed in seeds:
            record = log_of(plant, seed)
            tasks += [(vehicle, seed, record, slip) for slip in (None, *slips_of(record, plant))]
    return all_of(attempt, tasks, jobs, "making slips", "logs")


def attempt(vehicle: str, seed: int, record: Record, slip: Slip | None) -> Attempt:
    """The doubts about a clean log of a seed once this slip is made in it, or about the log as it is for None."""
    plant = load_vehicle(vehicle)
    raised = doubts(slipped(record, slip, plant) if slip else record, plant)
    return Attempt(vehicle, seed, slip.text if slip else "", tuple(t for d in raised for t in (d.text, *d.instead)))


def log_of(plant: Plant, seed: int = 1) -> Record:
    """A clean log of the vehicle's standard experiment."""
    settings = DIVES if plant.family.name == "float_piston" else {}
    if plant.family.kind == "body":
        settings = {"duration": DURATION}
    return run_mission(plant, np.random.default_rng(seed), **settings)


def doubts(record: Record, plant: Plant) -> tuple[Doubt, ...]:
    """The doubts about a log in windows of its vehicle's length, shorter ones for the short log of a torpedo."""
    seconds = WINDOW if plant.family.kind == "body" else plant.window
    return doubts_of(record, plant, free_run_windows(plant, record, seconds))


def _table(attempts: Sequence[Attempt]) -> Table:
    shown = table("Slips noticed, one at a time", "vehicle", "logs>", "clean, doubted>", "slips noticed>", "missed")
    for vehicle in dict.fromkeys(a.vehicle for a in attempts):
        mine = [a for a in attempts if a.vehicle == vehicle]
        made = [a for a in mine if a.slip]
        clean = [a for a in mine if not a.slip]
        missed = "; ".join(dict.fromkeys(a.slip for a in made if not a.right))
        doubted = sum(not a.right for a in clean)
        shown.add_row(vehicle, str(len(clean)), str(doubted), f"{sum(a.right for a in made)} of {len(made)}", missed)
    return shown


if __name__ == "__main__":
    sys.exit(main())
