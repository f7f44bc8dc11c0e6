"""Linear models driven by input increments, with disturbances and a steady-state filter that estimates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from auv_gym.models.linear import Polynomial, StateSpace

_RANK = 1e-7  # relative singular value below which two disturbances cannot be distinguished
_NOTHING = 1e-14  # of the largest row: rounding
_MARGIN = 1e-9
_STIR = 1e-10  # of the drifts: gives undriven modes a gain, too


@dataclass(frozen=True, eq=False)
class Increments:
    """The incremental model z(t+1) = a z(t) + b du(t), outputs c z + output_offset; measured: z + gain e, innovation e.

    z ends in the inputs of the last sample, minus input_offset; with `held` inputs and no innovation, outputs stay
    where a constant disturbance keeps them, so that a plan from there has no offset.  model: its states come first in
    z.
    disturbances: which of them are assumed to drift.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    gain: np.ndarray
    model: StateSpace
    input_offset: np.ndarray
    disturbances: tuple[str, ...]

    def initial(self, y: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state at rest with these outputs, where finite, and without disturbance; y: minus the offset."""
        z = np.zeros(self.a.shape[0])
        z[: len(self.model.states)] = self.model.initial(y + self.model.output_offset)
        z[z.size - u.size :] = u - self.input_offset
        return z

    def held_for(self, samples: int) -> Increments:
        """The increments over several samples, with inputs that change at the first; the filter is unchanged."""
        further = np.linalg.matrix_power(self.a, samples - 1)
        return replace(self, a=further @ self.a, b=further @ self.b)


def state_space_increments(model: StateSpace, noise: np.ndarray, drift: np.ndarray, scales: np.ndarray) -> Increments:
    """The increments of a state-space model with as many constant disturbances as outputs, and its Kalman filter.

    noise: standard deviation of each output's measurement.  drift: that of the change in a sample of each input's
    disturbance, then of each output's.  scales: of inputs, then of outputs.
    Disturbances act on the inputs, as far as these can be distinguished, then on the outputs: one on the output of an
    integrator would look like its state.  Raises if there are not as many as outputs.
    Source: Pannocchia and Rawlings 2003, AIChE J. 49(2), 426-437; Maciejowski 2002, sec. 8.2.
    """
    n, m, p = len(model.states), len(model.inputs), len(model.outputs)
    chosen = _told_apart(model, scales)
    names = [*model.inputs, *(f"{name} offset" for name in model.outputs)]
    at_inputs, at_outputs = np.eye(m, m + p), np.eye(p, m + p, m)
    push, shift = model.b @ at_inputs[:, chosen], at_outputs[:, chosen]
    a = np.block([[model.a, push], [np.zeros((p, n)), np.eye(p)]])
    c = np.hstack([model.c, shift])
    stirred = drift[:m] ** 2
    covariance = np.zeros((n + p, n + p))
    covariance[:n, :n] = (model.b * stirred) @ model.b.T + (model.k * noise**2) @ model.k.T
    covariance[range(n), range(n)] += _STIR * stirred.max(initial=0.0)
    covariance[n:, n:] = np.diag(drift[chosen] ** 2)
    try:
        spread = linalg.solve_discrete_are(a.T, c.T, covariance, np.diag(noise**2))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(
            f"The model has no steady Kalman filter ({error}): leave out states that no output shows, or change "
            "noise and drift."
        ) from None
    gain = np.linalg.solve(c @ spread @ c.T + np.diag(noise**2), c @ spread).T
    return Increments(
        a=np.block([[a, np.vstack([model.b, np.zeros((p, m))])], [np.zeros((m, n + p)), np.eye(m)]]),
        b=np.vstack([model.b, np.zeros((p, m)), np.eye(m)]),
        c=np.hstack([c, np.zeros((p, m))]),
        gain=np.vstack([gain, np.zeros((m, p))]),
        model=model,
        input_offset=model.input_offset,
        disturbances=tuple(names[i] for i in chosen),
    )


def polynomial_increments(model: Polynomial, observer: Sequence[float]) -> Increments:
    """The increments of A y = B u + C e / (1 - q) (CARIMA), whose filter follows from C alone.

    observer: coefficients of q, q^2, ... of a polynomial T used as C; none: the model's own C.
    Raises if the filter is not stable.  Source: Clarke, Mohtadi and Tuffs 1987, Automatica 23(2), 137-160.
    """
    p, m = len(model.outputs), len(model.inputs)
    integrated = np.concatenate([model.a, np.zeros((1, p, p))])
    integrated[1:] -= model.a
    noise = model.c
    if len(observer):
        noise = np.array([1.0, *observer])[:, None, None] * np.eye(p)
    predictor = Polynomial(
        integrated, model.b, model.inputs, model.outputs, model.dt, noise, output_offset=model.output_offset
    ).to_state_space()
    left = np.linalg.eigvals(predictor.a - predictor.k @ predictor.c)
    if np.abs(left).max(initial=0.0) > 1.0 - _MARGIN:
        raise ValueError(
            f"The filter of a polynomial model needs the zeros of C inside the unit circle, got one at "
            f"{np.abs(left).max():.4g}: give observer=, such as (-0.8,) for T = 1 - 0.8 q."
        )
    n = len(predictor.states)
    return Increments(
        a=np.block([[predictor.a, np.zeros((n, m))], [np.zeros((m, n)), np.eye(m)]]),
        b=np.vstack([predictor.b, np.eye(m)]),
        c=np.hstack([predictor.c, np.zeros((p, m))]),
        gain=np.vstack([predictor.gain, np.zeros((m, p))]),
        model=predictor,
        input_offset=model.input_offset,
        disturbances=tuple(f"{name} offset" for name in model.outputs),
    )


def _told_apart(model: StateSpace, scales: np.ndarray) -> list[int]:
    """The disturbances, at inputs then at outputs, that a filter can determine from constant outputs."""
    n, m, p = len(model.states), len(model.inputs), len(model.outputs)
    columns = np.vstack([model.a - np.eye(n), model.c / scales[m:, None]])
    if not _independent(columns):
        raise ValueError(
            f"The outputs {', '.join(model.outputs)} do not show an integrating state of the model: add the output "
            "that does, or leave the state out."
        )
    candidates = np.zeros((n + p, m + p))
    candidates[:n, :m] = model.b * scales[:m]
    candidates[n:, m:] = np.eye(p)
    chosen: list[int] = []
    for i in range(m + p):
        more = np.hstack([columns, candidates[:, [i]]])
        if len(chosen) < p and _independent(more):
            columns = more
            chosen.append(i)
    if len(chosen) < p:
        raise ValueError(
            f"Constant disturbances of the {p} outputs {', '.join(model.outputs)} cannot be told apart with the inputs "
            f"{', '.join(model.inputs)}: leave out an output that integrates another, or give the model more inputs."
        )
    return chosen


def _independent(columns: np.ndarray) -> bool:
    """Whether the columns are linearly independent, whatever the rows' units: rpm beside metres per second."""
    for axis in (1, 0):
        sizes = np.linalg.norm(columns, axis=axis, keepdims=True)
        columns = columns / np.where(sizes > _NOTHING * sizes.max(), sizes, 1.0)
    sizes = np.linalg.svd(columns, compute_uv=False)
    return columns.shape[1] <= columns.shape[0] and sizes[-1] > _RANK * sizes[0]
