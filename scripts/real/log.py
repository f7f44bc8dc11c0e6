"""A measured log: its description, what is known of it from elsewhere, and its diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import Diverged
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.record_check import needs_of
from auv_gym.records.density import read_profiles, with_density
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from auv_gym.records.understanding import Needs
from auv_gym.writing import finite
from identification.diagnosis import Diagnosis, diagnose
from identification.diagnosis.log.parts import Part, parts_of
from identification.diagnosis.result_files import as_json
from identification.fit.validation import free_runs, joined_runs

_SHOWN = {"rad": ("deg", float(np.rad2deg(1.0))), "rad/s": ("deg/s", float(np.rad2deg(1.0)))}


@dataclass(frozen=True)
class Places:
    """Locations: the folder of measured logs, and that of the environments of other packages."""

    data: Path
    peers: Path = Path(".peers")


@dataclass(frozen=True)
class Error:
    """The error of a signal in unseen data: as given, refitted and with effects, and with others' tools.

    unit: % is of the signal's deviation.  None if runs did not stay finite, or others state nothing.
    intervals: 95 % intervals of the stages' errors and of others', if they were estimated.
    """

    signal: str
    unit: str
    stages: Sequence[float | None]
    others: float | None = None
    intervals: Sequence[Sequence[float] | None] = ()


def plainly(log: Log, places: Places) -> dict[str, Any]:
    """The diagnosis of a log, judged by free runs in unseen parts; raises ValueError if it cannot be made."""
    plant = load_vehicle(log.vehicle)
    found = diagnose(log.record(places.data, log.files, needs_of(plant)), plant, source=log.name)
    return kept(found, fits={f"{horizon:g}": rate_fits(found, horizon) for horizon in log.horizons})


@dataclass(frozen=True)
class Log:
    """A measured log, or dives of one vehicle, and how it is judged.

    files: below the data's folder, or `slocum:NAME`, which dbdreader ships.  judged: files that no fit sees.
    least_depth: m, from which on it is used.  profile: of the water's density.  step: s, to which it is thinned.
    window: s, of free runs; None for the vehicle's.
    horizons: s, of free runs of the rates, if it is judged by these; the first is shown.
    signals: of the free runs to show; by default all.
    source: who made it.  known: what is known of the truth from elsewhere, and from whom.
    rivals: errors stated by others, by signal; rival: who they are.
    run: returns its result as plain data, see `kept`.
    """

    name: str
    vehicle: str
    files: tuple[str, ...]
    source: str
    known: str
    judged: tuple[str, ...] = ()
    least_depth: float = 0.0
    profile: str = ""
    step: float = 0.0
    window: float | None = None
    horizons: tuple[float, ...] = ()
    signals: tuple[str, ...] = ()
    rivals: Mapping[str, float] = field(default_factory=dict)
    rival: str = ""
    run: Callable[[Log, Places], dict[str, Any]] = plainly

    def missing(self, data: Path) -> list[str]:
        """Its files that do not exist."""
        files = (*self.files, *self.judged, *([self.profile] if self.profile else []))
        return [file for file in files if not bundled(file) and not (data / file).exists()]

    def record(self, data: Path, files: Sequence[str], needs: Needs | None = None) -> Record:
        """Some of its files as one record, thinned and cut as described."""
        paths = [file if bundled(file) else data / file for file in files]
        record = read_record(paths, None, needs or ())
        if self.step:
            record = record.resample(self.step)
        if self.least_depth > 0.0:
            record = record.select(record["depth_m"] > self.least_depth)
        return with_density(record, read_profiles(data / self.profile)) if self.profile else record

    def errors(self, said: Mapping[str, Any]) -> list[Error]:
        """The errors of the vehicles in its result, in readable units."""
        if "errors" in said:
            found = [Error(**error) for error in said["errors"]]
            found += _of_free_runs(said["error"], self.signals) if self.signals else []
        elif self.horizons:
            found = list(_of_fits(said["fits"][f"{self.horizons[0]:g}"], self.signals))
        else:
            found = list(_of_free_runs(said["error"], self.signals))
        return [replace(e, others=self.rivals.get(e.signal, e.others)) for e in found]


def bundled(file: str) -> bool:
    """Whether a package ships a log."""
    return ":" in file


def _of_fits(fits: Mapping[str, Sequence[float | None]], signals: Sequence[str]) -> Iterator[Error]:
    """Errors in percent of a signal's deviation, which is 100 less the fit percent."""
    for name in signals:
        *percents, _ = fits[name]
        stages = [None if p is None or not np.isfinite(p) else 100.0 - p for p in percents]
        yield Error(channel(name).label, "%", stages)


def _of_free_runs(error: Mapping[str, Any], signals: Sequence[str]) -> Iterator[Error]:
    for name in signals or error["as_given"]:
        unit, factor = _SHOWN.get(channel(name).unit, (channel(name).unit, 1.0))
        stages = [factor * error[stage][name]["rmse"] for stage in ("as_given", "refitted", "after")]
        yield Error(channel(name).label, unit, stages)


def kept(found: Diagnosis, **more: Any) -> dict[str, Any]:
    """The stored result of a log: its diagnosis, the `seconds` of each step, its samples, and more."""
    return finite({**as_json(found), "seconds": dict(found.seconds), "samples": len(found.record), **more})


def rate_fits(found: Diagnosis, horizon: float) -> dict[str, list[float]]:
    """For each rate, fit percent as given, refitted and with effects in free runs over `horizon` s, and samples.

    Each part of the log is predicted by a vehicle that was fitted, and whose effects were chosen, without it; NaN if
    its runs do not stay finite.
    """
    parts = parts_of(found.given.plant, found.record, len(found.windows))
    windows = [_windows(found.record, part, horizon + found.settle) for part in parts]
    stages = [list(stage.without) for stage in (found.given, found.refitted, found.after)]
    return fit_percents(stages, found.record, windows, found.settle, ("p_radps", "q_radps", "r_radps"))


def fit_percents(
    stages: Sequence[Sequence[Plant]],
    record: Record,
    windows: Sequence[Sequence[slice]],
    settle: float,
    names: Sequence[str],
) -> dict[str, list[float]]:
    """For each signal, fit percent at each stage and the samples, each group of windows by a plant of its own."""
    found: dict[str, list[float]] = {name: [] for name in names}
    samples = 0
    for plants in stages:
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                flown = [free_runs(p, record, own, settle) for p, own in zip(plants, windows, strict=True)]
        except Diverged:
            percents = dict.fromkeys(names, np.nan)
        else:
            scores = joined_runs(flown).scores(record)
            percents, samples = {n: scores[n].fit_percent for n in names}, scores[names[0]].samples
        for name in names:
            found[name].append(percents[name])
    return {name: [*values, samples] for name, values in found.items()}


def _windows(record: Record, part: Part, seconds: float) -> list[slice]:
    """A part in consecutive windows of exactly `seconds`; a shorter remainder is left out."""
    size = round(seconds / record.sample_interval) + 1  # the last row is `seconds` after the first
    return [slice(a, a + size) for piece in part for a in range(piece.start, piece.stop - size + 1, size)]
