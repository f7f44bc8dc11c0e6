"""The models of a campaign: each `[[fit]]` on its runs, tested on others, kept in the folder `models`."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import Any

from auv_gym.channels import CHANNELS, channel, is_flag, truth_of
from auv_gym.model import Model, model_constant_inputs
from auv_gym.models.files import load_model, save_model
from auv_gym.param import did_you_mean, spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.campaign.file.plan import PlannedRun, plan, selected
from identification.campaign.file.settings import Campaign, Fit, RunSettings
from identification.campaign.index import Row, read_index
from identification.campaign.running.shelf import Progress, Shelf
from identification.campaign.running.staging import make_campaign_vehicle, make_env
from identification.compare.comparison import OpenLoop
from identification.compare.model_tests import open_loop, poles_of, residual_tests
from identification.estimate import Estimate
from identification.estimator import Estimator, make_estimator

FOLDER, LIST = "models", "fits.json"
FORMAT = 1  # increased when the same settings come to give a different result
VEHICLE = "vehicle as designed"  # label of its free runs, beside those of the models


@dataclass(frozen=True, eq=False)
class FitTask:
    """One model to fit.

    name: of the model and of its files.  cell: the grid's values that `each` asked for.  train, held: runs.
    settings: of one of its training runs; origin: the folder that file names in them are relative to.
    """

    name: str
    fit: Fit
    cell: Mapping[str, Any]
    train: tuple[Row, ...]
    held: tuple[Row, ...]
    settings: RunSettings
    origin: Path

    @property
    def key(self) -> str:
        """A hash of everything that the result depends on."""
        told = {
            "format": FORMAT,
            "fit": self.fit.model_dump(mode="json", include={"method", "settings", "inputs", "outputs"}),
            "vehicle": self.settings.model_dump(mode="json", include={"vehicle", "experiment"}),
            "train": [(row.id, row.sha256) for row in self.train],
            "held": [(row.id, row.sha256) for row in self.held],
        }
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def fit_models(
    campaign: Campaign, folder: str | Path, *, jobs: int = 1, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """Make all fits; returns each result as stored in `models/NAME.json`; `status` is done or failed, with a `reason`.

    A fit with the same settings and runs as in an earlier call is not repeated.
    """
    folder = Path(folder)
    tasks = planned_fits(campaign, read_index(folder))
    return _shelf(folder).filled(tasks, partial(_fitted, folder), _empty, jobs, progress)


def planned_fits(campaign: Campaign, rows: Sequence[Row]) -> list[FitTask]:
    """The fits of a campaign on the runs that went as planned: one each, or one for each value that `each` asks for.

    Without `validate`, a model is tested on the other seeds of its own cells.
    """
    settings = {run.id: run.settings for run in plan(campaign)} if campaign.fit else {}
    usable = [row for row in rows if row.usable and row.id in settings]
    tasks = []
    for fit in campaign.fit:
        wanted = selected([row for row in rows if row.id in settings], fit.runs)
        cells = {json.dumps(cell): cell for cell in ({key: row.cell[key] for key in fit.each} for row in wanted)}
        for cell in cells.values():
            mine = [row for row in wanted if cell.items() <= row.cell.items()]
            train = [row for row in mine if row in usable]
            held = [row for row in usable if row not in mine and cell.items() <= row.cell.items()]
            if fit.validate_on is not None:
                held = selected(held, fit.validate_on)
            else:
                held = [row for row in held if any(row.cell == other.cell for other in train)]
            words = [f"{key.rpartition('.')[2]}={value}" for key, value in cell.items()]
            name = re.sub(r"[^\w.=-]+", "_", "-".join([fit.name, *words]))
            tasks.append(FitTask(name, fit, cell, tuple(train), tuple(held), settings[mine[0].id], campaign.folder))
    return tasks


def check_fits(campaign: Campaign, runs: Sequence[PlannedRun]) -> None:
    """Raise ValueError if a fit names a method, a setting or a channel that does not exist."""
    for fit in campaign.fit:
        try:
            plant = designed_vehicle(selected(runs, fit.runs)[0].settings, campaign.folder)
            _estimator(fit, plant)
            if plant is not None:
                _check_channels((*(fit.inputs or ()), *(fit.outputs or ())), plant)
        except ValueError as error:
            raise ValueError(f"{campaign.path}: fit {fit.name!r}: {error}") from None


def read_fits(folder: str | Path) -> list[dict[str, Any]]:
    """The results of the last `fit_models`; empty if nothing was fitted."""
    return _shelf(folder).read()


def load_fitted(folder: str | Path, fit: Mapping[str, Any]) -> Model:
    """The model of a successful fit."""
    return load_model(Path(folder) / FOLDER / str(fit["file"]))


def designed_vehicle(settings: RunSettings, origin: Path) -> Plant | None:
    """The vehicle of a run without the campaign's effects; None for a log without a vehicle."""
    if settings.vehicle is not None:
        return make_campaign_vehicle(settings.vehicle, origin, effects=False)
    if settings.experiment.kind != "env":
        return None
    env: Any = make_env(settings.model_copy(update={"sensors": {}}), origin)
    try:
        return env.unwrapped.plant
    finally:
        env.close()


