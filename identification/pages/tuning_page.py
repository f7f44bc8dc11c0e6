"""The page of `auv-gym tune`, and the tables that it and the command line print."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym import __version__
from auv_gym.channels import channel, set_point_of
from auv_gym.param import spec_at, value_at
from controllers.tuning.bench import segments
from controllers.tuning.requirements import QUANTITIES, worst
from controllers.tuning.tuning import Judged, Trying
from identification.diagnosis.wording import listed
from identification.pages.drawing import AFTER, BEFORE, INK, QUIET, downwards, new_figure, quantity_label, shown_values
from identification.pages.model_page import Section
from identification.pages.page import Table, amount, drawn, number, page, span

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW = 2.5  # inches of a loop's panels
_LISTED = 5  # drawn vehicles that could not be started


def tuning_summary(found: Judged) -> list[str]:
    """What came of it, in sentences."""
    count = len(next(iter(found.loops.values())))
    known = len(found.intervals)
    over = f"the vehicle and {count - 1} drawn from the 95 % intervals of {known} parameter{'s' * (known != 1)}"
    failed = [f"{channel(name).label} ({requirement})" for name, requirement, _, met in found.verdicts() if met < count]
    lines = [
        f"All requirements are met on {over}."
        if found.passed
        else f"Not met on all of {over}: {listed(failed, 'and')}."
        if failed
        else f"All requirements are met on {over} that could be started."
    ]
    if found.refused:
        lines.append(
            f"{len(found.refused)} drawn vehicles cannot hold themselves at the start, so the gains do not pass: "
            f"{'; '.join(found.refused[:_LISTED])}"
        )
    return lines


def requirement_table(found: Judged) -> Table:
    """Each requirement of each loop: on the vehicle itself, the worst, and on how many vehicles it is met."""
    rows, marked = [], []
    for name, requirement, value, met in found.verdicts():
        values = found.values(name, requirement.quantity)
        unit = QUANTITIES[requirement.quantity][0]
        marked += [len(rows)] if met < len(values) else []
        verdict = "pass" if met == len(values) else "FAIL"
        own = _shown(values[0], unit)
        rows.append((name, str(requirement), own, _shown(value, unit), f"{met} of {len(values)}", verdict))
    return Table(("loop", "required", "vehicle", "worst", "met", "verdict"), rows, 2, marked=marked)


def quantity_table(found: Judged) -> Table:
    """All quantities of each loop: on the vehicle itself and the worst."""
    rows = []
    for quantity, (unit, _) in QUANTITIES.items():
        cells = []
        for name in found.loops:
            values = found.values(name, quantity)
            cells.append(f"{_shown(values[0])} / {_shown(worst(quantity, values))}")
        rows.append(
            (quantity.removesuffix("_percent") + (f", {unit}" if quantity.endswith("_percent") else ""), *cells)
        )
    return Table(("vehicle / worst case", *found.loops), rows)


def tuning_page(found: Judged) -> str:
    """The report as the text of one HTML page."""
    sections = [
        Section("Requirements", tables=[requirement_table(found)]),
        Section(
            "Loops",
            [
                "For the margins, each loop is opened at its command, with all other loops closed, and measured on the "
                "simulated vehicle with a periodic signal added to the command. The RMS error and the overshoot are "
                "those of the first step, in percent of its size. A dash means that there is no such crossing, or that "
                "the loop did not settle within the run."
            ],
            [quantity_table(found)],
            [
                drawn(
                    lambda: tuning_figure(found),
                    "loops",
                    "Response of each loop and its step, for the vehicle and for those drawn from the intervals.",
                    "Gain and phase of each open loop, and its step response. Dark: the vehicle. Light blue: vehicles "
                    "drawn from the intervals. Orange: corner cases, with parameters at the ends of their intervals.",
                )
            ],
        ),
        Section("Gains", tables=[_gains_table(found)]),
        Section("Uncertain parameters", tables=[_intervals_table(found)]),
    ]
    content: dict[str, Any] = {
        "title": f"{found.plant.name}: {found.law.upper()} gains",
        "eyebrow": f"sample time {found.plant.dt:g} s, seed {found.seed}",
        "found": tuning_summary(found),
        "sections": sections,
        "version": __version__,
    }
    return page("models.html", content)


def tuning_figure(found: Judged) -> Figure:
    """Gain, phase and step of each loop on all vehicles."""
    figure = new_figure(_ROW * len(found.loops))
    panels = figure.subplots(len(found.loops), 3, squeeze=False)
    for (gain, phase, step), (name, of) in zip(panels, found.loops.items(), strict=True):
        looks = _looks(len(of), found.corners)
        for trying, look in reversed(list(zip(of, looks, strict=True))):
            omega, loop = trying.response.omega, trying.response.loop
            if trying.response.settled:
                gain.semilogx(omega, 20.0 * np.log10(np.abs(loop)), **look)
                phase.semilogx(omega, _phase(loop), **look)
            _draw_step(step, trying, name, look)
        gain.axhline(0.0, color=QUIET, linewidth=0.7)
        phase.axhline(-180.0, color=QUIET, linewidth=0.7)
        gain.set_ylabel("gain, dB")
        phase.set_ylabel("phase, deg")
        step.set_ylabel(quantity_label(name))
        downwards(step, name)
        gain.set_title(channel(name).label, loc="left")
    for axes, label in zip(panels[-1], ("frequency, rad/s", "frequency, rad/s", "time, s"), strict=True):
        axes.set_xlabel(label)
    return figure


def _phase(loop: np.ndarray) -> np.ndarray:
    """Degrees, continuous, between -360 and 0 deg where the gain is nearest to 1."""
    phase = np.rad2deg(np.unwrap(np.angle(loop)))
    at = int(np.argmin(np.abs(np.log(np.abs(loop)))))
    return phase - 360.0 * np.ceil(phase[at] / 360.0)


def _looks(count: int, corners: int) -> list[dict[str, Any]]:
    """How lines of the vehicle, of draws and of corners are drawn."""
    thin: dict[str, Any] = {"linewidth": 0.7, "alpha": 0.6}
    beyond = min(corners, count - 1)
    looks: list[dict[str, Any]] = [{"color": INK, "linewidth": 1.6}]
    return [*looks, *[{"color": AFTER, **thin}] * (count - 1 - beyond), *[{"color": BEFORE, **thin}] * beyond]


def _draw_step(axes, trying: Trying, name: str, look: dict[str, Any]) -> None:
    if trying.run is None:
        return
    part, _ = next(segments(trying.run, name))
    time = trying.run["time_s"][part]
    axes.plot(time, shown_values(name, trying.run[set_point_of(name)][part]), color=QUIET, linewidth=0.7)
    axes.plot(time, shown_values(name, trying.run[name][part]), **look)


def _gains_table(found: Judged) -> Table:
    rows = [
        (loop, ", ".join(f"{key} {number(value, 4)}" for key, value in settings.items()))
        for loop, settings in found.gains.loops[found.law].items()
    ]
    return Table(("loop", "gains"), rows, 2)


def _intervals_table(found: Judged) -> Table:
    rows: Sequence[Any] = [
        (
            spec_at(found.plant, path).title or path,
            path,
            amount(value_at(found.plant, path), spec_at(found.plant, path).unit),
            span(limits, spec_at(found.plant, path).unit),
        )
        for path, limits in found.intervals.items()
    ]
    return Table(("parameter", "path", "value", "95 % interval"), rows, 2)


def _shown(value: float, unit: str = "") -> str:
    return f"{number(value)}{' ' * bool(unit and isfinite(value))}{unit if isfinite(value) else ''}"
