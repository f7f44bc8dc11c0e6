"""How often the 95 % intervals of depth-averaged currents contain the truth, over simulated dives between GPS fixes.

    python -m scripts.studies.currents --seeds 40 --out currents

A seed is a mission of a `seaglider` in a current. Its drag, lift slope and volume differ from those of the model; all
three are fitted, as in a diagnosis that names a volume bias. The water moves up and down at random. The fixes, the
compass and the drift at the surface have the errors that `auv_gym.plant.currents` assumes. The time that the glider is
afloat is drawn.
"""

from __future__ import annotations

import sys
from math import radians
from typing import Any

import numpy as np
from scipy.signal import lfilter

from auv_gym.model import simulate
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.currents import dive_currents
from auv_gym.plant.flying import neutral_engine
from auv_gym.records.log import FIXES
from auv_gym.records.record import Record, concat
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.known import fit_known
from scripts.studies.harness import Found, Sheet, Study

CASES = {"three dives": (3, 10.0), "one dive": (1, 30.0)}  # number of dives, and s between samples
EPOCH, LATITUDE, LONGITUDE = 1.4e9, 47.0, -125.0
DEGREE = np.array([111175.0, 76057.0])  # m for a degree to the north and east at 47 deg north (tables of WGS 84)
OFF = 0.1  # relative deviation of drag and lift slope, as doubted by a diagnosis
VOLUME = 2e-5  # m^3, deviation of the volume bias
FIX, DRIFT, COMPASS = 5.0, 0.15, radians(2.0)  # m, m/s, rad: see `auv_gym.plant.currents`
AFLOAT = (60.0, 400.0)  # s, between a fix and a dive
CURRENT, NOISE = 0.15, 0.05  # m/s, deviation to either side; m, of the depth
HEAVE = 0.004, 120.0  # m/s and s, of random vertical motion of the water: the strongest of the blind dives
OFFSET = "effects.volume.offset"


def attempt(case: str, seed: int) -> dict[str, Any]:
    """Errors of the currents of a mission and their standard errors, m/s: (dives, north and east)."""
    rng, plant = np.random.default_rng(seed), load_vehicle("seaglider")
    coefficients = {p: value_at(plant, p) * (1.0 + OFF * rng.standard_normal()) for p in plant.coefficients}
    true = replace_at(plant, {**coefficients, OFFSET: VOLUME * rng.standard_normal()})
    dives, every = CASES[case]
    bias, current = COMPASS * rng.standard_normal(), CURRENT * rng.standard_normal((dives, 2))
    logs, begun = [], 0.0
    for own in current:
        logs.append(_dive(true, begun, every, own, bias, rng))
        begun = float(logs[-1].time[-1]) + 1000.0
    log = check_log(concat(logs), plant, Asked())
    known = fit_known(log, lambda fraction, text: None)
    bench = known.bench
    state = bench.fit(known.nominal.plant, (*known.nominal.paths, OFFSET), known.nominal)
    found = dive_currents(state.plant, log.record, bench.spread(state))
    alone = dive_currents(state.plant, log.record)
    return {
        "error": [[float(c.north - own[0]), float(c.east - own[1])] for c, own in zip(found, current, strict=True)],
        "standard": [[c.north_error, c.east_error] for c in found],
        "without_flight": [[c.north_error, c.east_error] for c in alone],
    }


def _dive(
    true: Plant, begun: float, every: float, current: np.ndarray, bias: float, rng: np.random.Generator
) -> Record:
    """A dive and a climb, logged at an interval of `every` s, with a fix before and one after."""
    time = np.arange(0.0, 9000.0, 10.0)
    bottom, nose, heading = rng.uniform(1600.0, 2400.0), rng.uniform(0.25, 0.5, 2), rng.uniform(0.0, 6.28)
    down = time < bottom
    net = rng.uniform(1e-4, 2e-4, 2)
    engine = neutral_engine(true, 100.0) + np.where(down, -net[0], net[1])
    wander = 0.02 * np.sin(time / 40.0 + heading)
    columns = {
        "buoyancy_volume_m3": engine,
        "pitch_rad": np.where(down, -nose[0], nose[1]) + wander,
        "heading_rad": heading + 5.0 * wander,
        "depth_m": np.full(time.size, 0.5),
    }
    moving = replace_at(true, dict(zip(("effects.current.north", "effects.current.east"), current, strict=True)))
    flown = simulate(moving, Record.from_arrays(time, columns))
    last = int(np.flatnonzero((flown["depth_m"] < 1.0) & ~down)[0])
    before, after = rng.uniform(*AFLOAT, 2)
    drift = current + DRIFT * rng.standard_normal(2)  # the wind is constant during a dive
    end = np.array([flown["north_m"][last], flown["east_m"][last]]) + after * drift
    places = (np.stack([-before * drift, end]) + FIX * rng.standard_normal((2, 2))) / DEGREE
    fixes = []
    for at, (north, east) in zip((begun - before, begun + time[last] + after), places, strict=True):
        fixes += [EPOCH + at, LATITUDE + north, LONGITUDE + east]
    own = slice(0, last + 1, round(every / 10.0))
    values = {name: column[own] for name, column in columns.items()}
    values["heading_rad"] = values["heading_rad"] + bias
    size, held = HEAVE[0], np.exp(-10.0 / HEAVE[1])
    pushed = lfilter([size * np.sqrt(1.0 - held**2)], [1.0, -held], rng.standard_normal(time.size))
    carried = np.where(flown["depth_m"] > 2.0, 10.0 * np.cumsum(pushed), 0.0)  # not at the surface
    values["depth_m"] = (flown["depth_m"] + carried + NOISE * rng.standard_normal(time.size)).clip(0.0)[own]
    attrs = {FIXES: fixes, "start_epoch_s": EPOCH}
    return Record.from_arrays(begun + time[own], values, attrs=attrs).with_labels([f"dive at {begun:.0f} s"])


def sheets(found: Found) -> list[Sheet]:
    """The share of intervals that hold, and the size of errors and standard errors."""
    rows = []
    for case in found.runs:
        errors, standard, alone = (
            np.concatenate([np.ravel(run[name]) for run in found.of(case)])
            for name in ("error", "standard", "without_flight")
        )
        sure = np.abs(errors) < 1.96 * standard
        rms = [1e3 * float(np.sqrt(np.mean(values**2))) for values in (errors, standard, alone)]
        rows.append([case, f"{sure.sum()} of {sure.size}", *(f"{value:.1f}" for value in rms)])
    heads = (
        "case", "95 % intervals that hold>", "error, RMS, mm/s>", "standard error>", "without that of the flight>",
    )  # fmt: skip
    return [Sheet("currents", "Depth-averaged currents of simulated dives", heads, rows)]


STUDY = Study(__doc__ or "", attempt, tuple(CASES), sheets, seeds=40, doing="missions")

if __name__ == "__main__":
    sys.exit(STUDY.main())
