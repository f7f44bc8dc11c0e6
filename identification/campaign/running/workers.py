"""Runs performed by worker processes of this machine or of a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from identification.campaign.file.plan import PlannedRun
from identification.campaign.running.perform import Outcome, perform
from identification.campaign.running.pool import in_parallel

_ANSWER = 10.0  # s, within which a scheduler answers
_LOST = "its worker process died again and again: out of memory, or killed"


def local_run_outcomes(runs: Sequence[PlannedRun], folder: Path, jobs: int) -> Iterator[Outcome]:
    """The outcomes of runs as they come, performed by `jobs` processes, by this one for a single job."""
    for number, outcome in in_parallel(partial(perform, folder=folder), runs, jobs):
        yield Outcome(runs[number].id, "failed", _LOST) if outcome is None else outcome


def dask_run_outcomes(scheduler: str, runs: Sequence[PlannedRun], folder: Path) -> Iterator[Outcome]:
    """The outcomes of runs as they come, performed by the workers of a Dask scheduler; logs are read here.

    Outcomes carry the content of their files, so workers need no access to the campaign's folder, only this package in
    the same version.  A run whose workers die more often than Dask allows (allowed-failures) is lost.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise ImportError("--scheduler needs Dask: pip install 'auv-gym[distributed]'.") from None
    try:
        client = Client(scheduler, timeout=_ANSWER)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(
            f"No Dask scheduler answers at {scheduler} ({error}): start one with `dask scheduler`."
        ) from None
    with client:
        here = [run for run in runs if run.settings.experiment.kind == "log"]
        yield from (perform(run, folder) for run in here)
        futures = {
            client.submit(perform, run, pure=False, key=f"run-{run.id}-{os.getpid()}"): run.id
            for run in runs
            if run not in here
        }
        for future in as_completed(futures):
            error = future.exception()
            if error is None:
                yield future.result()
            else:
                text = _LOST if isinstance(error, KilledWorker) else f"{type(error).__name__}: {error}"
                yield Outcome(futures[future], "failed", text)
            future.release()
