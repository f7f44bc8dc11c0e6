"""One run of a campaign, from its settings to the content of its file; its random numbers depend only on its seed."""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, final

import numpy as np

from auv_gym.channels import truth_of
from auv_gym.model import Diverged
from auv_gym.records.record import Record
from identification.campaign.file.plan import PlannedRun
from identification.campaign.file.settings import EnvExperiment, LogExperiment, RunSettings
from identification.campaign.running.staging import make_campaign_controller, make_campaign_vehicle, make_env
from identification.experiments.driving import drive, versions_used

Status = Literal["done", "ended", "diverged", "failed", "pending"]
_SUCCESSES = ("", "arrived")  # beginnings of the reasons of episodes that went as planned


@final
@dataclass(frozen=True)
class Outcome:
    """The outcome of a run.

    status: done; ended, if the vehicle left its envelope; diverged; failed, by an error, without a record.
    content: of the run's NetCDF file.  sha256: of the record's numbers.  duration_s, samples: of the record.
    seconds: computing time.
    """

    id: str
    status: Status
    reason: str = ""
    content: bytes = b""
    sha256: str = ""
    samples: int = 0
    duration_s: float = 0.0
    seconds: float = 0.0


def perform(run: PlannedRun, folder: Path | None = None) -> Outcome:
    """Perform a run; errors are outcomes, too.

    folder: of a log.  The run carries the content of all other files, so that it can be performed on any machine.
    """
    begin = time.perf_counter()
    try:
        with tempfile.TemporaryDirectory(prefix="auv-gym-") as aside:
            record, reason = _record(_with_files(run, Path(aside)), folder or Path(aside), Path(aside))
            status = run_status(reason)
            seconds = time.perf_counter() - begin
            digest = content_hash(record)
            attrs = {
                "campaign_run": run.id,
                "settings": run.settings.model_dump_json(exclude_none=True),
                "seed": run.seed,
                "status": status,
                "reason": reason,
                "sha256": digest,
                "seconds": seconds,
                "versions": versions_used(),
            }
            file = Path(aside) / "run.nc"
            Record(record.dataset.assign_attrs(attrs)).save(file)
            content = file.read_bytes()
    except Exception as error:  # the campaign continues without this run and reports the reason
        status = "diverged" if isinstance(error, Diverged) else "failed"
        return Outcome(run.id, status, _in_words(error), seconds=time.perf_counter() - begin)
    return Outcome(run.id, status, reason, content, digest, len(record), record.duration_s, seconds)


def content_hash(record: Record) -> str:
    """A hash of a record's numbers, times, segments and channel names, but not of its attributes."""
    digest = hashlib.sha256()
    columns: Mapping[str, np.ndarray] = {
        "time_s": record.time,
        "segment": record.dataset["segment"].values,
        **{name: record[name] for name in record.names},
    }
    for name in sorted(columns):
        digest.update(name.encode() + b"\0" + np.ascontiguousarray(columns[name], dtype="<f8").tobytes())
    return digest.hexdigest()


def _with_files(run: PlannedRun, aside: Path) -> RunSettings:
    """The settings, with the files that they name written into a folder under unique names."""
    moved: dict[str, str] = {}
    for number, (name, content) in enumerate(run.files.items()):
        moved[name] = f"{number}-{Path(name).name}"
        (aside / moved[name]).write_bytes(content)
    vehicle, controller = run.settings.vehicle, run.settings.controller
    changes: dict[str, Any] = {}
    if vehicle is not None and vehicle.file is not None:
        changes["vehicle"] = vehicle.model_copy(update={"file": moved[vehicle.file]})
    if controller is not None and controller.gains_file is not None:
        changes["controller"] = controller.model_copy(update={"gains_file": moved[controller.gains_file]})
    return run.settings.model_copy(update=changes)


def _record(settings: RunSettings, folder: Path, aside: Path) -> tuple[Record, str]:
    """The record of a run including the true states, and why it was cut short."""
    experiment = settings.experiment
    if isinstance(experiment, EnvExperiment):
        env = make_env(settings, aside)
        run = drive(
            env,
            make_campaign_controller(settings, env, aside),
            seed=settings.seed,
            targets=experiment.steps,
            start=experiment.start,
        )
        truth = {truth_of(name): run.truth[name] for name in run.truth.names}
        return run.record.with_channels(truth), run.reason
    if isinstance(experiment, LogExperiment):
        from auv_gym.records.reading import read_record

        log = experiment.file if experiment.file.startswith("slocum:") else folder / experiment.file
        runs: Literal["cut", "raise"] = "cut" if experiment.cut_gaps else "raise"
        return read_record(log, experiment.mapping, max_gap_s=experiment.max_gap_s, long_runs=runs), ""
    from identification.experiments.missions import run_mission

    assert settings.vehicle is not None  # ensured by RunSettings
    rng = np.random.default_rng(settings.seed)
    return run_mission(make_campaign_vehicle(settings.vehicle, aside), rng, **experiment.settings), ""


def run_status(reason: str) -> Status:
    """The status of a run, from the reason for the end of its episode."""
    if any(reason.startswith(begin) if begin else not reason for begin in _SUCCESSES):
        return "done"
    return "diverged" if reason.startswith("diverged") else "ended"


def _in_words(error: Exception) -> str:
    """The error in one line; an error that is not about settings or data also says where it was raised."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, ValueError | Diverged):
        return text
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} in {os.path.basename(last.filename)}, line {last.lineno}: {text}"
