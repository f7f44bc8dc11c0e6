"""Doubts about the log itself: slips that explain a disagreement better than any change of the vehicle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import outputs_of
from auv_gym.param import listed, replace_at, spec_at, value_at
from auv_gym.physics.frames import velocity_ned
from auv_gym.plant import Chart, Plant, Runs
from auv_gym.records.attitude import ANGLES, STEEP, from_angles, turns
from auv_gym.records.record import Record
from auv_gym.records.suspicions import is_folded
from identification.deciding import (
    ALONE,
    BAD,
    CLEAN,
    FACTOR,
    FASTEST,
    FLOOR,
    FOREIGN,
    MOSTLY,
    POOR,
    REACH,
    SLIP_GAIN,
    SLIP_LEFT,
)
from identification.diagnosis.log.parts import excitation
from identification.diagnosis.log.slips import Slip, impossible_units, possible_slips, undone
from identification.diagnosis.log.thruster_slips import likely_slips, thruster_slips
from identification.fit.first_readings import RATES
from identification.fit.residual import noise_floor
from identification.fit.shooting import Shooting
from identification.fit.windows import held_out

ROWS, PIECES, SHORTLIST = 80, 4, 3
DIVES = 4  # of a log, if dives are taken whole
STEEPEST = 0.5 * np.pi + 0.1  # rad; a channel beyond this is not a pitch angle
GYROS = ("p_radps", "q_radps", "r_radps")
_WILD = 9.0  # error assigned to a run that diverged


@dataclass(frozen=True)
class Doubt:
    """A reason to distrust the log.

    text: what looks wrong.  gain: squared error of the log as declared over that with the slip undone, in windows that
    were not fitted.  mend: what to do.  slip: for `undone`; None if no slip explains the log.  instead: other slips
    that would explain it as well.
    firm: whether it holds without trying effects first; a clock or scale slip that leaves more than noise may be an
    effect, and so may commands that do little.
    """

    text: str
    channels: tuple[str, ...]
    gain: float
    mend: str
    slip: Slip | None = None
    instead: tuple[str, ...] = ()
    firm: bool = True


@dataclass(frozen=True, eq=False)
class Match:
    """The distance between free runs of a plant and a record: squared error over the signal's variance, by channel.

    still: the same for signals that are mostly noise, over the smallest variance that counts as motion; see `telling`.
    noise: squared error over the variance of its white part, for the channels for which it was computed.
    """

    plant: Plant
    errors: dict[str, float] = field(default_factory=dict)
    still: dict[str, float] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)

    @property
    def total(self) -> float:
        """The mean over the channels of e/(1 + e), so that one diverged channel counts as one."""
        return float(np.mean([e / (1.0 + e) for e in self.errors.values()])) if self.errors else 0.0

    @property
    def stray(self) -> tuple[str, ...]:
        """The signals that hardly move and yet are far from the runs."""
        return tuple(name for name, error in self.still.items() if error > BAD)

    def telling(self, names: Iterable[str]) -> Match:
        """The match in which these signals count even if they hardly move."""
        return replace(self, errors=self.errors | {n: self.still[n] for n in names if n in self.still})

    def within(self, names: Iterable[str]) -> Match:
        """The match in these signals only, including those that hardly move."""
        kept = set(names)
        still = {n: e for n, e in self.still.items() if n in kept}
        return replace(self, errors={n: e for n, e in self.errors.items() if n in kept}, still=still)

    def add(self, name: str, values: np.ndarray, error: float, window: np.ndarray) -> None:
        """Add a channel's squared error, minus the noise variance; window: the window number of each row."""
        keep = np.isfinite(values)
        counts = np.bincount(window[keep], minlength=window[-1] + 1)
        means = np.bincount(window[keep], values[keep], minlength=window[-1] + 1) / np.maximum(counts, 1)
        variance, noise = float(np.mean((values - means[window])[keep] ** 2)), noise_floor(values, window) ** 2
        if variance > 0.0:
            moves = variance > MOSTLY * noise
            excess = max(error - noise, 0.0) / (max(variance, MOSTLY * noise) - noise)
            (self.errors if moves else self.still)[name] = excess if np.isfinite(excess) else _WILD


