"""Composed controllers: one sets another's target, several side by side, one command for two planes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from auv_gym.channels import is_flag, set_point_of
from controllers.controller import Controller, check_targets


class CascadeState(NamedTuple):
    """Memories of the outer and the inner controller."""

    outer: Any
    inner: Any


@dataclass(frozen=True)
class Cascade:
    """The outer controller's commands are the inner one's targets: depth to pitch, pitch to stern plane.

    The outer controller's output is reported as a set point (`pitch_cmd_rad`). An outer integral does not notice when
    an inner command is at its limit: give it an `integral_range`.

    Example:

        >>> from controllers import Cascade, Pid
        >>> depth = Pid(-0.1, measured="depth_m", command="pitch_rad", limit=0.3)
        >>> loop = Cascade(depth, Pid(-1.0, measured="pitch_rad", command="stern_plane_rad"))
        >>> reading = {"depth_m": 10.0, "pitch_rad": 0.0, "dt_s": 0.1}
        >>> command, memory = loop.act(loop.start(), reading, {"depth_m": 12.0})
        >>> {name: round(value, 3) for name, value in command.items()}
        {'pitch_cmd_rad': -0.2, 'stern_plane_rad': 0.2}
    """

    outer: Controller
    inner: Controller

    @property
    def targets(self) -> tuple[str, ...]:
        return targets_of(self.outer)

    @property
    def commands(self) -> tuple[str, ...]:
        return commanded_inputs(self.inner)

    def start(self) -> CascadeState:
        return CascadeState(self.outer.start(), self.inner.start())

    def act(
        self, state: CascadeState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], CascadeState]:
        wanted, outer = self.outer.act(state.outer, reading, target)
        command, inner = self.inner.act(state.inner, reading, {**target, **wanted})
        reports = {set_point_of(name): value for name, value in wanted.items()}
        return {**reports, **command}, CascadeState(outer, inner)


@dataclass(frozen=True)
class Joint:
    """Several controllers in parallel, each with its own commands; one without targets does not act.

    Example:

        >>> from controllers import Joint, Pid
        >>> both = Joint((Pid(1.0), Pid(-0.1, measured="depth_m", command="stern_plane_rad")))
        >>> both.commands
        ('rudder_rad', 'stern_plane_rad')
    """

    controllers: tuple[Controller, ...]

    def __post_init__(self) -> None:
        if not self.controllers:
            raise ValueError("Joint needs at least one controller, got none.")
        names = [name for controller in self.controllers for name in commanded_inputs(controller)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"Joint needs controllers with commands of their own, got {', '.join(twice)} twice.")

    @property
    def targets(self) -> tuple[str, ...]:
        return tuple(name for controller in self.controllers for name in targets_of(controller))

    @property
    def commands(self) -> tuple[str, ...]:
        return tuple(name for controller in self.controllers for name in commanded_inputs(controller))

    def start(self) -> tuple[Any, ...]:
        return tuple(controller.start() for controller in self.controllers)

    def act(
        self, state: tuple[Any, ...], reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], tuple[Any, ...]]:
        check_targets(self, target)
        commands, after = {}, []
        for controller, memory in zip(self.controllers, state, strict=True):
            if all(name in target for name in targets_of(controller)):
                command, memory = controller.act(memory, reading, target)
                # a report of several controllers, such as `infeasible_flag`, is set if any of them sets it
                raised = {
                    name: max(value, commands.get(name, value)) for name, value in command.items() if is_flag(name)
                }
                commands.update({**command, **raised})
            after.append(memory)
        return commands, tuple(after)


@dataclass(frozen=True)
class Mirrored:
    """A controller with one command that also moves a second actuator, `share` times as far.

    share: negative if the two oppose each other, as bow and stern planes do in pitch.

    Example:

        >>> from controllers import Mirrored, Pid
        >>> planes = Mirrored(Pid(-0.1, measured="depth_m", command="stern_plane_rad"), share=-0.5)
        >>> command, memory = planes.act(planes.start(), {"depth_m": 10.0, "dt_s": 0.1}, {"depth_m": 11.0})
        >>> {name: round(value, 3) for name, value in command.items()}
        {'stern_plane_rad': -0.1, 'bow_plane_rad': 0.05}
    """

    controller: Controller
    share: float
    source: str = "stern_plane_rad"
    command: str = "bow_plane_rad"

    def __post_init__(self) -> None:
        if not abs(self.share) <= 1.0:
            raise ValueError(f"Mirrored needs a share within [-1, 1], got {self.share!r}.")

    @property
    def targets(self) -> tuple[str, ...]:
        return targets_of(self.controller)

    @property
    def commands(self) -> tuple[str, ...]:
        return (*commanded_inputs(self.controller), self.command)

    def start(self) -> Any:
        return self.controller.start()

    def act(
        self, state: Any, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], Any]:
        command, state = self.controller.act(state, reading, target)
        return {**command, self.command: self.share * command[self.source]}, state


def targets_of(controller: Controller) -> tuple[str, ...]:
    """The channels whose targets a controller requires, if it lists them."""
    return tuple(getattr(controller, "targets", ()))


def commanded_inputs(controller: Controller) -> tuple[str, ...]:
    """The inputs that a controller commands, if it lists them."""
    return tuple(getattr(controller, "commands", ()))
