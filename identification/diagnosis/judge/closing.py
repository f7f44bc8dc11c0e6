"""Closed-loop runs before and after a diagnosis: each model is steered by the log's own set points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from auv_gym.channels import channel, set_point_of, wrap
from auv_gym.model import outputs_of
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from controllers.autopilots import autopilot
from controllers.controller import Controller
from controllers.kinds import KINDS
from identification.diagnosis.wording import quantity

MOST_SAMPLES = 4000  # samples; only the first part of a longer log is run again, to save time


@dataclass(frozen=True)
class ClosedLoop:
    """Agreement, in one channel, between the log and a model that is run under the log's own set points.

    logged: RMS of the log's tracking error.  tracking: RMS of the model's tracking error, by stage ("given", "before",
    "after").  given, before, after: RMS difference between the log's and the model's tracking error.  All are NaN if
    nothing could be run; `words` then says why.
    """

    channel: str
    unit: str
    logged: float
    given: float
    before: float
    after: float
    tracking: Mapping[str, float]
    words: str


def closed_loop(
    record: Record, stages: Mapping[str, Plant], name: str = "the log", last: str = "after"
) -> tuple[ClosedLoop, ...]:
    """Compare the closed loop of each model of a diagnosis with the log, for each channel with set points in the log.

    stages: the vehicle as "given", "before" and "after".  name: what to call the log in the text.  last: what to call
    the vehicle "after" there.

    The vehicle's autopilot steers the model to the log's set points.  The autopilot is also run on the logged readings;
    the difference between the logged commands and these (an excitation, or another controller's behaviour) is added to
    its commands.  A correct model then reproduces the log, whatever steered the vehicle.
    """
    plant = stages["given"]
    targets = targets_of(plant, record)
    wanted = ", ".join(map(set_point_of, _targets(plant)))
    lacking = f"the log has no set points ({wanted})." if wanted else f"no autopilot is known for {plant.name}."
    reason = "" if targets else lacking
    controller = None
    if not reason:
        try:
            record = _steered_part(record, targets)
        except ValueError:  # no sample has all set points
            reason = f"the log never has all of its set points ({wanted}) at once."
    if not reason:
        try:
            controller = controller_for_channels(plant, targets)
        except ValueError as error:
            reason = f"no autopilot is known for {plant.name}: {error}"
    if controller is None:
        first = _targets(plant)[0] if _targets(plant) else plant.outputs[0]
        nothing, why = dict.fromkeys(stages, np.nan), f"The closed loop was not compared: {reason}"
        return (ClosedLoop(first, channel(first).unit, np.nan, np.nan, np.nan, np.nan, nothing, why),)
    record = _beginning(record)
    told, runs = commands_at_log_samples(plant, controller, record, targets), {}
    for stage, model in stages.items():
        same = next((runs[n] for n in runs if np.array_equal(stages[n].vector, model.vector)), None)
        runs[stage] = steered(model, controller, record, targets, told) if same is None else same
    return tuple(_judged(target, record, {s: run[target] for s, run in runs.items()}, name, last) for target in targets)


def targets_of(plant: Plant, record: Record) -> tuple[str, ...]:
    """The channels in which the vehicle can be steered and for which the log has both readings and set points."""
    return tuple(
        name
        for name in _targets(plant)
        if record.has(name) and record.has(set_point_of(name)) and np.isfinite(record[set_point_of(name)]).any()
    )


def controller_for_channels(plant: Plant, targets: tuple[str, ...]) -> Controller:
    """The vehicle's controller for these channels; raises ValueError if there is none."""
    on_board = KINDS.of(plant.family).on_board
    return autopilot(plant, targets=targets) if on_board is None else on_board(plant, targets)


def steered(
    model: Plant,
    controller: Controller,
    record: Record,
    targets: tuple[str, ...],
    told: Sequence[Mapping[str, float]] | None = None,
) -> dict[str, np.ndarray]:
    """A model's outputs in the target channels, (n,) each, under the log's set points; infinite once it has diverged.

    told: the result of `commands_at_log_samples`, if available.  Without it, the model's outputs fill in for readings
    that are missing from the log.
    """
    names = [name for name in model.outputs if record.has(name)]
    logged = {name: record[name] for name in names}
    inputs = np.array(
        [record[n] if record.has(n) else np.full(len(record), model.constants[n]) for n in model.inputs]
    ).T
    limits, time, first = KINDS.of(model.family).ranges(model), record.time, outputs_of(model, record)
    goals, steps = _asked(record, targets, model.dt)
    found = np.full((len(record), len(targets)), inf)
    at = [model.outputs.index(name) for name in targets]
    for segment in record.segments:
        x, (own, its) = model.initial(first[segment.start]), (controller.start(), controller.start())
        for k in range(segment.start, segment.stop):
            outputs = model.output(x)
            found[k] = outputs[at]
            if not np.isfinite(outputs).all():
                found[k : segment.stop] = inf
                break
            reading = dict(zip(model.outputs, outputs.tolist(), strict=True)) | {"dt_s": steps[k]}
            command, own = controller.act(own, reading, goals[k])
            if told is None:
                seen = reading | {name: float(values[k]) for name, values in logged.items() if np.isfinite(values[k])}
                at_log, its = controller.act(its, seen, goals[k])
            else:
                at_log = told[k]
            u = inputs[k].copy()
            for index, name in enumerate(model.inputs):
                if name in command and name in limits:
                    low, high = limits[name]
                    extra = u[index] - min(max(at_log[name], low), high)
                    u[index] = min(max(min(max(command[name], low), high) + extra, low), high)
            if k + 1 < segment.stop:
                x = model.step_over(x, u, float(time[k + 1] - time[k]))
    return {name: found[:, column] for column, name in enumerate(targets)}


def commands_at_log_samples(
    plant: Plant, controller: Controller, record: Record, targets: tuple[str, ...]
) -> list[Mapping[str, float]] | None:
    """The controller's command at each of the log's readings; None if any of the plant's outputs is missing there."""
    if not np.isfinite(outputs_of(plant, record)).all():
        return None
    goals, steps = _asked(record, targets, plant.dt)
    rows = np.array([record[name] for name in plant.outputs]).T.tolist()
    found: list[Mapping[str, float]] = []
    for segment in record.segments:
        memory = controller.start()
        for k in range(segment.start, segment.stop):
            reading = dict(zip(plant.outputs, rows[k], strict=True)) | {"dt_s": steps[k]}
            command, memory = controller.act(memory, reading, goals[k])
            found.append(command)
    return found


def _asked(record: Record, targets: tuple[str, ...], dt: float) -> tuple[list[dict[str, float]], list[float]]:
    """The set points at each sample, and the time since the previous sample (dt where a segment begins)."""
    wanted, steps = {name: record[set_point_of(name)].tolist() for name in targets}, np.diff(record.time, prepend=0.0)
    steps[[segment.start for segment in record.segments]] = dt
    goals = [{name: v[k] for name, v in wanted.items()} for k in range(len(record))]
    return goals, steps.tolist()


def _targets(plant: Plant) -> tuple[str, ...]:
    kind = KINDS.of(plant.family)
    return kind.targets if kind.logged is None else kind.logged(plant)


def _steered_part(record: Record, targets: tuple[str, ...]) -> Record:
    """The part of the record in which every target has a set point; a set point holds until the next one is logged."""
    goals = {set_point_of(name): record[set_point_of(name)].copy() for name in targets}
    for values in goals.values():
        for part in record.segments:
            known = np.isfinite(values[part])
            last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
            values[part] = np.where(last >= 0, values[part][last], np.nan)
    return record.with_channels(goals).select(np.all([np.isfinite(values) for values in goals.values()], axis=0))


def _beginning(record: Record) -> Record:
    """The first samples of a long record."""
    return record if len(record) <= MOST_SAMPLES else record.select(np.arange(len(record)) < MOST_SAMPLES)


def _judged(name: str, record: Record, runs: Mapping[str, np.ndarray], log: str, last: str) -> ClosedLoop:
    logged = _errors(name, record, record[name])
    errors = {stage: _errors(name, record, run) for stage, run in runs.items()}
    apart = {stage: inf if np.isinf(runs[stage]).any() else _rms(_apart(name, errors[stage], logged)) for stage in runs}
    unit = channel(name).unit
    said = {stage: quantity(v, unit) if np.isfinite(v) else "no stable run" for stage, v in apart.items()}
    first = "as given" if runs["before"] is runs["given"] else "before"
    if runs["after"] is runs["before"]:
        told = f"{said['given']} as given"
        told += "" if first == "as given" else f" and {said['before']} refitted"
    else:
        told = f"{said['before']} {first} and {said['after']} {last}"
    words = (
        f"In {log}, the controller missed its set point of {channel(name).label} by {quantity(_rms(logged), unit)} "
        f"(RMS). With the model in the vehicle's place, the loop differs from the logged one by {told}."
    )
    tracking = {stage: inf if np.isinf(runs[stage]).any() else _rms(e) for stage, e in errors.items()}
    return ClosedLoop(name, unit, _rms(logged), apart["given"], apart["before"], apart["after"], tracking, words)


def _errors(name: str, record: Record, values: np.ndarray) -> np.ndarray:
    error = values - record[set_point_of(name)]
    with np.errstate(invalid="ignore"):
        return wrap(error) if channel(name).angle else error


def _apart(name: str, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return wrap(one - other) if channel(name).angle else one - other


def _rms(values: np.ndarray) -> float:
    """Root mean square of the finite values, which are those measured while there was a set point."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan
