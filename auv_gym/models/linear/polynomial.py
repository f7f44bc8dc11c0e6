"""Polynomial models in the delay operator: ARX, ARMAX, output error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from auv_gym.models.linear.state_space import StateSpace, check_names
from auv_gym.records.record import Record

_NONE = np.empty(0)


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A linear Model as a left matrix fraction in the delay q, with one matrix per power, and white e:

        A(q) (y - output_offset) = B(q) (u - input_offset) + C(q) e

    a: (na + 1, p, p), a[0] = I.  b: (nb + 1, p, m), b[0] = 0, no direct feedthrough.  c: (nc + 1, p, p), c[0] = I;
    default I (ARX); c = a is an output-error model.  Offsets default to zeros.
    Source: Ljung 1999, System Identification, secs. 4.2 and 4.4.

    Example:

        >>> from auv_gym import Polynomial
        >>> yaw = Polynomial.from_coefficients({"r_radps": [-0.9]}, {"r_radps": {"rudder_rad": [0.02]}}, dt=1.0)
        >>> yaw.to_state_space().poles()
        array([0.9])
    """

    a: np.ndarray
    b: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    c: np.ndarray = field(default_factory=lambda: _NONE)
    input_offset: np.ndarray = field(default_factory=lambda: _NONE)
    output_offset: np.ndarray = field(default_factory=lambda: _NONE)

    def __post_init__(self) -> None:
        m, p = len(self.inputs), len(self.outputs)
        one, none = np.eye(p), np.zeros((p, m))
        for name, first in (("a", one), ("b", none), ("c", one)):
            given = getattr(self, name)
            array = one[None].copy() if given is _NONE else np.array(given, dtype=np.float64, order="C")
            if array.ndim != 3 or array.shape[1:] != first.shape or not np.isfinite(array).all():
                raise ValueError(
                    f"Polynomial with {m} inputs and {p} outputs needs finite {name} of shape "
                    f"(powers, {first.shape[0]}, {first.shape[1]}), got {array.shape}: one matrix a power of the delay."
                )
            if not len(array) or not np.array_equal(array[0], first):
                wanted = "zero, since an output does not see the present input" if name == "b" else "the unit matrix"
                raise ValueError(f"Polynomial needs {name}[0] to be {wanted}, got {array[:1].tolist()}.")
            object.__setattr__(self, name, array)
        for name, size in (("input_offset", m), ("output_offset", p)):
            given = getattr(self, name)
            array = np.zeros(size) if given is _NONE else np.array(given, dtype=np.float64)
            if array.shape != (size,) or not np.isfinite(array).all():
                raise ValueError(f"Polynomial needs a finite {name} of shape ({size},), got shape {array.shape}.")
            object.__setattr__(self, name, array)
        check_names(self.inputs, self.outputs, self.dt)
        object.__setattr__(self, "inputs", tuple(self.inputs))
        object.__setattr__(self, "outputs", tuple(self.outputs))
        object.__setattr__(self, "dt", float(self.dt))

    @classmethod
    def from_coefficients(
        cls,
        a: Mapping[str, Sequence[float]],
        b: Mapping[str, Mapping[str, Sequence[float]]],
        dt: float,
        *,
        c: Mapping[str, Sequence[float]] | None = None,
        delay: int = 1,
        inputs: Sequence[str] | None = None,
    ) -> Polynomial:
        """The model with diagonal A and C, with coefficients listed as in papers.

        a: by output, from the first power on, without the leading 1.  b: by output and input, from q^delay on.
        c: as a.  inputs: their order, default the order of their names in b.
        """
        outputs, c = tuple(a), c or {}
        if set(b) - set(outputs) or set(c) - set(outputs):
            raise ValueError(
                f"from_coefficients needs a for every output, {', '.join({*b, *c})}, got it for {', '.join(outputs)}."
            )
        if delay < 1:
            raise ValueError(f"from_coefficients needs a delay of at least 1 sample, got {delay}.")
        named = tuple(dict.fromkeys(name for of_output in b.values() for name in of_output))
        order = named if inputs is None else tuple(inputs)
        if set(named) - set(order):
            raise ValueError(f"from_coefficients got b for inputs {', '.join(named)}, but inputs {', '.join(order)}.")
        longest = max((len(values) for of_output in b.values() for values in of_output.values()), default=0)
        filled = np.zeros((delay + longest, len(outputs), len(order)))
        for output, of_output in b.items():
            for name, values in of_output.items():
                filled[delay : delay + len(values), outputs.index(output), order.index(name)] = values
        return cls(_diagonal(outputs, a), filled, order, outputs, dt, _diagonal(outputs, c))

    def to_state_space(self) -> StateSpace:
        """The same model in observer form, with as many states for an output as the highest power in its row.

        Minimal if A is diagonal and no factor cancels.  The first state of an output is its prediction.
        Source: Kailath 1980, Linear Systems, sec. 6.4.
        """
        p, m = len(self.outputs), len(self.inputs)
        powers = max(len(self.a), len(self.b), len(self.c))
        a, b, c = (_padded(array, powers) for array in (self.a, self.b, self.c))
        used = np.any(np.concatenate([a, b, c], axis=2), axis=2)  # powers by outputs
        orders = [max(power for power in range(powers) if used[power, i]) or 1 for i in range(p)]
        at = np.concatenate([[0], np.cumsum(orders)])
        firsts = at[:-1]
        size = int(at[-1])
        matrix, drive, noise, read = (np.zeros((size, k)) for k in (size, m, p, p))
        for i, order in enumerate(orders):
            for power in range(1, min(order, powers - 1) + 1):
                row = firsts[i] + power - 1
                matrix[row, firsts] = -a[power, i]
                drive[row] = b[power, i]
                noise[row] = c[power, i] - a[power, i]
                if power < order:
                    matrix[row, row + 1] += 1.0
            read[firsts[i], i] = 1.0
        return StateSpace(
            matrix,
            drive,
            read.T,
            self.inputs,
            self.outputs,
            self.dt,
            k=noise,
            input_offset=self.input_offset,
            output_offset=self.output_offset,
            states=tuple(f"{name} {j + 1}" for name, order in zip(self.outputs, orders) for j in range(order)),
        )

    @cached_property
    def state_space(self) -> StateSpace:
        """The state-space form, cached, which the functions of the Model use."""
        return self.to_state_space()

    def to_control(self) -> Any:
        """The same system for python-control, in state space; offsets and C are lost, as it does not have them."""
        return self.state_space.to_control()

    @classmethod
    def from_control(
        cls, system: Any, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> Polynomial:
        """The output-error model of a discrete-time system of python-control: each output over its own denominator.

        Names are the system's unless given.  Raises as StateSpace.from_control does.
        """
        model = StateSpace.from_control(system, inputs, outputs)
        n = len(model.states)
        markov = [model.c @ np.linalg.matrix_power(model.a, k) @ model.b for k in range(n)]
        denominator = np.real(np.poly(model.a))
        p, m = len(model.outputs), len(model.inputs)
        a, b = np.zeros((n + 1, p, p)), np.zeros((n + 1, p, m))
        a[:] = denominator[:, None, None] * np.eye(p)
        for k in range(1, n + 1):
            b[k] = sum(denominator[j] * markov[k - 1 - j] for j in range(k))
        return cls(a, b, model.inputs, model.outputs, model.dt, c=a)

    @property
    def states(self) -> tuple[str, ...]:
        return self.state_space.states

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """The state with these outputs that is nearest to rest; see `StateSpace.initial`."""
        return self.state_space.initial(y0)

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state one sample later, shape (n_states,)."""
        return self.state_space.step(x, u)

    def output(self, x: np.ndarray) -> np.ndarray:
        """The outputs in a state, shape (n_outputs,)."""
        return self.state_space.output(x)

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state after measuring y, so that `predict` is the predictor of the polynomials."""
        return self.state_space.correct(x, y)

    def run(self, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
        """Outputs of free runs over windows of a record; see `StateSpace.run`."""
        return self.state_space.run(record, windows, starts)


def _diagonal(outputs: Sequence[str], rows: Mapping[str, Sequence[float]]) -> np.ndarray:
    powers = max((len(row) for row in rows.values()), default=0)
    array = np.zeros((powers + 1, len(outputs), len(outputs)))
    array[0] = np.eye(len(outputs))
    for i, output in enumerate(outputs):
        row = rows.get(output, ())
        array[1 : len(row) + 1, i, i] = row
    return array


def _padded(array: np.ndarray, powers: int) -> np.ndarray:
    return np.concatenate([array, np.zeros((powers - len(array), *array.shape[1:]))])
