"""Slips in how a log was written: a wrong sign, a wrong unit, two columns exchanged, a clock; each can be undone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import Diverged, simulate
from auv_gym.param import listed, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from auv_gym.records.suspicions import beyond_possible, is_folded, units_instead

KNOT = 1852.0 / 3600.0  # m/s
_TURNED = (  # channels that are often logged with the opposite sign
    *("rudder_rad", "stern_plane_rad", "bow_plane_rad", "heading_rad", "roll_rad", "pitch_rad", "depth_m", "piston_m"),
    *(
        "oil_volume_m3",
        "buoyancy_volume_m3",
        "p_radps",
        "q_radps",
        "r_radps",
        "v_mps",
        "w_mps",
        "v_dvl_mps",
        "w_dvl_mps",
        "north_m",
    ),
    *("east_m", "propeller_rpm", "propeller_V", "u_mps", "u_dvl_mps"),
)
# volumes that a record may count from one end, while the file counts from neutral, as a Seaglider's does
_VOLUMES = ("buoyancy_volume_m3",)
_EXCHANGED = (
    *(("rudder_rad", "stern_plane_rad"), ("rudder_rad", "bow_plane_rad"), ("roll_rad", "pitch_rad")),
    *(("pitch_rad", "heading_rad"), ("roll_rad", "heading_rad"), ("u_mps", "v_mps"), ("v_mps", "w_mps")),
    *(("u_dvl_mps", "v_dvl_mps"), ("v_dvl_mps", "w_dvl_mps"), ("north_m", "east_m"), ("p_radps", "q_radps")),
    *(("q_radps", "r_radps"), ("p_radps", "r_radps"), ("u_mps", "w_mps"), ("u_dvl_mps", "w_dvl_mps")),
)
_INSTRUMENTS = (  # channels of one instrument, which therefore share a unit
    ("p_radps", "q_radps", "r_radps"),
    ("roll_rad", "pitch_rad"),
    ("roll_rad", "pitch_rad", "heading_rad"),
    ("rudder_rad", "stern_plane_rad"),
    ("u_mps", "v_mps", "w_mps"),
    ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"),
    ("north_m", "east_m"),
)
_ANGLE = ((radians(1.0), "degrees"), (degrees(1.0), "radians turned into radians once more"))
_UNITS = {  # by unit of a channel: the factors for values logged in another unit, and that unit's name
    "rad": _ANGLE,
    "rad/s": ((radians(1.0), "degrees per second"), (degrees(1.0), "radians per second converted once more")),
    "m/s": ((KNOT, "knots"), (0.01, "centimetres per second"), (1.0 / KNOT, "knots converted twice")),
    "rpm": ((60.0, "revolutions per second"), (30.0 / np.pi, "radians per second")),
    "m": ((1e-3, "millimetres"), (0.01, "centimetres"), (0.3048, "feet"), (0.1, "ten times too large"), (10.0, "bar")),
    "m3": ((1e-6, "millilitres"), (1e-3, "litres")),
    "V": ((1e-3, "millivolts"),),
}
_UNWRAPPED = ("heading_rad", "roll_rad")  # by records, so that they may leave the circle
_FOLDED = 1.0  # RMS of steps; randomly wrapped steps have pi / sqrt(3)
_CLOCKS = ((2.0, "half"), (0.5, "twice"))


@dataclass(frozen=True)
class Slip:
    """One way in which a record may be wrong, and how to undo it.

    factors: what to multiply each channel by; empty if it is not certain.  exchanged: whether the two channels change
    places.  clock: what to multiply times by.  offset: added after the factors.  acts_on: the measured velocities by
    which the slip is judged, if it only affects those; empty for all signals.
    """

    text: str
    mend: str
    channels: tuple[str, ...]
    factors: tuple[float, ...] = ()
    exchanged: bool = False
    clock: float = 1.0
    offset: float = 0.0
    acts_on: tuple[str, ...] = ()

    @property
    def scales(self) -> bool:
        """Whether it only scales a signal or time, as a gain, a lag or a drag can."""
        return not self.exchanged and all(f > 0.0 for f in self.factors)

    def weakens(self, plant: Plant) -> bool:
        """Whether it makes commands smaller, as does an actuator that has lost much or all of its effect."""
        return set(self.channels) <= set(plant.inputs) and any(f < 1.0 for f in self.factors)


def possible_slips(record: Record, plant: Plant) -> tuple[Slip, ...]:
    """The slips that can have happened to a record of this plant, in the channels that the plant uses."""
    used = {name for name in (*plant.inputs, *plant.outputs, "depth_m", "pitch_rad") if record.has(name)}
    return (*_signs(used, plant), *_units(used), *_exchanges(used), *_clocks())


def impossible_units(record: Record, plant: Plant) -> Slip | None:
    """The slip of units that makes possible what no vehicle can do, such as a pitch of 20 rad; None without one.

    It judges by the ranges that a first look at a log uses, and needs no simulation: several channels may be wrong at
    once.  The angles that a record unwraps are judged only beside others: a heading may count many turns.
    Without factors if several units would make a channel possible.
    """
    found: dict[str, tuple[tuple[float, str], ...]] = {}
    for name in (*plant.inputs, *plant.outputs, "depth_m", "pitch_rad"):
        if record.has(name) and name not in _UNWRAPPED:
            values = record[name][np.isfinite(record[name])]
            if name == "depth_m" and values.size and np.median(values) < 0.0:  # its sign may be wrong instead
                continue
            if values.size and beyond_possible(name, values):
                units = units_instead(name, values, None)
                found |= {name: tuple(unit[:2] for unit in units)} if units else {}
    if not found:
        return None
    # a speed is compared with the depth and the pitch in their own units
    mended = record.with_channels({name: of[0][0] * record[name] for name, of in found.items() if len(of) == 1})
    for name in [name for name, of in found.items() if len(of) > 1]:
        values = record[name][np.isfinite(record[name])]
        found[name] = tuple(unit[:2] for unit in units_instead(name, values, mended))
    degrees_of = next((unit for name, unit in found.items() if channel(name).unit == "rad"), None)
    if degrees_of is not None:
        turned = {
            "heading_rad": lambda: is_folded(record, "heading_rad") or beyond_possible("heading_rad", _firsts(record)),
            "roll_rad": lambda: "pitch_rad" in found and beyond_possible("pitch_rad", record["roll_rad"]),
        }
        found |= {name: degrees_of for name, wrong in turned.items() if record.has(name) and wrong()}
    texts, mends = [], []
    for units in dict.fromkeys(found.values()):
        names = [name for name, own in found.items() if own == units]
        looks = "looks" if len(names) == 1 else "look"
        texts.append(f"{listed(names)} {looks} like {' or '.join(u for _, u in units)}, not {channel(names[0]).unit}")
        right = ", whichever is right" if len(units) > 1 else ""
        mends.append(f"multiply {listed(names)} by {' or '.join(f'{factor:.6g}' for factor, _ in units)}{right}")
    sure = all(len(units) == 1 for units in found.values())
    factors = tuple(units[0][0] for units in found.values()) if sure else ()
    return Slip("; ".join(texts), "; ".join(mends), tuple(found), factors)


def _firsts(record: Record) -> np.ndarray:
    """The first heading of each segment, which is as it was logged."""
    return np.array([record["heading_rad"][part.start] for part in record.segments])


def undone(record: Record, slip: Slip, plant: Plant) -> Record:
    """The record with a slip undone, to confirm a doubt or to continue with."""
    values = {}
    if slip.exchanged:
        first, second = slip.channels
        values = {first: record[second], second: record[first]}
    for name, factor in zip(slip.channels, slip.factors, strict=slip.factors != ()):
        steps = _unfolded(record, name, factor, plant) if channel(name).angle else record[name]
        values[name] = factor * steps + slip.offset
    read = dict(zip(slip.channels, reversed(slip.channels))) if slip.exchanged else {}
    mended = record.with_channels(values)
    if slip.clock != 1.0:
        mended = Record(mended.dataset.assign_coords(time_s=("time_s", record.time * slip.clock)))
    held = {name: record.readings(read.get(name, name)) for name in record.names}
    return mended.with_readings({name: mask for name, mask in held.items() if not mask.all()})


def _unfolded(record: Record, name: str, factor: float, plant: Plant) -> np.ndarray:
    """An angle in its own unit, without the steps of 2 pi that were inserted when it was read as radians.

    If the vehicle may turn by more than pi (in that unit) between samples, the steps closest to the plant's own
    simulation are used.
    """
    values = record[name]
    if not 0.0 < factor < 1.0 or name not in plant.outputs:
        return values
    try:
        expected = np.diff(simulate(plant, record)[name]) / factor
    except (Diverged, ValueError):  # no simulation to compare with
        return values
    fast = np.abs(expected) > 0.5 * np.pi
    steps = np.diff(values)
    if not fast.any() or np.sqrt(np.mean(steps[fast] ** 2)) < _FOLDED:  # else correct radians would change
        return values
    steps = steps + np.where(fast, 2.0 * np.pi * np.round((expected - steps) / (2.0 * np.pi)), 0.0)
    result = values[0] + np.r_[0.0, np.cumsum(steps)]
    for part in record.segments:
        result[part] += values[part.start] - result[part.start]
    return result


def _signs(used: set[str], plant: Plant) -> Iterator[Slip]:
    for name in _TURNED:
        if name not in used:
            continue
        label = channel(name).label
        if name in plant.inputs and name.endswith(("rudder_rad", "plane_rad")):
            text = f"the {label} acts with the opposite sign"
        else:
            text = f"{name} looks mirrored: the {label} has the opposite sign"
        yield Slip(text, f"change the sign of {name}", (name,), (-1.0,))
    if "piston_m" in used:
        low, high = (value_at(plant, f"hull.piston_{end}") for end in ("low", "high"))
        text = "the piston moves the wrong way: piston_m looks measured from the other end of the stroke"
        yield Slip(text, f"subtract piston_m from {low + high:g} m", ("piston_m",), (-1.0,), offset=low + high)
    for name in _VOLUMES:
        path = plant.family.constants.get(name, "")
        neutral = value_at(plant, path) if path else 0.0
        if name in used and neutral != 0.0:  # about 0, only the sign is reversed
            text = f"the {channel(name).label} moves the wrong way: {name} looks mirrored about neutral"
            mend = f"subtract {name} from {2.0 * neutral:.6g} m3, twice its neutral, or change the sign of its column"
            yield Slip(text, mend, (name,), (-1.0,), offset=2.0 * neutral)


def _units(used: set[str]) -> Iterator[Slip]:
    alone = [(name,) for name in (*_TURNED, "speed_cmd_mps") if name in used]
    together = [tuple(n for n in group if n in used) for group in _INSTRUMENTS]
    for names in dict.fromkeys([*alone, *(group for group in together if len(group) > 1)]):
        looks = "looks" if len(names) == 1 else "look"
        for factor, unit in _UNITS.get(channel(names[0]).unit, ()):
            like = unit if unit.startswith("ten times") else f"like {unit}"
            text = f"{listed(names)} {looks} {like}, not {channel(names[0]).unit}"
            yield Slip(text, f"multiply {listed(names)} by {factor:.6g}", names, (factor,) * len(names))


def _exchanges(used: set[str]) -> Iterator[Slip]:
    for pair in _EXCHANGED:
        if used.issuperset(pair):
            yield Slip(f"{listed(pair)} look exchanged", f"exchange {listed(pair)}", pair, exchanged=True)


def _clocks() -> Iterator[Slip]:
    for factor, rate in _CLOCKS:
        text = f"time runs at {rate} the rate it should"
        yield Slip(text, f"multiply time_s by {factor:g}", ("time_s",), clock=factor)
