"""Several logs of one vehicle, each of which may have effects of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.log.parts import OneLog, Part, in_equal_times, logs_in, windows_of
from identification.fit.changing import ChangingPlant, Course
from identification.fit.shooting import unknown_states


def with_own_effects(log: CheckedLog, paths: Sequence[str]) -> CheckedLog | None:
    """Parts that each hold a share of every log, and a vehicle whose effects may apply to some logs only.

    Effects may apply to one log, to all logs from one on, or to all logs up to one.  paths: of the effects.  None if
    there is only one log, or if a part of a log could not be predicted from the rest of that log.
    """
    logs = logs_in(log.record)
    parts = _shares_of_each(log, logs)
    if len(logs) < 2 or len(parts) < 2:
        return None
    courses = _courses(logs)
    plant = ChangingPlant.of(log.plant, {form: list(paths) for form in courses}, courses, log.record)
    runs = [windows_of(log.record, part, log.window) for part in parts]
    if not all(runs):
        return None
    return replace(log, plant=plant, parts=parts, windows=tuple(runs))


def in_last_log(plant: Plant, record: Record) -> Plant:
    """The vehicle as it was in the last of a record's logs."""
    return plant.at_row(len(record) - 1) if isinstance(plant, ChangingPlant) else plant


def last_log(plant: Plant, record: Record) -> tuple[Record, str]:
    """The log to which the vehicle of `in_last_log` belongs, and its name; the record if nothing differs by log."""
    if not isinstance(plant, ChangingPlant):
        return record, "the log"
    last = logs_in(record)[-1]
    return record.select(np.arange(len(record)) >= last.rows.start), last.name


def _courses(logs: Sequence[OneLog]) -> dict[str, Course]:
    found = {
        f"log{one.number}": Course((one.rows.start, one.rows.stop), (0.0, 1.0, 0.0), f"in {one.name}") for one in logs
    }
    for one in logs[1:-1]:
        found[f"since{one.number}"] = Course((one.rows.start,), (0.0, 1.0), f"from {one.name} on")
        found[f"until{one.number}"] = Course((one.rows.stop,), (1.0, 0.0), f"up to {one.name}")
    return found


def _shares_of_each(log: CheckedLog, logs: Sequence[OneLog]) -> tuple[Part, ...]:
    """As many parts as the log has, each with a share of every log; none if a log has fewer than two shares."""
    count = len(log.parts)
    found: list[list[slice]] = [[] for _ in range(count)]
    pieces = sorted((piece for part in log.parts for piece in part), key=lambda w: w.start)
    for one in logs:
        own = one.among(pieces)
        if unknown_states(log.plant):  # keep dives whole: pieces of one dive would share its unknown state
            shares = [own[k::count] for k in range(count)]
        else:
            shares = in_equal_times(log.record, own, count) if own else []
        if sum(map(bool, shares)) < 2:
            return ()
        for part, share in zip(found, shares, strict=True):
            part += share
    return tuple(tuple(part) for part in found if part)
