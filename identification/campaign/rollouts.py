"""Rollouts of identified models in the vehicle's place, driven by its inputs or by its controller."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.channels import channel, set_point_of
from auv_gym.model import Model
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.campaign.file.plan import plan, selected
from identification.campaign.file.settings import Campaign, EnvExperiment, RunSettings
from identification.campaign.fits import VEHICLE, designed_vehicle, load_fitted, read_fits
from identification.campaign.index import Row, read_index
from identification.campaign.running.perform import run_status
from identification.campaign.running.shelf import Progress, Shelf
from identification.campaign.running.staging import make_campaign_controller, make_env
from identification.compare.closed_loop import compare_closed, step_scales
from identification.compare.model_tests import open_loop, over_time

FOLDER, LIST = "rollouts", "rollouts.json"
KINDS = ("open", "closed")
FORMAT = 3  # increased when the same settings come to give a different result


@dataclass(frozen=True, eq=False)
class RolloutTask:
    """The rollouts, on one run, of all models that apply to it, in open or in closed loop.

    fits: successful results of `fit_models`.  origin: the folder that file names in the settings are relative to.
    """

    kind: str
    row: Row
    settings: RunSettings
    fits: tuple[Mapping[str, Any], ...]
    origin: Path

    @property
    def name(self) -> str:
        """The name of its files."""
        return f"{self.kind}-{self.row.id}"

    @property
    def key(self) -> str:
        """A hash of everything that the result depends on."""
        told = [FORMAT, self.kind, self.row.id, self.row.sha256, [fit["key"] for fit in self.fits]]
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()


def compare_rollouts(
    campaign: Campaign, folder: str | Path, *, jobs: int = 1, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """The results of the rollouts on each run, as stored in `rollouts/KIND-RUN.json`; the runs are beside it as NetCDF.

    Open loop: free runs over the record.  Closed loop: the run is repeated with the same controller, set points and
    seed, and with each model in the vehicle's place.  A comparison with the same models as before is not repeated.
    """
    folder = Path(folder)
    tasks = planned_rollouts(campaign, read_index(folder), read_fits(folder))
    return _shelf(folder).filled(tasks, partial(_compared, folder), _empty, jobs, progress)


def planned_rollouts(campaign: Campaign, rows: Sequence[Row], fits: Sequence[Mapping[str, Any]]) -> list[RolloutTask]:
    """The comparisons that a campaign asks for: each run with the models of its cell that were not fitted to it."""
    if campaign.compare is None:
        return []
    settings = {run.id: run.settings for run in plan(campaign)}
    known = [row for row in rows if row.usable and row.id in settings]
    wanted = [kind for kind in KINDS if getattr(campaign.compare, f"{kind}_loop")]
    tasks = []
    for kind in wanted:
        for row in selected(known, campaign.compare.runs):
            mine = [fit for fit in fits if fit["status"] == "done" and fit["cell"].items() <= row.cell.items()]
            mine = [fit for fit in mine if row.id not in fit["trained_on"]]
            if mine and (kind == "open" or isinstance(settings[row.id].experiment, EnvExperiment)):
                tasks.append(RolloutTask(kind, row, settings[row.id], tuple(mine), campaign.folder))
    return tasks


def read_rollouts(folder: str | Path) -> dict[str, list[dict[str, Any]]]:
    """The results of the last `compare_rollouts`, by kind; empty lists if nothing was compared."""
    results = _shelf(folder).read()
    return {kind: [result for result in results if result["kind"] == kind] for kind in KINDS}


def load_rollout(folder: str | Path, file: str) -> Record:
    """A record of a rollout."""
    return Record.load(Path(folder) / FOLDER / file)


def _compared(folder: Path, task: RolloutTask) -> dict[str, Any]:
    """Make, score and write the rollouts on one run."""
    result = _empty(task)
    try:
        models = {fit["name"]: load_fitted(folder, fit) for fit in task.fits}
        (_open if task.kind == "open" else _closed)(result, task, models, folder)
        result["status"] = "done"
    except Exception as error:  # the other comparisons continue, and this one reports its reason
        result["reason"] = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    _shelf(folder).put(task.name, result)
    return result


def _open(result: dict[str, Any], task: RolloutTask, models: Mapping[str, Model], folder: Path) -> None:
    record = Record.load(task.row.path(folder))
    plant = designed_vehicle(task.settings, task.origin)
    everything = models if plant is None else {**models, VEHICLE: plant}
    done = open_loop(everything, record)
    shown, scales = done.shown(), _judged(step_scales(record), record, models)
    result["file"] = _saved(shown, f"{task.name}.nc", folder)
    for name in everything:
        if name in done.failed:
            result["models"][name] = _failed(done.failed[name])
            continue
        run = done.runs[name]
        errors = {c: -run.residual[:, i] for i, c in enumerate(run.channels) if c in scales}
        elapsed = shown.elapsed
        file = _saved(done.shown(name), f"{task.name}-{name}.nc".replace(" ", "_"), folder, run.channels)
        result["models"][name] = _scored(errors, run.scored, elapsed, scales, file)


def _closed(result: dict[str, Any], task: RolloutTask, models: Mapping[str, Model], folder: Path) -> None:
    experiment = task.settings.experiment
    assert isinstance(experiment, EnvExperiment)  # ensured by planned_rollouts
    env = make_env(task.settings, task.origin)
    controller = make_campaign_controller(task.settings, env, task.origin)
    env.close()
    done = compare_closed(
        lambda model: make_env(task.settings, task.origin, model=model),
        controller,
        models,
        seed=task.settings.seed,
        targets=experiment.steps,
        start=experiment.start,
    )
    vehicle = done.vehicle.record
    scales = _judged(done.scales, vehicle, models)
    result["file"] = _saved(vehicle, f"{task.name}.nc", folder)
    for name in models:
        if name in done.failed:
            result["models"][name] = _failed(done.failed[name])
            continue
        run = done.runs[name]
        errors, elapsed = {}, vehicle.elapsed
        for c in scales:
            time, errors[c] = done.difference(name, c)
            elapsed = time - vehicle.time[0]
        scored = np.ones(elapsed.size, dtype=bool)
        file = _saved(run.record, f"{task.name}-{name}.nc", folder)
        early = run.reason if run_status(run.reason) != "done" else ""
        result["models"][name] = {**_scored(errors, scored, elapsed, scales, file), "reason": early}


def _judged(scales: Mapping[str, float], record: Record, models: Mapping[str, Model]) -> dict[str, float]:
    """The scales of the models' outputs and of channels with a set point, the latter first."""
    given = {name for model in models.values() for name in model.outputs if not isinstance(model, Plant)}
    aimed = [name for name in scales if record.has(set_point_of(name))]
    kept = dict.fromkeys([*aimed, *(name for name in scales if name in given)])
    return {name: scales[name] for name in kept or scales}


