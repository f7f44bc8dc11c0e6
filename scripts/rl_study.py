"""What a policy loses when it was trained on a model instead of the true vehicle, and how much a diagnosis gives back.

    python -m scripts.rl_study --out rl_study                              about an hour
    python -m scripts.rl_study --out tiny --steps 4096 --seeds 1 --episodes 3

In two settings the true vehicle has an effect that its modeller does not know of. Policies are trained on the true
vehicle, on models identified from its log, on the believed vehicle, on the vehicle that `diagnose` makes of that log
and the believed one, and with domain randomisation about the believed one; each is judged on the true vehicle, on the
same episodes. The same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from scripts.over_seeds import all_of
from scripts.rl.pictures import draw
from scripts.rl.runs import begin, done, work
from scripts.rl.settings import SETTINGS, Study
from scripts.rl.tables import console_tables, gathered, write_tables

ROWS = tuple(dict.fromkeys(row for setting in SETTINGS.values() for row in setting.all_rows))


def main(argv: Sequence[str] | None = None) -> int:
    """Train and judge what is not done yet; print the tables, write them and the figures; 1 if a row has failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of all results; one that was begun goes on")
    parser.add_argument("--seeds", type=int, default=5, help="logs and trainings of each row (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--setting", nargs="+", choices=list(SETTINGS), default=list(SETTINGS), help="default: both")
    parser.add_argument("--only", nargs="+", choices=ROWS, metavar="ROW", help=f"of {', '.join(ROWS)}; default: all")
    parser.add_argument("--steps", type=int, help="of each training (default: the setting's)")
    parser.add_argument("--episodes", type=int, default=50, help="to judge by (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of these episodes (default %(default)s)")
    parser.add_argument("--no-pictures", action="store_true", help="tables only; the figures need the extra render")
    given = parser.parse_args(argv)
    for name in ("seeds", "jobs", "episodes"):
        if getattr(given, name) < 1:
            parser.error(f"--{name} needs to be 1 or more, got {getattr(given, name)}")
    console = Console(highlight=False, width=max(Console().width, 130))
    study = Study(given.steps, given.episodes, given.seed)
    try:
        tasks = wanted(given.setting, given.only, range(given.seeds))
        begin(given.out, study)
        failed = carried_out(tasks, given.out, study, given.jobs)
        found = gathered(given.out, range(given.seeds))
        for shown in console_tables(found):
            console.print(shown)
        written = write_tables(found, given.out)
        if not given.no_pictures:
            written += draw(found, given.out)
    except (ValueError, OSError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    for path in written:
        console.print(f"Written to {path}", markup=False, soft_wrap=True)
    for reason in failed:
        console.print(reason, markup=False, soft_wrap=True)
    return int(bool(failed))


def wanted(settings: Sequence[str], only: Sequence[str] | None, seeds: Sequence[int]) -> list[tuple[str, str, int]]:
    """Setting, row and seed of all runs, seed by seed; a controller has one. Raises where no setting has a row."""
    tasks = [
        (name, row, seed)
        for name in settings
        for seed in seeds
        for row in SETTINGS[name].all_rows
        if (not only or row in only) and (seed == 0 or row in SETTINGS[name].rows)
    ]
    for row in only or ():
        if not any(row == task[1] for task in tasks):
            raise ValueError(
                f"{' and '.join(settings)} have no row {row!r}: take another --setting, or of "
                f"{', '.join(dict.fromkeys(r for name in settings for r in SETTINGS[name].all_rows))}."
            )
    return tasks


def carried_out(tasks: Sequence[tuple[str, str, int]], out: Path, study: Study, jobs: int) -> list[str]:
    """Do what is not done; the runs that failed, in words."""
    left = [task for task in tasks if done(*task, out) is None]
    if not left:
        return []
    results = all_of(attempt, [(*task, out, study) for task in left], jobs, "training", "runs")
    return [result["failed"] for result in results if "failed" in result]


def attempt(name: str, row: str, seed: int, out: Path, study: Study) -> dict[str, Any]:
    """The result of a run, or why there is none; the others go on, and the next call tries it again."""
    try:
        return work(name, row, seed, out, study)
    except ValueError as error:
        return {"failed": f"{name}, {row}, seed {seed}: {error}"}


if __name__ == "__main__":
    sys.exit(main())
