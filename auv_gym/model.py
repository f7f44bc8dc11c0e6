"""The Model protocol of envs and fits, optional protocols beside it, free runs and prediction."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from auv_gym.records.record import Record

_MOST_TOLD = 4  # values in a sentence
_MOST_SHOWN = 60  # characters of a wrong value in an error


@runtime_checkable
class Model(Protocol):
    """A discrete-time system without direct feedthrough; inputs are held over each sample.

    inputs, states, outputs: channel names.  dt: s.  State vectors are passed in and returned, never kept.
    """

    @property
    def inputs(self) -> tuple[str, ...]: ...

    @property
    def states(self) -> tuple[str, ...]: ...

    @property
    def outputs(self) -> tuple[str, ...]: ...

    @property
    def dt(self) -> float: ...

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """A state with these outputs, shape (n_states,)."""
        ...

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state one sample later; pure."""
        ...

    def output(self, x: np.ndarray) -> np.ndarray:
        """The outputs in a state, shape (n_outputs,)."""
        ...

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state after measuring y (NaN: not measured); this distinguishes prediction from simulation."""
        ...


@runtime_checkable
class Supplied(Protocol):
    """A model with default values for inputs that a record may not have."""

    @property
    def constants(self) -> Mapping[str, float]: ...


@runtime_checkable
class Continuous(Protocol):
    """A model in continuous time, which takes steps of any length."""

    def step_over(self, x: np.ndarray, u: np.ndarray, duration: float) -> np.ndarray:
        """The state `duration` s later; pure."""
        ...


@runtime_checkable
class Interpolating(Protocol):
    """A model with inputs that a record samples and does not hold: it uses their mean over each interval."""

    @property
    def interpolated(self) -> tuple[str, ...]: ...


@runtime_checkable
class Runner(Protocol):
    """A model that computes whole free runs faster than step by step."""

    def run(self, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
        """Outputs over windows from these states, (W, n_states), one window after the other: (rows, n_outputs)."""
        ...


@runtime_checkable
class Spread(Protocol):
    """A model whose states have a scale beyond which a fitted start is meaningless."""

    @property
    def start_spread(self) -> np.ndarray: ...


@runtime_checkable
class Trained(Protocol):
    """A model trained on data, which can say how far a record lies outside of them."""

    def outside(self, record: Record) -> float:
        """The share of a record's samples that are outside of the training data."""
        ...


def check_model(name: str, given: object) -> None:
    """Raise an error that names the caller, `name`, if this is not a model."""
    if isinstance(given, Model):
        return
    if isinstance(getattr(given, "model", None), Model):
        hint = "give the fit's model, fit.model"
    elif isinstance(given, str | os.PathLike):
        hint = "load_model reads a model file, and load_vehicle a vehicle"
    else:
        hint = "it has inputs, states, outputs, dt, initial, step, output and correct"
    raise ValueError(f"{name} needs a model, got {in_short(given)}: {hint}.")


def in_short(given: object) -> str:
    """A value as an error shows it: itself if it is short, otherwise its type."""
    shown = repr(given)
    return shown if len(shown) <= _MOST_SHOWN else f"a {type(given).__name__}"


def model_constant_inputs(model: Model) -> Mapping[str, float]:
    """The model's default values of inputs, by channel."""
    return model.constants if isinstance(model, Supplied) else {}


class Diverged(RuntimeError):
    """A simulation diverged; states when, in which channel, and the last finite values.

    Example:

        >>> from auv_gym import Diverged
        >>> error = Diverged(12.5, "pitch_rad", {"pitch_rad": 7.3})
        >>> error.time, error.channel
        (12.5, 'pitch_rad')
    """

    def __init__(self, time: float, channel: str, last: dict[str, float]):
        self.time, self.channel, self.last = time, channel, last
        told = sorted(last, key=lambda name: (name != channel, -abs(last[name])))[:_MOST_TOLD]
        values = ", ".join(f"{name} {last[name]:.4g}" for name in told)
        which = "last finite values" if len(told) == len(last) else "largest of the last finite values"
        super().__init__(
            f"The run diverged: {channel} is not finite at {time:.3f} s; {which}: {values}. "
            "Lower the step or check the model's coefficients."
        )


def inputs_of(model: Model, record: Record) -> np.ndarray:
    """The record's inputs in the model's order, shape (n, n_inputs); channels with a default value may be missing.

    `elapsed_s` is that of `elapsed_over_gaps` if the record does not have it.  Interpolated inputs are taken at the
    middle of the interval that a row begins.
    """
    constants = {name: np.full(record.time.size, value) for name, value in model_constant_inputs(model).items()}
    if "elapsed_s" in constants:
        constants["elapsed_s"] = elapsed_over_gaps(record)
    columns = [record[name] if record.has(name) or name not in constants else constants[name] for name in model.inputs]
    if isinstance(model, Interpolating) and model.interpolated:
        within = np.ones(max(record.time.size - 1, 0), dtype=bool)  # not across segments
        within[[s.start - 1 for s in record.segments if s.start]] = False
        for k, name in enumerate(model.inputs):
            if name in model.interpolated:
                columns[k] = columns[k] + np.r_[0.5 * np.where(within, np.diff(columns[k]), 0.0), 0.0]
    return np.ascontiguousarray(np.stack(columns, axis=1)) if columns else np.empty((record.time.size, 0))


