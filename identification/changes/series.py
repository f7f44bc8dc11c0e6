"""Trends over a series of missions: a few parameters, estimated from each mission alone, and the line through them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2, t as student

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record, concat
from auv_gym.writing import writable_folder, write_json
from identification.campaign.running.pool import Spread, in_parallel, on_cluster
from identification.changes.forms import Sized, refuse_overlaps
from identification.changes.missions import Comparison, compare_missions
from identification.deciding import DOUBT, MISSED, MOST_EFFECTS, PRICE, SURPRISE
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.result_files import digest_of
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import Workbench

MISSIONS, FOLLOWED = "missions", "followed.json"
LEAST = 4  # missions of a trend; this leaves two degrees of freedom
_KEEPS = ["paths", "values", "tied"]  # the parts of the comparison that its file keeps
_EITHER_SIDE = 2  # least missions before a step, and after it
_DAY = 86400.0  # s


@dataclass(frozen=True)
class MissionStep:
    """A step of a parameter from one mission to the next, which explains the missions better than a line.

    mission: the first one after the step.  ci95: the first and last mission of its 95 % interval.  at: when the step
    happened, half-way between two missions, in the units of a `Trend`.  evidence: over the line.
    """

    mission: str
    ci95: tuple[str, str]
    at: float
    before: Sized
    after: Sized
    change: Sized
    evidence: float


@dataclass(frozen=True)
class Trend:
    """The trend of a parameter over missions.

    rate: change per `per`, with a 95 % interval that allows for differences between missions beyond their own
    intervals; scatter: standard deviation of these.  level: of the line at the mean of `at`.  at: when the missions
    took place, (M,), in units of `per`.  sizes: the estimates from each mission alone.  tied: paths of what else would
    explain the change, see `Comparison`.  step: if one explains the missions better.
    """

    path: str
    title: str
    unit: str
    per: str
    rate: Sized
    scatter: float
    level: float
    at: tuple[float, ...]
    sizes: tuple[Sized, ...]
    tied: tuple[str, ...] = ()
    step: MissionStep | None = None

    @property
    def sure(self) -> bool:
        """Whether the interval of the rate excludes zero."""
        return self.rate.ci95[0] > 0.0 or self.rate.ci95[1] < 0.0


@dataclass(frozen=True, eq=False)
class Series:
    """The result of `follow_series`; failed: why a mission has no sizes, by its name."""

    plant: Plant
    missions: tuple[str, ...]
    trends: tuple[Trend, ...]
    failed: Mapping[str, str]


def follow_series(
    missions: Mapping[str, Record],
    plant: Plant,
    folder: str | Path,
    *,
    most: int = MOST_EFFECTS,
    doubt: float = DOUBT,
    trust: bool = False,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Progress = lambda fraction, text: None,
) -> Series:
    """The trends, over missions in order of time, of a vehicle's first coefficients and of the effects that are found.

    The earlier half is compared with the later half (`compare_missions`).  The effects and changes found there are
    followed together with the coefficients of a first fit.  Each mission then gives its own sizes of these, with all
    else fixed at the comparison's values.  Files in `folder` keep the results, so that an interrupted run continues and
    ends with the same result.  jobs: processes.
    scheduler: address of a Dask scheduler, whose workers process the missions instead of local processes.
    """
    if len(missions) < LEAST:
        raise ValueError(f"A trend needs at least {LEAST} missions, one after the other, got {len(missions)}.")
    refuse_overlaps(missions)
    times = _times(missions)
    with nullcontext(partial(in_parallel, jobs=jobs)) if scheduler is None else on_cluster(scheduler) as spread:
        return _followed(missions, times, plant, Path(folder), most, doubt, trust, spread, progress)


def _followed(
    missions: Mapping[str, Record],
    times: tuple[list[float], str],
    plant: Plant,
    folder: Path,
    most: int,
    doubt: float,
    trust: bool,
    spread: Spread,
    progress: Progress,
) -> Series:
    out = writable_folder(folder / MISSIONS)
    for part in (*folder.glob(f".{FOLLOWED}.*.part"), *out.glob(".*.part")):  # left over from a killed process
        part.unlink(missing_ok=True)
    key = _key(plant, [digest_of(r) for r in missions.values()], most, doubt, trust, _KEEPS)
    followed: dict[str, Any] | None = _kept(folder / FOLLOWED, key)
    if followed is None:
        records, half = list(missions.values()), len(missions) // 2
        halves = concat(records[:half]), concat(records[half:])
        found = compare_missions(*halves, plant, most=most, doubt=doubt, trust=trust, times=False, progress=progress)
        followed = {
            "key": key,
            "paths": followed_paths(found),
            "values": found.fitted,
            "tied": {c.path: _paths_tied(c.path, c.tied) for c in (*found.changed, *found.common)},
        }
        write_json(folder / FOLLOWED, followed)
    paths = followed["paths"]
    held = replace_at(plant, {p: v for p, v in followed["values"].items() if p not in paths})
    files = {name: _key(held, [digest_of(record)], paths, trust) for name, record in missions.items()}
    told = {name: _kept(out / f"{own}.json", own) for name, own in files.items()}
    left = [name for name, kept in told.items() if kept is None]
    work = partial(_sizes_or_why, plant=held, paths=paths, trust=trust)
    for done, (number, sizes) in enumerate(spread(work, [missions[name] for name in left]), 1):
        name = left[number]
        if isinstance(sizes, dict):
            told[name] = sizes
            write_json(out / f"{files[name]}.json", {"key": files[name], **sizes})
        else:  # write no file, so that the mission is tried again
            told[name] = {"failed": "its process died" if sizes is None else f"{type(sizes).__name__}: {sizes}"}
        progress(0.85 + 0.1 * done / len(left), f"{done} of {len(left)} missions")
    each = {name: own for name, own in told.items() if own is not None}
    at, per = times
    usable = [
        (name, when, each[name]["sizes"]) for name, when in zip(missions, at, strict=True) if "sizes" in each[name]
    ]
    tied = followed["tied"]
    trends = [t for path in paths if (t := _trend(plant, path, usable, per, tied.get(path, ()))) is not None]
    failed = {name: own["failed"] for name, own in each.items() if "failed" in own}
    return Series(plant, tuple(missions), tuple(trends), failed)


def followed_paths(found: Comparison) -> list[str]:
    """The nonzero coefficients of a vehicle's first fit, and what a comparison found."""
    first = [p for p in found.plant.coefficients if value_at(found.plant, p) != 0.0]
    return list(dict.fromkeys([*first, *(c.path for c in (*found.changed, *found.common))]))


