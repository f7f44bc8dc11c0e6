"""Checks of whether a record can be of a vehicle: the channels needed, values within range, inputs that move."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial

import numpy as np

from auv_gym.channels import channel, unit_after
from auv_gym.model import elapsed_over_gaps
from auv_gym.param import listed, value_at
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_ranges
from auv_gym.plant.currents import no_currents
from auv_gym.plant.thruster_commands import STILL, TOLERANCE, check_commands, command_remarks
from auv_gym.records.gliding import glide_attack
from auv_gym.records.record import Record
from auv_gym.records.suspicions import few_impossible
from auv_gym.records.understanding import Needs
from auv_gym.records.unread import only_readings

FEW = 0.01  # share of wild readings that are left out; more of them indicate a wrong sign or unit
_MOSTLY = 0.5  # share of a log that is most of it: of values in another unit, of samples left out, or of deep ones
_TOO_SMALL = {  # for values in a unit that makes them appear this many times too small
    "m3": ((1e6, "m3 in a column of cm3"), (1e3, "m3 in a column of litres")),
    "m": ((1e3, "m in a column of mm"),),
}
_TOO_LARGE = {"rad": (np.rad2deg(1.0), "degrees in a column of radians")}  # and this many times too large
_USED = 0.1  # share of its range through which an actuator moves in a log, at least; less may be noise
_RESOLVED = 1e-5  # of its range; a sensor of 16 bits cannot resolve less
DEEP = 10.0  # m; below this, waves and manoeuvres at the surface have no effect
_AT_SURFACE, _SURFACED = 2.0, 3  # m, and samples above it in a log of a vehicle that surfaces
_USUAL = {
    "piston_m": 1e-2,
    "oil_volume_m3": 1e-5,
    "buoyancy_volume_m3": 1e-5,
}  # sizes of inputs that are far from 1 in SI


def needs_of(plant: Plant) -> Needs:
    """The channels that a vehicle needs from a log, and the angle of attack of its glide if it has a polar."""
    family, attack = plant.family, None
    for part in family.body.parts if family.body else ():
        polar = part.found.polar and part.found.polar(getattr(plant.parameters.parts, part.name))
        if polar:
            drag_0, drag_2, lift_1, lift_0 = polar
            attack = partial(glide_attack, drag_0=drag_0, drag_2=drag_2, lift_1=lift_1, lift_0=lift_0)
    wanted = tuple(dict.fromkeys((*plant.inputs, *plant.outputs)))
    # a body without a required input still needs an actuator; otherwise any log would do
    required = tuple(dict.fromkeys((family.leading, *(family.required or family.actuators))))
    spare = {name for name in plant.outputs if not channel(name).angle} - {*required, *plant.inputs}
    return Needs(required, wanted, frozenset(spare), attack)


def check_ranges(plant: Plant, record: Record, few: float = 0.0) -> None:
    """Raise if a channel leaves the range that the vehicle states, or moves so little that its unit must be wrong.

    few: share of samples that may be outside, as occasional wild readings are; `described` leaves them out.
    """
    _check_spans(plant, record)
    for name, (least, most, slack, beyond) in _ranges(plant, record).items():
        values, lowest, highest = record[name], least - slack, most + slack
        if beyond.mean() > few:
            row = int(np.argmax(beyond))
            segment = next(k for k, s in enumerate(record.segments) if row < s.stop)
            label = record.labels[segment]
            where = f"at {record.time[row]:.0f} s" + (f" of {label}" if label else "")
            share = f"{int(beyond.sum())} of {values.size} samples"
            mended = {"; its sign looks turned": -values}
            neutral = value_at(plant, path) if (path := plant.family.constants.get(name)) else 0.0
            if neutral != 0.0:
                mended[f"; it looks mirrored about its neutral {neutral:.4g}"] = 2.0 * neutral - values
            # a wrong unit makes values a million times larger; a few times larger means another engine
            if channel(name).unit == "m3" and np.abs(values).max() > 1e3 * max(abs(lowest), abs(highest)):
                mended["; it looks like cm3 (a name that ends in _cm3)"] = 1e-6 * values
            other = f", and whether {plant.name} is the right vehicle"
            looks = next((w for w, v in mended.items() if lowest <= v.min() and v.max() <= highest), other)
            raise ValueError(
                f"{plant.name} has {channel(name).label} from {least:g} to {most:g}{unit_after(name)}; {name} is "
                f"{values[row]:.4g} {where} ({share} are beyond): check the column's sign and unit, throughout the log"
                f"{looks}."
            )
    check_commands(plant, record)


def _check_spans(plant: Plant, record: Record) -> None:
    """Raise if an actuator hardly moves or is mostly out of range, and would fit its range in another unit."""
    for name, (least, most) in _actuator_ranges(plant).items():
        values = record[name][np.isfinite(record[name])] if record.has(name) else np.empty(0)
        span, width = float(np.ptp(values)) if values.size else 0.0, most - least
        unit, of = channel(name).unit, f"{channel(name).label} of {plant.name}"
        lowest, highest = least - TOLERANCE * width, most + TOLERANCE * width
        larger, words = _TOO_LARGE.get(unit, (1.0, ""))
        beyond, mended = (values < lowest) | (values > highest), values / larger
        fits = span / larger >= _USED * width and np.all((lowest <= mended) & (mended <= highest))
        if fits and beyond.sum() > _MOSTLY * values.size:
            raise ValueError(
                f"{name} goes from {values.min():.4g} to {values.max():.4g} {unit}, while {of} goes from {least:.4g} "
                f"to {most:.4g} {unit}. It looks {larger:.4g} times too large, as {words} are: correct the column's "
                "unit in a mapping, or its values in the file."
            )
        for factor, words in _TOO_SMALL.get(unit, ()):
            fills = _USED * width <= factor * span <= (1.0 + 2.0 * TOLERANCE) * width
            # a small signal may be noise at rest, unless it is finer than any sensor, or rests at zero only
            if fills and (
                span < _RESOLVED * width or (lowest <= factor * values.min() and factor * values.max() <= highest)
            ):
                raise ValueError(
                    f"{name} hardly moves: it spans {span:.2g} {unit}, while {of} goes from {least:g} to {most:g} "
                    f"{unit}. It looks {factor:,.0f} times too small, as {words} is: correct the column's unit in a "
                    "mapping, or its values in the file."
                )


def _actuator_ranges(plant: Plant) -> dict[str, tuple[float, float]]:
    """The lower and upper limit of each actuator, as the vehicle's own parameters state them."""
    found = {
        name: (value_at(plant, low), value_at(plant, high))
        for name, (low, high) in plant.family.ranges.items()
        if isinstance(low, str) and isinstance(high, str)
    }
    if plant.family.body is not None:
        ends = command_ranges(plant)[:, [0, 2]].tolist()
        found |= dict(zip(plant.family.actuators, map(tuple, ends), strict=True))
    return {name: (low, high) for name, (low, high) in found.items() if np.isfinite(high - low)}


