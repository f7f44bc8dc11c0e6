"""A controller with excitation of its commands or targets, for closed-loop experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import floor, inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from auv_gym.channels import channel
from controllers.composed.loops import commanded_inputs, targets_of
from controllers.controller import Controller, time_step


class ExcitedState(NamedTuple):
    """Memory of the controller, and the time since it first acted, s (None: not yet)."""

    controller: Any
    elapsed: float | None


@dataclass(frozen=True, eq=False)
class Excited:
    """A controller with excitation signals added to its commands or targets.

    signals: one sample every dt by channel, zero after the last: an actuator's is added to the command, a set point's
    (`depth_m`) to the target, one of a thrusters' wrench (`heave_N`) to the wanted wrench.
    at_rest: commands of actuators that the controller does not command, about which a signal moves them.
    Limits are the vehicle's: an environment clips the sum.
    Reports `excitation_<channel>`, the added value.

    Example:

        >>> from controllers import Excited, Pid
        >>> loop = Excited(Pid(1.0), {"rudder_rad": [0.1, -0.1]}, dt=1.0)
        >>> command, memory = loop.act(loop.start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 0.2})
        >>> round(command["rudder_rad"], 3)
        0.3
    """

    controller: Controller
    signals: Mapping[str, np.ndarray]
    dt: float
    at_rest: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 < self.dt < inf:
            raise ValueError(f"Excited needs dt > 0 s, the time between samples of its signals, got {self.dt!r}.")
        for name, values in self.signals.items():
            channel(name)  # raises if it is unknown
            values = np.asarray(values, dtype=float)
            if values.ndim != 1 or not np.isfinite(values).all():
                raise ValueError(f"Excited needs a finite signal of shape (n,) at {name}, got shape {values.shape}.")
        own = (*commanded_inputs(self.controller), *targets_of(self.controller))
        if own:  # a controller that does not list its commands is checked when it acts
            known = (*own, *self.at_rest, *added_by(self.controller))
            self._check_channels(known, commanded_inputs(self.controller), targets_of(self.controller))

    @property
    def targets(self) -> tuple[str, ...]:
        return targets_of(self.controller)

    @property
    def commands(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*commanded_inputs(self.controller), *self.at_rest)))

    @property
    def adds(self) -> tuple[str, ...]:
        return added_by(self.controller)

    def start(self) -> ExcitedState:
        return ExcitedState(self.controller.start(), None)

    def act(
        self, state: ExcitedState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], ExcitedState]:
        elapsed = 0.0 if state.elapsed is None else state.elapsed + time_step(reading)
        at = floor(elapsed / self.dt + 1e-6)  # times are sums of intervals, with rounding
        added = {name: float(values[at]) if at < len(values) else 0.0 for name, values in self.signals.items()}
        wanted = {name: value + added.get(name, 0.0) for name, value in target.items()}
        apart = [name for name in added_by(self.controller) if name in added and name not in wanted]
        wanted |= {name: added[name] for name in apart}
        command, inner = self.controller.act(state.controller, reading, wanted)
        command = {**self.at_rest, **command}
        self._check_channels((*command, *wanted), tuple(command), tuple(target))
        moved = {name: command[name] + value for name, value in added.items() if name in command and name not in wanted}
        reports = {f"excitation_{name}": value for name, value in added.items()}
        return {**command, **moved, **reports}, ExcitedState(inner, elapsed)

    def _check_channels(self, known: tuple[str, ...], commands: tuple[str, ...], targets: tuple[str, ...]) -> None:
        for name in self.signals:
            if name not in known:
                raise ValueError(
                    f"No place for an excitation of {name}: the controller commands {', '.join(commands) or 'nothing'} "
                    f"and is told {', '.join(targets) or 'nothing'}. Excite one of these, or give at_rest={{{name!r}: "
                    "...}, the command around which to move an actuator that it leaves alone."
                )


def added_by(controller: Controller) -> tuple[str, ...]:
    """The channels, such as a wrench's, whose targets a controller adds to its output, if it lists them."""
    return tuple(getattr(controller, "adds", ()))


def command_without_excitation(command: Mapping[str, float]) -> dict[str, float]:
    """A command without the contributions of excitations, which are reported as zero."""
    plain = dict(command)
    for name, value in command.items():
        moved = name.removeprefix("excitation_")
        if moved != name and isfinite(value):
            plain[name] = 0.0
            if moved in command:
                plain[moved] = command[moved] - value
    return plain
