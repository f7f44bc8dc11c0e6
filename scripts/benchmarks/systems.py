"""Two systems with known coefficients, their records, and the errors of models identified from these.

One has one input and output and a coloured disturbance (ARMAX of orders 4, 4, 2), the other two of each with three
states and noise on the outputs and the states.  Every record has a seed of its own; the same seed gives the same record
everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.records.record import Record

DT = 1.0  # s
SYSTEMS = ("armax", "state_space")

_SETTLING = 200  # samples before an ARMAX record begins
_CLEAN_SEEDS = {"armax": 10_000, "state_space": 20_000}  # added to a seed, so that fresh data are fresh
_HOLDS = {"armax": (2,), "state_space": (3, 2)}  # samples for which each input stays
_PAIR = 0.95 * np.exp(0.3j), 0.80 * np.exp(1.0j)

A = np.real(np.poly([_PAIR[0], _PAIR[0].conjugate(), _PAIR[1], _PAIR[1].conjugate()]))
B = np.array([0.0, 0.05, 0.12, -0.04, 0.06])
C = np.array([1.0, -0.8, 0.3])
ARMAX = Polynomial(
    a=A[:, None, None], b=B[:, None, None], c=C[:, None, None], inputs=("stern_plane_rad",), outputs=("q_radps",), dt=DT
)
STATE_SPACE = StateSpace(
    a=np.array([[0.90, 0.20, 0.0], [-0.20, 0.90, 0.05], [0.0, 0.0, 0.70]]),
    b=np.array([[0.5, 0.0], [0.1, 0.4], [0.0, 1.0]]),
    c=np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -0.5]]),
    inputs=("rudder_rad", "stern_plane_rad"),
    outputs=("r_radps", "q_radps"),
    dt=DT,
)


@dataclass(frozen=True, eq=False)
class Signals:
    """The inputs and outputs of a system: u (n, m) and y (n, p), named by channel."""

    u: np.ndarray
    y: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def record(self) -> Record:
        """The same as a record, with a sample each DT."""
        names = (*self.inputs, *self.outputs)
        return Record.from_arrays(DT * np.arange(len(self.u)), dict(zip(names, np.hstack([self.u, self.y]).T)))


def truth(system: str) -> Polynomial | StateSpace:
    """The true system, as a model."""
    if system not in SYSTEMS:
        raise ValueError(f"Known systems are {' and '.join(SYSTEMS)}, got {system!r}: name one of them.")
    return ARMAX if system == "armax" else STATE_SPACE


def measured(system: str, samples: int, seed: int, noise: float = 0.10, state_noise: float = 0.05) -> Signals:
    """A record of an experiment.

    noise: standard deviation of the noise on an output, over that of the clean output; coloured for "armax", stationary
    from the first sample on, and white for "state_space", which starts at rest.  state_noise: standard deviation of the
    noise added to each state of "state_space" in every sample.
    """
    model, rng = truth(system), np.random.default_rng(seed)
    if system == "armax":
        u = _switching(samples + _SETTLING, 2, rng)
        answer, disturbance = (np.asarray(lfilter(num, A, x)) for num, x in ((B, u), (C, rng.standard_normal(u.size))))
        y = answer + noise * np.std(answer) / np.std(disturbance) * disturbance
        return _signals(model, u[_SETTLING:, None], y[_SETTLING:, None])
    u = _inputs(system, samples, rng)
    draws = rng.standard_normal((samples, 5))
    size = noise * _run(u, np.zeros((samples, 3))).std(axis=0)
    return _signals(model, u, _run(u, state_noise * draws[:, 2:]) + size * draws[:, :2])


def clean(system: str, samples: int, seed: int) -> Signals:
    """Fresh data to judge by: other inputs than in the measured record of this seed, without noise, from rest."""
    model, rng = truth(system), np.random.default_rng(_CLEAN_SEEDS[system] + seed)
    u = _inputs(system, samples, rng)
    if system == "armax":
        return _signals(model, u, np.asarray(lfilter(B, A, u, axis=0)))
    return _signals(model, u, _run(u, np.zeros((samples, 3))))


def fit_percent(y: np.ndarray, simulated: np.ndarray) -> float:
    """100 (1 - |y - simulated| / |y - mean of y|), averaged over outputs; -inf if a simulation is not finite."""
    left = np.linalg.norm(y - simulated, axis=0) / np.linalg.norm(y - y.mean(axis=0), axis=0)
    return float(np.mean(np.where(np.isfinite(left), 100.0 * (1.0 - left), -np.inf)))


def coefficient_error(a: ArrayLike, b: ArrayLike, c: ArrayLike | None = None) -> float:
    """Norm of the error of all coefficients of ARMAX over that of the true ones; without c, of a and b.

    Each from the first power of the delay on; missing ones count as zeros.
    """
    pairs = [(a, A), (b, B)] + ([] if c is None else [(c, C)])
    errors, sizes = [], []
    for given, true in pairs:
        found = np.asarray(given, dtype=float)
        size = max(found.size, true.size - 1)
        wanted = np.pad(true[1:], (0, size - true.size + 1))
        errors.append(np.pad(found, (0, size - found.size)) - wanted)
        sizes.append(wanted)
    return float(np.linalg.norm(np.concatenate(errors)) / np.linalg.norm(np.concatenate(sizes)))


def largest_pole_error(a: np.ndarray) -> float:
    """Largest distance of a true pole of STATE_SPACE to its partner in the transition matrix `a`.

    Poles are paired for the least sum of distances; surplus poles of `a` are ignored.
    """
    apart = np.abs(np.linalg.eigvals(STATE_SPACE.a)[:, None] - np.linalg.eigvals(np.asarray(a, dtype=float)))
    return float(apart[linear_sum_assignment(apart)].max()) if apart.shape[1] >= apart.shape[0] else float("inf")


def _signals(model: Polynomial | StateSpace, u: np.ndarray, y: np.ndarray) -> Signals:
    return Signals(u, y, model.inputs, model.outputs)


def _inputs(system: str, samples: int, rng: np.random.Generator) -> np.ndarray:
    return np.stack([_switching(samples, hold, rng) for hold in _HOLDS[system]], axis=1)


def _switching(samples: int, hold: int, rng: np.random.Generator) -> np.ndarray:
    """A random binary sequence of -1 and 1 that may change every `hold` samples, shape (samples,)."""
    return np.repeat(rng.choice([-1.0, 1.0], size=samples // hold + 1), hold)[:samples]


def _run(u: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Outputs of STATE_SPACE from rest, shape (n, 2); added: to the states of the next sample, (n, 3)."""
    x, states = np.zeros(3), np.empty((len(u), 3))
    driven = u @ STATE_SPACE.b.T + added
    for k, drive in enumerate(driven):
        states[k] = x
        x = STATE_SPACE.a @ x + drive
    return states @ STATE_SPACE.c.T
