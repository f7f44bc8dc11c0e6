"""A vehicle's hull learned from its logs: an LS-SVM replaces C(v)v + D(v)v, and all else is the vehicle's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from auv_gym.vehicles.body.learned_hull import VELOCITIES, LearnedHull, trend_terms
from identification.estimate import Estimate
from identification.kernel_machines import fixed_size, regression
from identification.kernel_machines.centres import farthest
from identification.kernel_machines.fixed_size import FixedSize
from identification.kernel_machines.hull.hull_targets import READINGS, HullTargets, hull_targets
from identification.kernel_machines.machine import KernelMachine
from identification.kernel_machines.regression import LsSvmRegression
from identification.kernel_machines.tuning.outward import tune_outward, tune_outward_each
from identification.kernel_machines.tuning.sweep import sweep, sweep_each
from identification.kernel_machines.tuning.tuning import descend, descend_each

WITHIN = 0.99  # share of the training velocities within the reach of a centre
TOLERANCE = 0.004  # of the forces' spread: a stiffer machine that is worse by less extrapolates better
TUNED_ON = 800  # samples, spread over the velocities, for tuning outward
MIRRORED = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # port to starboard, for velocities and forces alike
STILL = 1e-6  # m/s or rad/s
Settings = LsSvmRegression | FixedSize


@dataclass(frozen=True, eq=False)
class HullFit:
    """A vehicle with a learned hull.

    model: the plant with its `learned` hull.  targets: the forces estimated along the records.  machines: one for all
    forces, or six; settings: C and sigma of each, in units of the velocities' root mean square.
    errors: (6,) root mean square leave-one-out error of the forces, N and N m; shares: the same over the forces' own.
    estimates: empty; a machine has as many coefficients as samples, and none has a meaning or an interval of its own.
    notes: remarks for the reader of the fit.
    """

    model: Plant
    targets: HullTargets
    machines: tuple[KernelMachine, ...]
    settings: tuple[Settings, ...]
    errors: np.ndarray
    shares: np.ndarray
    notes: tuple[str, ...]
    estimates: tuple[Estimate, ...] = ()


@dataclass(frozen=True)
class HullLsSvm:
    """C(v)v + D(v)v of a torpedo by LS-SVM with radial kernels, from records of velocities, attitude and commands.

    plant: its mass, weight, fins, propulsion and effects are known.  penalty, sigma: C, and the width in units of the
    velocities' root mean square; tuned by default.  tuning: outward, by the prediction of the outer samples from the
    inner ones, or leave_one_out, which interpolates better and extrapolates badly.  size: number of centres, fitted to
    all samples; by default, each of at most `samples`, spread over the velocities, is a centre.
    separate: C and sigma for each force, at six times the cost of a step.  mirrored: forces to port mirror those to
    starboard.  trend: lift and damping, |u| times each velocity, are fitted first by least squares, and the machine
    fits the rest.
    Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, section 3.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import HullLsSvm, compare_open, steer
        >>> torpedo = load_vehicle("remus100")
        >>> log = steer(torpedo, rng=np.random.default_rng(0), duration=60)
        >>> fit = HullLsSvm(torpedo, penalty=10, sigma=3, size=50).fit(log)
        >>> fit.notes[0]
        '591 samples of the forces, without 5 at either end of each segment'
    """

    plant: Plant
    penalty: float | None = None
    sigma: float | None = None
    tuning: Literal["outward", "leave_one_out"] = "outward"
    size: int | None = None
    samples: int = 2000
    separate: bool = False
    mirrored: bool = False
    trend: bool = False

    def __post_init__(self) -> None:
        if (self.penalty is None) != (self.sigma is None):
            raise ValueError("HullLsSvm tunes penalty and sigma together: give both, or none.")
        if self.tuning not in ("outward", "leave_one_out"):
            raise ValueError(f"HullLsSvm needs tuning to be outward or leave_one_out, got {self.tuning!r}.")
        if self.samples < 30:
            raise ValueError(f"HullLsSvm needs samples of at least 30, got {self.samples!r}: some 1000 do for most.")
        _ = self._settings(1.0, 1.0), self._given()  # raises if a machine cannot have these settings

    def fit(self, *records: Record) -> HullFit:
        """The plant with its hull learned from all segments of all records; raises if they are unsuitable."""
        targets = hull_targets(self.plant, records)
        x, y = targets.velocities, targets.forces
        if self.mirrored:
            x, y = np.concatenate([x, x * MIRRORED]), np.concatenate([y, y * MIRRORED])
        _check(x)
        spread = np.sqrt(np.mean(x**2, axis=0))
        scaled = x / spread
        taken = farthest(scaled, self.samples) if self.size is None else np.arange(len(x))
        trend = _trend(x, y) if self.trend else np.zeros((6, 6))
        left = y - trend_terms(x) @ trend
        settings = tuple(self._given() or self._tuned(scaled, left, taken))
        machines = _trained(settings, scaled[taken], left[taken])
        errors = np.sqrt(np.mean(np.column_stack([m.leave_one_out for m in machines]) ** 2, axis=0))
        hull = replace(_hull(machines, spread, scaled), trend=trend)
        return HullFit(
            model=replace(self.plant, learned=hull),
            targets=targets,
            machines=machines,
            settings=settings,
            errors=errors,
            shares=errors / np.sqrt(np.mean(y**2, axis=0)),
            notes=_notes(targets, machines, hull),
        )

    def _given(self) -> list[Settings]:
        if self.penalty is None or self.sigma is None:
            return []
        return [self._settings(self.penalty, self.sigma)] * (6 if self.separate else 1)

    def _tuned(self, x: np.ndarray, y: np.ndarray, taken: np.ndarray) -> list[Settings]:
        """Tuned settings of the machines, one or six."""
        free = self._settings(1.0, 1.0)
        if self.tuning == "outward":
            rows, full = farthest(x, TUNED_ON), LsSvmRegression(scaled=False)
            here = x[rows], y[rows]
            found = (
                list(tune_outward_each(full, *here, tolerance=TOLERANCE))
                if self.separate
                else [tune_outward(full, *here, tolerance=TOLERANCE)]
            )
        elif isinstance(free, FixedSize):
            found = sweep_each(free, x, y) if self.separate else [sweep(free, x, y)]
        else:
            here = x[taken], y[taken]
            found = descend_each(free, *here) if self.separate else [descend(free, *here)]
        return [self._settings(one.settings.penalty, one.settings.sigma) for one in found]

    def _settings(self, penalty: float, sigma: float) -> Settings:
        if self.size is None:
            return LsSvmRegression(penalty, sigma, scaled=False)
        return FixedSize(penalty, sigma, self.size, scaled=False)


def _trend(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients of the trend, (6, 6), fitted with a constant, which is left to the machine's bias."""
    terms = np.column_stack([np.ones(len(x)), trend_terms(x)])
    return np.linalg.lstsq(terms, y, rcond=1e-8)[0][1:]