def log_doubts(record: Record, plant: Plant, windows: Sequence[slice], settle: float = 0.0) -> tuple[Doubt, ...]:
    """The problems of the log itself; empty for a log that a vehicle of this kind can have produced.

    Each slip is undone in turn and the initial states and coefficients are fitted, the coefficients within `FACTOR` and
    without a change of sign.  Free runs are then compared with those of the record as declared, in the fitted half of
    the windows and in the other half.
    Values that no vehicle can have are doubted first, and without any fit.
    settle: s, left out at the start of each window, for logs that begin in the middle of a manoeuvre.
    """
    impossible = impossible_units(record, plant)
    if impossible is not None:
        return (Doubt(impossible.text, impossible.channels, np.inf, impossible.mend, impossible),)
    windows = windows or record.windows(plant.window)  # a log whose depth has the wrong sign has no window under water
    masks = [_excited(record, plant, part, settle) for part in held_out(plant, record, windows)]
    if not all(mask.any() for mask in masks):
        return ()
    fitted, judged = (record.select(mask) for mask in masks)
    paths = _free(plant)
    declared = _match(fitted, plant, paths)
    stray = declared.stray
    if not stray and all(e <= POOR for e in declared.errors.values()):
        return _scattered(record, plant)
    before = _match(judged, declared.plant)
    off = declared.telling(stray)
    suspects = [s for s in possible_slips(record, plant) if _concerned(s, plant, off) and _agreeing(s, record, plant)]
    ranked = _ranked(suspects, record, masks[0], plant, stray)
    likely = likely_slips(list(thruster_slips(record, plant)), record.select(masks[0]), plant)
    found = []
    for slip, changed in (*ranked, *((slip, undone(record, slip, plant)) for slip in likely)):
        here = _match(changed.select(masks[0]), plant, paths)
        there = _match(changed.select(masks[1]), here.plant)
        pairs = ((declared, here), (before, there))
        if slip.acts_on:
            pairs = tuple((one.within(slip.acts_on), other.within(slip.acts_on)) for one, other in pairs)
            (_, here), (_, there) = pairs
        gain = min(_gain(slip, plant, *pair) for pair in pairs)
        if gain >= SLIP_GAIN and max(here.total, there.total) <= SLIP_LEFT:
            noise = max(error for match in (here, there) for error in (0.0, *match.noise.values()))
            firm = not slip.scales or (noise <= CLEAN and not slip.weakens(plant))
            found.append(_Mended(there.total, _moved(plant, here.plant, paths), gain, slip, firm))
    if found:
        return (_doubt(found),)
    if min(declared.total, before.total) > FOREIGN:
        return (_foreign(plant, declared, before),)
    return _scattered(record, plant)


def _scattered(record: Record, plant: Plant) -> tuple[Doubt, ...]:
    """A doubt if an angle jumps at random from sample to sample, which a fit would take for a very noisy sensor."""
    names = tuple(
        n for n in ("heading_rad", "roll_rad") if n in plant.outputs and record.has(n) and is_folded(record, n)
    )
    if not names:
        return ()
    text = f"{listed([channel(n).label for n in names])} jumps at random from one sample to the next"
    mend = "check that each row has its own time, the unit, and that the samples are close enough to follow the turns"
    return (Doubt(text, names, np.inf, mend),)


@dataclass(frozen=True)
class _Mended:
    """A slip that explains a log: the error left, how far coefficients moved, and by how much the error falls."""

    left: float
    moved: float
    gain: float
    slip: Slip
    firm: bool


def _doubt(found: Sequence[_Mended]) -> Doubt:
    """The slip that leaves the smallest error; of nearly equal ones, the one that changes the vehicle least."""
    least = min(each.left for each in found)
    equal = [each for each in found if each.left <= 1.3 * least + 0.3 * FLOOR]
    first, *others = sorted(equal, key=lambda each: each.moved)
    slip = first.slip
    instead = tuple(other.slip.text for other in others)
    return Doubt(slip.text, slip.channels, first.gain, slip.mend, slip, instead, first.firm)


