"""Runs performed by worker processes of this machine or of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from identification.campaign.file.plan import PlannedRun
from identification.campaign.running.perform import Outcome, perform
from identification.campaign.running.pool import in_parallel, on_cluster

_LOST = "its worker process died again and again: out of memory, or killed"


def local_run_outcomes(runs: Sequence[PlannedRun], folder: Path, jobs: int) -> Iterator[Outcome]:
    """The outcomes of runs as they finish, performed by `jobs` processes, or by this process for a single job."""
    for number, outcome in in_parallel(partial(perform, folder=folder), runs, jobs):
        yield Outcome(runs[number].id, "failed", _LOST) if outcome is None else outcome


def dask_run_outcomes(scheduler: str, runs: Sequence[PlannedRun], folder: Path) -> Iterator[Outcome]:
    """The outcomes of runs as they finish, performed by the workers of a Dask scheduler; logs are read here.

    Outcomes contain their files, so workers need no access to the campaign's folder.
    """
    far = [run for run in runs if run.settings.experiment.kind != "log"]
    with on_cluster(scheduler) as spread:
        yield from (perform(run, folder) for run in runs if run not in far)
        for number, outcome in spread(perform, far):
            if isinstance(outcome, Outcome):
                yield outcome
            else:
                text = _LOST if outcome is None else f"{type(outcome).__name__}: {outcome}"
                yield Outcome(far[number].id, "failed", text)
