"""What changes between missions of gliders and floats, and within a log: how often it is named, and when it is not there.

    python -m scripts.studies.changes --seeds 40 --jobs 2 --out changes

Vehicle, effect, noise and excitation are drawn from the seed.  Effects have 3 to 6 times the size that the part of a
log with them would just show.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any

import numpy as np
from scipy.stats import beta

from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from identification.changes.missions import Comparison, compare_missions
from scripts.blind.cases import FAMILIES, PERIOD_OF, detectable_sizes
from scripts.blind.kinds import effects_of, known, log_of
from scripts.blind.logs import Conditions
from scripts.studies.harness import Found, Option, Sheet, Study

VEHICLES = tuple(v for name in ("glider", "float") for v in FAMILIES[name].vehicles)
MULTIPLES = (3.0, 6.0)  # of the detectable size
DURATION = 600.0  # s, of a glider's log
ATTEMPTS = 60
MISSIONS = {  # whether the effect is there before and after
    "missions: the same": (False, False),
    "missions: effect in both": (True, True),
    "missions: effect new": (False, True),
    "missions: effect gone": (True, False),
}


def attempt(case: str, seed: int, vehicle: str) -> dict[str, Any]:
    """What was drawn, and what was found of it."""
    rng = np.random.default_rng([seed, len(case), *case.encode()])
    names = VEHICLES if vehicle == "all" else (vehicle,)
    plant = known(str(rng.choice(names)))
    conditions = Conditions(float(rng.choice([0.5, 1.0, 2.0])), float(rng.uniform(0.7, 1.3)), DURATION)
    return _missions(case, plant, conditions, rng) | {"vehicle": plant.name}


def _missions(case: str, plant: Plant, conditions: Conditions, rng: np.random.Generator) -> dict[str, Any]:
    seeds, there = [int(s) for s in rng.integers(2**31, size=2)], MISSIONS[case]
    path, plants, logs = "", (plant, plant), []
    for _ in range(ATTEMPTS):
        try:
            if any(there):
                path, other = drawn_effect(plant, conditions, seeds[1], rng)
                plants = tuple(other if effect else plant for effect in there)
            logs = [log_of(p, conditions, seed) for p, seed in zip(plants, seeds, strict=True)]
            break
        except (ValueError, Diverged, np.linalg.LinAlgError):  # the vehicle cannot be kept on its way with it
            logs = []
    if not logs:
        raise ValueError(f"No effect of {plant.name} shows in {ATTEMPTS} draws.")
    begin = perf_counter()
    found = compare_missions({"before": logs[0]}, {"after": logs[1]}, plant)
    truth = [value_at(p, path) for p in plants] if path else []
    return _told(found, path, truth) | {"seconds": perf_counter() - begin}


def drawn_effect(plant: Plant, conditions: Conditions, seed: int, rng: np.random.Generator) -> tuple[str, Plant]:
    """An effect, and the plant with it; raises ValueError where a clean log of this seed would not show it."""
    path = str(rng.choice([p for p in effects_of(plant.name) if p not in PERIOD_OF]))
    size = detectable_sizes(plant, log_of(plant, conditions, seed), [path])[path]
    spec = spec_at(plant, path)
    side = rng.choice([-1.0, 1.0]) if spec.bounds[0] < spec.neutral else 1.0
    value = spec.neutral + float(side * rng.uniform(*MULTIPLES) * size)
    if not spec.bounds[0] < value < spec.bounds[1]:
        raise ValueError(f"{path} shows nothing.")
    return path, replace_at(plant, path, value)


def _told(found: Comparison, path: str, truth: list[float]) -> dict[str, Any]:
    own = [c for c in found.changed if c.path == path or any(t.endswith(f" {path}") for t in c.tied)]
    same = [c for c in found.common if c.path == path or path in c.tied]
    exact = next((c for c in found.changed if c.path == path), None)
    return {
        "path": path,
        "truth": truth,
        "changed": [c.path for c in found.changed],
        "tied": [list(c.tied) for c in found.changed],
        "common": [c.path for c in found.common],
        "right_change": bool(own),
        "false_changes": [c.path for c in found.changed if c not in own],
        "sure_changes": [c.path for c in found.changed if c.surely],
        "right_common": bool(same),
        "covered": exact is not None and _holds(exact.change.ci95, truth),
        "sized": exact is not None,
    }


def _holds(limits: tuple[float, float], truth: list[float]) -> bool:
    return limits[0] <= truth[1] - truth[0] <= limits[1]


def exact(hits: int, count: int) -> str:
    """`19 of 20 (75 to 100 %)`, the exact 95 % interval.  Source: Clopper and Pearson 1934."""
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits} of {count} ({100.0 * low:.0f} to {100.0 * high:.0f} %)" if count else "–"


_RIGHT: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
    "missions: the same": lambda r: not r["changed"],
    "missions: effect in both": lambda r: r["right_common"],
    "missions: effect new": lambda r: r["right_change"],
    "missions: effect gone": lambda r: r["right_change"],
}


def sheets(found: Found) -> list[Sheet]:
    """A row for each case, and one for each log that came out wrong."""
    rows, misses = [], []
    for case in found.runs:
        runs = found.of(case)
        right = [_RIGHT[case](r) for r in runs]
        false = [bool(r["false_changes"]) for r in runs]
        sized = [r for r in runs if r["sized"]]
        seconds = f"{np.median([r['seconds'] for r in runs]):.0f}"
        covered = exact(sum(r["covered"] for r in sized), len(sized))
        rows.append([case, exact(sum(right), len(runs)), exact(sum(false), len(runs)), covered, seconds])
        for seed, r in found.runs[case].items():
            if not _RIGHT[case](r) or r["false_changes"]:
                told = "; ".join(r["changed"]) or "no change", "; ".join(r["common"])
                misses.append([case, str(seed), r["vehicle"], r["path"], *told])
    heads = ("case", "right>", "a false change>", "interval of the change holds>", "s>")
    wrong = ("case", "seed>", "vehicle", "truth", "named as changed", "named as common")
    return [
        Sheet("changes", "Changes between missions", heads, rows),
        Sheet("misses", "What came out wrong", wrong, misses),
    ]


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(MISSIONS),
    sheets,
    seeds=20,
    first_seed=9000,
    options={"vehicle": Option("all", "one of them alone", choices=("all", *VEHICLES))},
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
