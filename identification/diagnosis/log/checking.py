"""First step of a diagnosis: what a record can be asked, and what looks wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from auv_gym.plant import Chart, Plant
from auv_gym.plant.record_check import FEW, check_excitation, check_ranges, described
from auv_gym.records.record import Record
from identification.deciding import LEAST_WINDOWS, MOST_FOLLOWED, MOST_GROWTH, MOST_PARTS, SETTLE_SHARE
from identification.diagnosis.log.parts import Part, excerpts, parts_of, windows_of
from identification.diagnosis.log.plausibility import Doubt, log_doubts
from identification.fit.shooting import Shooting, unknown_states
from identification.fit.steps import readings_noise
from identification.fit.windows import LEAST_SAMPLES, free_run_windows

RECORD_LONGER = "record longer, give several logs of the vehicle, or diagnose with shorter windows (--window)."
_SHORTER = (1.0, 0.8, 0.65, 0.5)  # of the vehicle's window, tried in turn in short records


@dataclass(frozen=True)
class Asked:
    """How `diagnose` was called: what it takes to call it again."""

    window: float | None = None
    settle: float | None = None
    seed: int = 0
    most: int = 3
    doubt: float = 0.1
    trust: bool = False


@dataclass(frozen=True, eq=False)
class CheckedLog:
    """A record that a vehicle can be compared with, and how.

    parts: of the rows that are used.  windows: of free runs in each part, at most `window` s long, of which the first
    `settle` s tell the initial states.  steady: whether they may last as long as was asked.
    doubts: what is wrong with the log itself.  left_out: channels that nothing can foretell, since the speeds that move
    them were not measured.
    """

    record: Record
    plant: Plant
    asked: Asked
    parts: tuple[Part, ...]
    windows: tuple[Part, ...]
    window: float
    settle: float
    steady: bool
    doubts: tuple[Doubt, ...]
    left_out: tuple[str, ...] = ()

    @property
    def every_window(self) -> Part:
        """The windows of all parts, in the order of the record."""
        return tuple(sorted((w for part in self.windows for w in part), key=lambda w: w.start))

    @property
    def slipped(self) -> bool:
        """Whether the log looks mislabelled."""
        return any(d.slip is not None for d in self.doubts)

    @property
    def firm(self) -> bool:
        """Whether a doubt needs no model to be sure."""
        return any(d.firm for d in self.doubts)

    def in_brief(self) -> CheckedLog:
        """The log, of which fits count one stretch of each part if it is long; windows are those of the whole log.

        Not where each segment has an unknown of its own, which a stretch of it would tell less well.
        """
        states, samples = len(self.plant.family.states), sum(p.stop - p.start for part in self.parts for p in part)
        if samples * states <= MOST_FOLLOWED or unknown_states(self.plant):
            return self
        each = MOST_FOLLOWED // (states * len(self.parts))
        parts = excerpts(self.record, self.parts, self.plant.family.required, each)
        share = sum(p.stop - p.start for part in parts for p in part) / samples
        line = (
            f"The log is long: the fits count {100.0 * share:.0f} % of it, from each of its {len(parts)} parts the "
            "stretch in which the commands move most. Free runs are compared with all of it."
        )
        return replace(self, record=self.record.with_notes([*self.record.notes, line]), parts=parts)

    def in_shorter_windows(self) -> CheckedLog | None:
        """The log with free runs half as long, None where these would hold too few samples.

        For vehicles that run away in longer ones, as one that is unstable does with coefficients that it was not given.
        """
        window = 0.5 * self.window
        windows = tuple(windows_of(self.record, part, window) for part in self.parts)
        if not all(own and min(w.stop - w.start for w in own) >= LEAST_SAMPLES for own in windows):
            return None
        line = f"Free runs over {self.window:g} s diverge: they are {window:g} s long instead."
        settle = min(self.settle, SETTLE_SHARE * window)
        record = self.record.with_notes([*self.record.notes, line])
        return replace(self, record=record, windows=windows, window=window, settle=settle)


def check_log(record: Record, plant: Plant, asked: Asked) -> CheckedLog:
    """The record as it can be used.

    Raises ValueError if it is too short, lacks a channel, or does not excite the vehicle.
    """
    check_ranges(plant, record, FEW)
    record = described(plant, record)
    left_out = _adrift(record, plant)
    record = record.without(left_out)
    window, settle = asked.window or _usual_window(plant, record), asked.settle
    if settle is None:
        settle = plant.settle if window >= plant.window else min(plant.settle, SETTLE_SHARE * window)
    windows = _checked_windows(record, plant, window, settle)
    count = int(np.clip(len(windows), LEAST_WINDOWS, MOST_PARTS))
    calm = noise_limited_length(plant, record, window)
    if not (steady := calm >= window):
        window, settle = calm, min(settle, SETTLE_SHARE * calm)
        windows = _checked_windows(record, plant, window, settle)
    doubts = () if asked.trust else log_doubts(record, plant, windows, settle)
    parts = parts_of(plant, record, count)
    runs = [(part, windows_of(record, part, window)) for part in parts]
    kept = [(part, own) for part, own in runs if own]
    parts, scored = tuple(part for part, _ in kept), tuple(own for _, own in kept)
    return CheckedLog(record, plant, asked, parts, scored, window, settle, steady, doubts, left_out)


def too_short(record: Record, plant: Plant) -> str:
    """Why a record has too few windows to be compared with free runs; '' where it has enough."""
    try:
        record = described(plant, record)
        _checked_windows(record, plant, _usual_window(plant, record), 0.0)
    except ValueError as error:
        return str(error)
    return ""


def _adrift(record: Record, plant: Plant) -> tuple[str, ...]:
    """The depth of a vehicle that loops, where nothing tells its speed forward and to starboard.

    While it is level, its speed down alone makes the depth; pointing up or down, each of its speeds does.
    """
    channels = [name for name in plant.outputs if record.has(name)]
    unknown = plant.family.resting(channels) & {"u_mps", "v_mps"}
    if not unknown or not record.has("depth_m"):
        return ()
    return ("depth_m",) if Chart.along(plant.family, record).on else ()


def _usual_window(plant: Plant, record: Record) -> float:
    """The vehicle's length of a window, s, or down to half of it where the record has too few of these."""
    for share in _SHORTER:
        windows = free_run_windows(plant, record, share * plant.window)
        if len(windows) >= LEAST_WINDOWS and min(w.stop - w.start for w in windows) >= LEAST_SAMPLES:
            return share * plant.window
    return plant.window


