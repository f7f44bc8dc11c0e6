"""Summaries of the scores of many cases: shares with their Wilson intervals, by kind and by family, and the misses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np
from rich.table import Table

from auv_gym.cli.options.console import table
from scripts.blind.cases import FAMILIES, KINDS
from scripts.blind.scoring import FAILED

GOAL = 1.15  # goal for the error in unseen parts over that of the true model
WORDS = {
    "none": "nothing missing",
    "one": "one effect",
    "two": "two effects",
    "one_wrong": "one, coef. wrong",
    "none_wrong": "nothing, coef. wrong",
    "outside": "outside library",
}
Scores = Sequence[Mapping[str, Any]]


def wilson(hits: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share.  Source: Wilson 1927, J. Am. Stat. Assoc. 22."""
    if count == 0:
        return 0.0, 1.0
    z, p = 1.959964, hits / count
    middle, spread = p + z * z / (2 * count), z * sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    return max((middle - spread) / (1 + z * z / count), 0.0), min((middle + spread) / (1 + z * z / count), 1.0)


def share(hits: int, count: int) -> dict[str, float]:
    """A share as data: hits, count, share and its interval."""
    low, high = wilson(hits, count)
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
    covered = [hit for row in rows for hit in row["covered"].values()]
    ratios = [row["ratio"] for row in rows if row["ratio"] is not None]
    seconds = [row["seconds"] for row in rows if row["seconds"] is not None]
    quantiles = {name: _quantiles(values) for name, values in (("ratio", ratios), ("seconds", seconds)) if values}
    return {
        "right": share(sum(row["right"] for row in rows), len(rows)),
        "false": share(sum(bool(row["false"]) for row in rows), len(rows)),
        "unexplained": share(sum(row["verdict"] == "unexplained" for row in rows), len(rows)),
        "confident": share(sum(row["confident"] for row in rows), len(rows)),
        "failed": share(sum(row["verdict"] in FAILED for row in rows), len(rows)),
        "covered": share(sum(covered), len(covered)),
        "within": share(sum(ratio <= GOAL for ratio in ratios), len(ratios)),
        "coefficients_false": share(sum(bool(row["coefficients_false"]) for row in rows), len(rows)),
        **quantiles,
    }


def _quantiles(values: Sequence[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95)), "most": float(np.max(values))}


def shares_table(scores: Scores) -> Table:
    """A row for each kind and family: the share of right ones, in per cent with its interval, and hits over counts."""
    columns = ("right, %>", "false>", "unexpl.>", "conf.>", "cover>", f"<= {GOAL}>", "s>")
    made = table("Blind benchmark", "cases!", *columns)
    made.pad_edge, made.collapse_padding, made.padding = False, True, (0, 1)
    for kind, families in summary(scores).items():
        made.add_row(f"[bold]{WORDS.get(kind, 'all kinds')}[/bold]")
        for family, found in families.items():
            if family == "all" and len(families) == 2:
                continue
            right, time = found["right"], found.get("seconds")
            made.add_row(
                f"  {family}",
                f"{100 * right['share']:.0f} ({100 * right['low']:.0f}-{100 * right['high']:.0f})",
                *(_over(found[name]) for name in ("false", "unexplained", "confident", "covered", "within")),
                f"{time['median']:.1f}" if time else "-",
            )
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
    return f"{found['hits']}/{found['count']}" if found["count"] else "-"


def _short(path: str) -> str:
    return path.removeprefix("effects.")
