"""The first step of a diagnosis: what a record can be used for, and what looks wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import check_count, check_number
from auv_gym.plant import Chart, Plant
from auv_gym.plant.record_check import FEW, check_excitation, check_ranges, described, needs_of
from auv_gym.records.record import Record
from identification.deciding import LEAST_WINDOWS, MOST_FOLLOWED, MOST_GROWTH, MOST_PARTS, SETTLE_SHARE
from identification.diagnosis.log.parts import Part, excerpts, parts_of, windows_of
from identification.diagnosis.log.plausibility import Doubt, log_doubts
from identification.fit.shooting import Shooting, unknown_states
from identification.fit.steps import readings_noise
from identification.fit.windows import LEAST_SAMPLES, free_run_windows

RECORD_LONGER = "record longer, give several logs of the vehicle, or diagnose with shorter windows (--window)."
_TOO_COARSE = "choose longer windows or a smaller --resample, and check that times are in seconds."
_SHORTER = (1.0, 0.8, 0.65, 0.5)  # shares of the vehicle's window, tried in turn for short records


@dataclass(frozen=True)
class Asked:
    """The arguments of `diagnose`, for calling it again."""

    window: float | None = None
    settle: float | None = None
    seed: int = 0
    most: int = 3
    doubt: float = 0.1
    trust: bool = False

    def __post_init__(self) -> None:
        if self.window is not None:
            check_number("window", self.window, "s", above=0.0)
        if self.settle is not None:
            check_number("settle", self.settle, "s", at_least=0.0)
        check_count("seed", self.seed, 0)
        check_count("most", self.most)
        check_number("doubt", self.doubt, "1", at_least=0.0)


@dataclass(frozen=True, eq=False)
class CheckedLog:
    """A record that a vehicle can be compared with, and how to compare it.

    parts: of the rows that are used.  windows: of the free runs in each part, at most `window` s long; the initial
    states are fitted to their first `settle` s.  steady: whether the windows can be as long as requested.
    doubts: problems of the log itself.  left_out: channels that cannot be predicted, since the velocities they depend
    on were not measured.
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
        """Whether a doubt is certain without a fit of effects."""
        return any(d.firm for d in self.doubts)

    def in_brief(self) -> CheckedLog:
        """The log with fits limited to one stretch of each part, if it is long; the windows still cover the whole log.

        A log whose segments each have an unknown state is left as it is: a short stretch would determine that state
        less well.
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
        """The log with free runs half as long; None if they would then have too few samples.

        For vehicles whose longer runs diverge, for example an unstable vehicle with inaccurate coefficients.
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
    """Check a record and prepare it for the diagnosis.

    Raises ValueError if it is too short, lacks a channel, or does not excite the vehicle.
    """
    check_ranges(plant, record, FEW)
    record = _often_read(described(plant, record), plant, asked.window or plant.window)
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
    """The reason why a record has too few windows for free runs; '' if it has enough."""
    try:
        record = described(plant, record)
        _checked_windows(record, plant, _usual_window(plant, record), 0.0)
    except ValueError as error:
        return str(error)
    return ""


def _often_read(record: Record, plant: Plant, window: float) -> Record:
    """The record without measurements that were not read for longer than a free run lasts, with a note on each.

    A position that is fixed at the surface only says little about the runs in between.
    """
    gaps = {name: record.longest_unread(name) for name in sorted(needs_of(plant).spare) if record.has(name)}
    seldom = {name: gap for name, gap in gaps.items() if gap > window}
    lines = [
        f"{name} is left out: it was not read for {gap:,.0f} s, longer than a free run." for name, gap in seldom.items()
    ]
    return record.without(seldom).with_notes([*record.notes, *lines]) if seldom else record


def _adrift(record: Record, plant: Plant) -> tuple[str, ...]:
    """The depth channel of a vehicle that loops, if its forward or lateral speed is unknown.

    While the vehicle is level, the depth depends on its vertical speed only; while it points up or down, on all three
    speeds.
    """
    channels = [name for name in plant.outputs if record.has(name)]
    unknown = plant.family.resting(channels) & {"u_mps", "v_mps"}
    if not unknown or not record.has("depth_m"):
        return ()
    return ("depth_m",) if Chart.along(plant.family, record).on else ()


def _usual_window(plant: Plant, record: Record) -> float:
    """The vehicle's window length, s; reduced to as little as half if the record has too few such windows."""
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
            + (_TOO_COARSE if window < 2.0 * record.sample_interval else RECORD_LONGER)
        )
    shortest = min(w.stop - w.start for w in windows)
    if shortest < LEAST_SAMPLES:
        raise ValueError(
            f"Samples are {record.sample_interval:g} s apart, so that a window of {window:g} s holds only {shortest}; "
            f"at least {LEAST_SAMPLES} are needed: {_TOO_COARSE}"
        )
    return windows


def noise_limited_length(plant: Plant, record: Record, seconds: float) -> float:
    """The length of free runs, s, up to which noise in the initial state does not dominate; at most the given length.

    The length is doubled from the shortest while noise in a measured initial state grows by less than `MOST_GROWTH` in
    every output.  If a vehicle is unstable in yaw, as many torpedoes are, its free runs say something about the model
    for a few seconds only.  The search goes from short to long, since long runs of a wrong model may end up in a region
    where it is stable.
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
    """The largest growth of noise in a measured initial state over a window, in units of the outputs' noise."""
    problem = Shooting(plant, record, free_run_windows(plant, record, seconds))
    noise, point = readings_noise(problem), problem.point(plant.vector, problem.first_guess)
    if not np.isfinite(point.cost):
        return np.inf
    grown = np.abs(problem.linearise(point, (), noise).starts).max(axis=(1, 2))
    states = [plant.family.states[i] for i in problem.start_states]
    own = np.array([noise[problem.channels.index(s)] if s in problem.channels else 0.0 for s in states])
    return float((grown * own).max(initial=0.0))
