"""A body of named parts, and its capabilities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.vehicles.body.kinds import Command, PartKind, part_kind


@dataclass(frozen=True)
class Part:
    """A part as named in a vehicle file: its kind, the form of the kind, and the channels of its commands."""

    name: str
    kind: str
    choice: str = ""
    channels: tuple[str, ...] = ()

    @property
    def found(self) -> PartKind:
        return part_kind(self.kind, self.choice)

    @property
    def title(self) -> str:
        """The title: `stern plane`; a name with abbreviations or numbers, such as `th_ap`, is unchanged."""
        words = self.name.split("_")
        return " ".join(words) if all(len(word) > 2 for word in words) else self.name

    def channel(self, index: int) -> str:
        """The channel of one of its commands."""
        if index < len(self.channels) and self.channels[index]:
            return self.channels[index]
        command = self.found.commands[index]
        return command.channel or f"{self.name}_{command.suffix}"


@dataclass(frozen=True)
class Body:
    """A family's knowledge of its parts in six degrees of freedom, in the order of its parameters."""

    parts: tuple[Part, ...]

    @property
    def commands(self) -> tuple[tuple[Part, int, Command], ...]:
        """All commands in the order of the inputs: the part, the index among its commands, and the command."""
        return tuple((part, i, c) for part in self.parts for i, c in enumerate(part.found.commands))

    def by_role(self) -> dict[str, tuple[str, ...]]:
        """The channels for each role, in the order of the inputs."""
        return self._channels_by(lambda command: command.role)

    def by_inside(self) -> dict[str, tuple[str, ...]]:
        """The channels that move each thing inside the hull, see `Command.inside`, in the order of the inputs."""
        return self._channels_by(lambda command: command.inside)

    def _channels_by(self, of: Callable[[Command], str]) -> dict[str, tuple[str, ...]]:
        found: dict[str, tuple[str, ...]] = {}
        for part_, i, command in self.commands:
            if name := of(command):
                found[name] = (*found.get(name, ()), part_.channel(i))
        return found

    @property
    def thrusters(self) -> tuple[Part, ...]:
        """The parts whose thrust along a line depends only on their command."""
        return tuple(part_ for part_ in self.parts if part_.found.thrusts is not None)

    @property
    def steered(self) -> bool:
        """Whether it has parts for yaw, for pitch and for the drive."""
        return {"yaw", "pitch", "surge"} <= self.by_role().keys()

    @property
    def hovers(self) -> bool:
        """Whether it is moved by thrusters only, without parts for steering or drive."""
        return bool(self.thrusters) and not self.by_role()

    @property
    def glides(self) -> bool:
        """Whether it is moved only by its volume and by masses that slide and turn in it."""
        return {"volume", "slide", "turn"} <= self.by_inside().keys() and not self.by_role() and not self.thrusters

    @property
    def piloted(self) -> bool:
        """Whether autopilots and environments can move it: by fins and a drive, by thrusters, or by masses."""
        return self.steered or self.hovers or self.glides

    @property
    def kind(self) -> str:
        """The kind of the vehicle, according to what moves it."""
        return "hover" if self.hovers else "glide_body" if self.glides else "body"

    def required(self) -> tuple[str, ...]:
        """The channels that a record must have; a missing second part of a role, such as bow planes, is at rest."""
        first = {names[0] for names in self.by_role().values()}
        named = [(part_.channel(i), command) for part_, i, command in self.commands]
        return tuple(name for name, command in named if command.required and (not command.role or name in first))

    def ranges(self, parameters: Any) -> np.ndarray:
        """The lowest, resting and highest value of every command, in its channel's unit, (n, 3)."""
        rows = []
        for part_, _, command in self.commands:
            own = getattr(parameters.parts, part_.name)
            low, high = command.limits(own)
            rows.append((low, getattr(own, command.rest) if command.rest else command.idle, high))
        return np.array(rows, dtype=float).reshape(len(rows), 3)
