"""Suspicions about a log before any vehicle is known: units, signs, wraps and clocks."""

from __future__ import annotations

from math import log, pi, radians
from typing import Final

import numpy as np

from auv_gym.channels import CHANNELS, channel
from auv_gym.records.record import Record
from auv_gym.records.understanding import Understood

_ANGLE = ((radians(1.0), "degrees", "deg"),)
# For each channel or unit, the lowest and highest possible value, and units that would explain values beyond.
_SPEED = ((0.5144, "knots", "kn"), (1e-2, "centimetres per second", "cmps"), (1e-3, "millimetres per second", "mmps"))
_LENGTH = ((1e-2, "centimetres", "cm"), (1e-3, "millimetres", "mm"))
_POSSIBLE: Final[dict[str, tuple[float, float, tuple[tuple[float, str, str], ...]]]] = {
    "depth_m": (-10.0, 11_000.0, _LENGTH),
    "pitch_rad": (-0.5 * pi - 0.1, 0.5 * pi + 0.1, _ANGLE),
    "roll_rad": (-2.0 * pi - 0.1, 2.0 * pi + 0.1, _ANGLE),
    "heading_rad": (-2.0 * pi - 0.1, 4.0 * pi + 0.1, _ANGLE),
    "rudder_rad": (-0.5 * pi - 0.1, 0.5 * pi + 0.1, _ANGLE),
    "stern_plane_rad": (-0.5 * pi - 0.1, 0.5 * pi + 0.1, _ANGLE),
    "bow_plane_rad": (-0.5 * pi - 0.1, 0.5 * pi + 0.1, _ANGLE),
    "m/s": (-15.0, 15.0, _SPEED),
    "rad/s": (-20.0, 20.0, ((radians(1.0), "degrees per second", "degps"),)),
    "temperature_C": (-3.0, 60.0, ((1e-2, "hundredths of a degree", ""),)),
    "pressure_dbar": (
        -20.0,
        11_500.0,
        ((1e-4, "pascals", "Pa"), (0.1, "kilopascals", "kPa"), (1e-2, "millibars", "mbar")),
    ),
    "salinity_psu": (0.0, 50.0, ()),
    "buoyancy_volume_m3": (-0.1, 0.1, ((1e-6, "cubic centimetres", "cm3"),)),
    "density_kgpm3": (900.0, 1100.0, ()),
    "rpm": (-20_000.0, 20_000.0, ()),
    "V": (-1000.0, 1000.0, ()),
}
_ANYTHING: Final = (-np.inf, np.inf, ())
_RATES: Final = (("heading_rad", "r_radps"), ("pitch_rad", "q_radps"), ("roll_rad", "p_radps"))
_SURE = 0.6  # correlation above which an angle and its rate clearly belong together
_NEARLY_ONE = 0.95  # correlation above which a factor of two can be distinguished from a gain
_UPRIGHT = 0.5  # cosine of pitch below which roll and heading cannot be separated well
_STEEP = 0.7  # correlation of depth rate and pitch above which their signs are clear
_FACTORS: Final = (  # ratio of the change of an angle to the integral of its rate, and its meaning
    (180.0 / pi, "{rate} looks like radians per second that were taken for degrees, or {angle} like degrees"),
    (pi / 180.0, "{rate} looks like degrees per second that were taken for radians per second"),
    (1e3, "time_s looks 1000 times too short"),
    (1e-3, "time_s looks like milliseconds that were taken for seconds"),
    (2.0, "time runs at half the rate it should, or {rate} at half its size"),
    (0.5, "time runs at twice the rate it should, or {rate} at twice its size"),
)
_FROM_AN_END: Final = (  # volumes whose neutral would move, too, if a mapping changed their sign
    "buoyancy_volume_m3 is larger where depth grows, and more volume lifts: either the depth or the column that this "
    "volume is computed from has the opposite sign. Change that sign in the file."
)
_CLOSE = 0.15  # relative distance from one of these factors
_BLOCK = 1.0  # s, at least, over which rates are integrated
_LEAST = 30  # blocks
_MOST_OF_A_TURN = 5.5  # rad
_MANY_TURNS = 20.0 * pi  # rad; a heading rarely counts over more turns
_SAME_SIZE = log(2.0)  # of two units, in logarithms; the candidates differ by more
_SPIKE, _SPIKES, _FASTEST = 2.0, 10.0, 2.0  # m, usual steps, and m/s: a single depth further off is a spike
_FOLDED = 1.0  # RMS step of an angle, rad; a randomly wrapped angle has pi / sqrt(3)


