"""Work distributed over processes of this machine or a Dask cluster; one that dies loses only its own task."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

import joblib
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from auv_gym.extra import how_to_install

T = TypeVar("T")
R = TypeVar("R")

_ANSWER = 10.0  # s, timeout for a scheduler's answer


class Spread(Protocol):
    """Gives tasks to workers.

    Yields number and result of each task as they finish: None if its worker died (with Dask, more often than its
    setting allowed-failures allows), or the error that it raised.
    """

    def __call__(self, work: Callable[[T], R], tasks: Sequence[T]) -> Iterator[tuple[int, R | Exception | None]]: ...


def in_parallel(work: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[tuple[int, R | None]]:
    """Number and result of each task as they finish; None if its process died, even when it ran the task alone.

    jobs: processes with one thread each; with 1, everything runs in this process.  If a process dies, the tasks under
    way are repeated one by one, then the others continue.  Errors of `work` are raised.
    """
    if jobs == 1:
        yield from enumerate(map(work, tasks))
        return
    left, suspects = dict(enumerate(tasks)), list[int]()
    try:
        while left:
            alone = suspects[:1]
            under_way: list[int] = []
            batch = {number: left[number] for number in alone or left}
            try:
                for number, result in _spread(work, batch, jobs, under_way):
                    del left[number]
                    yield number, result
            except BrokenProcessPool:
                if alone:
                    del left[alone[0]]
                    yield alone[0], None
                else:
                    suspects = under_way
            suspects = [number for number in suspects if number in left]
    except BaseException:  # interrupted: nobody waits for the remaining results
        get_reusable_executor().shutdown(wait=False, kill_workers=True)
        raise


def _spread(work: Callable[[T], R], tasks: dict[int, T], jobs: int, under_way: list[int]) -> Iterator[tuple[int, R]]:
    """Number and result of each task as worker processes finish them; under_way holds the tasks handed to them."""

    def handed_out() -> Iterator[Any]:
        for number, task in tasks.items():
            under_way.append(number)
            yield joblib.delayed(_in_worker)(work, number, task)

    # one at a time, so that the task of a process that dies is known
    settings: Any = {"n_jobs": jobs, "batch_size": 1, "return_as": "generator_unordered", "max_nbytes": None}
    with joblib.parallel_config("loky", inner_max_num_threads=1):
        results: Any = joblib.Parallel(**settings)(handed_out())
        for number, result in results:
            under_way.remove(number)
            yield number, result


def _in_worker(work: Callable[[T], R], number: int, task: T) -> tuple[int, R]:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent stops the others
    return number, work(task)


@contextmanager
def on_cluster(scheduler: str) -> Generator[Spread]:
    """Yield a function that gives tasks to a Dask scheduler's workers like `in_parallel`; errors are results here.

    Workers need the same version of this package, but no access to local files.  scheduler: its address, such as
    tcp://host:8786.  Raises ValueError if none answers there, ImportError without the extra `distributed`.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise ImportError(f"--scheduler needs Dask; {how_to_install('distributed')}.") from None
    try:
        client = Client(scheduler, timeout=_ANSWER)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(
            f"No Dask scheduler answers at {scheduler} ({error}): start one with `dask scheduler`."
        ) from None

    def spread(work: Callable[[T], R], tasks: Sequence[T]) -> Iterator[tuple[int, R | Exception | None]]:
        futures = {client.submit(work, task, pure=False): number for number, task in enumerate(tasks)}
        for future in as_completed(futures):
            error = future.exception()
            if error is None:
                yield futures[future], future.result()
            else:
                yield futures[future], None if isinstance(error, KilledWorker) else error
            future.release()

    with client:
        yield spread
