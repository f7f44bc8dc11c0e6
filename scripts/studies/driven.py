"""Diagnoses of vehicles on missions that independent code simulates: right, wrong and missing names.

    python -m scripts.studies.driven --seed 9900 --jobs 2 --out driven
    python -m scripts.studies.driven --case 'torpedo*' --seed 9950 --jobs 2 --out torpedo

`bluerov2_heavy` is driven by hand (`scripts.blind.own_rov`); its damping is 10 % off (standard deviation).  `vt690`, a
torpedo, follows legs and depths (`scripts.blind.own_cruise`); all its coefficients are 10 % off.  Both are in an
undeclared current, and some have one more effect.  In all but one case of each, random pushes act: 0.6 N and 0.03 to
0.045 N m for 1.5 s (correlation time) on the first, 0.01 m/s^2 and 0.3 to 0.6 deg/s^2 for 3 s on the torpedo, which may
also be in an equally strong swell of 6 s, or have a compass that wanders by 0.03 rad, or a Doppler log that oscillates
by 0.03 m/s.  Logs of 300 s at 10 Hz hold attitude, rates, speeds over ground at 5 Hz, depth and commands.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import as_json, diagnose
from scripts.blind.own_cruise import cruised
from scripts.blind.own_forces import DAMPING
from scripts.blind.own_rov import driven
from scripts.studies.harness import Found, Option, Sheet, Study

OFF = 0.1  # relative standard deviation of the wrong coefficients
MOST_OFF = 2.0  # largest error, in these deviations


@dataclass(frozen=True)
class Mission:
    """A vehicle, its simulator, its current, and its wrong coefficients."""

    vehicle: str
    run: Callable[..., Record]
    current: Mapping[str, float]
    off: Callable[[str], bool]


@dataclass(frozen=True)
class Case:
    """A mission with effects; pushes: arguments of the function that makes the log."""

    mission: Mission
    effects: Mapping[str, float] = field(default_factory=dict)
    pushes: Mapping[str, float] = field(default_factory=dict)

    @property
    def true(self) -> dict[str, float]:
        """All effects that should be named."""
        return {**self.mission.current, **self.effects}


BY_HAND = Mission(
    "bluerov2_heavy", driven, {"effects.current.north": 0.1, "effects.current.east": -0.05}, DAMPING.__contains__
)
CRUISE = Mission("vt690", cruised, {"effects.current.north": 0.15, "effects.current.east": -0.1}, lambda path: True)
STILL, GUSTS, SWELL = {"push": 0.0, "swell": 0.0}, {"push": 0.5, "swell": 0.0}, {"push": 0.5, "swell": 0.5}
WANDERS, SWINGS = GUSTS | {"wander": 0.03}, GUSTS | {"swing": 0.03}
CASES: Mapping[str, Case] = {
    "nothing pushes it": Case(BY_HAND, pushes={"push": 0.0}),
    "pushed": Case(BY_HAND),
    "a thruster weak": Case(BY_HAND, {"effects.t3.lost": 0.4}),
    "a thruster slow": Case(BY_HAND, {"effects.t5.lag": 0.4}),
    "gyro bias": Case(BY_HAND, {"effects.gyros.bias_p": 0.01}),
    "Doppler log turned": Case(BY_HAND, {"effects.dvl_ground.misalignment": 0.12}),
    "torpedo, nothing pushes it": Case(CRUISE, pushes=STILL),
    "torpedo, pushed": Case(CRUISE, pushes=GUSTS),
    "torpedo, pushed, rudder offset": Case(CRUISE, {"effects.rudder.offset": 0.05}, GUSTS),
    "torpedo, pushed, too light": Case(CRUISE, {"effects.load.net_buoyancy": 3.0}, GUSTS),
    "torpedo, swell": Case(CRUISE, pushes=SWELL),
    "torpedo, swell, rudder offset": Case(CRUISE, {"effects.rudder.offset": 0.05}, SWELL),
    "torpedo, swell, too light": Case(CRUISE, {"effects.load.net_buoyancy": 3.0}, SWELL),
    "torpedo, swell, gyro bias": Case(CRUISE, {"effects.gyros.bias_r": 0.01}, SWELL),
    "torpedo, compass wanders": Case(CRUISE, pushes=WANDERS),
    "torpedo, compass wanders, rudder offset": Case(CRUISE, {"effects.rudder.offset": 0.05}, WANDERS),
    "torpedo, Doppler log swings, rudder offset": Case(CRUISE, {"effects.rudder.offset": 0.05}, SWINGS),
}


def truth_of(case: str, rng: np.random.Generator) -> Plant:
    """The vehicle of a case, with random coefficients."""
    mission = CASES[case].mission
    plant = load_vehicle(mission.vehicle)
    paths = [path for path in plant.coefficients if mission.off(path)]
    factors = 1.0 + OFF * np.clip(rng.standard_normal(len(paths)), -MOST_OFF, MOST_OFF)
    moved = {path: factor * value_at(plant, path) for path, factor in zip(paths, factors.tolist(), strict=True)}
    return replace_at(plant, {**moved, **CASES[case].true})


def attempt(case: str, seed: int, duration: float) -> dict[str, Any]:
    """The names given to a log, with intervals, the remainder, and the time taken."""
    rng, mission = np.random.default_rng([seed, list(CASES).index(case)]), CASES[case].mission
    log = mission.run(truth_of(case, rng), rng, duration, **CASES[case].pushes)
    began = perf_counter()
    found = as_json(diagnose(log, load_vehicle(mission.vehicle)))
    effects = {e["path"]: [e["value"], *e["ci95"]] for e in found["effects"]}
    left = [what for what, told in found["left"].items() if told]
    return {
        "verdict": found["verdict"],
        "effects": effects,
        "tied": found["tied"],
        "left": left,
        "process": {name: list(one.values()) for name, one in found["process_noise"]["process"].items()},
        "swell": found["process_noise"]["swell"],
        "lasting": found["process_noise"]["lasting"],
        "seconds": perf_counter() - began,
    }


def sheets(found: Found) -> list[Sheet]:
    """A row for each log."""
    rows = []
    for case, runs in found.runs.items():
        true = CASES[case].true
        for seed, one in runs.items():
            named = [(path.removeprefix("effects."), *numbers) for path, numbers in one["effects"].items()]
            held = sum(low <= true[path] <= high for path, (_, low, high) in one["effects"].items() if path in true)
            tied = {path for group in one["tied"] for path in group}
            right = sum(path in one["effects"] or path in tied for path in true)
            false = sum(
                path not in true and not any(path in group and true.keys() & set(group) for group in one["tied"])
                for path in one["effects"]
            )
            told = [f"swell of {swell['period_s']:.1f} s" for swell in one.get("swell", [])]
            for errors in one.get("lasting", []):
                period = f" of {errors['period_s']:.1f} s" if errors["period_s"] else ""
                told.append(f"lasting errors{period} ({', '.join(errors['errors'])})")
            rows.append([
                f"{case}, {seed}",
                ", ".join(f"{path.removeprefix('effects.')} {value:g}" for path, value in true.items()),
                one["verdict"],
                ", ".join(f"{path} {value:.3g} ({low:.3g} to {high:.3g})" for path, value, low, high in named),
                f"{right} of {len(true)}",
                str(false),
                f"{held} of {sum(path in true for path in one['effects'])}",
                ", ".join(one["left"]) or "nothing",
                ", ".join(told) or "none",
                f"{one['seconds']:.0f}",
            ])  # fmt: skip
    heads = (
        "case, seed", "true", "verdict", "named (95 % interval)", "right or tied", "false", "intervals hold", "left",
        "waves, lasting errors", "s>",
    )  # fmt: skip
    return [Sheet("driven", "Vehicles on missions, by code of its own", heads, rows)]


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(CASES),
    sheets,
    seeds=1,
    options={"duration": Option(300.0, "of a log, s", least=60.0)},
    facts={"cases": {case: one.true for case, one in CASES.items()}},
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
