"""Figures of a campaign's report: signals of a run, all runs at once, spectra, errors of rollouts over time.

Needs the extra `render`.  Functions return a matplotlib Figure; `drawing.svg` turns it into text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel, excitation_of, set_point_of
from auv_gym.records.record import Record
from identification.pages.drawing import (
    COMMAND,
    INK,
    INPUT,
    MEASURED,
    POINTS,
    Clock,
    compass_ticks,
    downwards,
    grid,
    line,
    new_figure,
    patch,
    quantity_label,
    shown_values,
    unit_label,
)
from identification.pages.drawn_channels import excited_set_point, inputs_of, outputs_of
from identification.pages.model_figures import LOOKS, legend, looks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GUARD_SHADE = "#f6dcc9"
EXCITATION = "#b07d00"
MOST_LINES = 40  # runs drawn in one panel


def signals_figure(record: Record, wanted: Sequence[str] = ()) -> Figure:
    """Outputs with their set points as excited, inputs including the excitation, shaded while the guard acted."""
    outputs, inputs, clock = outputs_of(record, wanted), inputs_of(record), Clock(record)
    heights = [1.35] * len(outputs) + [0.95] * len(inputs)
    figure = new_figure(sum(heights) + 0.26 * len(heights) + 0.6)
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axes, name in zip(panels, [*outputs, *inputs]):
        _shade_guard(axes, record, clock)
        look: dict[str, Any]
        moved = name in outputs
        if moved and record.has(set_point_of(name)):
            look = {"color": COMMAND, "linewidth": 1.3, "linestyle": "--", "zorder": 1.8}
            wish = shown_values(name, excited_set_point(record, name))
            line(axes, clock.times, wish, clock.cuts, **look, drawstyle="steps-post", label="set point")
        look = {"color": MEASURED if moved else INPUT, "linewidth": 1.1, "label": "output" if moved else "input"}
        look |= {} if moved else {"drawstyle": "steps-post"}
        line(axes, clock.times, shown_values(name, record[name]), clock.cuts, **look)
        if not moved and record.has(excitation_of(name)):
            added = shown_values(name, record[excitation_of(name)])
            look = {"color": EXCITATION, "linewidth": 0.8, "alpha": 0.9, "drawstyle": "steps-post", "zorder": 1.7}
            line(axes, clock.times, added, clock.cuts, **look, label="excitation")
        axes.set_title(quantity_label(name), loc="left")
        axes.margins(x=0.0)
        axes.locator_params(axis="y", nbins=5)
        downwards(axes, name)
        if name == "heading_rad":
            compass_ticks(axes)
    panels[-1].set_xlabel(clock.label)
    legend(figure, panels, [_named(GUARD_SHADE, "guard acted")] if guard_acted(record).any() else [])
    return figure


def overlay_figure(records: Sequence[Record], wanted: Sequence[str] = (), cells: Sequence[str] = ()) -> Figure:
    """Each output of all runs in one panel, with a colour for each cell of the grid if there are few cells.

    cells: words for the cell of each run.  Runs of one colour get a median line if they share times and set points.
    """
    picked = [int(i) for i in np.unique(np.linspace(0, len(records) - 1, min(len(records), MOST_LINES)).round())]
    shown = [records[i] for i in picked]
    told = list(dict.fromkeys(cells))
    coloured = 1 < len(told) <= len(LOOKS)
    labels: list[str] = [cells[i] for i in picked] if coloured else ["each run"] * len(shown)
    colours = {label: look["color"] for label, look in zip(told if coloured else ["each run"], LOOKS)}
    names = outputs_of(shown[0], wanted)
    figure = new_figure(2.3 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    longest = Clock(max(shown, key=lambda r: r.duration_s))
    faint = max(0.3, min(0.8, 8.0 / len(shown)))
    for axes, name in zip(panels, names):
        for record, label in zip(shown, labels):
            if record.has(name):
                clock = Clock(record)
                times, values = clock.times * (clock.size / longest.size), shown_values(name, record[name])
                look: dict[str, Any] = {"color": colours[label], "linewidth": 0.7, "alpha": faint, "label": label}
                line(axes, times, values, clock.cuts, points=POINTS // 2, **look)
        if not coloured and len(shown) > 2 and all(_alike(shown[0], r, name) for r in shown):
            middle = np.median([shown_values(name, r[name]) for r in shown], axis=0)
            line(axes, longest.times, middle, longest.cuts, color=INK, linewidth=1.4, label="median of the runs")
        axes.set_title(quantity_label(name), loc="left")
        axes.set_xlabel(longest.label)
        axes.margins(x=0.0)
        downwards(axes, name)
    legend(figure, panels)
    return figure


def spectra_figure(records: Sequence[Record], wanted: Sequence[str] = ()) -> Figure:
    """Welch power spectra of outputs, inputs and excitation: median over the runs, and their range."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    first = records[0]
    names = [*outputs_of(first, wanted), *inputs_of(first)]
    figure = new_figure(2.45 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        kind = "input" if channel(name).kind == "input" else "output"
        parts = [(name, kind, INPUT if kind == "input" else MEASURED), (excitation_of(name), "excitation", EXCITATION)]
        for signal, label, colour in parts:
            frequency, powers = spectra(records, signal)
            if frequency.size == 0:
                continue
            powers = powers * (float(shown_values(name, np.ones(1))[0]) ** 2)
            axes.plot(frequency, np.median(powers, axis=0), color=colour, linewidth=1.3, label=label)
            if len(powers) > 1:
                low, high = powers.min(axis=0), powers.max(axis=0)
                axes.fill_between(frequency, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(f"power of {channel(name).label}, {_power_unit(name)}", loc="left")
        axes.set_xlabel("frequency, rad/s")
    legend(figure, panels)
    return figure


def spectra(records: Sequence[Record], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies above zero, rad/s, (F,), and the power densities of a channel per rad/s, (runs, F).

    Half-overlapping Hann windows, at least six in the shortest run, with trends removed. Runs without the channel, or
    with a sample interval different from the first run's, are left out; empty if the channel never moves.
    Source: Welch 1967.
    """
    from scipy.signal import welch

    dt = records[0].sample_interval
    found = []
    for record in records:
        if record.has(name) and abs(record.sample_interval - dt) < 1e-6 * dt and record.is_uniform():
            values = record[name][max(record.segments, key=lambda s: s.stop - s.start)]
            if np.isfinite(values).all() and np.ptp(values) > 0.0:
                found.append(values)
    shortest = min((v.size for v in found), default=0)
    length = min(int(2.0 * shortest / 7.0), 1024)
    if length < 8:
        return np.empty(0), np.empty((0, 0))
    results = [welch(v, fs=1.0 / dt, nperseg=length, detrend="linear") for v in found]
    return 2.0 * np.pi * results[0][0][1:], np.array([p[1:] for _, p in results]) / (2.0 * np.pi)


def growth_figure(curves: Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]], names: Sequence[str]) -> Figure:
    """RMS error of each model over time, in percent of the step, over all compared runs.

    curves: model -> channel -> {"time_s": (bins,), "percent": (bins,)}.
    """
    figure = new_figure(2.6 * ((len(names) + 1) // 2))
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        for (label, of), look in zip(curves.items(), looks(len(curves))):
            if name in of:
                axes.plot(of[name]["time_s"], of[name]["percent"], linewidth=1.4, label=label, **look)
        axes.set_title(f"error of {channel(name).label}, percent of its step", loc="left")
        axes.set_xlabel("time, s")
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.0)
    legend(figure, panels)
    return figure


def guard_acted(record: Record) -> np.ndarray:
    """Whether an envelope's guard acted at each sample, (n,)."""
    return record["envelope_flag"] > 0.5 if record.has("envelope_flag") else np.zeros(len(record), dtype=bool)


def _alike(one: Record, other: Record, name: str) -> bool:
    """Whether a channel of two runs has the same times and the same set points."""
    if not (one.has(name) and other.has(name) and np.array_equal(one.time, other.time)):
        return False
    aims = [r[n] for n in map(set_point_of, outputs_of(one)) if one.has(n) and other.has(n) for r in (one, other)]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(aims[::2], aims[1::2]))


def _shade_guard(axes, record: Record, clock: Clock) -> None:
    acted = guard_acted(record)
    edges = np.flatnonzero(np.diff(np.r_[0, acted.astype(int), 0]))
    for start, stop in zip(edges[::2], edges[1::2]):
        last = min(stop, len(record) - 1)
        axes.axvspan(clock.times[start], clock.times[last], color=GUARD_SHADE, zorder=0, linewidth=0)


def _named(colour: str, label: str):
    shade = patch(colour)
    shade.set_label(label)
    return shade


def _power_unit(name: str) -> str:
    unit = unit_label(name)
    return f"({unit})²/(rad/s)" if "/" in unit else f"{unit}²/(rad/s)"
