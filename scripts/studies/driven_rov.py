"""A vehicle with thrusters that is driven by hand, simulated by code of its own: what is named, and what beside it.

    python -m scripts.studies.driven_rov --seed 9900 --jobs 2 --out driven_rov

`bluerov2_heavy` in a current, with damping that is 10 % off (standard deviation) and, in some cases, one effect that
nobody declared; in all but the first case random pushes of 0.6 N and 0.03 N m, with a correlation time of 1.5 s. Logs
of 300 s at 10 Hz have attitude, rates, speeds over ground at 5 Hz, depth and commands; see `scripts.blind.own_rov`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from time import perf_counter
from typing import Any

import numpy as np

from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from identification.diagnosis import as_json, diagnose
from scripts.blind.own_forces import DAMPING
from scripts.blind.own_rov import driven
from scripts.studies.harness import Found, Option, Sheet, Study

VEHICLE = "bluerov2_heavy"
CURRENT = {"effects.current.north": 0.1, "effects.current.east": -0.05}
OFF = 0.1  # relative standard deviation of damping
CASES: Mapping[str, Mapping[str, float]] = {
    "nothing pushes it": {},
    "pushed": {},
    "a thruster weak": {"effects.t3.lost": 0.4},
    "a thruster slow": {"effects.t5.lag": 0.4},
    "gyro bias": {"effects.gyros.bias_p": 0.01},
    "Doppler log turned": {"effects.dvl_ground.misalignment": 0.12},
}


def truth_of(case: str, rng: np.random.Generator) -> Plant:
    """The vehicle of a case, its damping drawn."""
    plant = load_vehicle(VEHICLE)
    paths = [path for path in plant.coefficients if path in DAMPING]
    factors = 1.0 + OFF * rng.standard_normal(len(paths))
    moved = {path: factor * value_at(plant, path) for path, factor in zip(paths, factors.tolist(), strict=True)}
    return replace_at(plant, {**moved, **CURRENT, **CASES[case]})


def attempt(case: str, seed: int, duration: float) -> dict[str, Any]:
    """What is named in a log, with intervals, what is left, and how long it took."""
    rng = np.random.default_rng([seed, list(CASES).index(case)])
    log = driven(truth_of(case, rng), rng, duration, push=0.0 if case == "nothing pushes it" else 0.3)
    began = perf_counter()
    found = as_json(diagnose(log, load_vehicle(VEHICLE)))
    effects = {e["path"]: [e["value"], *e["ci95"]] for e in found["effects"]}
    left = [what for what, told in found["left"].items() if told]
    return {
        "verdict": found["verdict"],
        "effects": effects,
        "tied": found["tied"],
        "left": left,
        "process": {name: list(one.values()) for name, one in found["process_noise"]["process"].items()},
        "seconds": perf_counter() - began,
    }


def sheets(found: Found) -> list[Sheet]:
    """A row for each log."""
    rows = []
    for case, runs in found.runs.items():
        true = {**CURRENT, **CASES[case]}
        for seed, one in runs.items():
            named = [(path.removeprefix("effects."), *numbers) for path, numbers in one["effects"].items()]
            held = sum(low <= true[path] <= high for path, (_, low, high) in one["effects"].items() if path in true)
            right = sum(path in true for path in one["effects"])
            rows.append([
                f"{case}, {seed}",
                ", ".join(f"{path.removeprefix('effects.')} {value:g}" for path, value in true.items()),
                one["verdict"],
                ", ".join(f"{path} {value:.3g} ({low:.3g} to {high:.3g})" for path, value, low, high in named),
                f"{right} of {len(true)}",
                str(len(one["effects"]) - right),
                f"{held} of {right}",
                ", ".join(one["left"]) or "nothing",
                f"{one['seconds']:.0f}",
            ])  # fmt: skip
    heads = ("case, seed", "true", "verdict", "named (95 % interval)", "right", "false", "intervals hold", "left", "s>")
    return [Sheet("driven", "A vehicle with thrusters, driven by hand, by code of its own", heads, rows)]


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(CASES),
    sheets,
    seeds=1,
    options={"duration": Option(300.0, "of a log, s", least=60.0)},
    facts={"current": CURRENT, "cases": {case: dict(effects) for case, effects in CASES.items()}},
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