def _paths_tied(path: str, tied: Sequence[str]) -> list[str]:
    """The paths of a comparison's alternatives, without the side on which they act: a trend has no sides."""
    return [other for other in dict.fromkeys(name.rpartition(" ")[2] for name in tied) if other != path]


def _sizes_or_why(record: Record, plant: Plant, paths: Sequence[str], trust: bool) -> dict[str, Any]:
    """The contents of a mission's file: its sizes, or why it has none."""
    try:
        return {"sizes": sizes_of(record, plant, paths, trust)}
    except ValueError as error:
        return {"failed": str(error)}


def sizes_of(record: Record, plant: Plant, paths: Sequence[str], trust: bool) -> dict[str, tuple[float, float]]:
    """Value and standard error of each path from one mission alone, without priors."""
    log = check_log(record, plant, Asked(trust=trust))
    bench = Workbench(log.plant, log.record, log.parts, np.inf, log.every_window)
    state = bench.fit(bench.plant, paths)
    return {path: (value, error) for path, (value, error, _) in bench.intervals(state).items()}


def _trend(
    plant: Plant, path: str, usable: Sequence[tuple[str, float, Mapping[str, Any]]], per: str, tied: Sequence[str]
) -> Trend | None:
    """The weighted line through the missions' sizes, with a scatter between missions; None if too few can be used."""
    told = [(name, when, *sizes[path]) for name, when, sizes in usable if 0.0 < sizes[path][1] < np.inf]
    if len(told) < LEAST:
        return None
    names = [name for name, *_ in told]
    at, values, errors = np.array([numbers for _, *numbers in told]).T
    slope, error, scatter, level = line(at, values, errors)
    ends = zip(values.tolist(), (SURPRISE * errors).tolist(), strict=True)
    sizes = tuple(Sized(v, (v - far, v + far)) for v, far in ends)
    spec, rate = spec_at(plant, path), _with_interval(slope, error, at.size)
    step = mission_step(names, at, values, errors)
    title = spec.title or path
    return Trend(path, title, spec.unit, per, rate, scatter, level, tuple(at.tolist()), sizes, tuple(tied), step)


def line(at: np.ndarray, values: np.ndarray, errors: np.ndarray) -> tuple[float, float, float, float]:
    """Slope of a line through values with standard errors, its own standard error, their scatter, and its mean level.

    For the scatter see `_Weighted`.
    """
    found = _Weighted.of(_line_through(at), values, errors)
    (level, slope), (_, error) = found.values.tolist(), found.errors.tolist()
    return slope, error, found.scatter, level


