"""Tables of the study of the torpedo AUV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from rich.table import Table

from auv_gym.channels import channel
from auv_gym.cli.options.console import table
from scripts.ls_svm.control import CASES
from scripts.ls_svm.experiments import MANOEUVRES
from scripts.ls_svm.study import AXES, DATA, WAYS, Learned, share_within

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


def tuned_table(joint: Learned, separate: Learned) -> Table:
    """Table 3 of the paper beside ours."""
    shown = table(
        "Tuned parameters; widths in m/s and rad/s of the paper, in root mean squares of each velocity here",
        "C(v)v + D(v)v",
        "paper: C>",
        "sigma>",
        "each by itself: C>",
        "sigma>",
        "error, %>",
        "one for all: C>",
        "sigma>",
        "error, %>",
    )
    one = joint.fit.settings[0]
    for axis, own, alone, together in zip(
        AXES, separate.fit.settings, separate.fit.shares, joint.fit.shares, strict=True
    ):
        penalty, width = PUBLISHED[axis]
        cells = (own.penalty, own.sigma, 100.0 * alone, one.penalty, one.sigma, 100.0 * together)
        shown.add_row(axis, f"{penalty:.4g}", f"{width:.4f}", *(f"{value:.3g}" for value in cells))
    return shown


def circles_table(rows: Sequence[Mapping]) -> Table:
    """Figures 9 and 10 in numbers: medians and worst over the seeds."""
    shown = table(
        "Circles with dives, learned without noise: off at 200 s, time and distance outside the data; median (worst)",
        "learned at!",
        "method!",
        "manoeuvre!",
        "off, % of path>",
        "depth, rms m>",
        "outside, %>",
        "farthest>",
        "within the limits>",
    )
    for data, way in product(DATA, WAYS):
        mine = [row for row in rows if row["data"] == data and row["method"] == way]
        for number, manoeuvre in enumerate(MANOEUVRES):
            found = [row["circles"][number] for row in mine]
            if not found:
                continue
            limits = CIRCLE_LIMITS[manoeuvre.voltage] if data == "4 V" else (1.0, np.inf)
            good = [max(one["position"] / limits[0], one["depth"] / limits[1]) for one in found]
            shown.add_row(
                data,
                way,
                manoeuvre.title,
                _spread([one["position"] for one in found], 2),
                _spread([one["depth"] for one in found], 3),
                _spread([100.0 * one["outside"] for one in found], 0),
                _spread([one["distance"] for one in found], 2),
                share_within(good, 1.0),
            )
        shown.add_section()
    return shown


def control_table(rows: Sequence[Mapping]) -> Table:
    """Figures 11 to 16 in numbers."""
    shown = table(
        "S-plane control: the model's run less the vehicle's, rms; median (worst) over seeds",
        "learned at!",
        "method!",
        "case",
        "% of the step>",
        "rms>",
        f"within {CONTROL_LIMIT:g} %>",
    )
    for data, way in product(DATA, WAYS):
        mine = [row for row in rows if row["data"] == data and row["method"] == way]
        for number, case in enumerate(CASES):
            found = [row["control"][number] for row in mine]
            if not found:
                continue
            unit = channel(case.channel).unit
            factor, unit = (180.0 / np.pi, "deg") if unit == "rad" else (1.0, unit)
            percent = [one["percent"] for one in found]
            shown.add_row(
                data,
                way,
                case.title,
                _spread(percent, 3),
                f"{_spread([factor * one['value'] for one in found], 4)} {unit}",
                share_within(percent, CONTROL_LIMIT),
            )
    return shown


def noisy_table(rows: Sequence[Mapping]) -> Table:
    """All methods on the same noisy records."""
    shown = table(
        "Learned from records with noise: off at the end, % of the path, and depth, rms m; median (worst) over seeds",
        "learned at!",
        "method!",
        *(f"{one.title}>" for one in MANOEUVRES),
        "failed>",
    )
    for data in DATA:
        own = [row for row in rows if row["data"] == data]
        for method in dict.fromkeys(row["method"] for row in own):
            mine = [row for row in own if row["method"] == method]
            cells = []
            for manoeuvre in MANOEUVRES:
                done = [row for row in mine if row.get("manoeuvre") == manoeuvre.title and "failed" not in row]
                cells.append(
                    f"{_spread([row['position'] for row in done], 2)}\n{_spread([row['depth'] for row in done], 3)} m"
                    if done
                    else "-"
                )
            shown.add_row(data, method, *cells, str(sum("failed" in row for row in mine)))
        shown.add_section()
    return shown


def _spread(values: Sequence[float], digits: int) -> str:
    return f"{_number(np.median(values), digits)} ({_number(np.max(values), digits)})"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.0e}"
