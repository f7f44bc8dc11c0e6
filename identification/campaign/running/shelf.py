"""Stored results of a campaign's tasks, one file each, so that no task is repeated."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from auv_gym.writing import write_json
from identification.campaign.running.pool import in_parallel

Progress = Callable[[float, str], Any]


class Task(Protocol):
    """The task of a result: the name of its file, and a hash of everything that the result depends on."""

    @property
    def name(self) -> str: ...

    @property
    def key(self) -> str: ...


T = TypeVar("T", bound=Task)


@dataclass(frozen=True)
class Shelf:
    """A folder of results, `NAME.json` each, with the `key` of the task, a `status`, and further files beside them.

    names: file with the names of the last requested tasks.  files: the further files that a result names.
    """

    folder: Path
    names: str
    files: Callable[[Mapping[str, Any]], Iterable[str]]

    def filled(
        self,
        tasks: Sequence[T],
        work: Callable[[T], dict[str, Any]],
        empty: Callable[[T], dict[str, Any]],
        jobs: int,
        progress: Progress | None,
    ) -> list[dict[str, Any]]:
        """The result of each task: the stored one, or what `work` returns; `work` stores it itself.

        empty: makes the result, stored with a reason, for a task whose process has died.
        """
        self.folder.mkdir(exist_ok=True)
        results = {task.name: kept for task in tasks if (kept := self.kept(task)) is not None}
        waiting = [task for task in tasks if task.name not in results]
        for number, result in in_parallel(work, waiting, jobs):
            task = waiting[number]
            if result is None:
                result = {**empty(task), "reason": "The process that did it died: too little memory, perhaps."}
                self.put(task.name, result)
            results[task.name] = result
            if progress is not None:
                progress(len(results) / len(tasks), task.name)
        write_json(self.folder / self.names, [task.name for task in tasks])
        return [results[task.name] for task in tasks]

    def kept(self, task: Task) -> dict[str, Any] | None:
        """The stored result for exactly this task, if it is done and its further files still exist."""
        try:
            result = json.loads(self._file_of(task.name).read_text(encoding="utf-8"))
            there = all((self.folder / file).is_file() for file in self.files(result))
            return result if result["key"] == task.key and result["status"] == "done" and there else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Store the result of a task."""
        write_json(self._file_of(name), result)

    def read(self) -> list[dict[str, Any]]:
        """The results of the last requested tasks; empty if there were none."""
        if not (self.folder / self.names).is_file():
            return []
        names = json.loads((self.folder / self.names).read_text(encoding="utf-8"))
        found = [self._file_of(name) for name in names]
        return [json.loads(path.read_text(encoding="utf-8")) for path in found if path.is_file()]

    def _file_of(self, name: str) -> Path:
        return self.folder / f"{name}.json"
