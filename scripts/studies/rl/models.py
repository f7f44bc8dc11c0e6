"""The log of the true vehicle, and models from it, stored as files: identified surrogates, the diagnosed vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.model import Model
from auv_gym.models.files import load_model, save_model
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.diagnosis import diagnose
from identification.experiments.missions import run_mission
from identification.fit.greybox import GreyBox
from identification.kernel_machines.hull.hull import HullLsSvm
from identification.linear.polynomials.armax import Armax
from scripts.studies.rl.scenarios import ARMAX, DIAGNOSED, GREY_BOX, HULL, Scenario
from scripts.studies.runs import write_json

CENTRES = 256  # of the learned hull
STEP = 0.1  # s, of its integration


def log_of(scenario: Scenario, seed: int) -> Record:
    """The log of the true vehicle under its autopilot with excitation added, from its noisy sensors."""
    return run_mission(scenario.truth, np.random.default_rng([seed, 7]), **scenario.log)


def model_of(scenario: Scenario, row: str, seed: int, folder: Path) -> Model:
    """The model of a row from the log of a seed, read from the folder if it exists."""
    if row not in _MAKERS:
        raise ValueError(f"{row} is no model that is made of a log; those are {', '.join(_MAKERS)}.")
    folder.mkdir(parents=True, exist_ok=True)
    for suffix in (".toml", ".npz"):
        kept = folder / f"{row}_seed_{seed}{suffix}"
        if kept.is_file():
            return load_model(kept, dt=scenario.dt)
    model, said = _MAKERS[row](scenario, _logged(scenario, seed, folder))
    write_json(folder / f"{row}_seed_{seed}.json", said)
    plain = isinstance(model, Plant) and model.learned is None
    save_model(model, folder / f"{row}_seed_{seed}{'.toml' if plain else '.npz'}")
    return model


def _logged(scenario: Scenario, seed: int, folder: Path) -> Record:
    path = folder / f"log_seed_{seed}.nc"
    if not path.is_file():
        log_of(scenario, seed).save(path)
    return Record.load(path)


def _armax(scenario: Scenario, record: Record) -> tuple[Model, dict[str, Any]]:
    fit = Armax((scenario.command,), **scenario.linear).fit(record)
    return fit.model.state_space, {"loss": np.diag(fit.loss).tolist()}  # a state space is three times as fast to step


def _grey_box(scenario: Scenario, record: Record) -> tuple[Model, dict[str, Any]]:
    fit = GreyBox(scenario.believed, scenario.free, window=scenario.window).fit(record)
    return fit.model, {e.path: {"value": e.value, "ci95": list(e.ci95)} for e in fit.estimates}


def _hull(scenario: Scenario, record: Record) -> tuple[Model, dict[str, Any]]:
    fit = HullLsSvm(replace(scenario.believed, longest_step=STEP), size=CENTRES, trend=True).fit(record)
    return fit.model, {"notes": list(fit.notes), "shares": fit.shares.tolist()}


def _diagnosed(scenario: Scenario, record: Record) -> tuple[Model, dict[str, Any]]:
    """The vehicle according to the diagnosis, which is given only the log and the believed vehicle."""
    found = diagnose(record, scenario.believed, window=scenario.window, settle=scenario.settle)
    effects = [
        {"path": e.path, "title": e.title, "value": e.value, "ci95": list(e.ci95), "tied_with": list(e.tied_with)}
        for e in found.effects
    ]
    return found.after.plant, {"verdict": found.verdict, "summary": found.summary(), "effects": effects}


_MAKERS: dict[str, Callable[[Scenario, Record], tuple[Model, dict[str, Any]]]] = {
    ARMAX: _armax,
    GREY_BOX: _grey_box,
    HULL: _hull,
    DIAGNOSED: _diagnosed,
}