def _checked_windows(record: Record, plant: Plant, window: float, settle: float) -> list[slice]:
    check_excitation(plant, record)
    if not settle < 0.5 * window:
        raise ValueError(f"The settling time must be less than half a window of {window:g} s, got {settle:g} s.")
    windows = free_run_windows(plant, record, window)
    if len(windows) < LEAST_WINDOWS:
        longest = max(float(np.ptp(record.time[s])) for s in record.segments)
        shorter = f", or of {_SHORTER[-1] * window:g} s in a short log" if window == plant.window else ""
        raise ValueError(
            f"A diagnosis needs at least {LEAST_WINDOWS} windows of {window:g} s{shorter}, without a gap; "
            f"got {len(windows)} (longest stretch {longest:.0f} s, samples {record.sample_interval:g} s apart): "
            + (
                "choose longer windows, and check that times are in seconds."
                if window < 2.0 * record.sample_interval
                else RECORD_LONGER
            )
        )
    shortest = min(w.stop - w.start for w in windows)
    if shortest < LEAST_SAMPLES:
        raise ValueError(
            f"Samples are {record.sample_interval:g} s apart, so that a window of {window:g} s holds only {shortest}; "
            f"at least {LEAST_SAMPLES} are needed: check that times are in seconds, or choose longer windows."
        )
    return windows


def noise_limited_length(plant: Plant, record: Record, seconds: float) -> float:
    """Seconds that free runs may last before the noise of their first reading decides them: at most those given.

    Doubled from the shortest while noise in a measured state grows by less than `MOST_GROWTH` on its way to any output.
    A vehicle that is unstable in yaw, as many torpedoes are, tells of its model for a few seconds only.  From short to
    long, since long runs of a wrong model leave the record for where it may be stable.
    """
    lengths = [seconds]
    while True:
        windows = free_run_windows(plant, record, lengths[-1] / 2.0)
        if not windows or min(w.stop - w.start for w in windows) < 2 * LEAST_SAMPLES:
            break
        lengths.append(lengths[-1] / 2.0)
    calm = lengths.pop()
    while lengths and _growth(plant, record, lengths[-1]) < MOST_GROWTH:
        calm = lengths.pop()
    return calm


def _growth(plant: Plant, record: Record, seconds: float) -> float:
    """By how much noise in a measured state at the start of a window grows, in noises of the outputs."""
    problem = Shooting(plant, record, free_run_windows(plant, record, seconds))
    noise, point = readings_noise(problem), problem.point(plant.vector, problem.first_guess)
    if not np.isfinite(point.cost):
        return np.inf
    grown = np.abs(problem.linearise(point, (), noise).starts).max(axis=(1, 2))
    states = [plant.family.states[i] for i in problem.start_states]
    own = np.array([noise[problem.channels.index(s)] if s in problem.channels else 0.0 for s in states])
    return float((grown * own).max(initial=0.0))