def _trained(settings: Sequence[Settings], x: np.ndarray, y: np.ndarray) -> tuple[KernelMachine, ...]:
    if len(settings) == 1:
        return (settings[0].fit(x, y),)
    sized = [one for one in settings if isinstance(one, FixedSize)]
    full = [one for one in settings if isinstance(one, LsSvmRegression)]
    return fixed_size.fit_each(sized, x, y) if sized else regression.fit_each(full, x, y)


def _hull(machines: Sequence[KernelMachine], spread: np.ndarray, x: np.ndarray) -> LearnedHull:
    """The machines in the form of the simulator; x: all training velocities, in units of the spread."""
    support = machines[0].support
    coefficients = np.zeros((len(machines), len(support), 6))
    for k, machine in enumerate(machines):
        coefficients[k][:, slice(None) if len(machines) == 1 else [k]] = machine.coefficients
    distances = KDTree(support).query(x, k=2)[0]
    apart = np.where(distances[:, 0] > 0.0, distances[:, 0], distances[:, 1])  # a centre is nearest to itself
    return LearnedHull(
        support=support * spread,
        spread=spread,
        sigma=np.array([machine.sigma for machine in machines], dtype=float),
        coefficients=coefficients,
        bias=np.concatenate([np.atleast_1d(machine.bias) for machine in machines]),
        reach=float(np.quantile(apart, WITHIN)),
    )


def _check(x: np.ndarray) -> None:
    still = [name for name, values in zip(VELOCITIES, x.T, strict=True) if np.ptp(values) <= STILL]
    if still:
        raise ValueError(
            f"HullLsSvm needs velocities that vary, got {' and '.join(still)} constant: excite both pairs of fins, as "
            "bang-bang commands do."
        )


def _notes(targets: HullTargets, machines: Sequence[KernelMachine], hull: LearnedHull) -> tuple[str, ...]:
    noise = ", ".join(f"{name} {value:.2g}" for name, value in zip(READINGS, targets.noise, strict=True))
    found = [
        f"{len(targets)} samples of the forces, without {targets.ends} at either end of each segment",
        f"noise found in the readings: {noise}",
        f"{len(hull.support)} centres; a velocity farther than {hull.reach:.3g} sizes from all is outside the data",
    ]
    return (*found, *dict.fromkeys(note for machine in machines for note in machine.notes))