def _ranges(plant: Plant, record: Record) -> dict[str, tuple[float, float, float, np.ndarray]]:
    """The family's limits of each channel with their tolerance, and a mask of the readings beyond."""
    found = {}
    for name, edges in plant.family.ranges.items():
        if record.has(name):
            least, most = (value_at(plant, edge) if isinstance(edge, str) else edge for edge in edges)
            slack = TOLERANCE * (most - least) if np.isfinite(most - least) else 0.0
            found[name] = least, most, slack, (record[name] < least - slack) | (record[name] > most + slack)
    return found


def _wild(plant: Plant, record: Record) -> dict[str, np.ndarray]:
    """Masks of the few readings that are beyond their channel's range or impossible, by their description."""
    ranges = _ranges(plant, record)
    found = {
        f"where {name} is beyond {least:g} to {most:g}{unit_after(name)}": mask
        for name, (least, most, _, mask) in ranges.items()
        if 0.0 < mask.mean() <= FEW
    }
    others = [name for name in plant.inputs if record.has(name) and name not in ranges]
    masks = {f"where {name} is impossible": few_impossible(name, record[name]) for name in others}
    return found | {words: mask for words, mask in masks.items() if mask.any()}


def refusal(plant: Plant, record: Record) -> str:
    """Why a diagnosis would refuse a record for this vehicle; '' if it would not, or if a channel is missing."""
    if not all(record.has(name) for name in (plant.family.leading, *plant.family.required)):
        return ""
    record = commanded(plant, record)
    try:
        check_ranges(plant, record, FEW)
        check_excitation(plant, described(plant, record))
    except ValueError as error:
        return str(error)
    return ""


