"""The models of Geng and Zhao 2012 of depth and pitch: fitted to 600 s, run free over 800 s of other data.

Orders are those of the paper: depth n_a 3, n_b 2 for each plane (7 parameters), pitch n_a 4, n_b 2 (8), delay 1.
Angles are in radians; the fits scale their signals, so the paper's reason for degrees does not arise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan, pi
from typing import Any

import numpy as np

from auv_gym.channels import truth_of
from auv_gym.model import Diverged, Model
from auv_gym.models.linear import Polynomial
from auv_gym.models.linear.differences import differenced, rate_of, with_differences
from auv_gym.records.record import Record
from identification.compare.comparison import free_runs_of
from identification.estimate import Estimate
from identification.fit.validation import score
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.orders import OrderSearch, search_orders
from identification.linear.polynomials.output_error import OutputError

DEPTH, PITCH = "depth_m", "pitch_rad"
INPUTS, OUTPUTS = ("bow_plane_rad", "stern_plane_rad"), (DEPTH, PITCH)
N_A, N_B, DELAY = {DEPTH: 3, PITCH: 4}, 2, 1
MOST_N_C = 3
LONGER = "ARMAX, pole at 1, depth n_b 3"
SETTLE = 40.0  # s, to which starts are fitted and which are not scored: a twentieth of the 800 s
PUBLISHED: Mapping[str, float] = {  # table 2, angles in degrees
    "a1[depth_m]": -2.950,
    "a2[depth_m]": 2.903,
    "a3[depth_m]": -0.953,
    "b1[depth_m, bow_plane_rad]": -0.00166,
    "b2[depth_m, bow_plane_rad]": 0.00153,
    "b1[depth_m, stern_plane_rad]": -0.000438,
    "a1[pitch_rad]": -3.520,
    "a2[pitch_rad]": 4.638,
    "a3[pitch_rad]": -2.712,
    "a4[pitch_rad]": 0.594,
    "b1[pitch_rad, bow_plane_rad]": 0.000894,
    "b2[pitch_rad, bow_plane_rad]": -0.000890,
    "b1[pitch_rad, stern_plane_rad]": -0.00149,
}


@dataclass(frozen=True)
class Verified:
    """Fits of a free run over fresh data, %: pitch, depth, depth differences, and these by eq (15).

    The third are differences of the free run of depth, the last the free run of the model whose pole at 1 is cancelled;
    NaN if there is no such model, or it diverges.
    """

    pitch: float
    depth: float
    differences: float
    equation: float = nan


def methods(n_c: Mapping[str, int]) -> dict[str, Any]:
    """The estimators by name: the model of the paper by several methods, and one with an additional coefficient of B.

    n_c: of ARMAX, by output.
    """
    orders: dict[str, Any] = {"inputs": INPUTS, "outputs": OUTPUTS, "n_a": tuple(N_A.values()), "delay": DELAY}
    plain: dict[str, Any] = {**orders, "n_b": N_B}
    noise: dict[str, Any] = {"n_c": tuple(n_c[name] for name in OUTPUTS)}
    longer: dict[str, Any] = {**orders, "n_b": ((N_B + 1,) * len(INPUTS), (N_B,) * len(INPUTS))}
    return {
        "ARX": Arx(**plain),
        "ARMAX": Armax(**plain, **noise),
        "ARMAX, pole at 1": Armax(**plain, **noise, integrating=(DEPTH,)),
        "output error": OutputError(**plain),
        "output error, pole at 1": OutputError(**plain, integrating=(DEPTH,)),
        LONGER: Armax(**longer, **noise, integrating=(DEPTH,)),
    }


def noise_orders(records: Sequence[Record]) -> dict[str, int]:
    """n_c of each output by AIC, at the paper's other orders."""
    return {name: noise_search(records, name).best(name, "aic").n_c for name in OUTPUTS}


def noise_search(records: Sequence[Record], output: str) -> OrderSearch:
    """ARMAX of the paper's orders of an output, with every n_c."""
    orders: dict[str, Any] = {"n_a": (N_A[output],), "n_b": (N_B,), "delay": (DELAY,), "n_c": range(MOST_N_C + 1)}
    return search_orders("armax", records, INPUTS, (output,), **orders)


def verify(model: Model, record: Record) -> Verified:
    """The fits of a model's free run over a record, for any model of pitch and depth, including a vehicle."""
    rate = rate_of(DEPTH)
    measured = with_differences(record, DEPTH)
    try:
        free, scored = free_run(model, record)
    except Diverged:
        return Verified(nan, nan, nan)
    free = with_differences(free, DEPTH)
    pitch, depth, change = (fit_percent(measured[name], free[name], scored) for name in (PITCH, DEPTH, rate))
    equation = nan
    if isinstance(model, Polynomial):
        try:
            cancelled, _ = free_run(differenced(model, DEPTH), measured)
            equation = fit_percent(measured[rate], cancelled[rate], scored)
        except (ValueError, Diverged):  # no pole near 1, or one that grows
            equation = nan
    return Verified(pitch, depth, change, equation)


def free_run(model: Model, record: Record) -> tuple[Record, np.ndarray]:
    """The record with the outputs of a model's free run instead of the measured ones, and which samples count."""
    runs = free_runs_of(model, record, record.segments, SETTLE)
    y = {name: record[name][runs.rows] - runs.residual[:, i] for i, name in enumerate(runs.channels)}
    return record.with_channels(y), runs.scored


def resolution(record: Record) -> Verified:
    """The fits of the true motion itself, limited by the rounding of the readings."""
    true = record.with_channels({name: record[truth_of(name)] for name in OUTPUTS})
    measured, free = with_differences(record, DEPTH), with_differences(true, DEPTH)
    scored = record.elapsed >= SETTLE
    pitch, depth, rate = (fit_percent(measured[n], free[n], scored) for n in (PITCH, DEPTH, rate_of(DEPTH)))
    return Verified(pitch, depth, rate)


def form(record: Record) -> Verified:
    """The fit of depth differences that 7 parameters reach when fitted to the very data that judge them."""
    measured = with_differences(record, DEPTH)
    rate = measured.select(np.isfinite(measured[rate_of(DEPTH)]))
    best = OutputError(INPUTS, (rate_of(DEPTH),), n_a=N_A[DEPTH] - 1, n_b=N_B, delay=DELAY).fit(rate)
    free, scored = free_run(best.model, measured)
    return Verified(nan, nan, nan, fit_percent(measured[rate_of(DEPTH)], free[rate_of(DEPTH)], scored))


def fit_percent(measured: np.ndarray, free: np.ndarray, scored: np.ndarray) -> float:
    """100 (1 - |y - yh| / |y - mean y|) over the samples that count."""
    return float(score(measured[scored], (measured - free)[scored]).fit_percent)


def in_degrees(estimate: Estimate) -> tuple[float, tuple[float, float], str]:
    """Value, interval and unit of a coefficient with angles in degrees, as the paper prints them."""
    factor = pi / 180.0 if estimate.unit.endswith("/rad") else 1.0
    low, high = estimate.ci95
    return factor * estimate.value, (factor * low, factor * high), estimate.unit.replace("/rad", "/deg")
