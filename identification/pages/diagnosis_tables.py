"""Tables of a report: candidates by round, effects, ties, coefficients, and detectable sizes."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

from auv_gym.param import listed, spec_at, value_at
from auv_gym.plant import Plant
from identification.diagnosis.judge.effects import Coefficient, Detectable, Effect
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.wording import at_most, for_people, quantity, typeset
from identification.pages.page import amount, both, number, span


def rounds_of(d: Diagnosis, titles: dict[str, str]) -> list[dict[str, Any]]:
    """The candidates of each round with their bars, for the tables."""
    sizes = [v for r in d.rounds for t in r.trials for v in (t.train, t.held) if isfinite(v)]
    low, high = min([0.0, *sizes]), max([1.5 * threshold(len(candidates_of(d.given.plant, d.record))), *sizes])
    low = max(low, -0.5 * high)  # limits the scale, so that one bad candidate does not flatten the good ones
    zero = 100.0 * -low / (high - low)
    rounds, added = [], []
    for number_, r in enumerate(d.rounds, 1):
        trials = [
            {
                "title": t.candidate.title,
                "value": _fitted_value(t),
                "bars": [_bar(v, low, high, zero) for v in (t.train, t.held)],
                "numbers": [number(v, 3) if abs(v) >= 0.95 else number(round(v, 1), 1) for v in (t.train, t.held)],
                "verdict": _verdict(d, t, r, titles),
                "kind": "chosen" if t is r.chosen else "tied" if t in r.tied else "seen" if t.state else "unseen",
            }
            for t in r.trials
        ]
        rounds.append(
            {
                "number": number_,
                "after": list(added),
                "trials": trials,
                "unfitted": sum(t["kind"] == "unseen" for t in trials),
                "zero": zero,
                "outcome": _outcome(d, r),
            }
        )
        added += [r.chosen.candidate.title] if r.chosen else []
    return rounds


def _bar(value: float, low: float, high: float, zero: float) -> dict[str, Any]:
    """Left edge and width of an evidence bar in percent, and whether it is cut off."""
    shown = min(max(value if isfinite(value) else 0.0, low), high)
    width = 100.0 * abs(shown) / (high - low)
    return {"left": f"{zero - (width if shown < 0 else 0):.2f}", "width": f"{width:.2f}", "cut": value < low}


def _fitted_value(trial: Trial) -> str:
    if trial.state is None:
        return "–"
    parts = []
    for path in trial.candidate.paths:
        spec, value = spec_at(trial.state.plant, path), value_at(trial.state.plant, path)
        value = spec.neutral if abs(value - spec.neutral) < 1e-3 * spec.probe else value
        text = amount(value, spec.unit, sign=spec.neutral == 0.0)
        text += "" if spec.neutral == 0.0 else f" (neutral {amount(spec.neutral, spec.unit)})"
        parts.append(f"{path.rpartition('.')[2].replace('_', ' ')} {text}" if len(trial.candidate.paths) > 1 else text)
    return "; ".join(parts)


def _is_dropped(d: Diagnosis, r: Round) -> bool:
    return r.chosen is not None and r.chosen.candidate.paths[0] in d.dropped


def _verdict(d: Diagnosis, trial: Trial, of: Round, titles: dict[str, str]) -> str:
    if trial is of.chosen:
        return "chosen, but not kept" if _is_dropped(d, of) else "chosen"
    if trial in of.tied:
        return "tied with the chosen one"
    return worded(trial.objection, titles) or "acceptable, but clearly worse than the chosen one"


def _outcome(d: Diagnosis, r: Round) -> str:
    if r.chosen is None:
        return "No candidate was accepted in this round, so the search ended."
    text = f"Chosen: {r.chosen.candidate.title}."
    if r.tied:
        text += f" The log cannot tell it from {listed([t.candidate.title for t in r.tied], 'or')}."
    if _is_dropped(d, r):
        text += f" It was not kept: {d.dropped[r.chosen.candidate.paths[0]].format(it='it')}."
    return text


def effect_of(d: Diagnosis, e: Effect, titles: dict[str, str]) -> dict[str, Any]:
    signed, c = e.neutral == 0.0, e.coefficient
    searched = {p for r in d.rounds if r.chosen for p in r.chosen.candidate.paths}
    halves = f"chosen by {100.0 * e.frequency:.0f} % of the halves of the log" if e.path in searched else ""
    if c is not None:
        return {
            "title": c.title,
            "path": c.path,
            "value": amount(c.value, c.unit),
            "si": "",
            "interval": span(c.ci95, c.unit),
            "interval_si": "",
            "neutral": quantity(c.given, c.unit),
            "neutral_label": "value as given",
            "evidence": (number(e.evidence_train), number(e.evidence_held)),
            "halves": halves,
            "probability": _percent(e.probability) if e.members else "",
            "alternatives": [_alternative(d, p, titles) for p in e.tied_with if p != c.path],
        }
    return {
        "title": e.title,
        "path": e.path,
        "value": at_most(e.value, e.ci95, e.neutral) + amount(e.value, e.unit, sign=signed),
        "si": both(e.value, e.unit).partition("(")[2].rstrip(")"),
        "interval": span(e.ci95, e.unit),
        "interval_si": _interval_si(e),
        "neutral": "" if signed else quantity(e.neutral, e.unit),
        "neutral_label": "neutral value",
        "evidence": (number(e.evidence_train), number(e.evidence_held)),
        "halves": halves,
        "probability": _percent(e.probability) if e.members else "",
        "alternatives": [_alternative(d, p, titles) for p in e.tied_with],
    }


def _interval_si(e: Effect) -> str:
    """The interval of an effect in SI, if it is displayed in another unit."""
    if for_people(e.unit)[1] == e.unit:
        return ""
    return typeset(f"{number(e.ci95[0])} to {number(e.ci95[1])} {e.unit}")


def _percent(probability: float | None) -> str:
    """A probability as a percentage, or nothing."""
    return "" if probability is None else f"{100.0 * probability:.0f} %"


def _alternative(d: Diagnosis, path: str, titles: dict[str, str]) -> dict[str, str]:
    """A tied path and the value that it would have if it were the cause."""
    moved = next((c for c in d.coefficients if c.path == path), None)
    if moved is not None:
        value = f"{amount(moved.value, moved.unit)} instead of {amount(moved.given, moved.unit)}"
        return {"title": titles.get(path, path), "path": path, "value": value}
    member = next((m for e in d.added for m in e.members if m.path == path), None)
    if member is None:
        return {"title": titles.get(path, path), "path": path, "value": ""}
    size = at_most(member.value, member.ci95, member.neutral)
    size += amount(member.value, member.unit, sign=member.neutral == 0.0)
    value = f"{size} ({span(member.ci95, member.unit)}), {_percent(member.probability)}"
    return {"title": titles.get(path, path), "path": path, "value": value}


def by_coefficient(d: Diagnosis, titles: dict[str, str]) -> list[tuple[str, str]]:
    """Effects inferred from a coefficient's change instead of chosen in a round, each with that coefficient."""
    chosen = {p for r in d.rounds if r.chosen for p in r.chosen.candidate.paths}
    moved = {c.path for c in d.coefficients}
    pairs = ((e, next((p for p in e.tied_with if p in moved), "")) for e in d.added if e.path not in chosen)
    return [(e.title, titles[path]) for e, path in pairs if path]


