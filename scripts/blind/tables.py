"""Summaries of the scores of many cases: shares with their exact intervals, by kind and by family, and the misses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Table
from scipy.stats import binomtest

from auv_gym.cli.options.console import table
from scripts.blind.cases import FAMILIES, KINDS
from scripts.blind.scoring import CONFIDENT, FAILED

GOAL = 1.15  # goal for the error in unseen parts over that of the true model
NONE = "-"
WIDE = 3  # causes that a name may mean; more of them are a wide tie
WORDS = {
    "none": "nothing missing",
    "one": "one effect",
    "two": "two effects",
    "one_wrong": "one, coef. wrong",
    "none_wrong": "nothing, coef. wrong",
    "outside": "outside library",
    "none_pushed": "nothing, pushed",
    "one_pushed": "one, pushed",
}
COVERED = {"covered": "named", "covered_in_ties": "in ties", "coefficients_covered": "coefficients"}
Scores = Sequence[Mapping[str, Any]]


def exact_interval(hits: int, count: int) -> tuple[float, float]:
    """The exact 95 % interval of a share.  Source: Clopper and Pearson 1934, Biometrika 26."""
    if count == 0:
        return 0.0, 1.0
    low, high = binomtest(int(hits), count).proportion_ci(0.95, method="exact")
    return float(low), float(high)


def share(hits: int, count: int) -> dict[str, float]:
    """A share as data: hits, count, share and its interval."""
    low, high = exact_interval(hits, count)
    return {"hits": hits, "count": count, "share": hits / count if count else 0.0, "low": low, "high": high}


def summary(scores: Scores) -> dict[str, Any]:
    """Every share and quantile, by kind and family ("all" among them)."""
    result: dict[str, Any] = {}
    for kind in (*KINDS, "all"):
        for family in (*FAMILIES, "all"):
            rows = [s for s in scores if kind in (s["kind"], "all") and family in (s["family"], "all")]
            if rows:
                result.setdefault(kind, {})[family] = _of(rows)
    return result


def _of(rows: Scores) -> dict[str, Any]:
    values = {
        name: [row[name] for row in rows if row.get(name) is not None] for name in ("tie", "ratio", "fresh", "seconds")
    }
    ties, ratios = values["tie"], values["ratio"]
    covered = {name: [hit for row in rows for hit in row.get(name, {}).values()] for name in COVERED}
    return {
        "right": share(sum(row["right"] for row in rows), len(rows)),
        "false": share(sum(bool(row["false"]) for row in rows), len(rows)),
        "unexplained": share(sum(row["verdict"] == "unexplained" for row in rows), len(rows)),
        "confident": share(sum(row["confident"] for row in rows), len(rows)),
        "failed": share(sum(row["verdict"] in FAILED for row in rows), len(rows)),
        "named": share(sum(row["verdict"] in CONFIDENT for row in rows), len(rows)),
        "wide": share(sum(tie > WIDE for tie in ties), len(ties)),
        **{name: share(sum(hits), len(hits)) for name, hits in covered.items()},
        "within": share(sum(ratio <= GOAL for ratio in ratios), len(ratios)),
        "coefficients_false": share(sum(bool(row["coefficients_false"]) for row in rows), len(rows)),
        **{name: _quantiles(found) for name, found in values.items() if found},
    }


def _quantiles(values: Sequence[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95)), "most": float(np.max(values))}


def shares_tables(scores: Scores) -> list[Table]:
    """Tables with a row for each kind and family: hits, counts and exact intervals in per cent, and medians.

    The intervals of one log's coefficients are not independent: more logs are needed than the exact interval suggests.
    """
    return [
        _by_kind("Blind benchmark", scores, {"right": "right", "false": "false", "failed": "failed"}, {"seconds": "s"}),
        _by_kind("Verdicts", scores, {"named": "named", "unexplained": "unexplained", "confident": "confident"}, {}),
        _by_kind(
            "Ties, and reported errors over those of the true vehicle and in a fresh log",
            scores,
            {"wide": f"tie > {WIDE}", "within": f"<= {GOAL}"},
            {"tie": "tie", "ratio": "true", "fresh": "fresh"},
        ),
        _by_kind("95 % intervals that hold the truth", scores, COVERED, {}),
    ]


def _by_kind(title: str, scores: Scores, rates: Mapping[str, str], medians: Mapping[str, str]) -> Table:
    """Rates and medians, by name and heading, of each kind and family that has any."""
    made = table(title, "cases!", *(f"{head}>" for head in (*rates.values(), *medians.values())))
    made.pad_edge, made.collapse_padding, made.padding = False, True, (0, 1)
    for kind, families in summary(scores).items():
        made.add_row(f"[bold]{WORDS.get(kind, 'all kinds')}[/bold]")
        for family, found in families.items():
            cells = [_over(found[name]) for name in rates]
            cells += [f"{found[name]['median']:.3g}" if name in found else NONE for name in medians]
            if set(cells) != {NONE} and (family != "all" or len(families) > 2):
                made.add_row(f"  {family}", *cells)
    return made


def misses_table(scores: Scores) -> Table:
    """A row for each case with a wrong, false or missing name, or a failure."""
    made = table("Misses", "case>", "kind", "vehicle", "truth", "verdict", "named", "false")
    for row in scores:
        if not row["right"] or row["confident"] or (row["false"] and row["kind"] != "outside"):
            named = [_short(p) + "~" * any(p in group for group in row["tied"]) for p in row["named"]]
            made.add_row(
                str(row["number"]),
                row["kind"],
                row["vehicle"],
                "\n".join(map(_short, row["actual"])),
                row["verdict"],
                "\n".join(named),
                "\n".join(map(_short, row["false"])),
            )
    return made


def _over(found: Mapping[str, float]) -> str:
    if not found["count"]:
        return NONE
    return f"{found['hits']}/{found['count']} ({100 * found['low']:.0f}-{100 * found['high']:.0f})"


def _short(path: str) -> str:
    return path.removeprefix("effects.")
