"""The effect of a torpedo's stern plane in waves, by a fit with process noise and by a short-term regression.

    python -m scripts.studies.process_noise.measured LOG

LOG is one that the shipped mapping of the VT 690 reads. The fit estimates the coefficients (priors of 10 %), the fins'
offsets, the stern plane's gain, the pitch sensor's error and a steady current. It relies on a model of the vehicle over
the whole log. The regression relies on hardly any model: it predicts pitch from pitch and the stern plane's angle in
earlier rows, and gives the change of pitch within a second after a step, over that of the given vehicle. Past pitch
contains the waves as far as they can be predicted, and a controller cannot steer against the rest in advance. But if
pitch is logged later than the plane, the plane has already reacted to it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from auv_gym.param import value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import find_cruise, find_helm
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from identification.fit.greybox import GreyBox, GreyBoxFit
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.validation import whiteness

VEHICLE, LEAST_DEPTH, SAMPLE, DOUBT = "vt690", 1.5, 0.5, 0.1  # -, m, s, relative
GAIN = "effects.stern_plane.gain"
FREE = (
    GAIN,
    "effects.stern_plane.offset",
    "effects.rudder.offset",
    "effects.inclinometer.pitch_bias",
    "effects.current.north",
    "effects.current.east",
)
LEADS = (0.5, 0.7, 1.0)  # s
LATE = (0, 1, 2, 3)  # rows by which pitch may be logged later than the plane
MEMORY = 2.0  # s, of the regressors: about a period of the pitching
_BLOCK = 20.0  # s, length of resampled blocks
_DRAWS, _SEED = 400, 690
_STEP = 1e-3  # rad, of the stern plane of the given vehicle
PLANE, PITCH, FORWARD = "stern_plane_rad", "pitch_rad", "u_dvl_mps"
BESIDE = (FORWARD, "w_dvl_mps", "depth_m")


@dataclass(frozen=True)
class Short:
    """The early response to the stern plane, over that of the given vehicle, with 95 % intervals by lead.

    late: assumed delay of the logged pitch behind the plane, rows.  left: RMS of one-step errors, rad.
    first: the coefficient of the latest angle over its standard error, positive if it acts like the plane.
    """

    late: int
    left: float
    first: float
    shares: dict[float, tuple[float, float, float]]


def fitted(record: Record, plant: Plant) -> GreyBoxFit:
    """The fit with process noise of a record as it was logged."""
    thin = record.resample(SAMPLE)
    return GreyBox(replace(plant, dt=SAMPLE), (*FREE, *plant.coefficients), doubt=DOUBT).fit(thin)


def short_leads(record: Record, plant: Plant, late: int) -> Short:
    """The response of pitch to the stern plane by a regression of each row on earlier ones (ARX, Ljung 1999, sec. 4.2).

    late: rows by which the log's pitch is behind its plane; the plane's last `late` angles are left out.  Intervals are
    those of resampled blocks (Efron and Tibshirani 1993, ch. 8).
    """
    step, speed = record.sample_interval, find_cruise(plant).speed
    memory, block = round(MEMORY / step), round(_BLOCK / step)
    normals, pulls, squares = [], [], 0.0
    for segment in record.segments:
        pitch, beside = record[PITCH][segment], [record[name][segment] for name in BESIDE]
        plane = record[PLANE][segment] * (beside[0] / speed) ** 2
        rows = np.arange(memory + late, len(pitch) - 1)
        past = rows[:, None] - np.arange(memory)
        told = np.column_stack([pitch[past], plane[past - late], np.ones(rows.size), *(b[rows] for b in beside)])
        fine = np.isfinite(told).all(axis=1) & np.isfinite(pitch[rows + 1])
        for first in range(0, rows.size, block):
            own = np.flatnonzero(fine[first : first + block]) + first
            normals.append(told[own].T @ told[own])
            pulls.append(told[own].T @ pitch[rows[own] + 1])
            squares += float((pitch[rows[own] + 1] ** 2).sum())
    every, right = np.array(normals), np.array(pulls)
    given = {lead: _given(plant, lead) for lead in LEADS}
    counts = np.random.default_rng(_SEED).multinomial(len(every), np.full(len(every), 1.0 / len(every)), size=_DRAWS)
    found = np.array([np.linalg.solve(np.tensordot(c, every, 1), c @ right) for c in (np.ones(len(every)), *counts)])
    shares = {}
    for lead, own in given.items():
        some = np.array([_stepped(one, memory, round(lead / step)) for one in found]) / own
        shares[lead] = (float(some[0]), *(float(v) for v in np.quantile(some[1:], (0.025, 0.975))))
    count = float(every[:, 2 * memory, 2 * memory].sum())  # entry of the constant
    left = np.sqrt(max(squares - float(found[0] @ right.sum(axis=0)), 0.0) / count)
    return Short(late, float(left), float(found[0, memory] / np.std(found[1:, memory])), shares)


def _stepped(coefficients: np.ndarray, memory: int, rows: int) -> float:
    """The pitch of a regression `rows` rows after a step of its plane by 1 rad."""
    own, felt = coefficients[:memory], np.cumsum(coefficients[memory : 2 * memory])
    pitch = np.zeros(memory + rows)
    for k in range(rows):
        pitch[memory + k] = own @ pitch[k : memory + k][::-1] + felt[min(k, memory - 1)]
    return float(pitch[-1])


def _given(plant: Plant, lead: float) -> float:
    """Change of the vehicle's pitch within a lead per angle of its stern plane, from level flight."""
    cruise, plane = find_cruise(plant), find_helm(plant).plane
    plant = replace(plant, dt=lead)
    found = []
    for side in (-1.0, 1.0):
        commands = cruise.commands.copy()
        commands[plane] += side * _STEP
        level = dict(zip(plant.family.states, cruise.state.tolist(), strict=False))
        x = plant.initial(np.array([level.get(name, 0.0) for name in plant.outputs]))
        found.append(plant.output(plant.step(x, commands))[plant.outputs.index(PITCH)])
    return float(found[1] - found[0]) / (2.0 * _STEP)


