"""Many independent runs in several processes: a progress bar, and a file for each finished run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from auv_gym.cli.options.console import progress_bar
from auv_gym.model import Diverged
from auv_gym.writing import write_text


@dataclass(frozen=True)
class Failure:
    """The reason of a missing result, in place of it."""

    reason: str


def results_of(
    work: Callable[..., Any],
    tasks: Sequence[tuple],
    jobs: int,
    doing: str,
    kept: Sequence[Path] | None = None,
) -> list[Any]:
    """Results of work(*task) as plain data, in the order of the tasks; a `Failure` if one raises.

    kept: a file for each task; a task with an existing file is not run, and each file is written, as a whole, by the
    process that did the task. A failed task has no file and is run again the next time.
    """
    results: list[Any] = [None] * len(tasks)
    with progress_bar() as show:
        for number, (at, result) in enumerate(_finished(work, tasks, jobs, kept), 1):
            results[at] = result
            show(number / len(tasks), f"{doing}: {number} of {len(tasks)}")
    return results


def write_json(path: Path, content: Any) -> None:
    """Write plain data to a file, as a whole or not at all."""
    write_text(path, json.dumps(content, indent=1, default=_plain) + "\n")


def read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _finished(
    work: Callable[..., Any], tasks: Sequence[tuple], jobs: int, kept: Sequence[Path] | None
) -> Iterator[tuple[int, Any]]:
    left = []
    for at in range(len(tasks)):
        if kept is not None and kept[at].is_file():
            yield at, read_json(kept[at])
        else:
            left.append(at)
    with Parallel(jobs, return_as="generator_unordered") as pool:
        yield from pool(delayed(_run)(work, at, tasks[at], kept[at] if kept else None) for at in left)


def _run(work: Callable[..., Any], at: int, task: tuple, path: Path | None) -> tuple[int, Any]:
    try:
        result = json.loads(json.dumps(work(*task), default=_plain))
    except (ValueError, Diverged) as error:
        return at, Failure(str(error))
    if path is not None:
        write_json(path, result)
    return at, result


def _plain(value: Any) -> Any:
    """Dataclasses as objects, arrays and numpy numbers as lists and numbers, complex ones as pairs."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, complex):
        return [value.real, value.imag]
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"A result must be plain data, got {type(value).__name__}.")
