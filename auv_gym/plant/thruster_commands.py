"""The commands of thrusters in a log: whether they move, in which unit they are, and what a diagnosis says of them."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.channels import unit_after
from auv_gym.param import listed
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_ranges
from auv_gym.plant.thrusters import find_thrusters
from auv_gym.records.mapping import FULL, Target, command_in
from auv_gym.records.record import Record

TOLERANCE = 0.05  # of a range; tolerance for readings outside it
STILL = 1e-3  # of an input's usual size; below this, it does not move
_MOSTLY = 0.5  # share of commands beyond the thrusters' range from which their unit must be another
_COMMAND_UNITS = (  # other units in which commands of thrusters may be logged: words, least, most
    ("shares from -1 to 1", -1.0, 1.0),
    ("percent from -100 to 100", -100.0, 100.0),
    ("pulse lengths less 1500 us", -500.0, 500.0),
    ("pulse lengths in us", 900.0, 2100.0),
)
_FEEBLE = 25.0 / 400.0  # of full command; Blue Robotics' Basic ESC rests from 1475 to 1525 us, of 1100 to 1900 us
_MOVES = 0.01  # of the distance of its ends; smallest movement of a thruster's command


@dataclass(frozen=True, eq=False)
class _Commands:
    """The logged commands of a thruster; ends: its lowest, resting and highest command."""

    name: str
    values: np.ndarray
    ends: tuple[float, float, float]

    @property
    def unit(self) -> str:
        return unit_after(self.name)

    @property
    def beyond(self) -> np.ndarray:
        low, _, high = self.ends
        slack = TOLERANCE * (high - low)
        return (self.values < low - slack) | (self.values > high + slack)

    @property
    def strongest(self) -> float:
        """The command furthest from rest, as a share of full thrust."""
        low, idle, high = self.ends
        shares = (self.values - idle) / np.where(self.values < idle, idle - low, high - idle)
        return float(np.abs(shares).max(initial=0.0))

    @property
    def still(self) -> bool:
        low, _, high = self.ends
        return bool(np.ptp(self.values) < STILL * (high - low))


def _thruster_commands(plant: Plant, record: Record) -> list[_Commands]:
    """The commands in a record for each thruster of a vehicle."""
    body = plant.family.body
    if body is None or not body.thrusters:
        return []
    thrusters = find_thrusters(plant)
    ends = command_ranges(plant)[thrusters.at].tolist()
    found = [_Commands(n, record[n], tuple(e)) for n, e in zip(thrusters.channels, ends, strict=True) if record.has(n)]
    return [replace(row, values=row.values[np.isfinite(row.values)]) for row in found]


def check_commands(plant: Plant, record: Record) -> None:
    """Raise if thruster commands are in another unit: those that are not at rest are mostly out of range."""
    rows = _thruster_commands(plant, record)
    moved = np.concatenate([np.empty(0), *(row.beyond[row.values != row.ends[1]] for row in rows)])
    if moved.sum() <= _MOSTLY * moved.size:
        return
    least, most = min(row.values.min() for row in rows), max(row.values.max() for row in rows)
    low, idle, high = rows[0].ends
    looks = next((words for words, a, b in _COMMAND_UNITS if a <= least and most <= b), "")
    raise ValueError(
        f"{plant.name} takes commands of {low:g} to {high:g}{rows[0].unit}, and rests at {idle:g}; those of this log "
        f"({listed([row.name for row in rows])}) go from {least:.4g} to {most:.4g}: "
        f"{f'they look like {looks}' if looks else 'check their unit'}. Convert them, so that {low:g} is full "
        f"thrust astern and {high:g} full thrust ahead."
    )


def command_remarks(plant: Plant, record: Record) -> list[str]:
    """Remarks on thrusters that a log moves beyond their range or not at all, and on commands without a thruster."""
    rows = _thruster_commands(plant, record)
    if not rows:
        return []
    lines = []
    for row in rows:
        low, _, high = row.ends
        if row.beyond.any():
            lines.append(
                f"{row.name} goes from {row.values.min():.4g} to {row.values.max():.4g}{row.unit}, but its thruster "
                f"takes {low:g} to {high:g}. Beyond this range ({np.sum(row.beyond)} of {row.values.size} samples), "
                "the thrust at its end is assumed: check whether these samples are errors of the log."
            )
    still = [row for row in rows if row.still]
    if still and len(still) < len(rows):
        many = len(still) > 1
        lines.append(
            f"{listed([row.name for row in still])} {'do' if many else 'does'} not move. This log shows nothing "
            f"about {'their' if many else 'its'} gain, dead zone, lag, place or direction."
        )
    strongest = max(row.strongest for row in rows)
    if 0.0 < strongest <= _FEEBLE:
        lines.append(
            f"No thruster is commanded more than {100.0 * strongest:.2g} % of its full thrust, which may be within its "
            "dead zone. Such a log shows little of a vehicle: use one in which it moves."
        )
    ending = rows[0].name.rpartition("_")[2]
    extra = [n for n in record.names if re.fullmatch(rf"[a-z]+\d+_{ending}", n) and n not in plant.inputs]
    if extra:
        lines.append(
            f"{plant.name} has {len(rows)} thrusters ({listed([row.name for row in rows])}), and the log also has "
            f"{listed(extra)}, which is not used. If the vehicle has more thrusters, add them to a vehicle file."
        )
    return lines


def moving_commands(record: Record) -> list[str]:
    """The commands of thrusters that move in a record, in any unit."""
    found = []
    for name in record.names:
        if re.fullmatch(rf"t\d+_({'|'.join(FULL)})", name):
            low, high = FULL[name.rpartition("_")[2]]
            values = record[name][np.isfinite(record[name])]
            found += [name] if values.size and np.ptp(values) > _MOVES * (high - low) else []
    return found


def convertible_commands(plant: Plant, names: Collection[str]) -> dict[str, Target]:
    """Conversions for the channels of a log that hold thruster commands in another unit than the vehicle's.

    Full thrust astern and ahead is -1 and 1 in shares, -100 and 100 in percent, and 1100 and 1900 in pulses in us.
    """
    found = {}
    for part in plant.family.body.thrusters if plant.family.body else ():
        wanted = part.channel(0)
        stem, _, ending = wanted.rpartition("_")
        given = next((other for other in FULL if f"{stem}_{other}" in names), ending)
        target = command_in(wanted, given)
        if wanted not in names and given != ending and target is not None:
            found[f"{stem}_{given}"] = target
    return found