def mission_step(names: Sequence[str], at: np.ndarray, values: np.ndarray, errors: np.ndarray) -> MissionStep | None:
    """The step that explains values with standard errors certainly better than one value, and better than a line.

    At least two missions lie on either side: a single one that deviates first or last may be an outlier.  Its size must
    differ from zero at the level of a 95 % interval, divided among all steps that were tried, and its evidence over a
    line must pay for the choice of the time.
    """
    later = np.arange(at.size)
    firsts = range(_EITHER_SIDE, at.size - _EITHER_SIDE + 1)
    tried = {k: _Weighted.of(np.stack([later < k, later >= k], axis=1).astype(float), values, errors) for k in firsts}
    first = max(tried, key=lambda k: tried[k].likelihood)
    best = tried[first]
    (before, after), change = best.values.tolist(), float(best.values[1] - best.values[0])
    error = float(np.hypot(*best.errors))  # no value is in both sides
    evidence = 2.0 * (best.likelihood - _Weighted.of(_line_through(at), values, errors).likelihood)
    chance = 2.0 * float(student.sf(abs(change) / error, at.size - 2)) * len(tried)
    if chance > MISSED or evidence < PRICE + 2.0 * np.log(len(tried)):
        return None
    likely = [k for k, one in tried.items() if one.likelihood > best.likelihood - 0.5 * float(chi2.isf(MISSED, 1))]
    sizes = [
        _with_interval(value, own, at.size)
        for value, own in zip((before, after, change), (*best.errors.tolist(), error), strict=True)
    ]
    middle = 0.5 * float(at[first - 1] + at[first])
    return MissionStep(names[first], (names[likely[0]], names[likely[-1]]), middle, *sizes, evidence)


def _line_through(at: np.ndarray) -> np.ndarray:
    """The regressors of a line: its level at the mean time, and its slope."""
    return np.stack([np.ones(at.size), at - at.mean()], axis=1)


def _with_interval(value: float, error: float, count: int) -> Sized:
    """A value of two that were fitted to so many missions, with its 95 % interval (Student's t)."""
    half = float(student.isf(0.5 * MISSED, count - 2)) * error
    return Sized(value, (value - half, value + half))


@dataclass(frozen=True, eq=False)
class _Weighted:
    """Values of a weighted regression, their standard errors, the scatter of the data, and the log-likelihood.

    The scatter, added to the errors of the data, is chosen so that the weighted sum of squares equals the degrees of
    freedom; it is zero if that sum is already smaller (Paule and Mandel 1982).
    """

    values: np.ndarray
    errors: np.ndarray
    scatter: float
    likelihood: float

    @classmethod
    def of(cls, design: np.ndarray, values: np.ndarray, errors: np.ndarray) -> _Weighted:
        """The regression of values with standard errors on the columns of a matrix."""

        def fitted(scatter: float) -> tuple[np.ndarray, np.ndarray, float, float]:
            weights = 1.0 / (errors**2 + scatter**2)
            covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
            found = covariance @ (design.T @ (weights * values))
            squares = float(weights @ (values - design @ found) ** 2)
            return found, covariance, squares, 0.5 * float(np.log(weights).sum() - squares)

        free, low, high = len(values) - design.shape[1], 0.0, 2.0 * float(np.ptp(values)) + float(errors.max())
        if fitted(0.0)[2] > free:
            for _ in range(60):  # bisections, down to rounding
                middle = 0.5 * (low + high)
                low, high = (middle, high) if fitted(middle)[2] > free else (low, middle)
        found, covariance, _, likelihood = fitted(low)
        return cls(found, np.sqrt(np.diag(covariance)), low, likelihood)


def _times(missions: Mapping[str, Record]) -> tuple[list[float], str]:
    """The times at which missions began, in days from the first if the logs have dates; otherwise their numbers.

    Raises ValueError if the dates are not in order.
    """
    begins = [float(r.attrs.get("start_epoch_s", np.nan)) + float(r.time[0]) for r in missions.values()]
    if not np.isfinite(begins).all():
        return [float(k) for k in range(len(begins))], "mission"
    for (name, begin), (other, later) in pairwise(zip(missions, begins, strict=True)):
        if later <= begin:
            raise ValueError(f"A series needs its missions in order of time, but {other} began before {name}: reorder.")
    return [(b - begins[0]) / _DAY for b in begins], "day"


def _key(plant: Plant, *facts: Any) -> str:
    """A hash of everything that a result depends on."""
    told = json.dumps([plant.name, plant.vector.tolist(), plant.dt, plant.longest_step, facts])
    return hashlib.sha256(told.encode()).hexdigest()


def _kept(file: Path, key: str) -> dict[str, Any] | None:
    """The contents of a file, if it has this key."""
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return told if told.get("key") == key else None
