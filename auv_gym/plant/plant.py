"""Plant: a vehicle and its effects, integrated, as a Model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np

from auv_gym.model import check_finite, in_short
from auv_gym.param import check_number, list_paths, pack, replace_at, spec_at, value_at
from auv_gym.plant.rollout import Programs, bind_family, scratch_for
from auv_gym.plant.runs import Correction, Runs, shared_out
from auv_gym.records.record import Record
from auv_gym.vehicles import Family
from auv_gym.vehicles.body.learned_hull import LearnedHull

_EFFECTS = "effects."


@dataclass(frozen=True, repr=False)
class Plant:
    """A vehicle and its effects as a Model.

    dt: s, the sample over which `step` holds its inputs.  longest_step: s, the largest RK4 step within a sample.
    window: s, default length of free runs for judging models of the vehicle.  settle: s, their first part, to which
    starts are fitted.  notes: the origin of each number, by path.  deviations: standard deviation of the prior
    knowledge of a coefficient or an effect, in its unit, by path.  fitted_to: the logs to which its numbers were
    fitted.  learned: replaces the hull's forces, see `LearnedHull`.

    Example:

        >>> from auv_gym import load_vehicle
        >>> glider = load_vehicle("slocum")
        >>> glider.outputs
        ('heading_rad', 'r_radps', 'north_m', 'east_m')
        >>> glider.inputs[0], glider.dt, glider.effects.rudder.gain
        ('rudder_rad', 4.0, 1.0)
    """

    name: str
    family: Family
    parameters: Any
    dt: float = 1.0
    longest_step: float = 0.5
    window: float = 120.0
    settle: float = 20.0
    title: str = ""
    description: str = ""
    notes: Mapping[str, str] = field(default_factory=dict, compare=False)
    deviations: Mapping[str, float] = field(default_factory=dict, hash=False)
    fitted_to: str = ""
    learned: LearnedHull | None = None

    def __post_init__(self):
        for path, deviation in self.deviations.items():
            check_deviation(self.parameters, path, deviation)
        if self.learned is not None and not self.family.learns:
            raise ValueError(
                f"A learned hull belongs to a vehicle in six degrees of freedom, got {self.name!r} of family "
                f"{self.family.name!r}."
            )
        for label, value in (("dt", self.dt), ("longest_step", self.longest_step), ("window", self.window)):
            check_number(f"A plant's {label}", value, "s", above=0.0)
        if not 0.0 < self.settle < 0.5 * self.window:
            raise ValueError(
                f"A plant needs settle > 0 s and under half of its window of {self.window:g} s, got {self.settle!r}."
            )

    def __repr__(self) -> str:
        values = ((path, value_at(self, path)) for path in list_paths(self) if path.startswith(_EFFECTS))
        present = [f"{path} = {value:.4g}" for path, value in values if value != spec_at(self, path).neutral]
        return f"Plant({self.name!r}: {self.title or self.family.title}; effects: {', '.join(present) or 'none'})"

    @property
    def hull(self) -> Any:
        return self.parameters.hull

    @property
    def parts(self) -> Any:
        """The parameters of the parts of a vehicle in six degrees of freedom, by name."""
        return self.parameters.parts

    @property
    def effects(self) -> Any:
        return self.parameters.effects

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.family.inputs

    @property
    def interpolated(self) -> tuple[str, ...]:
        """Inputs whose mean over a record's interval is used."""
        return self.family.interpolated

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.family.outputs

    @property
    def states(self) -> tuple[str, ...]:
        f = self.family
        past = [f"{name}[-{age}]" for age in range(self.history - 1, -1, -1) for name in f.actuators]
        positions_, memories = [f"{a} position" for a in f.actuators], [f"{a} play" for a in f.actuators]
        return (*f.states, *positions_, *memories, *f.sensors, *past)

    @cached_property
    def _size(self) -> int:
        return len(self.states)

    @cached_property
    def constants(self) -> dict[str, float]:
        """Values of the inputs that a record may lack."""
        named = self.family.constants
        return {
            name: value_at(self, named[name]) if name in named else 0.0
            for name in self.family.inputs
            if name not in self.family.required
        }

    @cached_property
    def coefficients(self) -> tuple[str, ...]:
        """The paths that a first fit frees: those of the family, and those with a standard deviation of their own.

        Terms that are zero in the vehicle are excluded, except those that it must have (`Family.unstated`).  Effects
        that the vehicle states as neutral are excluded, too: a diagnosis searches for them.
        """
        own = tuple(
            path
            for path in self.family.coefficients
            if value_at(self, path) != 0.0 or path in self.deviations or path in self._unstated
        )
        return (*own, *(path for path in self.deviations if path not in own and not self._neutral(path)))

    @cached_property
    def _unstated(self) -> Mapping[str, float]:
        return self.family.unstated(self.parameters)

    def _neutral(self, path: str) -> bool:
        return path.startswith(_EFFECTS) and value_at(self, path) == spec_at(self, path).neutral

    @cached_property
    def doubted(self) -> tuple[str, ...]:
        """The paths of all coefficients that are not known exactly; those of a first fit come first."""
        first = self.coefficients
        return (*first, *(path for path in self.family.doubted(self.parameters) if path not in first))

    @property
    def twins(self) -> dict[str, str]:
        """The effects that are equivalent to a coefficient, with the coefficient's path."""
        same = {effect: path for effect, (path, _) in self.family.coefficients_of(self.parameters).items()}
        return same | dict(self.family.twins)

    def deviation(self, path: str, doubt: float) -> float:
        """The standard deviation of the prior knowledge of a parameter, in its unit; infinite if there is none.

        doubt: relative standard deviation of coefficients without one of their own; 0 holds all of them, and infinity
        frees all of them and the effects for which the vehicle states one.
        """
        if np.isinf(doubt):
            return np.inf
        if path not in self.doubted:
            return self.deviations.get(path, np.inf)
        if doubt == 0.0:
            return 0.0
        return self.deviations.get(path, doubt * abs(value_at(self, path)) or self._unstated.get(path, np.inf))

    @cached_property
    def vector(self) -> np.ndarray:
        """The parameters in the order of `list_paths` for the compiled functions; then the learned table."""
        return pack(self) if self.learned is None else np.concatenate([pack(self), self.learned.table])

    @cached_property
    def derived(self) -> np.ndarray:
        """The input of the compiled programs: the parameters, and everything that depends on them alone."""
        derived = np.zeros(self.family.derived + (0 if self.learned is None else self.learned.table.size))
        self.programs.derive(self.vector.copy(), derived)  # a copy: read-only arrays would be compiled separately
        return derived

    @cached_property
    def _work_size(self) -> int:
        return scratch_for(self.family).size

    @property
    def programs(self) -> Programs:
        """The compiled programs; looked up each time, since cached attributes are pickled with the plant."""
        return bind_family(self.family)

    @cached_property
    def _measured(self) -> tuple[list[int], list[int]]:
        """Indices of the outputs that measure a state, and of those states; velocity over ground measures none."""
        names = [name for name in self.outputs if name in self.family.states]
        return [self.outputs.index(name) for name in names], [self.family.states.index(name) for name in names]

    @cached_property
    def _of_actuators(self) -> np.ndarray:
        """Which entries of the full state, after the family's states, are actuators' positions or commands."""
        among = np.ones(self._size - len(self.family.states), dtype=bool)
        sensors_at = 2 * len(self.family.actuators)
        among[sensors_at : sensors_at + len(self.family.sensors)] = False
        return among

    @cached_property
    def _rest(self) -> np.ndarray:
        """The resting value of each of these entries: the family's constant for the input, or zero."""
        named = self.family.constants
        rest = [value_at(self, named[name]) if name in named else 0.0 for name in self.family.actuators]
        return np.tile(rest, 2 + self.history)

    @cached_property
    def history(self) -> int:
        """The number of samples whose commands the full state keeps: the longest dead time in samples, plus one."""
        clock = self.effects.clock
        longest = max((value_at(self, p) for p in list_paths(self) if p.endswith(".dead_time")), default=0.0)
        return max(ceil(((1.0 + clock.rate) * longest + clock.delay) / self.dt - 1e-9), 0) + 1

    @cached_property
    def ages(self) -> np.ndarray:
        """Times, s, of the commands in the full state, ending at 0, then the end of the sample."""
        return self.dt * np.arange(1 - self.history, 2.0)

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """A state with these outputs where they are finite, zero otherwise; actuators at rest, sensors settled.

        If a reading of speed through the water is missing, speed over ground is used instead.
        """
        x = np.zeros(self._size)
        x[len(self.family.states) :][self._of_actuators] = self._rest
        known = dict(zip(self.outputs, np.asarray(y0, dtype=float), strict=True))
        for index, name in enumerate(self.family.states):
            for output in (name, self.family.nearly.get(name, name)):
                if np.isfinite(known.get(output, np.nan)):
                    x[index] = known[output]
                    break
        for _ in range(3):  # fixed-point iteration: the compass's lag depends on the heading, because of the deviation
            self.programs.settle(x, self.derived)
            x = self.correct(x, y0)
        return x

    def settled(self, states: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The full state with these states of the family, with actuators long settled at the inputs."""
        actuators, n = len(self.family.actuators), len(self.family.states)
        x = np.zeros(self._size)
        x[:n] = states
        u, memory, positions = np.array(u, dtype=np.float64), np.zeros(actuators), np.zeros(actuators)
        for _ in range(2):  # the first pass sets the play, which starts in its middle
            self.family.hooks.shape(u, memory, self.family.view(self.derived), positions)
            memory[:] = positions
        x[n : n + actuators] = x[n + actuators : n + 2 * actuators] = positions
        x[x.size - self.history * actuators :] = np.tile(positions, self.history)
        self.programs.settle(x, self.derived)
        return x

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state one sample later, shape (n_states,); u: the inputs in order, in the channels' units."""
        return self._advance(x, u, self.ages)

    def step_over(self, x: np.ndarray, u: np.ndarray, duration: float) -> np.ndarray:
        """The state `duration` s later; earlier commands count as held for dt each."""
        ages = self.ages.copy()
        ages[-1] = duration
        return self._advance(x, u, ages)

    def _advance(self, x: np.ndarray, u: np.ndarray, ages: np.ndarray) -> np.ndarray:
        next_x, u = np.array(x, dtype=np.float64), np.ascontiguousarray(u, dtype=np.float64)
        if next_x.shape != (self._size,) or u.shape != (len(self.inputs),):  # compiled code does not check indices
            raise ValueError(
                f"A step of {self.name} needs a state of shape ({self._size},), as `initial` returns it, and "
                f"inputs of shape ({len(self.inputs)},): {', '.join(self.inputs)}; got {next_x.shape} and {u.shape}."
            )
        self.programs.step(next_x, u, ages, self.longest_step, self.derived, np.empty(self._work_size))
        return next_x

    def output(self, x: np.ndarray) -> np.ndarray:
        """The outputs as the sensors give them, shape (n_outputs,)."""
        x = np.ascontiguousarray(x, dtype=np.float64)
        if x.shape != (self._size,):
            raise ValueError(f"A state of {self.name} has shape ({self._size},), got {x.shape}: see `initial`.")
        y = np.empty(len(self.outputs))
        self.programs.read(x, self.derived, y)
        return y

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state moved so that its outputs are y where y is finite; the rest of the state is kept."""
        measured, states = self._measured
        x, y = np.array(x, dtype=float), np.asarray(y, dtype=float)[measured]
        for _ in range(100):  # fixed-point iteration: the compass deviation depends on the heading
            error = y - self.output(x)[measured]
            if not np.any(np.abs(error) > 1e-13 * (1.0 + np.abs(y))):
                break
            x[states] += np.where(np.isfinite(error), error, 0.0)
        return x

    def run(self, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
        """Outputs of free runs over windows of a record, shape (total rows, n_outputs).

        starts: (n_windows, at least the family's states), the states at the windows' first rows; commands before a
        window, in its segment, are taken into account.  Raises Diverged.
        """
        size = len(self.family.states)
        y = self.run_many(Runs.over(self, record, windows), self.vector[None, :], starts[None, :, :size])[0]
        times = np.concatenate([record.time[w] for w in windows])
        check_finite(self.outputs, times, y)
        return y

    def run_many(self, runs: Runs, vectors: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Outputs for several parameter vectors (S, n) and starts (S, W, n_states): (S, rows, n_outputs), unchecked."""
        expected = (vectors.shape[0], runs.begin.size, len(self.family.states))
        if vectors.shape[1:] != self.vector.shape or starts.shape != expected:
            raise ValueError(
                f"run_many needs parameter vectors of shape (S, {self.vector.size}) and starts of shape {expected}, "
                f"got {vectors.shape} and {starts.shape}: see `vector` and `family.states`."
            )
        y = np.empty((vectors.shape[0], runs.rows, len(self.outputs)))
        vectors, starts = (np.ascontiguousarray(a, dtype=np.float64) for a in (vectors, starts))
        free = Correction.none(self, runs)
        shared_out(len(vectors), runs.rows, lambda part: self._run(runs, vectors[part], starts[part], free, y[part]))
        return y

    def _run(
        self,
        runs: Runs,
        vectors: np.ndarray,
        starts: np.ndarray,
        c: Correction,
        y: np.ndarray,
        after: Any = None,
        earlier: Sequence[tuple[int, np.ndarray]] = (),
    ) -> None:
        """Write the runs into y; earlier: pairs of a row and the parameters by which actuators moved up to it."""
        after = np.empty((0, runs.rows, starts.shape[2])) if after is None else after
        until = np.array([row for row, _ in earlier], dtype=np.int64)
        count, parameters = vectors.shape
        before = np.stack([own for _, own in earlier], axis=1) if earlier else np.empty((count, 0, parameters))
        windows = (runs.begin, runs.stop, c.carried, c.constant)
        times = (runs.times, runs.inputs, runs.first, runs.references, self.longest_step, runs.stride, runs.shares)
        corrected = (c.measured, c.gains, c.moved, c.told, c.kicks, c.decays)
        starts = np.ascontiguousarray(starts)  # each memory layout would be compiled separately
        self.programs.rollout(vectors, starts, *windows, *times, *corrected, before, until, y, after)

    def pieces(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows at which the parameters change, (E,), and the parameters before, between and after, (E + 1, n).

        vector: (n,), its parameters, which do not change along a record here.
        """
        return np.empty(0, dtype=np.int64), np.ascontiguousarray(vector[None], dtype=np.float64)

    def follow_many(
        self, runs: Runs, vectors: np.ndarray, starts: np.ndarray, correction: Correction, keep: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Runs that are corrected at every row, for several parameter vectors (S, n), unchecked.

        starts: (S or 1, W, F), F states, sensor states and accelerations.  Returns the outputs before each correction,
        (S, rows, n_outputs), and with `keep` the states one row later, (S, rows, F).
        """
        rows = runs.rows
        vectors, starts = (np.ascontiguousarray(a, dtype=np.float64) for a in (vectors, starts))
        y = np.empty((len(vectors), rows, len(self.outputs)))
        after = np.empty((len(vectors) if keep else 0, rows, starts.shape[2]))

        def run(part: slice) -> None:
            own = starts if len(starts) == 1 else starts[part]
            self._run(runs, vectors[part], own, correction, y[part], after[part] if keep else after)

        shared_out(len(vectors), rows * runs.stride, run)
        return y, after


def check_deviation(parameters: Any, path: str, deviation: Any) -> None:
    """Raise unless a standard deviation is valid for a coefficient or an effect at a path."""
    unit = spec_at(parameters, path).unit
    if not path.startswith(("hull.", "parts.", _EFFECTS)):
        raise ValueError(f"{path} cannot have a deviation: only numbers of the hull and of parts, and effects, do.")
    number = isinstance(deviation, int | float | np.floating) and not isinstance(deviation, bool)
    if not number or not 0.0 <= deviation < np.inf:
        raise ValueError(
            f"{path} needs a deviation of at least 0 {unit} (one standard deviation; 0 holds the value), got "
            f"{deviation!r}."
        )


def check_vehicle(name: str, given: Any) -> None:
    """Raise an error that names the caller, `name`, if this is neither a vehicle nor acts as one."""
    if not hasattr(given, "dt"):  # a simulator of another make may stand in
        hint = f"load_vehicle({given!r})" if isinstance(given, str) else "what load_vehicle returns"
        raise ValueError(f"{name} needs a vehicle, got {in_short(given)}: give {hint}.")


def without_effects(plant: Plant) -> Plant:
    """The plant with every effect neutral.

    Example:

        >>> from auv_gym import load_vehicle, replace_at, without_effects
        >>> bent = replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.03)
        >>> without_effects(bent).effects.rudder.offset
        0.0
    """
    effects = [path for path in list_paths(plant) if path.startswith("effects.")]
    return replace_at(plant, {path: spec_at(plant, path).neutral for path in effects})
