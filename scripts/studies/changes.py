"""How often diagnoses name changes between two missions, in some of three logs, and within a log.

    python -m scripts.studies.changes --seeds 40 --jobs 2 --out changes
    python -m scripts.studies.changes --case 'log: *' --vehicle npsauv --seeds 4 --jobs 2 --out onsets

The seed draws the vehicle (a glider or a float unless --vehicle is given), effect, noise and excitation.  An effect has
3 to 6 times the size that is just detectable in the part of a log that it acts in.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from time import perf_counter
from typing import Any

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record, concat
from identification.changes.missions import Comparison, compare_missions
from identification.changes.onset import find_onsets
from identification.changes.spans import BETWEEN, OUTSIDE
from identification.changes.timed_forms import FROM, GROWING
from identification.diagnosis import diagnose
from identification.fit.changing import changed
from scripts.blind.cases import FAMILIES, PERIOD_OF, Clean
from scripts.blind.kinds import effects_of, kind_of, known, log_of
from scripts.blind.logs import Conditions, continued
from scripts.blind.tables import exact_interval
from scripts.studies.harness import Found, Option, Sheet, Study

VEHICLES = tuple(v for name in ("glider", "float") for v in FAMILIES[name].vehicles)
OTHERS = tuple(v for name in ("torpedo", "rov", "glide") for v in FAMILIES[name].vehicles)  # a log takes minutes
MULTIPLES = (3.0, 6.0)  # of the detectable size
DURATION = 600.0  # s, length of a log of vehicles whose blind logs have no length of their own
ATTEMPTS = 60
MISSIONS = {  # whether the effect is present before and after
    "missions: the same": (False, False),
    "missions: effect in both": (True, True),
    "missions: effect new": (False, True),
    "missions: effect gone": (True, False),
}
SEVERAL = {  # of three logs, those with the effect
    "three logs: nothing": (),
    "three logs: effect in all": (1, 2, 3),
    "three logs: effect in one": (2,),
    "three logs: effect from the second on": (2, 3),
}
_ONLY = {(): (), (1, 2, 3): ("",), (2,): ("log2",), (2, 3): ("since2",)}  # the expected form of the name
ONSETS: dict[str, Callable[[float, Sequence[float]], float]] = {  # share of the effect by share of the log
    "log: nothing": lambda t, times: 0.0,
    "log: effect throughout": lambda t, times: 1.0,
    "log: effect from a time on": lambda t, times: float(t >= times[0]),
    "log: effect that grows": lambda t, times: round(min(max(t, 0.0), 1.0), 2),
    "log: effect off, on, off": lambda t, times: float(times[0] <= t < times[1]),
    "log: effect on, off, on": lambda t, times: float(not times[0] <= t < times[1]),
}
FORMS = {  # expected forms of the names
    "log: effect from a time on": FROM,
    "log: effect that grows": GROWING,
    "log: effect off, on, off": BETWEEN,
    "log: effect on, off, on": OUTSIDE,
}
SPANS = ((0.15, 0.55), (0.45, 0.85))  # shares of the log: ranges of the first and second time


def attempt(case: str, seed: int, vehicle: str) -> dict[str, Any]:
    """The drawn truth, and the findings."""
    rng = np.random.default_rng([seed, len(case), *case.encode()])
    names = VEHICLES if vehicle == "all" else (vehicle,)
    plant = known(str(rng.choice(names)))
    length = next(group.durations for group in FAMILIES.values() if plant.name in group.vehicles)
    duration = DURATION if length is None else float(np.mean(length))
    conditions = Conditions(float(rng.choice([0.5, 1.0, 2.0])), float(rng.uniform(0.7, 1.3)), duration)
    work = _missions if case in MISSIONS else _several if case in SEVERAL else _onset
    return work(case, plant, conditions, rng) | {"vehicle": plant.name}


def _onset(case: str, plant: Plant, conditions: Conditions, rng: np.random.Generator) -> dict[str, Any]:
    """An effect from a time on, growing, between or outside of two times, or none."""
    shape, seed, form = ONSETS[case], int(rng.integers(2**31)), FORMS.get(case, "")
    times = tuple(rng.uniform(*SPANS)) if form in (BETWEEN, OUTSIDE) else (float(rng.uniform(0.2, 0.8)),)
    there = 1.0 - times[0] if len(times) == 1 else abs(float(form == OUTSIDE) - (times[1] - times[0]))
    path, value, record, length = "", 0.0, None, kind_length(plant, conditions)
    for _ in range(ATTEMPTS):
        try:
            other = plant
            if case != "log: nothing":
                path, other = drawn_effect(plant, conditions, seed, rng, there)
                value = value_at(other, path)
            record = changing_log(plant, other, path, conditions, seed, lambda t: shape(t / length, times))
            break
        except (ValueError, Diverged, np.linalg.LinAlgError):
            record = None
    if record is None:
        raise ValueError(f"No effect of {plant.name} shows in {ATTEMPTS} draws.")
    begin = perf_counter()
    found = find_onsets(record, plant)
    # an effect acts from the first sample at or after its onset
    truth = [float(record.time[min(np.searchsorted(record.time, t * length), len(record) - 1)]) for t in times]
    own = [f for f in found.found if path and (f.path == path or any(t.endswith(path) for t in f.tied))]
    timed = [[t for t in (f.time, f.second) if t is not None] for f in own if f.form == form]
    timed = [told for told in timed if told]
    return {
        "path": path,
        "size": value,
        "times": truth,
        "length": length,
        "found": [[f.form, f.path, f.size.value, *f.size.ci95, list(f.tied), f.steady] for f in found.found],
        "named": bool(own),
        "forms": [f.form for f in own],
        "changing": [f.path for f in found.found if f.form],
        "flagged": any(f.form or not f.steady for f in found.found),
        "false": [f.path for f in found.found if f not in own],
        "near": any(all(abs(t.value - true) <= 0.05 * length for t, true in zip(told, truth)) for told in timed),
        "holds": any(all(t.ci95[0] <= true <= t.ci95[1] for t, true in zip(told, truth)) for told in timed),
        "timed": bool(timed),
        "seconds": perf_counter() - begin,
    }


def kind_length(plant: Plant, conditions: Conditions) -> float:
    """The length of the standard experiment's log, s."""
    record = continued(log_of(plant, conditions, 0))
    return float(record.time[-1] - record.time[0])