def _scored(
    errors: Mapping[str, np.ndarray],
    scored: np.ndarray,
    elapsed: np.ndarray,
    scales: Mapping[str, float],
    file: str,
) -> dict[str, Any]:
    """The errors of a rollout by channel: in the channel's unit, in percent of its step, and over time."""
    scores, curves = {}, {}
    for name, error in errors.items():
        kept = error[scored & np.isfinite(error)]
        if kept.size:
            rmse = float(np.sqrt(np.mean(kept**2)))
            scores[name] = {
                "rmse": rmse,
                "maximum": float(np.max(np.abs(kept))),
                "percent": 100.0 * rmse / scales[name],
                "step": scales[name],
            }
            curves[name] = over_time(elapsed, error, scales[name])
    return {"status": "done", "reason": "", "file": file, "scores": scores, "over_time": curves}


def _failed(reason: str) -> dict[str, Any]:
    return {"status": "failed", "reason": reason, "file": "", "scores": {}, "over_time": {}}


def _saved(record: Record, name: str, folder: Path, channels: Sequence[str] | None = None) -> str:
    """Write channels of a rollout (default: those that a picture may show); returns the file's name."""
    kept = [n for n in record.names if channel(n).kind in ("motion", "input", "command") or n.endswith("_flag")]
    Record(record.dataset[[*(kept if channels is None else channels), "segment"]]).save(folder / FOLDER / name)
    return name


def _shelf(folder: str | Path) -> Shelf:
    """The storage of results and of the records that they name."""

    def files(result: Mapping[str, Any]) -> list[str]:
        return [result["file"], *(of["file"] for of in result["models"].values() if of["status"] == "done")]

    return Shelf(Path(folder) / FOLDER, LIST, files)


def _empty(task: RolloutTask) -> dict[str, Any]:
    """The result for a comparison that has not been made."""
    return {
        "key": task.key,
        "kind": task.kind,
        "run": task.row.id,
        "seed": task.row.seed,
        "cell": dict(task.row.cell),
        "status": "failed",
        "reason": "",
        "file": "",
        "models": {},
    }