def suspicions(known: Understood, record: Record | None) -> list[str]:
    """Sentences on what looks wrong with the recognised signals of a log, each with what to do."""
    with np.errstate(all="ignore"):  # a damaged file may hold any number
        found = [*_impossible(known, record), *_wrapped(known)]
        if record is not None:
            found += [*_spikes(record), *_folded(record), *_against_rates(record), *_against_depth(record)]
    return found


def _impossible(known: Understood, record: Record | None) -> list[str]:
    found: list[str] = []
    for name, sources in known.by_channel.items():
        of, source = channel(name), sources[0]
        values = next((s.values[name] for s in known.streams if name in s.values), np.empty(0))
        values = values[np.isfinite(values)]
        if not values.size:
            continue
        least, most = _extent(values)
        if name == "depth_m" and most < 0.5 and least < -2.0:
            found.append(
                f"{source.column}: depth goes from {least:.3g} to {most:.3g} m and so is positive upwards: map it to "
                '"-depth_m".'
            )
        elif beyond_possible(name, values) and not (name == "heading_rad" and _counted(values)):
            units, stem = units_instead(name, values, record), name.rpartition("_")[0]
            looks = f"it looks like {' or '.join(unit[1] for unit in units)}" if units else "check its unit"
            targets = [f'"{stem}_{unit[2]}"' for unit in units if unit[2]]
            mend = f": map it to {' or '.join(targets)}" if targets else ""
            mend += f", whichever gives the true {of.label}" if len(targets) > 1 else ""
            within = name == "heading_rad" and most - least < _MANY_TURNS
            mend += ", unless it is counted over several turns" if within else ""
            found.append(f"{source.column}: {of.label} goes from {least:.4g} to {most:.4g} {of.unit}; {looks}{mend}.")
        elif (few := few_impossible(name, values)).any():
            count, first = int(few.sum()), values[np.argmax(few)]
            found.append(
                f"{source.column}: {count} of {values.size:,} values {'is' if count == 1 else 'are'} impossible for "
                f"{of.label}, such as {first:.4g} {of.unit}. A diagnosis leaves out these samples: correct them in the "
                "file if they matter."
            )
        elif of.unit == "rad" and of.angle and name.startswith("heading"):
            raw = source.group.columns[source.column]
            bottom, top = (float(np.nanmin(raw)), float(np.nanmax(raw))) if isinstance(raw, np.ndarray) else (0.0, 0.0)
            turn = -pi - 0.01 <= bottom and top <= 2.0 * pi + 0.01 and top - bottom > _MOST_OF_A_TURN
            if turn and most < 0.2:
                found.append(
                    f"{source.column}: taken as degrees, but it fills 0 to 2 pi and looks like radians: map it to "
                    f'"{name}".'
                )
    return found


def beyond_possible(name: str, values: np.ndarray) -> bool:
    """Whether the finite values of a channel are beyond what is possible at all, a few of them apart."""
    low, high, _ = _possible_range(name)
    least, most = _extent(values)
    return least < low or most > high


def few_impossible(name: str, values: np.ndarray) -> np.ndarray:
    """A mask of the few impossible values of an input, whose unit is right otherwise; values may be missing."""
    known = np.isfinite(values)
    if name not in CHANNELS or channel(name).kind != "input" or not known.any() or beyond_possible(name, values[known]):
        return np.zeros(values.size, dtype=bool)
    low, high, _ = _possible_range(name)
    return known & ((values < low) | (values > high))


def units_instead(name: str, values: np.ndarray, record: Record | None) -> tuple[tuple[float, str, str], ...]:
    """The units that make the finite values of a channel possible: size in SI, name and suffix of each.

    If there are several, and the record relates depth to forward speed and pitch, only those that agree with it.
    """
    low, high, units = _possible_range(name)
    least, most = _extent(values)
    possible = tuple(u for u in units if least * u[0] >= low and most * u[0] <= high)
    if len(possible) < 2 or record is None:
        return possible
    ratio = _climb(record)
    size = {"depth_m": 1.0 / ratio, "u_mps": ratio}.get(name, np.nan)
    return tuple(u for u in possible if abs(np.log(u[0] / size)) < _SAME_SIZE) or possible