def commanded(plant: Plant, record: Record) -> Record:
    """The samples in which all inputs of a record are known; a diagnosis also leaves out those before."""
    known = np.isfinite(record.matrix([name for name in plant.inputs if record.has(name)])).all(axis=1)
    return record.select(known) if known.any() else record


def surfaces(plant: Plant, record: Record) -> bool:
    """Whether a record is mostly deep, with samples at the surface that the vehicle's kind does not leave out.

    It is also False if channels are missing, and for vehicles that are only judged below the surface.
    """
    needed = (plant.family.leading, *plant.family.required)
    if plant.family.afloat is not None or not all(record.has(name) for name in ("depth_m", *needed)):
        return False
    found = _not_described(plant, record)
    left_out = np.any(list(found.values()), axis=0) if found else np.zeros(len(record), dtype=bool)
    depth = record["depth_m"]
    return bool(np.sum((depth < _AT_SURFACE) & ~left_out) >= _SURFACED and np.mean(depth > DEEP) > _MOSTLY)


def wrong_for(plant: Plant, record: Record) -> list[str]:
    """Sentences on what is wrong with a record for this vehicle, for a first look; none if channels are missing."""
    if not all(record.has(name) for name in (plant.family.leading, *plant.family.required)):
        return []
    if refused := refusal(plant, record):
        return [refused]
    found = _not_described(plant, record)
    left_out = _left_out(plant, found) if found and np.any(list(found.values()), axis=0).mean() > _MOSTLY else ""
    return [*([left_out] if left_out else []), *command_remarks(plant, record)]


def check_commanded(plant: Plant, called: str = "") -> None:
    """Raise ValueError if a vehicle has no actuator, so that no log can be compared with it.

    called: what the user calls it, if not by its name.
    """
    if not plant.family.actuators:
        raise ValueError(
            f"{called or plant.name} has no part with a command, such as a fin or a thruster, so a log cannot be "
            "compared with it: add such parts to the vehicle file, see `auv-gym list parts`."
        )


def check_excitation(plant: Plant, record: Record) -> None:
    """Raise if all inputs that move the vehicle are constant throughout, or if what they move is."""
    still: dict[str, list[str]] = {}
    moving = plant.family.required or [name for name in plant.family.actuators if record.has(name)]
    check_commanded(plant)
    if not moving:
        raise ValueError(
            f"Nothing excites the vehicle: the log has none of {', '.join(plant.family.actuators) or 'its inputs'}. "
            "Use a log with the commands."
        )
    for name in moving:
        signal = record[name]
        if np.ptp(signal) < STILL * max(abs(float(signal.mean())), _USUAL.get(name, 1.0)):
            still.setdefault(f"constant at {float(signal[0]):.4g}{unit_after(name)}", []).append(name)
    if sum(map(len, still.values())) == len(moving):
        said = [f"{_in_short(names)} {'is' if len(names) == 1 else 'are'} {held}" for held, names in still.items()]
        raise ValueError(f"Nothing excites the vehicle: {', '.join(said)}. Use a log in which it moves.")
    leading = plant.family.leading
    if plant.family.required and record.has(leading) and np.ptp(record[leading]) == 0.0:
        raise ValueError(
            f"{leading} is constant at {float(record[leading][0]):.4g}{unit_after(leading)} in all "
            f"{len(record):,} samples, although the inputs move: its sensor is stuck, or the column holds something "
            "else. Map another column, or use another log."
        )


def _in_short(names: list[str]) -> str:
    """A list of channels; the first and the last if they are more than two numbered ones."""
    numbered = len(names) > 2 and all(re.fullmatch(r"[a-z]+\d+_[a-z]+", name) for name in names)
    return f"{names[0]} to {names[-1]}" if numbered else listed(names)


