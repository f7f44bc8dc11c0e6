"""Generalised predictive control: a plan over a horizon within limits, repeated at every sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import exp, inf, isfinite, pi
from typing import NamedTuple

import numpy as np

from auv_gym.channels import channel
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.param import did_you_mean
from controllers.controller import check_targets, target_of, time_step
from controllers.predictive.increments import Increments, polynomial_increments, state_space_increments
from controllers.predictive.program import Aims, Program, build, solver

Limits = Mapping[str, tuple[float, float]]

_SHARE = 0.01  # of a scale: default size of noise and drift
_ON_TIME = 1e-3  # of a sample, tolerance for times


class GpcState(NamedTuple):
    """Memory of a Gpc: estimate and command of its last plan, None before the first.

    reference: of each weighted output, minus the model's offset.  plan: the planned next commands, (k, m).
    elapsed: s since the estimate.  since: samples from the plan to it.  infeasible: number of plans without moves
    within the inputs' limits.
    """

    estimate: np.ndarray | None = None
    command: np.ndarray | None = None
    reference: np.ndarray | None = None
    plan: np.ndarray | None = None
    elapsed: float = 0.0
    since: int = 0
    flag: bool = False
    infeasible: int = 0


@dataclass(frozen=True, eq=False)
class Gpc:
    """Offset-free predictive control with any linear model, under constant disturbances and within limits.

    Minimises the squares of weights times errors, `first` to `horizon` steps ahead, and of move_weights times `moves`
    changes of the inputs.  A plan is made, and its steps last, `every` samples of the model; the filter uses each
    sample.
    weights: by output, 1 over an error that matters.  move_weights: by input, default 1 over half its range; all are
    multiplied by `effort`: the larger, the calmer.
    input_limits, rate_limits (per s, from plan to plan): hard.  output_limits: kept whenever possible, whatever the
    errors; otherwise, they are exceeded less for larger `soft`.  reference_time: s, in which the reference approaches
    the target.  nominal: default targets.  neutral: inputs before the first plan.  A StateSpace gets a Kalman filter;
    noise: standard deviations of its outputs, drift: of the change in a sample of each input's or output's disturbance,
    multiplied by drift_factor: the larger it is, the more the filter trusts its readings over the model.
    A Polynomial is treated as CARIMA, see `polynomial_increments` for observer.

    Example:

        >>> from auv_gym import linearise, load_vehicle
        >>> from controllers import Gpc
        >>> model = linearise(load_vehicle("slocum"), outputs=["heading_rad"])
        >>> loop = Gpc(model, weights={"heading_rad": 10.0}, input_limits={"rudder_rad": (-0.35, 0.35)})
        >>> command, memory = loop.act(loop.start(), {"heading_rad": 0.0}, {"heading_rad": 0.02})
        >>> round(command["rudder_rad"], 3)
        0.047
    """

    model: StateSpace | Polynomial
    weights: Mapping[str, float]
    horizon: int = 30
    moves: int = 10
    first: int = 1
    every: int = 1
    move_weights: Mapping[str, float] = field(default_factory=dict)
    effort: float = 1.0
    input_limits: Limits = field(default_factory=dict)
    rate_limits: Mapping[str, float] = field(default_factory=dict)
    output_limits: Limits = field(default_factory=dict)
    soft: float = 1e4
    reference_time: float = 0.0
    nominal: Mapping[str, float] = field(default_factory=dict)
    neutral: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    drift: Mapping[str, float] = field(default_factory=dict)
    drift_factor: float = 1.0
    observer: Sequence[float] = ()

    def __post_init__(self) -> None:
        solver()
        if not isinstance(self.model, StateSpace | Polynomial):
            raise ValueError(
                f"Gpc needs a linear model, a StateSpace or a Polynomial, got {type(self.model).__name__}: linearise it"
            )
        inputs, outputs = self.model.inputs, self.model.outputs
        for name, known in (
            *(("weights", outputs), ("output_limits", outputs), ("nominal", outputs), ("noise", outputs)),
            *(("move_weights", inputs), ("input_limits", inputs), ("rate_limits", inputs), ("neutral", inputs)),
            ("drift", (*inputs, *outputs)),
        ):
            for key in getattr(self, name):
                if key not in known:
                    raise ValueError(
                        f"Gpc's {name} name {key!r}, which the model has not. {did_you_mean(key, known)}Known: "
                        f"{', '.join(known)}."
                    )
        if not 1 <= self.first <= self.horizon or not 1 <= self.moves <= self.horizon:
            raise ValueError(
                f"Gpc needs 1 <= first <= horizon and 1 <= moves <= horizon, in steps, got first {self.first}, moves "
                f"{self.moves}, horizon {self.horizon}."
            )
        if self.every < 1:
            raise ValueError(f"Gpc needs a plan every 1 or more samples of its model, got every={self.every!r}.")
        if not self.weights or not all(0.0 < w < inf for w in self.weights.values()):
            raise ValueError(f"Gpc needs a weight above 0 for one or more outputs, got {dict(self.weights)}.")
        for name in ("move_weights", "rate_limits", "noise", "drift"):
            if not all(value > 0.0 for value in getattr(self, name).values()):
                raise ValueError(f"Gpc needs {name} above 0, got {dict(getattr(self, name))}.")
        for name in ("input_limits", "output_limits"):
            for key, (low, high) in getattr(self, name).items():
                if not low < high:
                    raise ValueError(f"Gpc needs {name} (low, high) with low < high, got {key}: ({low}, {high}).")
        for key in set(inputs) - set(self.move_weights) - set(self.input_limits):
            raise ValueError(f"Gpc needs a move weight or limits for every input, got neither for {key!r}.")
        factors = {name: getattr(self, name) for name in ("soft", "effort", "drift_factor")}
        if not all(0.0 < value < inf for value in factors.values()) or not 0.0 <= self.reference_time < inf:
            raise ValueError(
                f"Gpc needs {', '.join(factors)} above 0 and reference_time >= 0 s, got {factors} and "
                f"{self.reference_time!r}."
            )
        low, high = self._limits
        if ((self._neutral < low) | (self._neutral > high)).any():
            raise ValueError(
                f"Gpc needs neutral inputs within their limits, got {dict(zip(inputs, self._neutral.tolist()))} and "
                f"{dict(self.input_limits)}: give neutral=, or wider limits."
            )

    @property
    def targets(self) -> tuple[str, ...]:
        """The channels whose targets are required."""
        return tuple(name for name in self.model.outputs if name in self.weights and name not in self.nominal)

    @property
    def commands(self) -> tuple[str, ...]:
        return self.model.inputs

    def start(self) -> GpcState:
        return GpcState()

    def act(
        self, state: GpcState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], GpcState]:
        """The commands and `infeasible_flag`, and the next memory; between plans the commands are held.

        An output that is missing or NaN counts as predicted.  An input among the readings is what the vehicle received,
        if that differs from the command.  Without a feasible plan, the last plan continues.
        """
        parts, dt = self._parts, self.model.dt
        if state.estimate is None or state.command is None or state.reference is None:
            before = self._neutral
            measured = self._measured(reading)
            z = parts.increments.initial(measured, before)
            reference = (parts.increments.c @ z)[parts.tracked]
        else:
            elapsed = state.elapsed + time_step(reading)
            if elapsed < dt * (1.0 - _ON_TIME):
                return self._named(state.command, state.flag), state._replace(elapsed=elapsed)
            samples = round(elapsed / dt)
            if abs(elapsed - samples * dt) > _ON_TIME * dt or samples > self.every:
                raise ValueError(
                    f"This Gpc's model steps {dt:g} s at a time, {self.every} to a plan, got a call {elapsed:g} s "
                    f"after the last: call it every {dt:g} s or a whole fraction of that, or give it a model of the "
                    "interval of the calls."
                )
            before = np.array([reading.get(name, held) for name, held in zip(self.model.inputs, state.command)])
            before = np.where(np.isfinite(before), before, state.command)
            z, reference = state.estimate, state.reference
            was = z[parts.last] + self.model.input_offset
            z = parts.increments.a @ z + parts.increments.b @ (before - was)
            for _ in range(samples - 1):
                z = parts.increments.a @ z
            innovation = self._wrapped(self._measured(reading) - parts.increments.c @ z)
            z = z + parts.increments.gain @ np.where(np.isfinite(innovation), innovation, 0.0)
            since = state.since + samples
            if since < self.every:
                return self._named(state.command, state.flag), state._replace(estimate=z, elapsed=0.0, since=since)
        now = parts.increments.c @ z
        ahead = self._wanted(target) - now
        goal = (now + self._wrapped(ahead))[parts.tracked]
        moves = parts.program.solve(np.concatenate([z, goal, reference]))
        if moves is not None:
            plan = before + np.cumsum(moves, axis=0)
        elif state.plan is not None and len(state.plan):
            plan = state.plan
        else:
            plan = before[None, :]
        low, high = self._limits
        command = np.minimum(np.maximum(plan[0], low), high)
        flag = moves is None
        return self._named(command, flag), GpcState(
            estimate=z,
            command=command,
            reference=goal - parts.fading * (goal - reference),
            plan=plan[1:],
            flag=flag,
            infeasible=state.infeasible + flag,
        )

    @property
    def program(self) -> Program:
        """The quadratic program of every plan, for s = [estimate | goals | references]."""
        return self._parts.program

    @property
    def disturbances(self) -> tuple[str, ...]:
        """The disturbances that the filter assumes to drift: inputs by name, outputs as offsets."""
        return self._parts.increments.disturbances

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray]:
        pairs = [self.input_limits.get(name, (-inf, inf)) for name in self.model.inputs]
        return np.array([low for low, _ in pairs], dtype=float), np.array([high for _, high in pairs], dtype=float)

    @cached_property
    def _neutral(self) -> np.ndarray:
        default = dict(zip(self.model.inputs, self.model.input_offset))
        return np.array([float(self.neutral.get(name, default[name])) for name in self.model.inputs])

    @cached_property
    def _parts(self) -> _Parts:
        model = self.model
        low, high = self._limits
        half = np.where(np.isfinite(high - low), 0.5 * (high - low), 1.0)
        move_weights = np.array([self.move_weights.get(name, 1.0 / h) for name, h in zip(model.inputs, half)])
        scales = np.array([self._scale(name) for name in model.outputs])
        if isinstance(model, Polynomial):
            increments = polynomial_increments(model, self.observer)
        else:
            noise = np.array([self.noise.get(name, _SHARE * s) for name, s in zip(model.outputs, scales)])
            sizes = np.concatenate([half, scales])
            names = (*model.inputs, *model.outputs)
            drift = np.array([self.drift.get(name, _SHARE * size) for name, size in zip(names, sizes)])
            increments = state_space_increments(model, noise, self.drift_factor * drift, sizes)
        ends = [self.output_limits.get(name, (-inf, inf)) for name in model.outputs]
        step = self.every * model.dt
        fading = exp(-step / self.reference_time) if self.reference_time > 0.0 else 0.0
        program = build(
            increments.held_for(self.every),
            Aims(
                horizon=self.horizon,
                moves=self.moves,
                first=self.first,
                weights=np.array([self.weights.get(name, 0.0) for name in model.outputs]),
                move_weights=self.effort * move_weights,
                lowest=low - model.input_offset,
                highest=high - model.input_offset,
                rates=step * np.array([self.rate_limits.get(name, inf) for name in model.inputs]),
                output_lowest=np.array([low for low, _ in ends]) - model.output_offset,
                output_highest=np.array([high for _, high in ends]) - model.output_offset,
                fading=fading,
                soft=self.soft,
            ),
        )
        m = len(model.inputs)
        return _Parts(
            increments=increments,
            program=program,
            tracked=np.array([i for i, name in enumerate(model.outputs) if name in self.weights]),
            last=slice(increments.a.shape[0] - m, None),
            angles=np.array([channel(name).angle for name in model.outputs]),
            fading=fading,
        )

    def _scale(self, name: str) -> float:
        """The size of an output that matters, in its unit."""
        low, high = self.output_limits.get(name, (-inf, inf))
        half = 0.5 * (high - low)
        return 1.0 / self.weights[name] if name in self.weights else half if isfinite(half) else 1.0

    def _measured(self, reading: Mapping[str, float]) -> np.ndarray:
        return np.array([reading.get(name, np.nan) for name in self.model.outputs]) - self.model.output_offset

    def _wanted(self, target: Mapping[str, float]) -> np.ndarray:
        check_targets(self, target)
        asked = {name: target.get(name, usual) for name, usual in self.nominal.items()}
        asked |= {name: target_of(self, name, target) for name in self.targets}
        wanted = [asked[name] if name in self.weights else 0.0 for name in self.model.outputs]
        return np.array(wanted) - self.model.output_offset

    def _wrapped(self, difference: np.ndarray) -> np.ndarray:
        turned = (difference + pi) % (2.0 * pi) - pi
        return np.where(self._parts.angles, turned, difference)

    def _named(self, command: np.ndarray, flag: bool) -> dict[str, float]:
        return {**dict(zip(self.model.inputs, command.tolist())), "infeasible_flag": float(flag)}


@dataclass(frozen=True, eq=False)
class _Parts:
    """Quantities that depend on the settings alone."""

    increments: Increments
    program: Program
    tracked: np.ndarray
    last: slice
    angles: np.ndarray
    fading: float
