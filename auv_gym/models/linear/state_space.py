"""State-space linear models in innovations form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.compiled import compiled
from auv_gym.model import check_finite, check_interval, inputs_of
from auv_gym.records.record import Record

_NONE = np.empty(0)
_EXACT = 1e-9  # relative; rounding in a product of matrices with tens of rows is much smaller
_LARGEST_GAIN = 1e4  # over the innovations' own; more would throw the state far off in `correct`, and back in `step`


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear Model in innovations form; e is the difference of the outputs from their prediction:

        x(t+1) = a x(t) + b (u(t) - input_offset) + k e(t),    y(t) = c x(t) + output_offset + e(t)

    k and the offsets default to zeros; default names of states are x1, x2, ...
    `correct` adds l e to the state with a l = k, so that `correct` followed by `step` is this equation, and `predict`
    its predictor.  If there is no such l (a has a pole at zero that k drives), the innovations become states for one
    sample.
    Source: Ljung 1999, System Identification, sec. 4.3; Anderson and Moore 1979, Optimal Filtering, sec. 9.2.

    Example:

        >>> from auv_gym import StateSpace
        >>> turning = StateSpace([[0.9]], [[0.02]], [[1.0]], ("rudder_rad",), ("r_radps",), dt=1.0)
        >>> turning.poles(), turning.dc_gain().round(3)
        (array([0.9]), array([[0.2]]))
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    k: np.ndarray = field(default_factory=lambda: _NONE)
    input_offset: np.ndarray = field(default_factory=lambda: _NONE)
    output_offset: np.ndarray = field(default_factory=lambda: _NONE)
    states: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n, m, p = np.shape(self.a)[0], len(self.inputs), len(self.outputs)
        shapes = {"a": (n, n), "b": (n, m), "c": (p, n), "k": (n, p), "input_offset": (m,), "output_offset": (p,)}
        for name, shape in shapes.items():
            given = getattr(self, name)
            array = np.zeros(shape) if given is _NONE else np.array(given, dtype=np.float64, order="C")
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(
                    f"StateSpace with {n} states, {m} inputs and {p} outputs needs finite {name} of shape {shape}, "
                    f"got shape {array.shape}: one row a state or output, one column a state, input or innovation."
                )
            object.__setattr__(self, name, array)
        check_names(self.inputs, self.outputs, self.dt)
        names = tuple(self.states) or tuple(f"x{i + 1}" for i in range(n))
        if len(names) != n or len(set(names)) != n:
            raise ValueError(f"StateSpace needs {n} different names of states, got {', '.join(names)}.")
        set_field = object.__setattr__
        set_field(self, "states", names)
        set_field(self, "inputs", tuple(self.inputs))
        set_field(self, "outputs", tuple(self.outputs))
        set_field(self, "dt", float(self.dt))
        if not self._corrects:
            set_field(self, "a", np.block([[self.a, self.k], [np.zeros((p, n + p))]]))
            set_field(self, "b", np.vstack([self.b, np.zeros((p, m))]))
            set_field(self, "c", np.hstack([self.c, np.zeros((p, p))]))
            set_field(self, "k", np.vstack([self.k, np.zeros((p, p))]))
            set_field(self, "states", (*names, *(f"{output} innovation" for output in self.outputs)))
            del self.__dict__["gain"]

    @cached_property
    def gain(self) -> np.ndarray:
        """The gain of `correct` from innovations to the state, shape (n, p): a gain = k."""
        n, p = self.k.shape
        if n > p and not self.a[n - p :].any() and np.array_equal(self.a[:, n - p :], self.k):
            return np.vstack([np.zeros((n - p, p)), np.eye(p)])  # innovations among the states
        return np.linalg.lstsq(self.a, self.k, rcond=1e-12)[0] if self.k.any() else np.zeros((n, p))

    @property
    def _corrects(self) -> bool:
        size = np.abs(self.k).max(initial=0.0)
        close = np.abs(self.a @ self.gain - self.k).max(initial=0.0) <= _EXACT * size
        return close and np.abs(self.gain).max(initial=0.0) <= _LARGEST_GAIN * max(size, 1.0)

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """The state with these outputs that is nearest to rest (least |x(t+1) - x(t)|); NaN leaves an output free."""
        wanted = np.asarray(y0, dtype=float) - self.output_offset
        known = np.isfinite(wanted)
        start = self._start if known.all() else self._start_from(known)
        return start @ wanted[known]

    @cached_property
    def _start(self) -> np.ndarray:
        return self._start_from(np.ones(len(self.outputs), dtype=bool))

    def _start_from(self, known: np.ndarray) -> np.ndarray:
        """The matrix from these outputs to the state nearest to rest."""
        c, change = self.c[known], self.a - np.eye(len(self.states))
        some = np.linalg.pinv(c, rcond=1e-12)
        _, sizes, rows = np.linalg.svd(c)
        unseen = rows[np.count_nonzero(sizes > 1e-12 * sizes.max(initial=0.0)) :].T
        return some - unseen @ np.linalg.pinv(change @ unseen, rcond=1e-9) @ (change @ some)

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state one sample later, shape (n_states,)."""
        return self.a @ x + self.b @ (u - self.input_offset)

    def output(self, x: np.ndarray) -> np.ndarray:
        """The outputs in a state, shape (n_outputs,)."""
        return self.c @ x + self.output_offset

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state after measuring y; an output that is NaN counts as predicted."""
        innovation = y - self.output(x)
        return x + self.gain @ np.where(np.isfinite(innovation), innovation, 0.0)

    def run(self, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
        """Outputs of free runs over windows of a record, shape (total rows, n_outputs).

        starts: (n_windows, n_states), the states at the windows' first rows.  Raises for another sample interval, and
        Diverged.
        """
        for window in windows:
            check_interval(self, record.time[window])
        driven = (inputs_of(self, record) - self.input_offset) @ self.b.T
        begin = np.array([w.start for w in windows], dtype=np.int64)
        stop = np.array([w.stop for w in windows], dtype=np.int64)
        starts = np.ascontiguousarray(starts, dtype=np.float64)
        if starts.shape != (begin.size, len(self.states)):
            raise ValueError(
                f"run needs starts of shape {(begin.size, len(self.states))}, one state a window, got {starts.shape}."
            )
        x = np.empty((int((stop - begin).sum()), len(self.states)))
        with np.errstate(over="ignore", invalid="ignore"):  # reported by Diverged, with the time
            _free_runs(self.a, np.ascontiguousarray(driven), begin, stop, starts, x)
            y = x @ self.c.T + self.output_offset
        check_finite(self.outputs, np.concatenate([record.time[w] for w in windows]), y)
        return y

    def poles(self) -> np.ndarray:
        """The poles in discrete time, largest first."""
        poles = np.linalg.eigvals(self.a)
        return poles[np.argsort(-np.abs(poles), kind="stable")]

    def is_stable(self) -> bool:
        """Whether every pole is inside the unit circle; an integrator's is not."""
        return bool((np.abs(self.poles()) < 1.0 - 1e-9).all())

    def dc_gain(self) -> np.ndarray:
        """The steady outputs per unit of a constant input, shape (p, m); raises if the model integrates."""
        if np.abs(self.poles() - 1.0).min(initial=1.0) < 1e-9:
            raise ValueError("The model has a pole at 1, so it has no gain at frequency 0: ask for a frequency above.")
        return self.frequency_response(np.zeros(1))[0].real

    def frequency_response(self, omega: np.ndarray) -> np.ndarray:
        """The complex response from inputs to outputs at frequencies in rad/s, shape (n, p, m)."""
        z = np.exp(1j * np.asarray(omega, dtype=float) * self.dt)
        resolved = z[:, None, None] * np.eye(len(self.states)) - self.a
        return self.c @ np.linalg.solve(resolved, np.broadcast_to(self.b.astype(complex), (z.size, *self.b.shape)))

    def to_control(self) -> Any:
        """The same system for python-control; offsets and k, which python-control does not have, are lost."""
        zeros = np.zeros((len(self.outputs), len(self.inputs)))
        names = {"inputs": list(self.inputs), "outputs": list(self.outputs), "states": list(self.states)}
        return _control().ss(self.a, self.b, self.c, zeros, self.dt, **names)

    @classmethod
    def from_control(
        cls, system: Any, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None, **fields: Any
    ) -> StateSpace:
        """The model of a discrete-time system of python-control, of any form, with its signals' names unless given.

        fields: further ones of StateSpace.  Raises if the output depends on the present input, see Model.
        """
        system: Any = _control().ss(system)
        if not isinstance(system.dt, float | int) or isinstance(system.dt, bool) or not system.dt > 0.0:
            raise ValueError(f"A model needs discrete time with a sample time in s, got dt {system.dt}: sample it.")
        if np.any(system.D):
            raise ValueError("A model's output does not see the present input, got a system with D: delay its input.")
        own: dict[str, Any] = {"states": tuple(system.state_labels)}
        return cls(
            a=system.A,
            b=system.B,
            c=system.C,
            inputs=tuple(inputs or system.input_labels),
            outputs=tuple(outputs or system.output_labels),
            dt=float(system.dt),
            **(own | fields),
        )


