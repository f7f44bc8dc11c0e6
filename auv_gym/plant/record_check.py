"""What a vehicle takes from a log, and whether a record can be of it: values within its range, inputs that move."""

from __future__ import annotations

from functools import partial

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import value_at
from auv_gym.plant import Plant
from auv_gym.records.gliding import glide_attack
from auv_gym.records.reading import Needs
from auv_gym.records.record import Record

_TOLERANCE = 0.05  # of a range, by which a reading may be beyond it
_STILL = 1e-3  # of an input's usual size, below which it does not move
_USUAL = {
    "piston_m": 1e-2,
    "oil_volume_m3": 1e-5,
    "buoyancy_volume_m3": 1e-5,
}  # sizes of inputs that are far from 1 in SI


def needs_of(plant: Plant) -> Needs:
    """The channels that a vehicle takes from a log, and the angle of attack of its glide where it has a polar."""
    family, attack = plant.family, None
    for part in family.body.parts if family.body else ():
        polar = part.found.polar and part.found.polar(getattr(plant.parameters.parts, part.name))
        if polar:
            drag_0, drag_2, lift_1, lift_0 = polar
            attack = partial(glide_attack, drag_0=drag_0, drag_2=drag_2, lift_1=lift_1, lift_0=lift_0)
    wanted = tuple(dict.fromkeys((*plant.inputs, *plant.outputs)))
    return Needs(tuple(dict.fromkeys((family.leading, *family.required))), wanted, attack)


def check_ranges(plant: Plant, record: Record) -> None:
    """Raises if a channel leaves the range that the vehicle's family states for it, with where and how far."""
    for name, (low, high) in plant.family.ranges.items():
        if not record.has(name):
            continue
        least, most = (value_at(plant, edge) if isinstance(edge, str) else edge for edge in (low, high))
        slack = _TOLERANCE * (most - least) if np.isfinite(most - least) else 0.0
        values, lowest, highest = record[name], least - slack, most + slack
        beyond = (values < lowest) | (values > highest)
        if beyond.any():
            row = int(np.argmax(beyond))
            segment = next(k for k, s in enumerate(record.segments) if row < s.stop)
            label = record.labels[segment]
            where = f"at {record.time[row]:.0f} s" + (f" of {label}" if label else "")
            share = f"{int(beyond.sum())} of {values.size} samples"
            mended = {"; its sign looks turned": -values}
            if channel(name).unit == "m3":
                mended["; it looks like cm3 (a name that ends in _cm3)"] = 1e-6 * values
            looks = next((w for w, v in mended.items() if lowest <= v.min() and v.max() <= highest), "")
            raise ValueError(
                f"{plant.name} has {channel(name).label} from {least:g} to {most:g} {channel(name).unit}; {name} is "
                f"{values[row]:.4g} {where} ({share} are beyond): check the column's sign and unit, throughout the log"
                f"{looks}."
            )


def check_excitation(plant: Plant, record: Record) -> None:
    """Raises if the inputs that move the vehicle are constant throughout; of several, one that moves will do."""
    still = []
    moving = plant.family.required or [name for name in plant.family.actuators if record.has(name)]
    if not moving:
        raise ValueError(
            f"Nothing excites the vehicle: the log has none of {', '.join(plant.family.actuators) or 'its inputs'}. "
            "Use a log with the commands."
        )
    for name in moving:
        signal = record[name]
        if np.ptp(signal) < _STILL * max(abs(float(signal.mean())), _USUAL.get(name, 1.0)):
            still.append(f"{name} is constant at {float(signal[0]):.4g} ({channel(name).unit})")
    if len(still) == len(moving):
        raise ValueError(f"Nothing excites the vehicle: {', '.join(still)}. Use a log in which it moves.")


def described(plant: Plant, record: Record) -> Record:
    """The samples of a record that the vehicle's family describes; notes say what is left out, and what is assumed.

    `elapsed_s` counts from the record's start on, since what grows with time goes on over what is left out.  Raises
    ValueError where nothing is left.
    """
    lines = [
        f"The log has no {channel(name).label} ({name}): {plant.constants[name]:g} {channel(name).unit} is assumed "
        "throughout."
        for name in plant.family.assumed
        if not record.has(name)
    ]
    found = _not_described(plant, record)
    left_out = np.any(list(found.values()), axis=0) if found else np.zeros(len(record), dtype=bool)
    if left_out.any():
        counted, shares = np.zeros(len(record), dtype=bool), []
        for words, mask in found.items():
            share, counted = float(np.mean(mask & ~counted)), counted | mask
            shares += [f"{100.0 * share:.0f} % {words}"] if share > 0.0 else []
        line = f"{100.0 * left_out.mean():.0f} % of the log is left out, since {plant.name} does not describe it: "
        lines.append(f"{line}{', '.join(shares)}.")
        if left_out.all():
            raise ValueError(f"{lines[-1]} Check signs and units of depth, pitch and the inputs, or give a longer log.")
    if found and not record.has("elapsed_s"):
        record = record.with_channels({"elapsed_s": record.time - record.time[0]})
    kept = record.select(~left_out) if left_out.any() else record
    return kept.with_notes([*kept.notes, *lines]) if lines else kept


def _not_described(plant: Plant, record: Record) -> dict[str, np.ndarray]:
    """Masks of the samples that the family does not describe, by what they are."""
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
    return found