def _shelf(folder: str | Path) -> Shelf:
    """The storage of results and of the models that they name."""
    return Shelf(Path(folder) / FOLDER, LIST, lambda result: [result["file"]])


def _fitted(folder: Path, task: FitTask) -> dict[str, Any]:
    """Fit, test and write a model."""
    started = perf_counter()
    result = _empty(task)
    try:
        _fill(result, task, folder)
        result["status"] = "done"
    except Exception as error:  # any error: the other fits continue, and this one reports its reason
        ours = isinstance(error, ValueError | ImportError) or type(error).__name__ == "Diverged"
        result["reason"] = str(error) if ours else f"{type(error).__name__}: {error}"
    result["seconds"] = result["seconds"] or perf_counter() - started
    _shelf(folder).put(task.name, result)
    return result


def _empty(task: FitTask) -> dict[str, Any]:
    """The result for a fit that has not been made."""
    return {
        "key": task.key,
        "name": task.name,
        "fit": task.fit.name,
        "method": task.fit.method,
        "settings": task.fit.settings,
        "cell": dict(task.cell),
        "status": "failed",
        "reason": "",
        "remarks": [],
        "file": "",
        "trained_on": [row.id for row in task.train],
        "held_out": [row.id for row in task.held],
        "inputs": [],
        "outputs": [],
        "dt": 0.0,
        "seconds": 0.0,
        "parameters": [],
        "poles": [],
        "scores": {},
        "vehicle_scores": {},
        "residuals": {},
    }


def _fill(result: dict[str, Any], task: FitTask, folder: Path) -> None:
    if not task.train:
        raise ValueError("No run that it should be fitted to has a record: see the reasons in the index.")
    records = [Record.load(row.path(folder)) for row in task.train]
    plant = designed_vehicle(task.settings, task.origin)
    fit = task.fit
    estimator = _estimator(fit, plant)
    started = perf_counter()
    found = estimator.fit(*records)
    model = found.model
    result["seconds"] = perf_counter() - started
    suffix = ".toml" if isinstance(model, Plant) else ".npz"
    attrs = {"campaign_fit": fit.name, "method": fit.method, "runs": [row.id for row in task.train]}
    save_model(model, folder / FOLDER / f"{task.name}{suffix}", attrs)
    driven = [name for name in model.inputs if name not in model_constant_inputs(model)]
    result |= {
        "file": f"{task.name}{suffix}",
        "inputs": driven or list(model.inputs),
        "outputs": [name for name in model.outputs if records[0].has(name)],
        "dt": model.dt,
        "poles": poles_of(model),
        "parameters": [_told(estimate, model) for estimate in found.estimates],
    }
    judged = []
    for row in task.held:
        record = Record.load(row.path(folder))
        run = _judged(model, plant, record)
        if "model" in run.failed:
            result["remarks"].append(f"Run {row.id}: {run.failed['model']}")
            continue
        for place, name in (("scores", "model"), ("vehicle_scores", VEHICLE)):
            if name in run.runs:
                result[place][row.id] = {c: _finite(score.as_dict()) for c, score in run.scores[name].items()}
        judged.append(record)
    if judged:
        result["residuals"] = residual_tests(model, judged)


def _estimator(fit: Fit, plant: Plant | None) -> Estimator:
    return make_estimator(fit.method, fit.settings, plant=plant, inputs=fit.inputs, outputs=fit.outputs)


def _check_channels(names: Sequence[str], plant: Plant) -> None:
    """Raise if a simulated run of a vehicle cannot have one of these channels."""
    own = (*plant.inputs, *plant.outputs)
    known = {*CHANNELS, *own, *(truth_of(name) for name in plant.states if name in CHANNELS)}
    for name in names:
        # set points, excitations and flags depend on the controller
        if name not in known and channel(name).kind == "auxiliary" and not is_flag(name):
            raise ValueError(
                f"No run of {plant.name} has a channel {name!r}. {did_you_mean(name, own)}It has {', '.join(own)}."
            )


def _judged(model: Model, plant: Plant | None, record: Record) -> OpenLoop:
    """Free runs of a model, and of the vehicle as designed if it can follow the record."""
    if plant is not None:
        with suppress(ValueError):
            return open_loop({"model": model, VEHICLE: plant}, record)
    return open_loop({"model": model}, record)


def _told(estimate: Estimate, model: Model) -> dict[str, Any]:
    return {
        "name": estimate.path,
        "title": spec_at(model, estimate.path).title if isinstance(model, Plant) else "",
        "unit": estimate.unit,
        "value": estimate.value,
        "error": estimate.error if isfinite(estimate.error) else None,
        "ci95": list(estimate.ci95) if all(map(isfinite, estimate.ci95)) else None,
        "problem": estimate.problem,
    }


def _finite(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if isfinite(value) else None for name, value in values.items()}