def changing_log(
    plant: Plant, other: Plant, path: str, conditions: Conditions, seed: int, share: Callable[[float], float]
) -> Record:
    """The log of a plant's standard experiment, with an effect of another plant times a share that depends on time."""
    low, high = (value_at(p, path) if path else 0.0 for p in (plant, other))

    @cache
    def at(size: float) -> Plant:
        return replace_at(plant, path, low + size * (high - low)) if size else plant

    kind = kind_of(plant)
    moving = kind.changing(plant, lambda t: at(share(t)))
    return kind.log(plant, conditions, np.random.default_rng(seed), moving)


def _missions(case: str, plant: Plant, conditions: Conditions, rng: np.random.Generator) -> dict[str, Any]:
    there = MISSIONS[case]
    path, other, logs = drawn_logs(plant, conditions, rng, there)
    begin = perf_counter()
    found = compare_missions(logs[0], logs[1], plant)
    truth = [value_at(other if effect else plant, path) for effect in there] if path else []
    return _told(found, path, truth) | {"seconds": perf_counter() - begin}


def _several(case: str, plant: Plant, conditions: Conditions, rng: np.random.Generator) -> dict[str, Any]:
    """Three logs as one record, some of them with an effect."""
    there = SEVERAL[case]
    path, other, logs = drawn_logs(plant, conditions, rng, [k in there for k in (1, 2, 3)])
    begin = perf_counter()
    labelled = [log.with_labels([f"log {k}"] * len(log.segments)) for k, log in enumerate(logs, 1)]
    found = diagnose(concat(labelled), plant)
    groups = [[changed(p) for p in (e.path, *e.tied_with)] for e in found.effects]
    right = [[form for form, own in group if own == path] for group in groups]
    size = next((e for e in found.effects if changed(e.path) in [(form, path) for form in _ONLY[there]]), None)
    # an effect of only some logs is its addition in these
    truth = value_at(other, path) - (value_at(plant, path) if len(there) < len(logs) else 0.0) if path else 0.0
    return {
        "path": path,
        "truth": truth,
        "verdict": found.verdict,
        "found": [[e.path, e.value, *e.ci95, list(e.tied_with)] for e in (*found.effects, *found.alike)],
        "right": bool(right) and any(set(_ONLY[there]) & set(forms) for forms in right),
        "named": any(right),
        "false": [e.path for e, forms in zip(found.effects, right, strict=True) if not forms],
        "covered": size is not None and size.ci95[0] <= truth <= size.ci95[1],
        "sized": size is not None,
        "seconds": perf_counter() - begin,
    }


def drawn_logs(
    plant: Plant, conditions: Conditions, rng: np.random.Generator, there: Sequence[bool]
) -> tuple[str, Plant, list[Record]]:
    """Logs, some of them with an effect: its path, "" if none has one, the plant with it, and the logs."""
    seeds, path, other = [int(s) for s in rng.integers(2**31, size=len(there))], "", plant
    for _ in range(ATTEMPTS):
        try:
            if any(there):
                path, other = drawn_effect(plant, conditions, seeds[1], rng)
            plants = [other if effect else plant for effect in there]
            return path, other, [log_of(p, conditions, seed) for p, seed in zip(plants, seeds, strict=True)]
        except (ValueError, Diverged, np.linalg.LinAlgError):  # the vehicle cannot be controlled with it
            continue
    raise ValueError(f"No effect of {plant.name} shows in {ATTEMPTS} draws.")