def _foreign(plant: Plant, *matches: Match) -> Doubt:
    names = [n for n in matches[0].errors if all(m.errors.get(n, 0.0) > BAD for m in matches)]
    signals = ", ".join(channel(n).label for n in names) or "its signals"
    text = (
        f"the log and the vehicle {plant.name} are far apart: no coefficients within a factor of {FACTOR:g} of its own "
        f"(or within the wider range that its file states) reproduce {signals}, and no single error of sign, unit, "
        "column or clock explains the difference"
    )
    mend = (
        "check that the log is of this vehicle, and the signs, units and columns of all channels; if they are right, "
        "the model lacks something large"
    )
    return Doubt(text, tuple(names), 1.0, mend)


def _free(plant: Plant) -> tuple[str, ...]:
    """The nonzero coefficients, which a fit may change by a factor."""
    return tuple(p for p in plant.coefficients if value_at(plant, p) != 0.0)


def _factor(plant: Plant, path: str) -> float:
    """The factor by which a coefficient may differ: `FACTOR`, or more if its stated deviation is large."""
    return max(FACTOR, 1.0 + REACH * plant.deviations.get(path, 0.0) / abs(value_at(plant, path)))


def _moved(given: Plant, fitted: Plant, paths: Sequence[str]) -> float:
    """The largest change of a coefficient by a fit, as a share (in logarithms) of the largest change allowed."""
    ratios = {p: max(value_at(fitted, p) / value_at(given, p), 1e-9) for p in paths}
    return max((abs(np.log(ratio)) / np.log(_factor(given, p)) for p, ratio in ratios.items()), default=0.0)