def check_names(inputs: Sequence[str], outputs: Sequence[str], dt: float) -> None:
    """Raise if a linear model's channels or sample time are invalid."""
    for name in (*inputs, *outputs):
        channel(name)  # raises if it is unknown
    if len({*inputs, *outputs}) != len(inputs) + len(outputs) or not outputs:
        raise ValueError(
            f"A linear model needs one or more outputs, and each channel once, got inputs {', '.join(inputs)} and "
            f"outputs {', '.join(outputs)}."
        )
    if not 0.0 < dt < np.inf:
        raise ValueError(f"A linear model needs dt > 0 s, got {dt!r}.")


def _control() -> Any:
    try:
        return import_module("control")
    except ImportError:
        raise ValueError("Systems of python-control need the package `control`: pip install control.") from None


@compiled
def _free_runs(a, driven, begin, stop, starts, x):
    """Write the states of free runs into x, shape (total rows, n); driven: the inputs' contribution in each row."""
    n, row = a.shape[0], 0
    for window in range(begin.size):
        for i in range(n):
            x[row, i] = starts[window, i]
        row += 1
        for at in range(begin[window], stop[window] - 1):
            for i in range(n):
                total = driven[at, i]
                for j in range(n):
                    total += a[i, j] * x[row - 1, j]
                x[row, i] = total
            row += 1
