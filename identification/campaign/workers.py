"""Runs performed by worker processes of this machine or of a Dask cluster; those that kill their worker are found."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from identification.campaign.perform import Outcome, perform
from identification.campaign.plan import PlannedRun

_LOST = "its worker process died again and again: out of memory, or killed"


def outcomes_here(runs: Sequence[PlannedRun], folder: Path, jobs: int) -> Iterator[Outcome]:
    """The outcomes of runs as they come, performed by `jobs` processes with one thread each; by this one for one job.

    Where a process dies, the runs that were under way are done once more, each alone in a process; the one that dies
    again is lost, and the others go on.
    """
    if jobs == 1:
        yield from (perform(run, folder) for run in runs)
        return
    import joblib
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import BrokenProcessPool

    left = {run.id: run for run in runs}
    suspects: list[str] = []
    try:
        while left:
            alone = bool(suspects)
            under_way: list[str] = []
            batch = [left[suspects.pop(0)]] if alone else list(left.values())

            def tasks(batch: list[PlannedRun] = batch, under_way: list[str] = under_way):
                for run in batch:
                    under_way.append(run.id)
                    yield joblib.delayed(_in_worker)(run, folder)

            pool: Any = {"n_jobs": jobs, "batch_size": 1, "return_as": "generator_unordered", "max_nbytes": None}
            try:
                with joblib.parallel_config("loky", inner_max_num_threads=1):
                    outcomes: Any = joblib.Parallel(**pool)(tasks())
                    for outcome in outcomes:
                        under_way.remove(outcome.id)
                        del left[outcome.id]
                        yield outcome
            except BrokenProcessPool:
                if alone:
                    lost = batch[0].id
                    del left[lost]
                    yield Outcome(lost, "failed", _LOST)
                else:
                    suspects = [id for id in under_way if id in left]
    except BaseException:  # interrupted: nobody waits for what the others are doing
        get_reusable_executor().shutdown(wait=False, kill_workers=True)
        raise


def outcomes_on(scheduler: str, runs: Sequence[PlannedRun], folder: Path) -> Iterator[Outcome]:
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
        client = Client(scheduler, timeout=10, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(
            f"No Dask scheduler answers at {scheduler} ({error}): start one with `dask scheduler`."
        ) from None
    with client:
        remote = [run for run in runs if run.settings.experiment.kind != "log"]
        yield from (perform(run, folder) for run in runs if run not in remote)
        futures = {client.submit(perform, run, pure=False, key=f"run-{run.id}-{os.getpid()}"): run.id for run in remote}
        for future in as_completed(futures):
            error = future.exception()
            if error is None:
                yield future.result()
            else:
                text = _LOST if isinstance(error, KilledWorker) else f"{type(error).__name__}: {error}"
                yield Outcome(futures[future], "failed", text)
            future.release()


def _in_worker(run: PlannedRun, folder: Path) -> Outcome:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends the others
    return perform(run, folder)
