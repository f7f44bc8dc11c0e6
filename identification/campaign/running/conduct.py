"""Execution of all runs of a campaign, in parallel on this machine or on a cluster; interrupted campaigns resume."""

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
from identification.campaign.fits import check_fits
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
_ROW_SIZE = 1024  # bytes; enough for a row of the index
_INDEX_EVERY = 2.0  # s; the index may lag behind, since the run files count

Progress = Callable[[int, int, int, str], None]


@final
@dataclass(frozen=True)
class Conducted:
    """The present content of a campaign's folder.

    rows: of all runs.  kept: how many of them existed before.  strangers: run files of an earlier version of the
    campaign file.  trouble: other things that could not be written.
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
    """Perform the runs of a campaign that are missing in its folder; write a file for each run, and the index.

    Only this process writes into the folder, wherever the runs are performed, and it never leaves a partial file. An
    interrupted campaign therefore continues when it is called again.  jobs: worker processes.  scheduler: address of a
    Dask scheduler to use instead of local workers.  progress: done, total, failed, text.
    Raises ValueError for invalid settings, before any run, and KeyboardInterrupt once the index is written.
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
        check_fits(campaign, runs)
        # reserve space for the index, which must be able to report a full disk
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
    """Make the folder, remove partial files of a killed process, and store the campaign file."""
    try:
        (out / RUNS).mkdir(parents=True, exist_ok=True)
        for part in (*out.glob(".*.part"), *(out / RUNS).glob(".*.part")):
            part.unlink()
    except OSError as error:
        raise ValueError(f"Cannot write into {out}: {error.strerror or error}. Give another folder.") from None
    with replacing(out / CAMPAIGN) as new:
        new.write_text(campaign.text, encoding="utf-8")


def _check(todo: Sequence[PlannedRun], campaign: Campaign, tell: Callable[[int, int], None]) -> None:
    """Try one run of each point of the grid; this also fills the compilation cache for the workers."""
    firsts = list({run.settings.model_copy(update={"seed": 0}).model_dump_json(): run for run in todo}.values())
    for number, run in enumerate(firsts):
        tell(number + 1, len(firsts))
        try:
            check_campaign_run(run.settings, campaign.folder)
        except ValueError as error:
            cell = ", ".join(f"with {key} = {value!r}" for key, value in run.cell.items())
            raise ValueError(f"{campaign.path}{', ' * bool(cell)}{cell}: {error}") from None


def _written(outcome: Outcome, out: Path) -> Outcome:
    """Write the run's file; the outcome is failed, with the reason, if that is impossible."""
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
    """Raise ValueError if another process conducts a campaign in the folder; a killed process releases the lock."""
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
    """Treat SIGTERM like Ctrl-C while the campaign runs."""
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
