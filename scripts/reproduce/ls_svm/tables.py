"""Tables of the LS-SVM models of the torpedo AUV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from identification.pages.drawing import shown_values, unit_label
from scripts.reproduce.ls_svm.experiments import MANOEUVRES
from scripts.reproduce.s_plane import CASES
from scripts.studies.harness import Sheet

PUBLISHED = {  # table 3: C and sigma, of inputs in their own units
    "surge": (9.183e6, 1.0934),
    "sway": (2.528e7, 0.0922),
    "heave": (9.665e5, 0.0578),
    "roll": (1.316e5, 0.0321),
    "pitch": (2.747e5, 0.0698),
    "yaw": (2.081e5, 0.0136),
}
CIRCLE_LIMITS = {3.5: (1.0, 0.05), 4.5: (5.0, 0.3)}  # % of the path, m; learned at 4 V
CONTROL_LIMIT = 2.0  # % of the step


Results = Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]  # of each seed, by data and method


def tuned(joint: Mapping[str, Any], separate: Mapping[str, Any]) -> Sheet:
    """Table 3 of the paper beside ours."""
    title = "Tuned parameters; widths in m/s and rad/s of the paper, in root mean squares of each velocity here"
    heads = ("C(v)v + D(v)v", "paper: C>", "sigma>", "each by itself: C>", "sigma>", "error, %>")
    (one,), rows = joint["settings"], []
    for axis, own, alone, together in zip(
        PUBLISHED, separate["settings"], separate["shares"], joint["shares"], strict=True
    ):
        penalty, width = PUBLISHED[axis]
        cells = (own["penalty"], own["sigma"], 100.0 * alone, one["penalty"], one["sigma"], 100.0 * together)
        rows.append([axis, f"{penalty:.4g}", f"{width:.4f}", *(f"{value:.3g}" for value in cells)])
    return Sheet("tuned", title, (*heads, "one for all: C>", "sigma>", "error, %>"), rows)


def circles(results: Results) -> Sheet:
    """Figures 9 and 10 in numbers: medians and worst over the seeds."""
    title = (
        "Circles with dives, learned without noise: off at 200 s, time and distance outside the data; median (worst)"
    )
    heads = ("off, % of path>", "depth, rms m>", "outside, %>", "farthest>", "within the limits>")
    rows: list[list[str]] = []
    for (data, way), runs in results.items():
        for number, manoeuvre in enumerate(MANOEUVRES):
            found = [run["circles"][number] for run in runs]
            limits = CIRCLE_LIMITS[manoeuvre.voltage] if data == "4 V" else (1.0, np.inf)
            good = [max(one["position"] / limits[0], one["depth"] / limits[1]) for one in found]
            numbers = (("position", 1.0, 2), ("depth", 1.0, 3), ("outside", 100.0, 0), ("distance", 1.0, 2))
            cells = [_spread([factor * one[name] for one in found], digits) for name, factor, digits in numbers]
            rows.append([data, way, manoeuvre.title, *cells, share_within(good, 1.0)])
        rows.append([])
    return Sheet("circles", title, ("learned at!", "method!", "manoeuvre!", *heads), rows)


def control(results: Results) -> Sheet:
    """Figures 11 to 16 in numbers."""
    title = "S-plane control: the model's run less the vehicle's, rms; median (worst) over seeds"
    heads = ("learned at!", "method!", "case", "% of the step>", "rms>", f"within {CONTROL_LIMIT:g} %>")
    rows: list[list[str]] = []
    for (data, way), runs in results.items():
        for number, case in enumerate(CASES):
            percent, values = ([run["control"][number][name] for run in runs] for name in ("percent", "value"))
            rms = f"{_spread(shown_values(case.channel, np.array(values)), 4)} {unit_label(case.channel)}"
            rows.append([data, way, case.title, _spread(percent, 3), rms, share_within(percent, CONTROL_LIMIT)])
        rows.append([])
    return Sheet("control", title, heads, rows)


def noisy(by_data: Mapping[str, Sequence[Mapping[str, Any]]]) -> Sheet:
    """All methods on the same noisy records."""
    title = (
        "Learned from records with noise: off at the end, % of the path, and depth, rms m; median (worst) over seeds"
    )
    rows: list[list[str]] = []
    for data, own in by_data.items():
        for method in dict.fromkeys(row["method"] for row in own):
            mine = [row for row in own if row["method"] == method]
            cells = []
            for manoeuvre in MANOEUVRES:
                done = [row for row in mine if row.get("manoeuvre") == manoeuvre.title and "failed" not in row]
                off, depth = (_spread([row[name] for row in done], n) for name, n in (("position", 2), ("depth", 3)))
                cells.append(f"{off}\n{depth} m" if done else "-")
            rows.append([data, method, *cells, str(sum("failed" in row for row in mine))])
        rows.append([])
    return Sheet("noisy", title, ("learned at!", "method!", *(f"{one.title}>" for one in MANOEUVRES), "failed>"), rows)


def share_within(values: Sequence[float], limit: float) -> str:
    """The number of values within a limit, in words."""
    return f"{int(np.sum(np.asarray(values) <= limit))} of {len(values)}"


def _spread(values: Sequence[float] | np.ndarray, digits: int) -> str:
    if not len(values):
        return ""
    return f"{_number(np.median(values), digits)} ({_number(np.max(values), digits)})"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.0e}"
