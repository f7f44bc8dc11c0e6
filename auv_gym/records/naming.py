"""Columns that look like a channel, by the words that people use for it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import SequenceMatcher
from itertools import pairwise
from typing import Final

from auv_gym.channels import CHANNELS
from auv_gym.param import listed

_OVER_GROUND: Final = ("dvl", "bt")  # bottom track
# For each channel, words or symbols that other people's names for it contain.
WORDS: Final[dict[str, tuple[str, ...]]] = {
    "time_s": ("time", "timestamp", "t", "epoch", "juld", "seconds", "secs", "sec", "date", "datetime", "clock", "utc"),
    "heading_rad": ("heading", "hdg", "yaw", "psi", "head", "compass", "azimuth", "bearing"),
    "pitch_rad": ("pitch", "theta", "pitchang", "tilt", "trim"),
    "roll_rad": ("roll", "phi", "rollang", "heel", "bank"),
    "depth_m": ("depth", "z", "deep", "dep", "pos_z"),
    "pressure_dbar": ("pressure", "press", "pres", "dbar"),
    "north_m": ("north", "x", "northing", "pos_n"),
    "east_m": ("east", "y", "easting", "pos_e"),
    "u_mps": ("u", "surge", "speed", "forward", "stw", "airspeed"),
    "v_mps": ("v", "sway", "lateral"),
    "w_mps": ("w", "heave"),
    "p_radps": ("p", "rollrate", "rollspeed", "gyrx", "gyro_x", "omega_x"),
    "q_radps": ("q", "pitchrate", "pitchspeed", "gyry", "gyro_y", "omega_y"),
    "r_radps": ("r", "yawrate", "yawspeed", "gyrz", "gyro_z", "omega_z", "turnrate"),
    "rudder_rad": ("rudder", "fin", "rud", "delta_r", "deltar", "dr", "steering"),
    "stern_plane_rad": ("stern_plane", "elevator", "elev", "plane", "delta_s", "deltas", "ds", "stern", "sternplane"),
    "bow_plane_rad": ("bow_plane", "bowplane", "delta_b", "bow"),
    "propeller_rpm": ("propeller", "rpm", "prop", "shaft", "thruster", "rotor", "n"),
    "propeller_V": ("propeller", "voltage", "prop", "motor", "thruster"),
    "speed_cmd_mps": ("speed", "desired_speed", "throttle", "velocity"),
    "piston_m": ("piston", "stroke", "ballast"),
    "oil_volume_m3": ("oil", "bladder", "vbd", "ballast", "volume", "buoyancy"),
    "buoyancy_volume_m3": ("vbd", "ballast", "buoyancy", "engine", "volume", "oil"),
    "u_dvl_mps": tuple(f"{dvl}_{axis}" for dvl in _OVER_GROUND for axis in ("u", "x", "vx", "fwd", "forward", "surge")),
    "v_dvl_mps": tuple(
        f"{dvl}_{axis}"
        for dvl in _OVER_GROUND
        for axis in ("v", "y", "vy", "stbd", "starboard", "lateral", "lat", "sway")
    ),
    "w_dvl_mps": tuple(f"{dvl}_{axis}" for dvl in _OVER_GROUND for axis in ("w", "z", "vz", "down", "heave")),
    "temperature_C": ("temperature", "temp"),
    "salinity_psu": ("salinity", "psal", "sal"),
    "density_kgpm3": ("density", "rho", "sigma"),
}
# Aliases that are unambiguous together with a suitable unit, and the beginning of our name.
NICKNAMES: Final[dict[str, str]] = {
    "yaw": "heading", "hdg": "heading", "yaw_rate": "r", "yawrate": "r", "pitch_rate": "q", "pitchrate": "q",
    "roll_rate": "p", "rollrate": "p", "prop_rpm": "propeller_rpm", "prop": "propeller", "rudder_angle": "rudder",
    "sternplane": "stern_plane", "stern_plane_angle": "stern_plane", "temp": "temperature",
    "water_temp": "temperature", "water_temperature": "temperature", "sal": "salinity", "psal": "salinity",
    "practical_salinity": "salinity", "cond": "conductivity", "press": "pressure", "pres": "pressure",
    "northing": "north", "easting": "east", "rud": "rudder",
    **{f"{word}_{axis}": rate for word in ("gyro", "gyr", "omega") for axis, rate in zip("xyz", "pqr", strict=True)},
    **{f"{word}{axis}": rate for word in ("gyro", "gyr") for axis, rate in zip("xyz", "pqr", strict=True)},
}  # fmt: skip
_NUMBERED: Final = re.compile(r"(thr|thruster|thrust|t|motor|mot|esc|prop|propeller|pwm|output|servo|m|ch)_?(\d+)")
_SURE_NUMBERED: Final = ("thr", "thruster")
_COMMANDED = frozenset(
    {"cmd", "c", "command", "commanded", "desired", "des", "target", "setpoint", "sp", "ref", "goal", "d"}
)
_ALIKE = 0.8  # share of common letters above which one word may be a misspelling of another


def nickname_of(stem: str) -> str:
    """The beginning of our name for an alias that is unambiguous together with a suitable unit; '' if it is none."""
    numbered = _NUMBERED.fullmatch(stem)
    if numbered is not None and numbered[1] in _SURE_NUMBERED:
        return f"t{int(numbered[2])}"
    return NICKNAMES.get(stem, "")


def candidates(channel: str, columns: Iterable[str], most: int = 3) -> list[str]:
    """The columns whose names look like a channel's, the likeliest first; empty if there are none.

    A command may serve as an input, but not as a measured motion.
    """
    wants_command = "_cmd" in channel
    measured = channel.replace("_cmd", "")
    words = WORDS.get(channel, WORDS.get(measured, (measured.rpartition("_")[0],)))
    moves = channel in CHANNELS and CHANNELS[channel].kind == "motion"
    scored = []
    for column in columns:
        said = _words_of(column)
        if moves and _COMMANDED & said:
            continue
        score = max((_score(word, said, column.lower()) for word in words), default=0.0)
        score = max(score, _score_of_number(measured, said))
        if score and bool(_COMMANDED & said) != wants_command:
            score -= 0.3
        if score > 0.0:
            scored.append((-score, len(scored), column))
    return [column for _, _, column in sorted(scored)[:most]]


def is_commanded(name: str) -> bool:
    """Whether a name contains a word for a command rather than a measurement."""
    return bool(_COMMANDED & _words_of(name))


def looks_like(channel: str, columns: Iterable[str]) -> str:
    """A sentence on the columns that look like a channel, with a trailing space; empty if there are none."""
    found = [f"`{column}`" for column in candidates(channel, columns)]
    if not found:
        return ""
    verb = "looks" if len(found) == 1 else "look"
    return f"{listed(found)} {verb} like `{channel}`. "


def _score(word: str, said: set[str], column: str) -> float:
    if len(word) == 1:  # a one-letter symbol counts only if it is the whole name
        return 0.8 if said == {word} else 0.0
    if word in said:
        return 1.0 if len(word) > 2 else 0.8
    if len(word) > 3 and word.replace("_", "") in column.replace("_", ""):
        return 0.7
    if len(word) > 3 and any(SequenceMatcher(None, word, other).ratio() >= _ALIKE for other in said):
        return 0.5
    return 0.0


def _score_of_number(channel: str, said: set[str]) -> float:
    """How well the words of a column name the thruster of a channel such as `t1_share`: `Thr1`, `motor 1`."""
    wanted = re.fullmatch(r"t(\d+)_[a-z]+", channel)
    if wanted is None:
        return 0.0
    found = [match for word in said if (match := _NUMBERED.fullmatch(word)) and int(match[2]) == int(wanted[1])]
    return max((1.0 if match[1] in _SURE_NUMBERED else 0.7 for match in found), default=0.0)


def _words_of(name: str) -> set[str]:
    parts = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    words = [word for word in re.split(r"[^a-z0-9]+", parts.lower()) if word]
    pairs = list(pairwise(words))
    return {*words, *("_".join(pair) for pair in pairs), *("".join(pair) for pair in pairs)}
