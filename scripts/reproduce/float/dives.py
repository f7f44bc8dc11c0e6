"""The dives of a simulated float, the compared methods, and the errors of their free runs."""

from __future__ import annotations

from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from auv_gym.model import Diverged, Model, simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.float_dives import depth_control
from identification.fit.greybox import GreyBox
from identification.fit.validation import score
from identification.kernel_machines.ls_svm import LsSvm
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.ivls import Ivls
from identification.recursive.refined_iv import RefinedIv
from identification.recursive.rwls import Rwls
from scripts.reproduce.float.consistency import VARIANTS, break_down

VEHICLE = "qiandao_float"
DEPTHS = (30, 40, 50, 60)  # m
TRAINING = 40  # m, depth of the dive that is fitted
RATES = {"dt": 1.0 / 1.43, "near": (0.8, 1.0 / 2.78)}  # s; closer where within 0.8 m of the target
START = 1.0  # m; at the surface the waterplane carries the float, which equation (5) leaves out
SURFACED = 0.5  # m; the fitted dive ends there
AT_REST = 5.0  # s over which the initial depth of a free run is read
# a first guess that is wrong by a third or more, as a test for the grey box
GUESS = {"hull.drag_quadratic": 20.0, "hull.drag_linear": 3.0, "hull.piston_area": 1.5e-3}
FREE = (*GUESS, "effects.volume.offset")
WINDOW = 300.0  # s; the simulated float has no process noise, so long windows lose nothing
MEASURES = ("AVGAE", "RMSE", "R2", "MAXAE", "RMSE, true depth")
RMSE, R2, TRUE_RMSE = (MEASURES.index(name) for name in ("RMSE", "R2", "RMSE, true depth"))
NO_RUN = (inf, inf, -inf, inf, inf)  # for a failed fit, or a run that leaves the finite numbers
PRINTED, CORRECTED, REFINED, GREY_BOX = "IVLS as printed", "IVLS corrected", "refined IV", "grey box"
RWLS, RWLS_OF_ONE, LS_SVM = "RWLS as printed", "RWLS, theta_1 = 1", "LS-SVM"
METHODS = (RWLS, RWLS_OF_ONE, LS_SVM, PRINTED, CORRECTED, REFINED, GREY_BOX)


class Dive(NamedTuple):
    """A recorded dive, and the true depth of the float, m."""

    record: Record
    true_depth: np.ndarray


def compared(seed: int, noise: float) -> dict[str, Any]:
    """The dives of one noise seed, fitted and run by every method.

    outcomes: by method MEASURES at each of DEPTHS, (4, 5), its parameters, and the reason of a failure.  breakdowns: of
    each variant of the printed IVLS.
    """
    dives = [dive(depth, seed, noise) for depth in DEPTHS]
    training = dives[DEPTHS.index(TRAINING)].record
    outcomes = {}
    for name, method in methods().items():
        try:
            fit = method.fit(training)
        except ValueError as error:
            outcomes[name] = {"errors": [NO_RUN] * len(DEPTHS), "estimates": [], "problem": str(error)}
            continue
        errors = [measures(fit.model, d) for d in dives]
        outcomes[name] = {"errors": errors, "estimates": fit.estimates, "problem": ""}
    known = {"least squares": methods()[RWLS_OF_ONE], "corrected": methods()[CORRECTED]}
    starts = {name: method.fit(training).theta for name, method in known.items()}
    last = dives[-1]
    breakdowns = [
        break_down(variant, starts, training, lambda model: measures(model, last)[RMSE]) for variant in VARIANTS
    ]
    return {"outcomes": outcomes, "breakdowns": [found._asdict() for found in breakdowns]}


def dive(depth: int, seed: int, noise: float) -> Dive:
    """The dive to a depth, m; the fitted one also returns to 0 m, up to where it comes near the surface."""
    plant, rng = load_vehicle(VEHICLE), np.random.default_rng([seed, depth])
    there = 600.0 + 5.0 * (depth - DEPTHS[0])  # s: 300 to 450 to arrive, the rest to settle
    targets, hold = ([depth, 0.0], [there, there]) if depth == TRAINING else ([depth], [there])
    record = depth_control(plant, targets, rng=rng, hold=hold, noise=noise, start=START, **RATES)
    surfaced = np.flatnonzero((record.time > there) & (record["depth_m"] < SURFACED))
    if surfaced.size:
        record = record.between(0.0, float(record.time[surfaced[0]]))
    x = plant.initial(np.array([START, 0.0]))[None, :]
    return Dive(record, plant.run(record, record.segments, x)[:, 0])


def methods() -> dict[str, Any]:
    """The compared estimators, by name; the grey box starts from GUESS."""
    guessed = replace_at(load_vehicle(VEHICLE), GUESS)
    settings = (Rwls(), Rwls(known=("unity",)), LsSvm(), Ivls(), CorrectedIvls(), RefinedIv())
    return dict(zip(METHODS, (*settings, GreyBox(guessed, FREE, window=WINDOW))))


def measures(model: Model, dive: Dive) -> tuple[float, ...]:
    """MEASURES of a free run; infinite if it leaves the finite numbers."""
    try:
        run = from_rest(model, dive.record)
    except Diverged:
        return NO_RUN
    measured = dive.record["depth_m"]
    with np.errstate(over="ignore", invalid="ignore"):  # a run may be close to overflow at its end
        found, true = score(measured, measured - run), score(dive.true_depth, dive.true_depth - run)
    values = (found.mean_absolute, found.rmse, found.r2, found.maximum, true.rmse)
    return values if all(map(isfinite, values)) else NO_RUN


def from_rest(model: Model, record: Record) -> np.ndarray:
    """Depths, m, of a free run from rest, from the depth that fits the first seconds; raises Diverged.

    The float hardly moves in these, and a single reading would add its noise to the whole run.  Below the surface no
    model here depends on the depth, so a run may be shifted.
    """
    run, first = simulate(model, record)["depth_m"], record.time < AT_REST
    return run + np.mean(record["depth_m"][first] - run[first])