def _climb(record: Record) -> float:
    """The size of the depth rate relative to that of u sin(pitch); NaN if the record does not determine it."""
    if not all(map(record.has, ("depth_m", "u_mps", "pitch_rad"))):
        return np.nan
    sunk, along = _increments(record, record["depth_m"], -record["u_mps"] * np.sin(record["pitch_rad"]), block=10.0)
    known = np.isfinite(sunk) & np.isfinite(along)
    sunk, along = sunk[known], along[known]
    if sunk.size < _LEAST or not (sunk.std() > 0.0 and along.std() > 0.0):
        return np.nan
    clear = abs(float(np.corrcoef(sunk, along)[0, 1])) > _STEEP
    return float(np.sqrt(np.mean(sunk**2) / np.mean(along**2))) if clear else np.nan


def _possible_range(name: str) -> tuple[float, float, tuple[tuple[float, str, str], ...]]:
    return _POSSIBLE.get(name, _POSSIBLE.get(channel(name).unit, _ANYTHING) if name in CHANNELS else _ANYTHING)


def _extent(values: np.ndarray) -> tuple[float, float]:
    """The range of values, a few of them apart."""
    return float(np.quantile(values, 0.01, method="higher")), float(np.quantile(values, 0.99, method="lower"))


def _counted(heading: np.ndarray) -> bool:
    """Whether a heading, rad, can be one counted over a few turns: such a count begins within a turn."""
    return bool(abs(heading[0]) <= 2.0 * pi and np.ptp(heading) < _MANY_TURNS)


def _wrapped(known: Understood) -> list[str]:
    """Angles that jump by a whole turn, in columns not recognised as angles on a circle."""
    found: list[str] = []
    if any("heading_rad" in stream.values for stream in known.streams):  # the heading is already known
        return found
    for stream in known.streams:
        for name, values in stream.values.items():
            of = channel(name)
            if of.unit != "rad" or of.angle or name not in known.by_channel:
                continue
            steps = np.abs(np.diff(values[np.isfinite(values)]))
            jumps = int(np.sum(np.abs(steps - 2.0 * pi) < 0.5))
            if jumps:
                column = known.by_channel[name][0].column
                found.append(
                    f"{column}: jumps by a whole turn {jumps} time{'s' * (jumps != 1)}, and records do not unwrap "
                    f'{name}: map it to "heading_rad" if it is clockwise from north.'
                )
    return found


def _spikes(record: Record) -> list[str]:
    """Single depths that deviate strongly from those before and after them."""
    if not record.has("depth_m"):
        return []
    depth, aside = record["depth_m"], np.zeros(len(record))
    for part in record.segments:
        own = depth[part]
        if own.size > 2:
            aside[part][1:-1] = own[1:-1] - np.clip(own[1:-1], *np.sort([own[:-2], own[2:]], axis=0))
    usual = float(np.median(np.abs(np.diff(depth))))
    spikes = np.abs(aside) > max(_SPIKE, _SPIKES * usual, _FASTEST * record.sample_interval)
    count = int(spikes.sum())
    if not count:
        return []
    many = count > 1
    return [
        f"depth_m has {count:,} reading{'s' * many} that {'jump' if many else 'jumps'} by up to "
        f"{np.abs(aside).max():.3g} m and back ({'the first ' * many}at {record.time[np.argmax(spikes)]:.6g} s). "
        f"{'They stay' if many else 'It stays'} in the record, where a diagnosis of steady flight is cut at each: "
        f"remove {'them' if many else 'it'} from the file."
    ]


def _folded(record: Record) -> list[str]:
    return [
        f"{name}: its steps from sample to sample are as large as if it were folded at random; it looks like degrees "
        "that were taken for radians, or is sampled too slowly to follow the turns."
        for name in ("heading_rad", "roll_rad")
        if record.has(name) and is_folded(record, name)
    ]


def is_folded(record: Record, name: str) -> bool:
    """Whether the steps of an angle are as large as if it were folded at random."""
    steps = np.concatenate([np.diff(record[name][part]) for part in record.segments])
    return steps.size > _LEAST and float(np.sqrt(np.mean(steps**2))) > _FOLDED


