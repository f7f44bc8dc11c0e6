"""Which vehicles fit a log best, by the channels that they need and those that a mapping can convert."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from auv_gym.cli.options import logs

if TYPE_CHECKING:
    from auv_gym.plant import Plant
    from auv_gym.records.first_look import FirstLook
    from auv_gym.records.mapping import Target
    from auv_gym.records.record import Record
    from auv_gym.records.understanding import Needs

_MOST_NAMED = 4  # vehicles that match equally well and are named; more are a list of their own


@dataclass(frozen=True, eq=False)
class Matches:
    """Vehicles against a log.  needs: what each of them takes from a log."""

    found: FirstLook
    needs: Mapping[str, Needs]
    _records: dict[str, Record | None] = field(default_factory=dict)

    @cached_property
    def plants(self) -> dict[str, Plant]:
        """The vehicles by name."""
        from auv_gym.plant import load_vehicle

        return {name: load_vehicle(name) for name in self.needs}

    @cached_property
    def own(self) -> dict[str, FirstLook]:
        """The look at the log with the record that each vehicle gets."""
        return {name: self.found.for_needs(needs) for name, needs in self.needs.items()}

    @cached_property
    def turned(self) -> dict[str, dict[str, Target]]:
        """What becomes of the log's commands of thrusters that a vehicle takes in another unit, by vehicle, channel."""
        from auv_gym.plant.thruster_commands import convertible_commands

        return {name: convertible_commands(plant, self.own[name].channels) for name, plant in self.plants.items()}

    def missing(self, name: str) -> list[str]:
        """The channels that a vehicle needs and the log does not have, in any unit."""
        have = {target.name for target in self.turned[name].values()}
        return [one for one in self.own[name].missing(self.needs[name]) if one not in have]

    @cached_property
    def offers(self) -> dict[str, dict[str, list[str]]]:
        """The columns that may be what a vehicle is missing, the likeliest first, by vehicle and missing channel."""
        return {
            name: {one: list(self.found.offers(one, needs)) for one in self.missing(name)}
            for name, needs in self.needs.items()
        }

    def used(self, name: str) -> int:
        """How many channels of the log a vehicle uses, those that are converted or serve for others among them."""
        from auv_gym.records.reading import command_for

        need, have = self.needs[name], self.own[name].channels
        serving = sum(command_for(one) in have for one in set(need.required) - have)
        return len(have & {*need.required, *need.wanted}) + serving + len(self.turned[name])

    @cached_property
    def kept(self) -> set[str]:
        """The channels of the log that none of the vehicles uses."""
        used = [{*self.own[name].uses(needs), *self.turned[name]} for name, needs in self.needs.items()]
        return {signal.channel for signal in self.found.signals if signal.channel}.difference(*used)

    @cached_property
    def ranked(self) -> list[str]:
        """The vehicles, best match first.

        In order: fewest missing channels that no column looks like, a model that uses most of the motion that was
        logged, fewest missing channels, a thruster for each output that moves, that of the log's source, fewest
        conversions, most channels used.
        """
        return sorted(self.needs, key=self._places.__getitem__)

    @cached_property
    def best(self) -> list[str]:
        """The vehicles that match as well as the best one."""
        first = min(self._places.values())
        return [name for name, place in self._places.items() if place == first]

    @cached_property
    def guessed(self) -> bool:
        """Whether a column looks like a channel that one of the best vehicles is missing."""
        return any(found for name in self.best for found in self.offers[name].values())

    def record_of(self, name: str) -> Record | None:
        """The log as a diagnosis with a vehicle reads it; None if it cannot be read so."""
        if name not in self._records:
            self._records[name] = self.found.as_read(self.needs[name])
        return self._records[name]

    def unread(self, name: str) -> list[str]:
        """Lines on values that a diagnosis with a vehicle does not take for readings: repeated ones, and spikes."""
        from auv_gym.records.unread import only_readings

        record = None if self.found.sampled is not None else self.record_of(name)
        if record is None:
            return []
        return only_readings(record, [o for o in self.plants[name].outputs if record.has(o)])[1]

    @property
    def fits(self) -> bool:
        """Whether the best vehicles have all that they need."""
        best = self.best[0]
        return self.found.record is not None and not self.own[best].missing(self.needs[best])

    @cached_property
    def refused(self) -> dict[str, str]:
        """Why a diagnosis with each of the best vehicles would refuse the log, '' where not; none where none fits."""
        if not self.fits:
            return {}
        if self.found.sampled is not None:
            return dict.fromkeys(self.best, "")
        records = {name: self.record_of(name) for name in self.best}
        return {name: _refusal(self.plants[name], record) for name, record in records.items() if record is not None}

    def surfacing(self, names: Sequence[str]) -> float | None:
        """The depth, m, below which a diagnosis with these vehicles should begin; None if it needs no such limit."""
        from auv_gym.plant.record_check import DEEP, surfaces

        if self.found.sampled is not None:
            return None
        for name in names:
            plant, record = self.plants[name], self.record_of(name)
            if record is None or not surfaces(plant, record):
                return None
            if _refusal(plant, logs.between_depths(record, DEEP, None)):
                return None
        return DEEP

    def thrusters(self, name: str) -> int:
        """How many thrusters a vehicle has."""
        body = self.plants[name].family.body
        return len(body.thrusters) if body is not None else 0

    def _leaves_motion(self, name: str) -> bool:
        """Whether a vehicle's model has no use for most of the motion that was logged, as a float has for attitudes."""
        from auv_gym.channels import channel
        from auv_gym.records.attitude import QUATERNION

        needs = self.needs[name]
        motion = {one for one in self.found.channels if channel(one).kind == "motion" and one not in QUATERNION}
        return 2 * len(motion & {*needs.required, *needs.wanted}) < len(motion)

    @cached_property
    def _places(self) -> dict[str, tuple[int, bool, int, int, bool, int, int]]:
        """What the vehicles are ranked by, the least first."""
        from auv_gym.plant.thruster_commands import moving_commands
        from auv_gym.records.mapping import fitting_mappings

        own = {fitting.vehicle for fitting in fitting_mappings(self.found.log)}
        moving = len(moving_commands(self.found.record)) if self.found.record is not None else 0
        return {
            name: (
                sum(not found for found in self.offers[name].values()),
                self._leaves_motion(name),
                len(self.offers[name]),
                abs(self.thrusters(name) - moving) if moving else 0,
                name not in own,
                len(self.turned[name]),
                -self.used(name),
            )
            for name in self.needs
        }


def to_type(names: Sequence[str]) -> tuple[str, str]:
    """The vehicle to type, and what explains it: NAME where several would do."""
    if len(names) == 1:
        return names[0], ""
    listed = " or ".join(names) if len(names) <= _MOST_NAMED else "see auv-gym list vehicles"
    return "NAME", f"where NAME is your vehicle: {listed}"


def _refusal(plant: Plant, record: Record) -> str:
    """Why a diagnosis of a record would be refused, '' where it would not."""
    from auv_gym.plant.record_check import commanded, refusal
    from identification.diagnosis.log.checking import too_short

    return refusal(plant, record) or too_short(logs.thinned(commanded(plant, record), plant.dt), plant)
