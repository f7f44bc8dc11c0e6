"""Scores of a diagnosis against the sealed truth: right or false names, ties, coverage, and errors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from identification.diagnosis.log.parts import parts_of, windows_of
from identification.fit.validation import free_runs
from scripts.blind.cases import whole
from scripts.blind.diagnosing import REFUSED
from scripts.blind.sealing import read_truth

CONFIDENT = ("named", "tied")
FAILED = ("timeout", "crash", REFUSED)


def score(
    said: Mapping[str, Any], truth: Mapping[str, Any], ratio: float | None = None, fresh: float | None = None
) -> dict[str, Any]:
    """The score of a diagnosis, given as its JSON, against a truth as `seal` writes it.

    right: by the kind of the case.  false: names of effects that are not there and not tied with one that is, or with a
    wrong coefficient.  confident: a name for a cause outside the library, with nothing called unexplained.
    alike: effects that the difference is said to act like, without naming them.
    tie: the largest number of causes that one name may mean, None unless the verdict is a name.
    covered, covered_in_ties: by the path of a true effect that is named, or tied with a name, whether its interval
    holds the value.  coefficients_covered: the same for refitted coefficients, if the diagnosis is right and has no
    false name.  Nothing tied with a wrong coefficient is judged, since its size includes the coefficient's error.
    ratio, fresh: error reported for unseen parts over the true model's there, and over that of the diagnosis's own
    model in a fresh log.
    """
    verdict = said["verdict"]
    named = {e["path"]: e for e in said.get("effects", ())}
    groups = [frozenset(group) for group in said.get("tied", ())]
    wrong, actual = truth["wrong"], truth["effects"]
    excused = set(actual) | set(wrong)
    false = [p for p in named if not _meant(p, groups) & {whole(q) for q in excused}]
    coefficients = [c["path"] if isinstance(c, Mapping) else c for c in said.get("coefficients_wrong") or ()]
    found = [p for p in actual if any(whole(p) in _meant(q, groups) for q in named) or any(p in g for g in groups)]
    helped = bool((said.get("discovered") or {}).get("holds"))
    kind = truth["case"]["kind"]
    slipped = any(doubt["slip"] for doubt in said.get("doubts", ()))
    flagged = (verdict == "unexplained" or bool(said.get("unexplained")) or verdict == "doubted") and not slipped
    if kind == "outside":
        right = flagged or helped
    elif actual:
        right = len(found) == len(actual)
    else:
        right = not false and verdict not in (*FAILED, "unexplained", "doubted")
    judged = [p for p in actual if not any(p in group and group & set(wrong) for group in groups)]
    members = {m["path"]: m for e in named.values() for m in e.get("members", ())}
    own = [group for group in groups if group & set(named)]
    return {
        "number": truth["case"]["number"],
        "kind": kind,
        "family": truth["case"]["family"],
        "vehicle": truth["case"]["vehicle"],
        "verdict": verdict,
        "actual": [truth["cause"]] if kind == "outside" else sorted(actual),
        "named": sorted(named),
        "tied": [sorted(group) for group in groups],
        "right": bool(right),
        "false": sorted(false),
        "alike": sorted(e["path"] for e in said.get("acts_like", ())),
        "confident": bool(kind == "outside" and (slipped or (verdict in CONFIDENT and not flagged and not helped))),
        "coefficients_found": sorted(set(coefficients) & set(wrong)),
        "coefficients_false": sorted(set(coefficients) - set(wrong)),
        "tie": max([1, *(len({whole(p) for p in group}) for group in own)]) if verdict in CONFIDENT else None,
        "covered": {p: _holds(named[p], actual[p]) for p in judged if p in named},
        "covered_in_ties": {p: _holds(members[p], actual[p]) for p in judged if p in members and p not in named},
        "coefficients_covered": _coefficients(said, truth, groups) if right and not false else {},
        "ratio": ratio,
        "fresh": fresh,
        "seconds": said.get("seconds"),
    }


def score_folders(log: Path, truth: Path, said: Mapping[str, Any]) -> dict[str, Any]:
    """The score of one case from its log's folder and its truth's."""
    sealed = read_truth(truth)
    ratio = fresh = None
    if "error" in said and not sealed["cause"]:
        error, true = said["error"], load_vehicle(truth / "vehicle.toml")
        frame = error["parts"], error["window_s"], error["settle_s"]
        ratio = error_ratio(error["after"], Record.load(log / "log.nc"), true, *frame)
        if "changed" in said and (truth / "fresh.nc").exists():
            found = replace_at(load_vehicle(log / "vehicle.toml"), said["changed"])
            fresh = _fresh_ratio(error["after"], Record.load(truth / "fresh.nc"), found, *frame)
    return score(said, sealed, ratio, fresh)


def _fresh_ratio(
    after: Mapping[str, Mapping[str, float]], fresh: Record, found: Plant, parts: int, window: float, settle: float
) -> float | None:
    """See `error_ratio`; 0 if the model diverges, None if the fresh log cannot be used, such as one in short pieces."""
    try:
        return error_ratio(after, fresh, found, parts, window, settle)
    except Diverged:
        return 0.0
    except ValueError:
        return None


def error_ratio(
    after: Mapping[str, Mapping[str, float]], record: Record, plant: Plant, parts: int, window: float, settle: float
) -> float:
    """Geometric mean over the channels of a diagnosis's error in unseen parts over that of a plant in a record."""
    record = described(plant, record)
    windows = [w for part in parts_of(plant, record, parts) for w in windows_of(record, part, window)]
    scores = free_runs(plant, record, sorted(windows, key=lambda w: w.start), settle).scores(record)
    ratios = [after[name]["rmse"] / scores[name].rmse for name in after if name in scores and scores[name].rmse > 0.0]
    return float(np.exp(np.mean(np.log(ratios))))


def _holds(told: Mapping[str, Any], value: float) -> bool:
    low, high = told["ci95"]
    return bool(low <= value <= high)


def _coefficients(said: Mapping[str, Any], truth: Mapping[str, Any], groups: list[frozenset[str]]) -> dict[str, bool]:
    """Whether the interval of each refitted coefficient holds its value, for those that are not tied with an effect."""
    if truth["cause"]:
        return {}
    refitted = {c["path"]: c for c in said.get("coefficients", ()) if not any(c["path"] in group for group in groups)}
    return {path: _holds(c, truth["wrong"].get(path, [c["given"]])[0]) for path, c in refitted.items()}


def _meant(path: str, groups: list[frozenset[str]]) -> set[str]:
    """The possible meanings of a name: itself, and the paths that the diagnosis cannot tell from it."""
    tied = {p for group in groups if path in group or whole(path) in {whole(q) for q in group} for p in group}
    return {whole(p) for p in (path, *tied)}
