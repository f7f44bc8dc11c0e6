"""Shared parts of the comparison of missions and the search in time: what may change, in which form, and its size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from auv_gym.param import spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.deciding import FEW_STATES
from identification.diagnosis.log.checking import Asked, CheckedLog, check_log
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate, candidates_of
from identification.diagnosis.search.known import Known
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import changed
from identification.fit.parameters import jumps


@dataclass(frozen=True)
class Sized:
    """A value with its 95 % interval, in the parameter's unit."""

    value: float
    ci95: tuple[float, float]


def sized(
    bench: Workbench,
    state: State,
    shares: Mapping[str, float],
    added: float = 0.0,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> Sized:
    """A sum of fitted parameters, each multiplied by its share, with its interval.

    The interval of one effect with jumps, whose slopes say nothing of other sizes, or next to a bound is that of its
    likelihood profile.
    """
    value = added + sum(share * value_at(state.plant, p) for p, share in shares.items())
    half = bench.half_width_of(state, shares)
    if list(shares.values()) == [1.0]:
        (path,) = shares
        least, most = bench.problem.bounds(path)
        own = value_at(state.plant, path)
        if jumps(path) or not least < own - half or not own + half < most:
            low, high = bench.interval(state, path)
            return Sized(value, (added + low, added + high))
    low, high = np.clip([value - half, value + half], *bounds)
    return Sized(float(np.clip(value, *bounds)), (float(low), float(high)))


def usable_log(record: Record, plant: Plant, asked: Asked, side: str = "") -> CheckedLog:
    """Check a record for use; raises ValueError, with the side's name, if it cannot be used or surely is mislabelled.

    If effects may explain what looks like a slip, as a dead rudder does, a note says so.
    """
    named = f"The log {side}".rstrip()
    try:
        log = check_log(record, plant, asked)
    except ValueError as error:
        raise ValueError(f"{named}: {error}" if side else str(error)) from None
    if not log.slipped:
        return log
    told = "; ".join(d.text for d in log.doubts if d.slip is not None)
    if log.firm:
        raise ValueError(f"{named} looks mislabelled: {told}. Correct the log, or use --trust to continue anyway.")
    note = f"{named} may be mislabelled: {told}. An effect may be the reason instead."
    return replace(log, doubts=(), record=log.record.with_notes([*log.record.notes, note]))


def refuse_overlaps(missions: Mapping[str, Record]) -> None:
    """Raise ValueError if two missions, or segments of one, overlap in time, as far as the logs have dates."""
    spans = []
    for name, record in missions.items():
        begin = float(record.attrs.get("start_epoch_s", np.nan))
        for label, own in zip(record.labels, record.segments, strict=True):
            first, last = begin + record.time[own.start], begin + record.time[own.stop - 1]
            spans += [(first, last, f"{name}, {label}" if label else name)] if np.isfinite(begin) else []
    spans.sort()
    for (_, last, name), (first, _, other) in pairwise(spans):
        if first < last:
            raise ValueError(
                f"Missions of one vehicle cannot overlap in time, but {other} begins {last - first:.0f} s before "
                f"{name} ends: leave one of them out, or correct their clocks."
            )


@dataclass(frozen=True)
class Changeable:
    """The parts of a vehicle that may change: effects, and the paths of refitted coefficients."""

    effects: tuple[Candidate, ...]
    coefficients: tuple[str, ...]

    @classmethod
    def of(cls, plant: Plant, record: Record, doubt: float) -> Changeable:
        """The parts of a plant that may change, except effects with a period.

        For a vehicle with many states, effects with jumps are left out, too: each size needs its own runs.
        """
        doubted = (p for p in plant.doubted if plant.deviation(p, doubt) > 0.0 and value_at(plant, p) != 0.0)
        few = len(plant.family.states) <= FEW_STATES
        effects = (c for c in candidates_of(plant, record) if c.sloped or (c.jumps and few))
        return cls(tuple(effects), tuple(doubted))

    @property
    def paths(self) -> list[str]:
        """The paths of the effects."""
        return [p for c in self.effects for p in c.paths]

    def refitted(self, known: Known) -> list[Candidate]:
        """The coefficients that a first fit frees, as candidates."""
        plant = known.bench.plant
        return [Candidate(spec_at(plant, p).title or p, (p,)) for p in known.coefficients if p in self.coefficients]


def kind_of(form: str) -> str:
    """A form without its number: `from` of `from7`."""
    return form.rstrip("0123456789")


def in_form(candidate: Candidate, form: str) -> Candidate:
    """The candidate as a change in this form."""
    return candidate.in_form(form, f"{candidate.title}, {kind_of(form)}")


def tied_names(rounds: Sequence[Round]) -> tuple[str, ...]:
    """Paths of the alternatives to what rounds have chosen; a change has the kind of its form in front."""
    found = (changed(p) for r in rounds for t in r.tied for p in t.candidate.paths)
    return tuple(dict.fromkeys(" ".join(filter(None, (kind_of(form), path))) for form, path in found))