def elapsed_over_gaps(record: Record) -> np.ndarray:
    """Time since each sample's log or dive began, s, shape (n,); it continues over gaps within.

    Consecutive segments with the same label are one log or dive, unless time goes back between them.
    """
    time, labels, begun = record.time, record.labels, np.empty(len(record))
    origin = 0.0
    for number, segment in enumerate(record.segments):
        first = segment.start
        if not number or labels[number] != labels[number - 1] or time[first] < time[first - 1]:
            origin = time[first]
        begun[segment] = origin
    return time - begun


def elapsed_in(record: Record) -> np.ndarray:
    """The time that effects which grow with time count, s, shape (n,): the record's own, or `elapsed_over_gaps`."""
    return record["elapsed_s"] if record.has("elapsed_s") else elapsed_over_gaps(record)


def outputs_of(model: Model, record: Record) -> np.ndarray:
    """The record's outputs in the model's order, shape (n, n_outputs), NaN if a channel was not measured."""
    missing = np.full(record.time.size, np.nan)
    return np.stack([record[name] if record.has(name) else missing for name in model.outputs], axis=1)


def simulate(model: Model, record: Record) -> Record:
    """Simulate each segment of a record as a free run, from its first measured outputs and its inputs alone.

    The result is the record with the model's outputs in place of the measured ones. A plant integrates to the record's
    own times; other models raise if their dt is not its sample interval. Raises Diverged if a run leaves the finite
    numbers.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, replace_at, simulate
        >>> from identification import closed_loop
        >>> glider = load_vehicle("slocum")
        >>> bent = replace_at(glider, "effects.rudder.offset", 0.03)
        >>> log = closed_loop(bent, rng=np.random.default_rng(0), duration=300)
        >>> round(float(simulate(glider, log)["heading_rad"][-1] - log["heading_rad"][-1]), 2)
        -0.67
    """
    check_model("simulate", model)
    measured = outputs_of(model, record)
    if not isinstance(model, Continuous):
        for segment in record.segments:
            check_interval(model, record.time[segment])
    starts = np.array([model.initial(measured[s.start]) for s in record.segments])
    return _with_outputs(model, record, run_free(model, record, record.segments, starts))


def run_free(model: Model, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
    """Outputs of free runs over windows from these states, (W, n_states), one after the other: (rows, n_outputs)."""
    if isinstance(model, Runner):
        return model.run(record, windows, starts)
    inputs, result = inputs_of(model, record), []
    for window, x in zip(windows, starts, strict=True):
        for k in range(window.start, window.stop):
            result.append(model.output(x))
            x = model.step(x, inputs[k])
    return np.array(result).reshape(-1, len(model.outputs))


def predict(model: Model, record: Record, horizon: int = 1, starts: np.ndarray | None = None) -> Record:
    """Predict `horizon` samples ahead, each time by a free run from the state corrected with all earlier measurements.

    The first `horizon` samples of a segment are a free run from its start: starts, (segments, n_states), by default
    those of `initial`, which corrections may take long to improve. Raises as `simulate` does.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, predict
        >>> from identification import closed_loop
        >>> glider = load_vehicle("slocum")
        >>> log = closed_loop(glider, rng=np.random.default_rng(0))
        >>> ahead = predict(glider, log, horizon=5)
        >>> round(float(np.std(ahead["heading_rad"] - log["heading_rad"])), 3)
        0.027
    """
    check_model("predict", model)
    if horizon < 1:
        raise ValueError(f"predict needs a horizon of at least 1 sample, got {horizon}: 1 is one step ahead.")
    inputs, measured = inputs_of(model, record), outputs_of(model, record)
    result, stepped = np.empty_like(measured), stepper(model)
    for number, segment in enumerate(record.segments):
        times = record.time[segment]
        if not isinstance(model, Continuous):
            check_interval(model, times)

        def advance(x, k, times=times, start=segment.start):
            return stepped(x, inputs[start + k], float(times[k + 1] - times[k]))

        corrected = [model.initial(measured[segment.start]) if starts is None else starts[number]]
        for k in range(times.size - 1):
            corrected.append(model.correct(advance(corrected[k], k), measured[segment.start + k + 1]))
        for k in range(times.size):
            origin = max(k - horizon, 0)
            x = corrected[origin]
            for j in range(origin, k):
                x = advance(x, j)
            result[segment.start + k] = model.output(x)
    return _with_outputs(model, record, result)


def stepper(model: Model) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    """The step of a model over a duration in seconds; a discrete model always steps by its own sample."""
    return model.step_over if isinstance(model, Continuous) else lambda x, u, _: model.step(x, u)


def check_interval(model: Model, times: np.ndarray) -> None:
    """Raise if a model in discrete time does not fit these times, s."""
    intervals = np.diff(times)
    if intervals.size and np.max(np.abs(intervals - model.dt)) > 1e-3 * model.dt:
        raise ValueError(
            f"This model steps {model.dt:g} s at a time, got samples {intervals.min():g} to {intervals.max():g} s "
            f"apart: call record.resample({model.dt:g}) first, or fit the model at the record's own interval."
        )


def check_finite(outputs: tuple[str, ...], times: np.ndarray, y: np.ndarray) -> None:
    """Raise Diverged at the first value of y, shape (n, n_outputs), that is not finite."""
    bad = ~np.isfinite(y)
    if bad.any():
        row = int(np.argmax(bad.any(axis=1)))
        last = dict(zip(outputs, map(float, y[max(row - 1, 0)]), strict=True))
        raise Diverged(float(times[row]), outputs[int(np.argmax(bad[row]))], last)


def _with_outputs(model: Model, record: Record, result: np.ndarray) -> Record:
    check_finite(model.outputs, record.time, result)
    return record.with_channels(dict(zip(model.outputs, result.T, strict=True)))
