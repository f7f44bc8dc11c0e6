"""A plant linearised along a path of states, and the Kalman filters of that for several noises at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from identification.fit.shooting import Shooting

_PROBE = 1e-4  # change of a state, rad, m or m/s, for its derivatives
_SMALL = 1e-6  # m^3 and the like: of states whose unit is far larger than they are
_DIFFUSE = 3.0  # how many times what a state varies by its start may be off
_LEAST = 30.0  # the same in measurement deviations


@dataclass(frozen=True, eq=False)
class Path:
    """The plant about a reference, row by row.

    next = after + a (x - reference) + b p;  y = output + c (x - reference) + d p, with p the parameters' changes in
    units of their scales.
    reference, after: (rows, F).  a: (rows, F, F).  b: (rows, F, P).  error: (rows, C), measured less output, 0 where
    nothing was measured.  c: (rows, C, F).  d: (rows, C, P).  finite: (rows, C).  first: (rows,), where windows begin.
    durations: (rows,), s, to the next row.
    """

    reference: np.ndarray
    after: np.ndarray
    a: np.ndarray
    b: np.ndarray
    error: np.ndarray
    c: np.ndarray
    d: np.ndarray
    finite: np.ndarray
    first: np.ndarray
    durations: np.ndarray


@dataclass(frozen=True, eq=False)
class Filtered:
    """What filters with S noises found.

    profile: (S,), log-likelihood with the parameters at their best.  change: (S, P), how far that is from the path's,
    in scales; covariance: (S, P, P).  states: (S, rows, F), filtered, less the reference.  innovations: (S, rows, C),
    over their deviations, NaN where nothing was measured.
    """

    profile: np.ndarray
    change: np.ndarray
    covariance: np.ndarray
    states: np.ndarray
    innovations: np.ndarray


def along(
    problem: Shooting,
    plant: Plant,
    states: np.ndarray,
    starts: np.ndarray,
    reference: np.ndarray | None,
    paths: Sequence[str],
) -> tuple[Path, np.ndarray]:
    """The plant linearised along the reference, (rows, F), and the reference; None is the free run from the starts.

    Actuators and sensors keep their own memory along the way: what was commanded before a window, in its segment,
    counts.
    """
    rows, count, channels = problem.runs.rows, states.size, len(problem.channels)
    steps, others = _moved(problem, plant, paths)
    used = np.empty((rows, count)) if reference is None else reference
    after, a, b = np.zeros((rows, count)), np.zeros((rows, count, count)), np.zeros((rows, count, len(paths)))
    output, c, d = np.zeros((rows, channels)), np.zeros((rows, channels, count)), np.zeros((rows, channels, len(paths)))
    durations, first = np.zeros(rows), np.zeros(rows, dtype=bool)
    first[problem.offsets] = True
    probes = np.array([_SMALL if plant.family.states[s].endswith("m3") else _PROBE for s in states])
    runs, time, size = problem.runs, problem.record.time, len(plant.family.states)
    for w, window in enumerate(problem.windows):
        begin = int(runs.first[window.start])
        full = [_begun(model, starts[w], runs, time, begin, window.start) for model in (plant, *others)]
        for k in range(window.start, window.stop):
            row = int(problem.offsets[w]) + k - window.start
            if k == window.start and reference is None:
                used[row] = starts[w, states]
            for x in full:
                x[:size] = full[0][:size]  # what is not filtered goes on as the plant has it
                x[states] = used[row]
            last = k + 1 == window.stop
            duration = plant.dt if last else float(time[k + 1] - time[k])
            durations[row] = duration
            y = plant.output(full[0])[problem.columns]
            ahead = plant.step_over(full[0], runs.inputs[k], duration)
            output[row], after[row] = y, ahead[states]
            for j, (index, probe) in enumerate(zip(states, probes, strict=True)):
                x = full[0].copy()
                x[index] += probe
                c[row, :, j] = (plant.output(x)[problem.columns] - y) / probe
                a[row, :, j] = (plant.step_over(x, runs.inputs[k], duration)[states] - after[row]) / probe
            for j, (model, step) in enumerate(zip(others, steps, strict=True)):
                d[row, :, j] = (model.output(full[1 + j])[problem.columns] - y) / step
                full[1 + j] = model.step_over(full[1 + j], runs.inputs[k], duration)
                b[row, :, j] = (full[1 + j][states] - after[row]) / step
            full[0] = ahead
            if reference is None and not last:
                used[row + 1] = after[row]
    error = np.where(problem.finite, problem.measured - output, 0.0)
    turns = np.round(error[problem.offsets] / (2.0 * np.pi)) * problem.angles
    error = np.where(problem.finite, error - 2.0 * np.pi * turns[problem.window_of_row], 0.0)
    return Path(used, after, a, b, error, c, d, problem.finite, first, durations), used


def filtered(path: Path, measurement: np.ndarray, process: np.ndarray) -> Filtered:
    """Kalman filters along a path for variances of the channels (S, C) and of the states' random walks, per s, (S, F).

    The parameters' sensitivities go through the same gains, so that their best values follow in closed form.
    Source: Harvey 1989, Forecasting, Structural Time Series Models and the Kalman Filter, sec. 3.4.
    """
    rows, count, channels = path.after.shape[0], path.after.shape[1], path.error.shape[1]
    number, paths = measurement.shape[0], path.b.shape[2]
    eye, blank = np.eye(count), np.zeros((number, count, 1 + paths))
    spread = _DIFFUSE * np.std(path.reference, axis=0)
    least = _LEAST * np.sqrt(np.median(measurement))
    wide = np.diag(np.maximum(spread, np.minimum(least, 1.0) * (spread > 0.0) + 1e-6 * (spread == 0.0)) ** 2)
    noise, drive = measurement[:, :, None] * np.eye(channels), process[:, :, None] * np.eye(count)
    normal = np.zeros((number, 1 + paths, 1 + paths))
    logs, states = np.zeros(number), np.zeros((number, rows, count))
    sensitivities = np.zeros((number, rows, count, paths))
    errors, weights = np.zeros((number, rows, channels, 1 + paths)), np.zeros((number, rows, channels))
    mean, spread_now = blank, np.broadcast_to(wide, (number, count, count))
    for k in range(rows):
        if path.first[k]:
            mean, spread_now = blank, np.broadcast_to(wide, (number, count, count))
        else:
            a = path.a[k - 1]
            mean = a @ mean
            mean[:, :, 0] += path.after[k - 1] - path.reference[k]
            mean[:, :, 1:] += path.b[k - 1]
            spread_now = a @ spread_now @ a.T + path.durations[k - 1] * drive
        seen = path.finite[k]
        if seen.any():
            c = path.c[k][seen]
            error = -(c @ mean)
            error[:, :, 0] += path.error[k][seen]
            error[:, :, 1:] -= path.d[k][seen]
            r = noise[:, seen][:, :, seen]
            cross = spread_now @ c.T
            own = c @ cross + r
            inverse = np.linalg.inv(own)
            gain = cross @ inverse
            normal += error.transpose(0, 2, 1) @ inverse @ error
            logs -= 0.5 * (np.linalg.slogdet(own)[1] + seen.sum() * np.log(2.0 * np.pi))
            mean = mean + gain @ error
            kept = eye - gain @ c
            spread_now = kept @ spread_now @ kept.transpose(0, 2, 1) + gain @ r @ gain.transpose(0, 2, 1)
            errors[:, k, seen], weights[:, k, seen] = error, 1.0 / np.sqrt(np.einsum("sii->si", own))
        states[:, k], sensitivities[:, k] = mean[:, :, 0], mean[:, :, 1:]
    change, covariance = np.zeros((number, paths)), np.zeros((number, paths, paths))
    if paths:
        covariance = np.linalg.pinv(normal[:, 1:, 1:], rcond=1e-12, hermitian=True)
        change = -(covariance @ normal[:, 1:, :1])[:, :, 0]
    profile = logs - 0.5 * (normal[:, 0, 0] + np.einsum("sp,sp->s", change, normal[:, 1:, 0]))
    left = errors[..., 0] + np.einsum("srcp,sp->src", errors[..., 1:], change)
    innovations = np.where(path.finite, left * weights, np.nan)
    return Filtered(
        np.where(np.isfinite(profile), profile, -np.inf),
        change,
        covariance,
        states + np.einsum("srfp,sp->srf", sensitivities, change),
        innovations,
    )


def _moved(problem: Shooting, plant: Plant, paths: Sequence[str]) -> tuple[list[float], list[Plant]]:
    """By how many scales each parameter is moved for its derivatives, into its bounds, and the plants with that."""
    steps, plants = [], []
    for path in paths:
        step, scale = problem.steps[0], problem.scale(path)
        if value_at(plant, path) + step * scale > spec_at(plant, path).bounds[1]:
            step = -step
        steps.append(step)
        plants.append(replace_at(plant, path, value_at(plant, path) + step * scale))
    return steps, plants


def _begun(model: Plant, start: np.ndarray, runs, time: np.ndarray, begin: int, at: int) -> np.ndarray:
    """The full state of a plant at a window's start, its actuators and sensors as the segment's commands left them."""
    size = len(model.family.states)
    x = model.initial(np.full(len(model.outputs), np.nan))
    x[:size] = start
    model.programs.settle(x, model.derived)
    for k in range(begin, at):
        x = model.step_over(x, runs.inputs[k], float(time[k + 1] - time[k]))
        x[:size] = start
    return x