def described(plant: Plant, record: Record) -> Record:
    """The samples of a record that the vehicle's family describes; notes say what is left out or assumed.

    `elapsed_s` includes what is left out, since effects that grow with time continue there: it counts from the
    beginning of the log, or over all dives of a vehicle whose dives may differ (`Family.by_dive`).  Channels that never
    change are left out, too, see `_never_read`, and values that only repeat and single spikes are no readings,
    see `auv_gym.records.unread`.  Raises ValueError if nothing is left.
    """
    lines = [
        f"The log has no {channel(name).label} ({name}): {plant.constants[name]:g}{unit_after(name)} is assumed "
        "throughout."
        for name in plant.family.assumed
        if not record.has(name)
    ]
    lines = [*filter(None, [no_currents(plant, record)]), *lines, *command_remarks(plant, record)]
    found = _not_described(plant, record)
    left_out = np.any(list(found.values()), axis=0) if found else np.zeros(len(record), dtype=bool)
    if left_out.any():
        lines.append(_left_out(plant, found))
        if left_out.all():
            raise ValueError(f"{lines[-1]} Check signs and units of depth, pitch and the inputs, or give a longer log.")
    if found and not record.has("elapsed_s"):
        elapsed = record.time - record.time[0] if plant.family.by_dive else elapsed_over_gaps(record)
        record = record.with_channels({"elapsed_s": elapsed})
    kept = record.select(~left_out) if left_out.any() else record
    if still := _never_read(plant, kept):
        lines.append(
            f"{listed(still)} {'never changes' if len(still) == 1 else 'never change'}, as no sensor's readings do: "
            f"{'it is' if len(still) == 1 else 'they are'} left out."
        )
        kept = kept.without(still)
    kept, unread = only_readings(kept, [name for name in plant.outputs if kept.has(name)])
    new = [line for line in (*lines, *unread) if line not in kept.notes]
    return kept.with_notes([*kept.notes, *new]) if new else kept


def _never_read(plant: Plant, record: Record) -> list[str]:
    """Outputs that are constant throughout, such as a filled column or a stuck sensor.

    Outputs that the vehicle needs are not included: they are refused (`check_excitation`).
    """
    needed = {plant.family.leading, *plant.family.required, *plant.inputs}
    measured = {name: record[name] for name in plant.outputs if record.has(name) and name not in needed}
    finite = {name: values[np.isfinite(values)] for name, values in measured.items()}
    return [name for name, values in finite.items() if values.size > 1 and np.ptp(values) == 0.0]


def _left_out(plant: Plant, found: Mapping[str, np.ndarray]) -> str:
    """A sentence on the samples that a vehicle does not describe, by reason; each sample counts once."""
    counted, shares = np.zeros(1, dtype=bool), []
    for words, mask in found.items():
        share, counted = float(np.mean(mask & ~counted)), counted | mask
        shares += [f"{_percent(share)} {words}"] if share > 0.0 else []
    return (
        f"{_percent(counted.mean())} of the log is left out, since {plant.name} does not describe it: "
        f"{', '.join(shares)}."
    )


def _percent(share: float) -> str:
    """A share in percent, with a nonzero digit even if it is small."""
    return f"{100.0 * share:.0f} %" if share >= 0.005 else f"{100.0 * share:.1g} %"


def _not_described(plant: Plant, record: Record) -> dict[str, np.ndarray]:
    """Masks of the samples that the family does not describe, by reason."""
    found: dict[str, np.ndarray] = {}
    needed = (plant.family.leading, *plant.family.required)
    for name in needed:
        if not record.has(name):
            raise ValueError(
                f"A log of {plant.name} needs the channel {name}, got {', '.join(record.names)}: name it in a mapping."
            )
    names = [name for name in dict.fromkeys((*needed, *plant.inputs, *plant.outputs)) if record.has(name)]
    for part in record.segments:
        columns = {name: record[name][part] for name in names}
        for words, mask in plant.family.beyond(record.time[part], columns).items():
            found.setdefault(words, np.zeros(len(record), dtype=bool))[part] = mask
    return found | _wild(plant, record)