def coloured(fit: GreyBoxFit) -> dict[str, float]:
    """Correlation of prediction errors from one sample to the next, by channel."""
    problem = PredictionErrors(fit.model, fit.record, fit.windows).with_noises_of(fit.noise)
    point = problem.point(fit.model.vector, problem.logs_of(fit.noise))
    stretches = problem.stretch_of_row
    return {
        name: float(whiteness(point.errors[:, c], stretches).correlation[0]) for c, name in enumerate(problem.channels)
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print both estimates, the process noise, and the correlation of prediction errors from sample to sample."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("log", help="a log of the VT 690")
    log = parser.parse_args(arguments).log
    plant = load_vehicle(VEHICLE)
    record = read_record(log)
    record = record.select(record["depth_m"] > LEAST_DEPTH)
    for late in LATE:
        said = short_leads(record, plant, late)
        print(
            f"pitch {late} rows late: one-step errors {degrees(said.left):.4f} deg, "
            f"latest angle at {said.first:.1f} standard errors"
        )
        for lead, (share, low, high) in said.shares.items():
            print(
                f"  within {lead:g} s: the stern plane turns it by {share:.2f} of the given ({low:.2f} to {high:.2f})"
            )
    fit = fitted(record, plant)
    moment = "parts.stern_plane.moment"
    share = fit[GAIN].value * fit[moment].value / value_at(plant, moment)
    print(f"with process noise: {share:.2f} of the given, gain times moment")
    for one in fit.estimates:
        factor, unit = (degrees(1.0), "deg") if one.unit == "rad" else (1.0, one.unit)
        low, high = (factor * end for end in one.ci95)
        print(f"  {one.path}: {factor * one.value:.4g} {unit} ({low:.4g} to {high:.4g})")
    for name, (size, tau) in fit.noise.process.items():
        print(f"  acceleration of {name}: {size:.3g} over {tau:.0f} s")
    for period, pushes in fit.noise.swell.items():
        for name, (size, tau) in pushes.items():
            print(f"  waves of {period:.1f} s push {name}: {size:.3g}, in phase for {tau:.0f} s")
    for period, errors in fit.noise.lasting.items():
        told = f" with a period of {period:.1f} s" if period else ""
        for name, (size, tau) in errors.items():
            print(f"  errors of {name} that last{told}: {size:.3g} over {tau:.0f} s")
    for name, value in coloured(fit).items():
        print(f"  prediction errors of {name}: correlation from sample to sample {value:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
