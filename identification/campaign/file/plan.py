"""The runs of a campaign: every point of its grid with every seed, each run with its own id."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Protocol, TypeVar, final

from auv_gym.param import did_you_mean
from identification.campaign.file.complaints import checked
from identification.campaign.file.reading import with_value
from identification.campaign.file.settings import Campaign, Filter, RunSettings

FORMAT = 2  # of the runs; increased when the same settings come to mean a different run
_ID_DIGITS = 12


@final
@dataclass(frozen=True, eq=False)
class PlannedRun:
    """One run: its settings, and its place in the campaign.

    id: a short hash of the settings and of the content of files that they name.  cell: the grid's values, by key.
    files: content of the files that workers need, by the names used in the settings.
    """

    id: str
    seed: int
    cell: Mapping[str, Any]
    settings: RunSettings
    files: Mapping[str, bytes]


class Placed(Protocol):
    """Anything that a filter can select: it has a seed and a point of the grid."""

    @property
    def seed(self) -> int: ...

    @property
    def cell(self) -> Mapping[str, Any]: ...


P = TypeVar("P", bound=Placed)


def plan(campaign: Campaign) -> tuple[PlannedRun, ...]:
    """All runs of a campaign, seed by seed within each point of the grid; raises for invalid settings.

    The filters of fits and comparisons are checked as well: a filter that selects no run is an error.
    """
    runs: list[PlannedRun] = []
    contents: dict[str, bytes] = {}
    for values in product(*campaign.grid.values()):
        cell = dict(zip(campaign.grid, values, strict=True))
        content = dict(campaign.template)
        where = ", ".join([str(campaign.path), *(f"with {key} = {value!r}" for key, value in cell.items())])
        try:
            for key, value in cell.items():
                content = with_value(content, key, value)
        except ValueError as error:
            raise ValueError(f"{campaign.path}: {error}") from None
        for seed in campaign.seeds:
            settings = checked(RunSettings, {**content, "seed": seed}, where)
            runs.append(_planned(settings, cell, campaign.folder, contents))
    seen: set[str] = set()
    for run in runs:
        if run.id in seen:
            raise ValueError(
                f"{campaign.path}: the grid names the same run twice, {_named(run)}: drop one of the values."
            )
        seen.add(run.id)
    for fit in campaign.fit:
        for words, wanted in ((f"fit {fit.name!r}: runs", fit.runs), (f"fit {fit.name!r}: validate", fit.validate_on)):
            _check_filter(runs, wanted or {}, f"{campaign.path}: {words}")
        for key in fit.each:
            if key not in campaign.grid:
                raise ValueError(f"{campaign.path}: fit {fit.name!r}: each {_no_key(key, campaign.grid)}")
    if campaign.compare is not None:
        _check_filter(runs, campaign.compare.runs, f"{campaign.path}: compare.runs")
    return tuple(runs)


def selected(runs: Sequence[P], wanted: Filter) -> list[P]:
    """The runs that a filter selects by seed and grid values; all runs if the filter is empty."""
    return [run for run in runs if all(_value(run, key) in _listed(values) for key, values in wanted.items())]


def _planned(settings: RunSettings, cell: Mapping[str, Any], folder: Path, contents: dict[str, bytes]) -> PlannedRun:
    shipped = settings.files
    log = settings.experiment.file if settings.experiment.kind == "log" else ""
    named = [*shipped, *([log] if log and not log.startswith("slocum:") else [])]
    for name in named:
        if name not in contents:
            try:
                contents[name] = (folder / name).read_bytes()
            except OSError as error:
                raise ValueError(f"Cannot read {folder / name}: {error.strerror}. Correct the name.") from None
    told = {
        "format": FORMAT,
        "settings": settings.model_dump(mode="json", exclude_none=True),
        "files": {name: hashlib.sha256(contents[name]).hexdigest() for name in named},
    }
    digest = hashlib.sha256(json.dumps(told, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
    return PlannedRun(digest[:_ID_DIGITS], settings.seed, cell, settings, {name: contents[name] for name in shipped})


def _check_filter(runs: Sequence[PlannedRun], wanted: Filter, where: str) -> None:
    for key, values in wanted.items():
        if key != "seeds" and key not in runs[0].cell:
            raise ValueError(f"{where} {_no_key(key, runs[0].cell)}")
        known = list({json.dumps(_value(run, key)): _value(run, key) for run in runs}.values())
        for value in _listed(values):
            if value not in known:
                raise ValueError(f"{where}: {key} is {' or '.join(map(repr, known))}, got {value!r}.")
    if not selected(runs, wanted):
        raise ValueError(f"{where} chooses no run: {wanted!r}.")


def _no_key(key: str, grid: Mapping[str, Any]) -> str:
    known = ("seeds", *grid)
    return f"has no key {key!r}. {did_you_mean(key, known)}Known: {', '.join(known)}."


def _value(run: Placed, key: str) -> Any:
    return run.seed if key == "seeds" else run.cell.get(key)


def _listed(values: Any) -> list[Any]:
    return values if isinstance(values, list) else [values]


def _named(run: PlannedRun) -> str:
    return ", ".join([f"seed {run.seed}", *(f"{key} = {value!r}" for key, value in run.cell.items())])
