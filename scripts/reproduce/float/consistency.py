"""The effect of depth noise on each estimator of a float's diving model: the bias, and the failure of IVLS."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from auv_gym.model import Model
from auv_gym.physics.buoyancy import GRAVITY
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from controllers.pid import float_depth_pid
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.diving_model import DivingModel, regressors
from identification.recursive.ivls import Ivls
from identification.recursive.recursion import STATE
from identification.recursive.refined_iv import RefinedIv
from identification.recursive.rwls import Rwls
from identification.recursive.samples import Samples

LENGTHS = (1_000, 3_000, 10_000, 30_000, 100_000)  # samples
PLANNED, FEEDBACK = "planned", "feedback"
# each with the scheme under which its equation is exact, so that only noise remains
CONSISTENCY = {
    "RWLS as printed": (Rwls(), "difference"),
    "RWLS, theta_1 = 1": (Rwls(known=("unity",)), "difference"),
    "IVLS as printed": (Ivls(), "difference"),
    "IVLS corrected": (CorrectedIvls(), "difference"),
    "refined IV": (RefinedIv(), "exact"),
}
_FAR, _NEAR, _CLOSE = 0.7, 0.36, 0.8  # s, s, m: the paper's sampling
_SHALLOW, _DEEP = 5.0, 25.0  # m
_SHORTEST, _LONGEST = 40.0, 120.0  # s at one target depth
_TYPICAL_SPEED = 0.07  # m/s, half of the float's fastest


# The bias against the number of samples


def bias(plant: Plant, seed: int, piston: str, samples: int, noise: float) -> dict[str, dict[int, float]]:
    """The relative error of D/M by method and number of samples, for one long record and its beginnings.

    piston: planned, as if moved without regard to the noisy depth, or by feedback.  Infinite if a fit fails.
    """
    exact, found = diving_form(plant), {}
    for scheme, truth in (("difference", replace(exact, scheme="difference")), ("exact", exact)):
        record = long_dive(plant, truth, samples, noise, np.random.default_rng(seed), piston == FEEDBACK)
        for method, (estimator, own) in CONSISTENCY.items():
            if own == scheme:
                parts = {n: record.select(np.arange(samples) < n) for n in LENGTHS if n <= samples}
                found[method] = {n: _damping(estimator, part) / truth.damping - 1 for n, part in parts.items()}
    return found


def _damping(estimator: Any, record: Record) -> float:
    try:
        return estimator.fit(record)["damping"].value
    except ValueError:
        return inf


def diving_form(plant: Plant) -> DivingModel:
    """Equation (5) with the parameters of a float with a piston, its drag linearised at half of its fastest speed."""
    hull = plant.hull
    mass = float(hull.mass + hull.added_mass)
    lift = float(hull.density * GRAVITY * hull.piston_area) / mass
    square = float(hull.piston_square) / mass
    neutral = float(hull.piston_neutral)
    damping = float(hull.drag_linear + hull.drag_quadratic * _TYPICAL_SPEED) / mass
    return DivingModel(damping, -(square * neutral + lift) * neutral, 0.0, -square, -lift)


def long_dive(
    plant: Plant, truth: DivingModel, samples: int, noise: float, rng: np.random.Generator, feedback: bool
) -> Record:
    """A record of a float that obeys a diving model and is sent to another depth every minute or two.

    noise: m, white.  feedback: whether the controller acts on the noisy depth, otherwise on the true one.
    """
    controller, (of_noise, rng) = float_depth_pid(plant), rng.spawn(2)  # a short record is the beginning of a long one
    added = noise * of_noise.standard_normal(samples)
    x, memory, now, interval, target, until = truth.initial(np.array([15.0])), controller.start(), 0.0, _FAR, 15.0, 0.0
    rows = np.empty((samples, 3))
    for k in range(samples):
        if now >= until:
            target, until = rng.uniform(_SHALLOW, _DEEP), now + rng.uniform(_SHORTEST, _LONGEST)
        depth = x[0] + added[k] if feedback else x[0]
        command, memory = controller.act(memory, {"depth_m": depth, "dt_s": interval}, {"depth_m": target})
        rows[k] = now, x[0] + added[k], command["piston_m"]
        interval = _NEAR if abs(depth - target) < _CLOSE else _FAR
        x = truth.step_over(x, rows[k, 2:], interval)
        now += interval
    return Record.from_arrays(rows[:, 0], {"depth_m": rows[:, 1], "piston_m": rows[:, 2]})


def consistency_rows(biases: Mapping[tuple[str, str, int], Sequence[float]]) -> tuple[list[str], list[list[str]]]:
    """Head and rows: how the piston moves, the method, and its error in per cent for each number of samples."""
    lengths = sorted({n for _, _, n in biases})
    rows = []
    for piston in (PLANNED, FEEDBACK):
        for method in CONSISTENCY:
            rows.append([piston, method, *(_percent(biases[piston, method, n]) for n in lengths)])
    return ["piston", "method", *(f"{n} samples" for n in lengths)], rows


def _percent(errors: Sequence[float]) -> str:
    middle, low, high = (100.0 * f(errors) for f in (np.median, min, max))
    if not isfinite(high) or (low < 0.0 < high and max(-low, high) >= 100.0):
        return f"> 100 in {sum(abs(e) >= 1.0 for e in errors)} of {len(errors)}"
    digits = 0 if abs(middle) >= 100.0 else 1
    middle, low, high = (round(value, digits) + 0.0 for value in (middle, low, high))  # avoids a negative zero
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


# The failure of IVLS as printed


@dataclass(frozen=True)
class Variant:
    """IVLS as printed, or with one change; start: the source of the initial theta of recursion and instrument."""

    name: str
    start: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


VARIANTS = (
    Variant("as printed"),
    Variant("alpha = 0.05", settings={"share": 0.05}),
    Variant("N = 1", settings={"lag": 1}),
    Variant("theta_1 = 1", settings={"known": ("unity",)}),
    Variant("theta_1 = 1, from RWLS", "least squares", {"known": ("unity",)}),
    Variant("theta_1 = 1, from IVLS corrected", "corrected", {"known": ("unity",)}),
)


class Breakdown(NamedTuple):
    """The failure of a variant on a record.

    error: m, RMSE of a free run.  instrument: m, largest |xi|.  negative: samples whose denominator is below zero.
    unity: |theta_1 - 1| at the end.  damping: D/M, 1/s.
    """

    error: float
    instrument: float
    negative: float
    unity: float
    damping: float


def break_down(
    variant: Variant, starts: Mapping[str, np.ndarray], record: Record, rated: Callable[[Model], float]
) -> Breakdown:
    """The behaviour of a variant on a record, sample by sample; rated: returns the error of a model.

    The denominator is the ratio of the errors of equation (8) before and after the update, 1 / (1 - i S).
    """
    initial = {"initial": tuple(map(float, starts[variant.start]))} if variant.start else {}
    estimator = Ivls(**initial, **variant.settings)
    samples = Samples.of([record], "Ivls", 1)
    rows = np.zeros((samples.depth.size, 6))
    regressors(samples.depth, samples.piston, samples.interval, rows)
    memory, largest, negative = estimator.start(), 0.0, 0
    with np.errstate(over="ignore", invalid="ignore"):
        for z, x, h, row in zip(samples.depth, samples.piston, samples.interval, rows):
            before, memory = memory.theta, estimator.update(memory, z, x, h)
            state: Any = memory.vector.view(STATE)[0]
            largest = max(largest, abs(float(state.simulated[0])))
            negative += bool(row[2] != 0.0 and (z - row @ before) * (z - row @ memory.theta) < 0.0)
            if not np.isfinite(memory.vector).all():
                return Breakdown(inf, inf, negative, inf, inf)
    theta = memory.theta
    damping, offset, piston_rate, piston_square, piston = map(float, theta[1:])
    error = rated(DivingModel(damping, offset, piston_rate, piston_square, piston))
    return Breakdown(error, largest, negative, abs(float(theta[0]) - 1.0), damping)


def breakdown_rows(breakdowns: Sequence[Sequence[Mapping[str, float]]]) -> tuple[list[str], list[list[str]]]:
    """Head and rows: each variant with its medians over seeds, seeds with an error below 1 m, and quartiles of D/M."""
    head = [
        "variant",
        "RMSE at 60 m, m",
        "below 1 m",
        "largest |xi|, m",
        "denominators below 0",
        "|theta_1 - 1|",
        "D/M, 1/s",
    ]
    rows = []
    for i, variant in enumerate(VARIANTS):
        found = np.array([list(b[i].values()) for b in breakdowns])
        error, *rest = map(_short, np.median(found[:, :-1], axis=0))
        # order statistics: values of failed seeds cannot be interpolated
        low, middle, high = map(_short, np.quantile(found[:, -1], (0.25, 0.5, 0.75), method="nearest"))
        good = f"{int(np.sum(found[:, 0] < 1.0))} of {len(breakdowns)}"
        rows.append([variant.name, error, good, *rest, f"{middle} ({low} to {high})"])
    return head, rows


def _short(value: float) -> str:
    return f"{value:.2g}" if isfinite(value) else "lost"
