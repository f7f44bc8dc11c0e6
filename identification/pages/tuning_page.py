"""The page of `auv-gym tune`, and the tables that it shares with the command line."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym import __version__
from auv_gym.channels import channel, set_point_of
from auv_gym.param import listed, spec_at, value_at
from controllers.tuning.bench import segments
from controllers.tuning.requirements import QUANTITIES, worst
from controllers.tuning.spread import CHANGE
from controllers.tuning.tuning import Judged, Trying
from identification.diagnosis.wording import short
from identification.pages.drawing import AFTER, BEFORE, INK, QUIET, downwards, new_figure, shown_values, with_unit
from identification.pages.model_page import Section
from identification.pages.page import Table, amount, drawn, number, page, span

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW = 2.5  # inches of height for a loop's panels
_LISTED = 5  # number of vehicles listed that could not be started
_AS_USUAL = 1.01  # times the default interval; wider intervals make a measurement worthwhile
_ACROSS = 3  # loops side by side in 80 columns
_TOLD = 4  # parameters of the worst vehicle in its sentence


def tuning_summary(found: Judged) -> list[str]:
    """The result of tuning, in sentences."""
    count, known = len(found.plants), len(found.intervals)
    drawn_from = f"drawn from the 95 % intervals of {known} parameter{'s' * (known != 1)}"
    over = f"the vehicle itself and {count - 1} vehicle{'s' * (count != 2)} {drawn_from}"
    if count == 1:
        over = "the vehicle itself; no other vehicle was drawn"
    failed = [
        f"{requirement.words} in the {_loop(name)} loop (met on {met} of {count} vehicles)"
        for name, requirement, _, met in found.verdicts()
        if met < count
    ]
    lines = [f"Warning: {text}" for text in found.warnings]
    if failed:
        lines += [f"Some requirements are not met: {'; '.join(failed)}.", f"The gains were tested on {over}."]
    else:
        lines.append(f"All requirements are met on {over}{'' if found.passed else ' that could be started'}.")
    hardest = found.hardest()
    if hardest is not None and count > 1:
        quantity, unit, _ = QUANTITIES[hardest.requirement.quantity]
        worst_value = f"a {quantity} of {_shown(hardest.value, unit)} in the {_loop(hardest.channel)} loop"
        values = [_with_value(found, path, value) for path, value in found.changed(hardest.at).items()]
        if hardest.at == 0:
            lines.append(f"Relative to its limit, the worst value is that of the vehicle itself, {worst_value}.")
        else:
            more = f" Its other {len(values) - _TOLD} parameters are in the file of gains." * (len(values) > _TOLD)
            lines.append(
                f"The worst vehicle is {found.names[hardest.at]}{_which(found, hardest.at)}, with {worst_value}. "
                f"It has {listed(values[:_TOLD], 'and')}.{more}"
            )
    if failed:
        lines.append(_remedy(found))
    if found.refused:
        lines.append(
            f"{len(found.refused)} drawn vehicles cannot hold themselves at the start, so the gains do not pass: "
            f"{'; '.join(found.refused[:_LISTED])}"
        )
    return lines


def _which(found: Judged, at: int) -> str:
    """What a drawn vehicle or a corner is, in brackets."""
    corner = found.names[at].startswith("corner")
    return f" ({'parameters at the ends of' if corner else 'parameters drawn at random from'} their intervals)"


def _with_value(found: Judged, path: str, value: float) -> str:
    """A parameter of a drawn vehicle in words: `yaw damping −0.00012 (given: −0.0011)`."""
    spec, given = spec_at(found.plant, path), value_at(found.plant, path)
    return f"{short(spec.title or path)} {amount(value, spec.unit)} (given: {amount(given, spec.unit)})"


def _remedy(found: Judged) -> str:
    """Advice on requirements that are not met."""
    widths = {}
    for path, (low, high) in found.intervals.items():
        given = value_at(found.plant, path)
        if given != 0.0:
            widths[path] = (high - low) / abs(given)
    words = "To meet them, allow more evaluations or relax the requirement"
    widest = max(widths, key=lambda path: widths[path], default="")
    if not widest or widths[widest] < 2.0 * _AS_USUAL * CHANGE:
        return f"{words}."
    spec = spec_at(found.plant, widest)
    return (
        f"{words}, or narrow the intervals. The widest one is that of {short(spec.title or widest)} ({widest}), "
        f"{span(found.intervals[widest], spec.unit)}: state a smaller deviation in the vehicle file, or tune on the "
        "diagnosis of a log."
    )


def requirement_table(found: Judged) -> Table:
    """Each requirement of each loop: on the vehicle itself, the worst, and the number of vehicles that meet it."""
    rows, marked = [], []
    for name, requirement, value, met in found.verdicts():
        values = found.values(name, requirement.quantity)
        marked += [len(rows)] if met < len(values) else []
        verdict = f"{'pass' if met == len(values) else 'FAIL'}, {met} of {len(values)}"
        rows.append((_loop(name), requirement.words, _shown(values[0]), _shown(value), verdict))
    return Table(("loop", "required", "vehicle", "worst", "met on"), rows, 2, marked=marked)


def quantity_tables(found: Judged, across: int = _ACROSS) -> list[Table]:
    """All quantities of each loop, on the vehicle itself and the worst; `across` loops side by side in one table."""
    loops = tuple(found.loops)
    return [_quantity_table(found, loops[first : first + across]) for first in range(0, len(loops), across)]


def _quantity_table(found: Judged, loops: Sequence[str]) -> Table:
    rows = []
    for name, quantity in QUANTITIES.items():
        values = [found.values(loop, name) for loop in loops]
        rows.append((quantity.label, *(f"{_shown(of[0])} / {_shown(worst(name, of))}" for of in values)))
    return Table(("vehicle / worst", *map(_loop, loops)), rows)


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
            quantity_tables(found, len(found.loops)),
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
        Section(
            "Gains",
            [
                "Gains have the unit of the command per unit of the error, of its integral or of its rate, in SI units "
                "and radians. Times are in seconds."
            ],
            [_gains_table(found)],
        ),
        Section(
            "Uncertain parameters",
            [
                "Vehicles are drawn from these intervals. A coefficient keeps its sign, so an interval that would come "
                "near zero ends as far below the value, by factor, as above it. The worst vehicle is the one on which "
                "a loop is furthest from a requirement."
            ],
            [_intervals_table(found)],
        ),
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
    """Gain, phase and step response of each loop on all vehicles."""
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
        step.set_ylabel(with_unit(_loop(name), name))
        downwards(step, name)
        gain.set_title(_loop(name), loc="left")
    for axes, label in zip(panels[-1], ("frequency, rad/s", "frequency, rad/s", "time, s"), strict=True):
        axes.set_xlabel(label)
    return figure


def _phase(loop: np.ndarray) -> np.ndarray:
    """Continuous phase in degrees, between -360 and 0 where the gain is nearest to 1."""
    phase = np.rad2deg(np.unwrap(np.angle(loop)))
    at = int(np.argmin(np.abs(np.log(np.abs(loop)))))
    return phase - 360.0 * np.ceil(phase[at] / 360.0)


def _looks(count: int, corners: int) -> list[dict[str, Any]]:
    """Line styles for the vehicle, for draws and for corners."""
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
    hardest = found.hardest()
    rows = []
    for path, limits in found.intervals.items():
        spec = spec_at(found.plant, path)
        row = [spec.title or path, path, amount(value_at(found.plant, path), spec.unit), span(limits, spec.unit)]
        if hardest is not None:
            row.append(amount(value_at(found.plants[hardest.at], path), spec.unit))
        rows.append(row)
    heads = ["parameter", "path", "value", "95 % interval drawn from"]
    if hardest is not None:
        heads.append(f"worst vehicle ({found.names[hardest.at]})")
    return Table(heads, rows, 2)


def _loop(name: str) -> str:
    """The quantity that a loop controls: `forward speed` for the forward speed through the water."""
    return channel(name).label.partition(" through ")[0]


def _shown(value: float, unit: str = "") -> str:
    return f"{number(value)}{' ' * bool(unit and isfinite(value))}{unit if isfinite(value) else ''}"