def _excited(record: Record, plant: Plant, windows: Sequence[slice], settle: float) -> np.ndarray:
    """A mask of the samples in those pieces of the windows in which the inputs move most; pieces never touch."""
    mask, pieces = np.zeros(len(record), dtype=bool), []
    if plant.family.shared:  # whole dives: each has an unknown state, which its pieces would not share
        for s in record.segments[:: max(len(record.segments) // DIVES, 1)]:
            inside = [w for w in windows if s.start <= w.start < s.stop]
            if inside:
                mask[inside[0].start : inside[-1].stop] = True
        return mask
    for w in windows:
        start = int(np.searchsorted(record.time[w], record.time[w.start] + settle)) + w.start
        # leave one sample out to keep adjacent pieces apart
        pieces += [slice(a, b - 1) for a, b in pairwise([*range(start, w.stop, ROWS), w.stop]) if b - a > 8]
    if not pieces or not any(record.has(name) for name in plant.family.required):
        return mask
    order = np.argsort(-excitation(record, plant.family.required, pieces), kind="stable")
    for k in order[:PIECES]:
        mask[pieces[k]] = True
    return mask


def _match(record: Record, plant: Plant, paths: Sequence[str] = (), iterations: int = 4) -> Match:
    """Compare free runs with the segments of a record, from fitted starts, with coefficients fitted within `FACTOR`."""
    if not _possible(record, plant):
        return Match(plant, {name: _WILD for name in (*plant.outputs, "depth_m", "pitch_rad") if record.has(name)})
    problem = Shooting(plant, record, record.segments)
    found, point = plant, problem.point(plant.vector, problem.first_guess)
    if np.isfinite(point.cost):
        with (
            suppress(np.linalg.LinAlgError),
            np.errstate(all="ignore"),
        ):  # a run close to divergence has sensitivities that are not finite
            found, point = _fitted(problem, plant, paths, iterations)
    match, known = Match(found), np.isfinite(point.cost)
    for c, name in enumerate(problem.channels):
        held, window = record.readings(name), problem.window_of_row  # filled-in values are less noisy
        if problem.counts[c] == 0 or not held.any():
            continue
        residual = point.residual[held, c]
        error = float(np.nanmean(residual**2)) if known else np.inf
        match.add(name, problem.signals[held, c], error, window[held])
        match.noise[name] = error / noise_floor(residual, window[held]) ** 2
    if "depth_m" not in plant.outputs:
        _sink(match, record, problem.window_of_row)
    return match


def _fitted(problem: Shooting, plant: Plant, paths: Sequence[str], iterations: int):
    point = problem.solve(plant, paths, max_iterations=iterations)
    found = problem.plant_at(point, paths)
    held = {}
    for path in paths:
        given, ratio = value_at(plant, path), value_at(found, path) / value_at(plant, path)
        factor = _factor(plant, path)
        if not 1.0 / factor <= ratio <= factor:
            low, high = spec_at(plant, path).bounds
            held[path] = float(np.clip(given * (factor if ratio > factor else 1.0 / factor), low, high))
    if held:
        rest = [p for p in paths if p not in held]
        point = problem.solve(replace_at(found, held), (), max_iterations=iterations)
        found = replace_at(problem.plant_at(point, rest), held)
    return found, point


def _sink(match: Match, record: Record, window: np.ndarray) -> None:
    """Add the error of depth, integrated from speed and pitch, for a plant without a depth output."""
    if not all(record.has(name) for name in ("depth_m", "pitch_rad", "u_mps")):
        return
    v, w, roll = (record[name] if record.has(name) else 0.0 for name in ("v_mps", "w_mps", "roll_rad"))
    _, _, rate = velocity_ned(record["u_mps"], v, w, roll, record["pitch_rad"], 0.0)
    total = 0.0
    for part in record.segments:
        steps = 0.5 * (rate[part][1:] + rate[part][:-1]) * np.diff(record.time[part])
        rest = record["depth_m"][part] - np.r_[0.0, np.cumsum(steps)]
        total += float(np.sum((rest - rest.mean()) ** 2))
    match.add("depth_m", record["depth_m"], total / len(record), window)


def _possible(record: Record, plant: Plant) -> bool:
    """Whether the angles, depth and speed are possible for a vehicle."""
    for name in ("pitch_rad", "rudder_rad", "stern_plane_rad", "bow_plane_rad"):
        if record.has(name) and np.quantile(np.abs(record[name]), 0.95) > STEEPEST:
            return False
    # beyond the vertical, roll winds up: it indicates an error only for a vehicle that stays clear of the vertical
    upright = not record.has("pitch_rad") or float(np.abs(record["pitch_rad"]).max()) < STEEP
    if upright and record.has("roll_rad") and np.quantile(np.abs(_less_turns(record["roll_rad"])), 0.95) > 2.0 * np.pi:
        return False
    below = not record.has("depth_m") or float(np.median(record["depth_m"])) > -1.0
    if not below or not record.has("u_mps"):
        return below
    speed = float(np.median(record["u_mps"]))
    # a vehicle held in place by thrusters drifts astern as often as ahead
    return -FASTEST < speed < FASTEST if "u_mps" in plant.family.driven else 0.0 < speed < FASTEST


def _less_turns(angle: np.ndarray) -> np.ndarray:
    """An angle minus the whole turns in its median: a glider may turn round at the surface before it dives."""
    return angle - 2.0 * np.pi * np.round(np.median(angle) / (2.0 * np.pi))


def _concerned(slip: Slip, plant: Plant, declared: Match) -> bool:
    """Whether a slip can have caused the errors: it acts on all signals, or on a sensor with a large error."""
    if _everywhere(slip, plant):
        return True
    poor = [declared.errors.get(name, 0.0) > POOR for name in slip.channels]
    return all(poor) if slip.exchanged else any(poor)


def _agreeing(slip: Slip, record: Record, plant: Plant) -> bool:
    """Whether undoing a slip leaves attitude and gyros in no worse agreement; checked if the attitude turns far.

    The error of such a run is a rotation, which is bounded, whatever factor an angle is multiplied by.
    """
    if set(slip.channels).isdisjoint((*ANGLES, *GYROS)) or not all(record.has(n) for n in (*ANGLES, *GYROS)):
        return True
    if not Chart.along(plant.family, record).on:
        return True
    return _disagreement(undone(record, slip, plant)) <= _disagreement(record)


def _disagreement(record: Record) -> float:
    """RMS difference over samples between turns of the measured attitude and turns by the gyros, rad."""
    rates, left = record.matrix(GYROS), []
    for part in record.segments:
        turned = turns(from_angles(*record.matrix(ANGLES)[part].T))
        left.append(turned - 0.5 * (rates[part][1:] + rates[part][:-1]) * np.diff(record.time[part])[:, None])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))


