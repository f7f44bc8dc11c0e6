"""All runs of a campaign: in parallel on this machine or on a cluster, resumed where they were left."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, final

from auv_gym.writing import replacing
from identification.campaign.file.plan import PlannedRun, plan
from identification.campaign.file.settings import Campaign
from identification.campaign.index import (
    RUNS,
    Row,
    rows_from_run_files,
    run_file,
    strangers,
    with_outcome,
    write_index,
)
from identification.campaign.running.perform import Outcome
from identification.campaign.running.staging import check_campaign_run
from identification.campaign.running.workers import dask_run_outcomes, local_run_outcomes

CAMPAIGN = "campaign.toml"
_RESERVE = ".reserve"
_ROW_SIZE = 1024  # bytes that a row of the index surely fits into
_INDEX_EVERY = 2.0  # s; run files are the truth, so that an index that lags costs nothing

Progress = Callable[[int, int, int, str], None]


@final
@dataclass(frozen=True)
class Conducted:
    """What a campaign's folder holds now.

    rows: of all runs.  kept: how many of them were there before.  strangers: run files of a campaign file that has
    changed since.  trouble: what could not be written besides.
    """

    rows: tuple[Row, ...]
    kept: int
    strangers: tuple[Path, ...]
    trouble: str = ""

    @property
    def failures(self) -> list[Row]:
        """The runs that did not go as planned."""
        return [row for row in self.rows if not row.usable]


def conduct(
    campaign: Campaign,
    folder: str | Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Progress = lambda done, total, failed, text: None,
) -> Conducted:
    """Performs the runs of a campaign that its folder does not hold yet, and writes a file for each, and the index.

    Nothing else writes into the folder than this process, wherever the runs are performed; a file is there whole or
    not at all. So a campaign that was stopped in any way goes on when it is called again.  jobs: worker processes.
    scheduler: address of a Dask scheduler, in place of workers here.  progress: done, total, failed, text.
    Raises ValueError on settings that cannot be, before any run, and KeyboardInterrupt once the index is written.
    """
    if jobs < 1:
        raise ValueError(f"A campaign needs at least one job, got {jobs}.")
    out = Path(folder)
    progress(0, 1, 0, "planning")
    runs = plan(campaign)
    _open(out, campaign)
    with _alone(out):
        rows = {row.id: row for row in rows_from_run_files(runs, out)}
        kept = sum(row.finished for row in rows.values())
        todo = [run for run in runs if not rows[run.id].finished]
        _check(todo, campaign, lambda k, n: progress(kept, len(runs), 0, f"checking {k} of {n}"))
        # room for the index, which is to say so when the disk is full
        with replacing(out / _RESERVE) as reserve:
            reserve.write_bytes(b"\0" * (_ROW_SIZE * (len(runs) + 8)))
        trouble, last = "", -_INDEX_EVERY
        try:
            with _interruptible():
                done, failed = kept, sum(row.finished and not row.usable for row in rows.values())
                progress(done, len(runs), failed, "running")
                for outcome in _outcomes(todo, campaign.folder, jobs, scheduler):
                    outcome = _written(outcome, out)
                    rows[outcome.id] = with_outcome(rows[outcome.id], outcome)
                    done, failed = done + 1, failed + (outcome.status != "done")
                    progress(done, len(runs), failed, "running")
                    if monotonic() - last > _INDEX_EVERY:
                        trouble, last = _try_index(rows, out), monotonic()
        finally:
            (out / _RESERVE).unlink(missing_ok=True)
            trouble = _try_index(rows, out)
    return Conducted(tuple(rows.values()), kept, tuple(strangers(runs, out)), trouble)


def _outcomes(todo: Sequence[PlannedRun], folder: Path, jobs: int, scheduler: str | None) -> Iterator[Outcome]:
    if not todo:
        return iter(())
    return local_run_outcomes(todo, folder, jobs) if scheduler is None else dask_run_outcomes(scheduler, todo, folder)


def _open(out: Path, campaign: Campaign) -> None:
    """Makes the folder, without what a killed process left half written, and keeps the campaign file there."""
    try:
        (out / RUNS).mkdir(parents=True, exist_ok=True)
        for part in (*out.glob(".*.part"), *(out / RUNS).glob(".*.part")):
            part.unlink()
    except OSError as error:
        raise ValueError(f"Cannot write into {out}: {error.strerror or error}. Give another folder.") from None
    with replacing(out / CAMPAIGN) as new:
        new.write_text(campaign.text, encoding="utf-8")


def _check(todo: Sequence[PlannedRun], campaign: Campaign, tell: Callable[[int, int], None]) -> None:
    """Tries one run of each point of the grid, which also compiles what the workers then find in the cache."""
    firsts = list({run.settings.model_copy(update={"seed": 0}).model_dump_json(): run for run in todo}.values())
    for number, run in enumerate(firsts):
        tell(number + 1, len(firsts))
        try:
            check_campaign_run(run.settings, campaign.folder)
        except ValueError as error:
            cell = ", ".join(f"with {key} = {value!r}" for key, value in run.cell.items())
            raise ValueError(f"{campaign.path}{', ' * bool(cell)}{cell}: {error}") from None


def _written(outcome: Outcome, out: Path) -> Outcome:
    """The outcome, its content put into the run's file; failed, with the reason, where that cannot be written."""
    if not outcome.content:
        return outcome
    try:
        with replacing(run_file(out, outcome.id)) as new:
            new.write_bytes(outcome.content)
    except ValueError as error:
        return Outcome(outcome.id, "failed", f"not saved: {error}", seconds=outcome.seconds)
    return outcome


def _try_index(rows: dict[str, Row], out: Path) -> str:
    try:
        write_index(list(rows.values()), out)
    except ValueError as error:
        return str(error)
    return ""


@contextmanager
def _alone(out: Path) -> Generator[None]:
    """Raises ValueError where another process conducts a campaign in the folder; a killed one leaves it free."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with (out / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"Another process runs a campaign into {out}: wait for it, or give another folder."
            ) from None
        except OSError:  # a file system without locks
            pass
        yield


@contextmanager
def _interruptible() -> Generator[None]:
    """Makes a polite kill (SIGTERM) what Ctrl-C is, while the campaign runs."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
