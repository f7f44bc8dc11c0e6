"""The index of a campaign's folder: the outcome of each run. The index is derived from the run files."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

from auv_gym.records.record import Record
from auv_gym.writing import replacing
from identification.campaign.file.plan import PlannedRun
from identification.campaign.running.perform import Outcome, content_hash

RUNS, INDEX = "runs", "index.csv"
_PLAIN = ("id", "status", "reason", "seed", "samples", "duration_s", "seconds", "sha256")
_GRID = "grid."


@final
@dataclass(frozen=True)
class Row:
    """The outcome of one run.

    status: see `perform.Outcome`; pending for a run that has not been made.  cell: the grid's values, by key.
    sha256: of the record's numbers; empty without a record.  seconds: computing time of the run.
    """

    id: str
    status: str
    seed: int
    cell: Mapping[str, Any]
    reason: str = ""
    samples: int = 0
    duration_s: float = 0.0
    seconds: float = 0.0
    sha256: str = ""

    @property
    def usable(self) -> bool:
        """Whether the run went as planned, so that models can be fitted to its record."""
        return self.status == "done"

    @property
    def finished(self) -> bool:
        """Whether there is a record, so that nothing is left to do."""
        return bool(self.sha256)

    def path(self, folder: str | Path) -> Path:
        """The path of the run's record, if there is one."""
        return run_file(folder, self.id)


def run_file(folder: str | Path, id: str) -> Path:
    """The path of a run's file in a campaign's folder."""
    return Path(folder) / RUNS / f"{id}.nc"


def planned_row(run: PlannedRun) -> Row:
    """The row of a run that has not been made."""
    return Row(run.id, "pending", run.seed, run.cell)


def with_outcome(row: Row, outcome: Outcome) -> Row:
    """The row with the outcome of its run."""
    return replace(
        row,
        status=outcome.status,
        reason=outcome.reason,
        samples=outcome.samples,
        duration_s=outcome.duration_s,
        seconds=round(outcome.seconds, 3),
        sha256=outcome.sha256,
    )


def rows_from_run_files(runs: Sequence[PlannedRun], folder: str | Path) -> list[Row]:
    """The rows of all runs according to their files; the index counts only for runs without a file.

    Damaged files, and files whose numbers are not those that were written, count as missing.
    """
    told = {row.id: row for row in read_index(folder)} if (Path(folder) / INDEX).is_file() else {}
    rows = []
    for run in runs:
        row = _of_file(run, run_file(folder, run.id))
        if row is None:
            before = told.get(run.id)
            row = planned_row(run)
            if before is not None and not before.finished:
                row = replace(row, status=before.status, reason=before.reason, seconds=before.seconds)
        rows.append(row)
    return rows


def strangers(runs: Iterable[PlannedRun], folder: str | Path) -> list[Path]:
    """Run files in the folder that do not belong to any run of the present campaign."""
    ids = {run.id for run in runs}
    return sorted(path for path in (Path(folder) / RUNS).glob("*.nc") if path.stem not in ids)


def write_index(rows: Sequence[Row], folder: str | Path) -> None:
    """Write the index as CSV, aside and then renamed; the grid's values are in JSON."""
    keys = list(dict.fromkeys(key for row in rows for key in row.cell))
    with replacing(Path(folder) / INDEX) as new, new.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*_PLAIN, *(f"{_GRID}{key}" for key in keys)])
        for row in rows:
            cell = [json.dumps(row.cell[key]) if key in row.cell else "" for key in keys]
            writer.writerow([*(getattr(row, name) for name in _PLAIN), *cell])


def read_index(folder: str | Path) -> list[Row]:
    """The rows of a campaign's folder; raises ValueError if it has no index, or one written by something else."""
    path = Path(folder) / INDEX
    try:
        with path.open(encoding="utf-8", newline="") as file:
            lines = list(csv.DictReader(file))
        return [
            Row(
                id=line["id"],
                status=line["status"],
                seed=int(line["seed"]),
                cell={k.removeprefix(_GRID): json.loads(v) for k, v in line.items() if k.startswith(_GRID) and v},
                reason=line["reason"],
                samples=int(line["samples"]),
                duration_s=float(line["duration_s"]),
                seconds=float(line["seconds"]),
                sha256=line["sha256"],
            )
            for line in lines
        ]
    except OSError as error:
        raise ValueError(f"Cannot read {path}: {error.strerror}. Run the campaign into this folder first.") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(
            f"{path} is no index of a campaign ({error!r}): delete it and run the campaign again."
        ) from None


def _of_file(run: PlannedRun, path: Path) -> Row | None:
    if not path.is_file():
        return None
    try:
        record = Record.load(path)
        told = record.attrs
        digest = content_hash(record)
        if told["campaign_run"] != run.id or told["sha256"] != digest:
            return None
        return replace(
            planned_row(run),
            status=str(told["status"]),
            reason=str(told["reason"]),
            samples=len(record),
            duration_s=record.duration_s,
            seconds=round(float(told["seconds"]), 3),
            sha256=digest,
        )
    except (ValueError, KeyError):
        return None