def ties_of(d: Diagnosis, titles: dict[str, str]) -> list[dict[str, Any]]:
    """Each group that the record cannot tell apart, in words, and what another log would have to contain."""
    apart = {path: spec_at(d.given.plant, path).apart for group in d.tied for path in group}
    return [
        {
            "members": listed([titles.get(p, p) for p in group], "or"),
            "first": titles.get(group[0], group[0]),
            "common": next((c.words(d.titles, d.reach) for c in d.common if next(iter(c.members)) == group[0]), ""),
            "apart": [(titles.get(p, p), apart[p]) for p in group if apart[p]],
        }
        for group in d.tied
    ]


def coefficient_of(c: Coefficient) -> dict[str, str]:
    change = number(100.0 * (c.value / c.given - 1.0), 2, sign=True) + " %" if c.given else ""
    cells = {"given": amount(c.given, c.unit), "value": amount(c.value, c.unit), "interval": span(c.ci95, c.unit)}
    return {"title": c.title or c.path, "path": c.path, "change": change, **cells}


def in_order(items: Sequence[Detectable], plant: Plant) -> list[Detectable]:
    """The candidates by size in probes; those that cannot be detected come last."""
    return sorted(items, key=lambda x: (not isfinite(x.size), x.size / (spec_at(plant, x.path).probe or 1.0)))


def detectable_of(d: Diagnosis, x: Detectable, titles: dict[str, str]) -> dict[str, Any]:
    plant, seen = d.given.plant, isfinite(x.size)
    probe, twin = spec_at(plant, x.path).probe, plant.twins.get(x.path, "")
    remark = worded(x.reason, titles)
    if not seen:
        remark = f"not detectable in this log{f': {remark}' if remark else ''}"
        if twin in {c.path for c in d.coefficients}:
            remark = f"would change the refitted coefficient {titles[twin]}; see its interval"
    return {
        "title": x.title or x.path,
        "path": x.path,
        "seen": seen,
        "size": amount(x.size, x.unit) if seen else "",
        "probe": quantity(probe, x.unit),
        "probes": number(x.size / probe, 2) if seen and probe > 0.0 else "",
        "remark": remark,
    }


def worded(text: str, titles: dict[str, str]) -> str:
    """The text with each path replaced by its title."""
    for path in sorted(titles, key=len, reverse=True):
        text = text.replace(path, titles[path])
    return text