def _everywhere(slip: Slip, plant: Plant) -> bool:
    """Whether a slip acts on all signals (a slip of the clock or of an input), not only on its own sensors."""
    return slip.clock != 1.0 or not set(slip.channels).isdisjoint(plant.inputs)


def _ranked(
    suspects: Sequence[Slip], record: Record, mask: np.ndarray, plant: Plant, stray: Sequence[str]
) -> list[tuple[Slip, Record]]:
    """The most promising slips, each with the record corrected for it, by runs with the coefficients as given.

    The runs start from measured states, or from fitted ones if the vehicle has unknown states.  stray: signals that
    count even if they hardly move.
    """
    scores = []
    for number, slip in enumerate(suspects):
        changed = undone(record, slip, plant)
        part = changed.select(mask)
        if _possible(part, plant):
            here = _match(part, plant, iterations=3) if plant.family.shared else _glance(part, plant, stray)
            scores.append((here.telling(stray).total, number, slip, changed))
    return [(slip, changed) for *_, slip, changed in sorted(scores, key=lambda item: item[:2])[:SHORTLIST]]


def _glance(record: Record, plant: Plant, stray: Sequence[str]) -> Match:
    """A match without any fit: runs start from measured states; a constant error counts for stray signals only."""
    logged, names, chart = outputs_of(plant, record), plant.family.states, Chart.along(plant.family, record)
    signals = chart.signals(plant.outputs, logged, np.arange(len(record)))
    starts = np.zeros((1, len(record.segments), len(names)))
    for w, part in enumerate(record.segments):
        starts[0, w] = plant.initial(logged[part.start])[: len(names)]
        for rate, signal in RATES.items():
            if rate in names and not record.has(rate) and record.has(signal):
                head = slice(part.start, part.start + 4)
                angle = chart.on and signal in ANGLES
                values = signals[head, plant.outputs.index(signal)] if angle else record[signal][head]
                starts[0, w, names.index(rate)] = np.polyfit(record.time[head], values, 1)[0]
    starts[0] = chart.seen(starts[0], [part.start for part in record.segments])
    runs = Runs.over(plant, record, record.segments, chart)
    residual = chart.readings(plant.outputs, logged) - plant.run_many(runs, plant.vector[None], starts)[0]
    window = np.repeat(np.arange(len(record.segments)), [s.stop - s.start for s in record.segments])
    match = Match(plant)
    for c, name in enumerate(plant.outputs):
        if not record.has(name):
            continue
        held, still = record.readings(name), name in stray
        if np.isfinite(signals[held, c]).any():
            parts = [e for s in record.segments if (e := residual[s, c][held[s]]).size]
            error = float(np.mean([np.nanmean(e**2) if still else np.nanvar(e) for e in parts]))
            match.add(name, signals[held, c], error, window[held])
    if "depth_m" not in plant.outputs:
        _sink(match, record, window)
    return match


def _gain(slip: Slip, plant: Plant, before: Match, after: Match) -> float:
    """The factor by which the error falls: over all channels or, for a sensor's slip, in its own if they were bad.

    Only signals that move or are stray, before or after, count.  Infinite if none of the sensor's signals counts, so
    that nothing can be said; zero if the slip would leave a signal without any variation.
    """
    everywhere = _everywhere(slip, plant)
    told = {*before.errors, *after.errors, *before.stray, *after.stray}
    if not everywhere:
        told &= set(slip.channels)
    before, after = before.telling(told), after.telling(told)
    lost = {name for name, error in before.errors.items() if error != _WILD} - after.errors.keys()
    if lost:
        return 0.0
    whole = before.total / max(after.total, FLOOR)
    if everywhere:
        return whole
    own = [n for n in slip.channels if n in before.errors and n in after.errors]
    if after.total > before.total + FLOOR:
        return whole
    if not own:
        return np.inf
    worst, left = (max(match.errors[n] for n in own) for match in (before, after))
    return whole if worst < ALONE or left > BAD else max(whole, worst / max(left, FLOOR))