def _against_rates(record: Record) -> list[str]:
    """Angles compared with the integrals of their rates: the sign, the unit of either, or the clock."""
    found = []
    for angle, rate in _RATES:
        if not (record.has(angle) and record.has(rate)):
            continue
        turned, integral = _increments(record, record[angle], _angle_rate(record, angle, rate))
        if turned.size < _LEAST or not (turned.std() > 0.0 and integral.std() > 0.0):
            continue
        correlation = abs(float(np.corrcoef(turned, integral)[0, 1]))
        if correlation < _SURE:
            continue
        slope = float(np.sqrt(np.mean(turned**2) / np.mean(integral**2)) * np.sign(np.mean(turned * integral)))
        if slope < 0.0:
            found.append(f'{angle} and {rate} have opposite signs: turn one of them in a mapping, as in "-{rate}".')
        for factor, words in _FACTORS:
            near_one = 0.1 < factor < 10.0  # such a factor can also be a gain or noise
            if abs(abs(slope) / factor - 1.0) < _CLOSE and not (near_one and correlation < _NEARLY_ONE):
                found.append(f"{words.format(angle=angle, rate=rate)}: {angle} turns {abs(slope):.3g} times as far.")
    return found


def _angle_rate(record: Record, angle: str, rate: str) -> np.ndarray:
    """The rate of an angle from the body rates; NaN near the vertical, or if a required rate is missing.

    Source: Fossen 2021, eq. (2.38).
    """
    own = record[rate]
    if not (record.has("roll_rad") and record.has("pitch_rad")):
        return own
    roll, pitch = record["roll_rad"], record["pitch_rad"]
    upright = np.cos(pitch) > _UPRIGHT
    if not (record.has("q_radps") and record.has("r_radps")):
        return np.where(upright & (np.abs(np.sin(roll)) < 0.3) & (np.abs(pitch) < 0.3), own, np.nan)
    q, r = record["q_radps"], record["r_radps"]
    about_vertical = (q * np.sin(roll) + r * np.cos(roll)) / np.where(upright, np.cos(pitch), 1.0)
    rates = {
        "roll_rad": own + about_vertical * np.sin(pitch),
        "pitch_rad": q * np.cos(roll) - r * np.sin(roll),
        "heading_rad": about_vertical,
    }
    return np.where(upright, rates[angle], np.nan)


def _against_depth(record: Record) -> list[str]:
    words = {
        "pitch_rad": "pitch_rad is positive where depth grows; bow up is positive here and depth grows downwards: turn "
        'one of them in a mapping, as in "-pitch_rad", unless the vehicle moves backwards.',
        "buoyancy_volume_m3": "buoyancy_volume_m3 is larger where depth grows, and more volume lifts: turn one of them "
        'in a mapping, as in "-buoyancy_volume_m3".',
    }
    found = []
    for name, said in words.items():
        if _with_depth(record, name) > _STEEP:
            end = name == "buoyancy_volume_m3" and (record[name].min() > 0.0 or record[name].max() < 0.0)
            found.append(_FROM_AN_END if end else said)
    if abs(_with_depth(record, "roll_rad")) > _STEEP and abs(_with_depth(record, "pitch_rad")) < _SURE:
        found.append(
            "roll_rad follows the depth rate, as a pitch does, and pitch_rad does not: they look exchanged. Exchange "
            "them in a mapping."
        )
    return found


def _with_depth(record: Record, name: str) -> float:
    """The correlation of a signal with the depth rate; NaN if the record does not determine it."""
    if not (record.has("depth_m") and record.has(name)):
        return np.nan
    sunk, signal = _increments(record, record["depth_m"], record[name], block=10.0)
    moves = sunk.size >= _LEAST and sunk.std() > 0.5 and signal.std() > 0.0
    return float(np.corrcoef(sunk, signal)[0, 1]) if moves else np.nan


def _increments(
    record: Record, moved: np.ndarray, rate: np.ndarray, block: float = _BLOCK
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of a signal over blocks, and the integrals of another over the same blocks, where that is known."""
    time = record.time
    changes, integrals = [], []
    for part in record.segments:
        t, x, y = time[part], moved[part], rate[part]
        whole = np.r_[0.0, np.cumsum(np.diff(t) * 0.5 * np.nan_to_num(y[1:] + y[:-1]))]
        lost = np.r_[0, np.cumsum(~np.isfinite(y[1:] + y[:-1]))]
        count = max(3, int(np.ceil(block / max(float(np.median(np.diff(t))), 1e-9))))
        at = np.arange(0, t.size, count)
        kept = np.diff(lost[at]) == 0
        changes.append(np.diff(x[at])[kept])
        integrals.append(np.diff(whole[at])[kept])
    return np.concatenate(changes), np.concatenate(integrals)