def drawn_effect(
    plant: Plant, conditions: Conditions, seed: int, rng: np.random.Generator, share: float = 1.0
) -> tuple[str, Plant]:
    """An effect, and the plant with it; raises ValueError if a clean log of this seed would not show it.

    share: of the log, the last part, in which it must be visible.
    """
    path = str(rng.choice([p for p in effects_of(plant.name) if p not in PERIOD_OF]))
    size = _clean(plant, conditions, seed, share).detectable([path])[path]
    spec = spec_at(plant, path)
    side = rng.choice([-1.0, 1.0]) if spec.bounds[0] < spec.neutral else 1.0
    value = spec.neutral + float(side * rng.uniform(*MULTIPLES) * size)
    if not spec.bounds[0] < value < spec.bounds[1]:
        raise ValueError(f"{path} shows nothing.")
    return path, replace_at(plant, path, value)


@lru_cache(maxsize=1)
def _clean(plant: Plant, conditions: Conditions, seed: int, share: float) -> Clean:
    """The last part of a log without effects, this share of it."""
    clean = continued(log_of(plant, conditions, seed))
    return Clean.of(plant, clean.select(clean.time >= clean.time[-1] - share * (clean.time[-1] - clean.time[0])))


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
    """`19 of 20 (75 to 100 %)`, the exact 95 % interval."""
    low, high = exact_interval(hits, count)
    return f"{hits} of {count} ({100.0 * low:.0f} to {100.0 * high:.0f} %)" if count else "–"


_RIGHT: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
    "missions: the same": lambda r: not r["changed"],
    "missions: effect in both": lambda r: r["right_common"],
    "missions: effect new": lambda r: r["right_change"],
    "missions: effect gone": lambda r: r["right_change"],
    "three logs: nothing": lambda r: not r["found"],
    **{case: lambda r: r["right"] for case, there in SEVERAL.items() if there},
    "log: nothing": lambda r: not r["changing"],
    "log: effect throughout": lambda r: r["named"] and not r["changing"],
    **{case: lambda r, form=form: form in r["forms"] for case, form in FORMS.items()},
}


def sheets(found: Found) -> list[Sheet]:
    """A row for each case, and one for each log that came out wrong."""
    rows, misses = {"missions": [], "three logs": [], "log": []}, []
    for case in found.runs:
        runs, missions = found.of(case), case in MISSIONS
        right, false = [_RIGHT[case](r) for r in runs], "false_changes" if missions else "false"
        row = [case, exact(sum(right), len(runs)), exact(sum(bool(r[false]) for r in runs), len(runs))]
        if missions or case in SEVERAL:
            sized = [r for r in runs if r["sized"]]
            row.append(exact(sum(r["covered"] for r in sized), len(sized)))
        else:
            timed = [r for r in runs if r["timed"]]
            row += [exact(sum(r[key] for r in timed), len(timed)) for key in ("near", "holds")]
            row.insert(2, exact(sum(r["flagged"] for r in runs), len(runs)))
        rows[case.partition(":")[0]].append([*row, f"{np.median([r['seconds'] for r in runs]):.0f}"])
        for seed, r in found.runs[case].items():
            if not _RIGHT[case](r) or r[false]:
                told = [f"{f[0]} {f[1]}".strip() for f in r["found"]] if not missions else r["changed"] + r["common"]
                if case in SEVERAL:
                    told = [r["verdict"], *(f[0] for f in r["found"])]
                misses.append([case, str(seed), r["vehicle"], r["path"], "; ".join(told)])
    heads = ("case", "right>", "something false>")
    wrong = ("case", "seed>", "vehicle", "truth", "found")
    of_missions, of_logs = ("interval of the size holds>", "s>"), ("times within 5 %>", "their intervals hold>", "s>")
    every = [
        Sheet("missions", "Changes between missions", (*heads, *of_missions), rows["missions"]),
        Sheet("three_logs", "Effects of some of three logs", (*heads, *of_missions), rows["three logs"]),
        Sheet("logs", "Changes within a log", (*heads[:2], "said to change>", heads[2], *of_logs), rows["log"]),
        Sheet("misses", "What came out wrong", wrong, misses),
    ]
    return [sheet for sheet in every if sheet.rows]


STUDY = Study(
    __doc__ or "",
    attempt,
    (*MISSIONS, *SEVERAL, *ONSETS),
    sheets,
    seeds=20,
    first_seed=9000,
    options={"vehicle": Option("all", "one of them alone", choices=("all", *VEHICLES, *OTHERS))},
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
