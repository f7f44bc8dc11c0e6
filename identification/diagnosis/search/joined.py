"""One-step errors of a vehicle over windows joined end to end, for vehicles whose free runs must be short.

A free run of an unstable vehicle says nothing after a few seconds, and in a few seconds the fitted start explains most
of what a slow cause does. A filter without process noise goes on from one short window into the next: its errors are
white with the measurement noise if the vehicle is right, whatever the vehicle's stability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.disturbed import along, filtered
from identification.fit.residual import noise_floor
from identification.fit.shooting import Shooting

PASSES = 4  # linearisations, each about the parameters and states that the one before found
SETTLED = 3.0  # standard errors: a change of the parameters over which errors are linear


@dataclass(frozen=True, eq=False)
class Joined:
    """One-step errors over their expected deviations, (rows, C), NaN where nothing was measured.

    window: (rows,), which joined window each row is in.
    """

    errors: np.ndarray
    window: np.ndarray


def joined_errors(
    plant: Plant, record: Record, windows: Sequence[slice], paths: Sequence[str], seconds: float
) -> Joined | None:
    """One-step errors over windows joined to at most `seconds`, the paths at their best; None where these diverge.

    windows: short ones, in which free runs hold.  The first `seconds` of each segment are left out: where the
    actuators stood before the log began is not known, and a slow propeller's way from there is no error of the model.
    """
    long = joined_windows(record, windows, seconds)
    covered = [w for w in windows if any(whole.start <= w.start < whole.stop for whole in long)]
    if not long:
        return None
    short, problem = Shooting(plant, record, covered), Shooting(plant, record, long)
    point = short.solve(plant, ())
    if not np.isfinite(point.cost):
        return None
    noise = np.array([noise_floor(e, short.window_of_row) for e in point.residual.T])[None]
    states, still = short.start_states, np.zeros((1, short.start_states.size))
    starts = point.starts[np.isin([w.start for w in covered], [w.start for w in long])]
    reference, found = along(short, plant, states, point.starts, None, ())[1], None
    for _ in range(PASSES):
        path, _ = along(problem, plant, states, starts, reference, paths)
        try:
            result = filtered(path, noise**2, still)
        except np.linalg.LinAlgError:
            break
        if not np.isfinite(result.profile[0]):
            break
        found = Joined(result.innovations[0], problem.window_of_row)
        change, deviation = result.change[0], np.sqrt(np.maximum(np.diag(result.covariance[0]), 0.0))
        if np.all(np.abs(change) <= SETTLED * deviation):
            break
        values = {}
        for p, size in zip(paths, change.tolist(), strict=True):
            low, high = problem.bounds(p)
            values[p] = min(max(value_at(plant, p) + size * problem.scale(p), low), high)
        plant, reference = replace_at(plant, values), reference + result.states[0]
    return found


def joined_windows(record: Record, windows: Sequence[slice], seconds: float) -> list[slice]:
    """Neighbouring windows as one, up to a length in s; without those that begin so soon in their segment."""
    begins = np.array([segment.start for segment in record.segments])
    found: list[slice] = []
    for w in windows:
        begin = begins[np.searchsorted(begins, w.start, side="right") - 1]
        if record.time[w.start] - record.time[begin] < seconds:
            continue
        last = found[-1] if found else None
        if last and last.stop == w.start and record.time[w.stop - 1] - record.time[last.start] <= seconds:
            found[-1] = slice(last.start, w.stop)
        else:
            found.append(w)
    return found
