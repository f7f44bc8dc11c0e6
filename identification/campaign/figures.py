"""Figures of a campaign's report: signals of a run, all runs at once, spectra, rollouts of models, residual tests.

Needs the extra `render`.  Functions return a matplotlib Figure; `drawing.svg` turns it into text.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel, set_point_of
from auv_gym.record import Record
from identification.drawing import (
    COMMAND,
    INK,
    INPUT,
    MEASURED,
    POINTS,
    QUIET,
    Clock,
    band,
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

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Models in the order in which they come; colours and line styles differ both.
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "#0072b2", "linestyle": "-"},
    {"color": "#d55e00", "linestyle": (0, (5, 1.4))},
    {"color": "#00785a", "linestyle": (0, (1.5, 1.2))},
    {"color": "#b0558f", "linestyle": (0, (5, 1.2, 1.2, 1.2))},
    {"color": "#b07d00", "linestyle": (0, (8, 2))},
)
GUARD_SHADE = "#f6dcc9"
EXCITATION = "#b07d00"
FEW_OUTPUTS = 4  # in one figure, unless more are followed or modelled
MOST_LINES = 40  # runs drawn over one another
_STILL = {"rad": 1e-3, "rad/s": 1e-4, "m": 1e-2, "m/s": 1e-3}  # ranges below which a signal counts as still
_FIRST = ("depth_m", "pitch_rad", "heading_rad", "u_mps", "w_mps", "q_radps", "roll_rad", "north_m", "east_m")


def outputs_of(record: Record, wanted: Sequence[str] = ()) -> list[str]:
    """The motions worth a picture: with a set point, then wanted, then the usual ones; none that stand still."""
    moving = [n for n in record.names if channel(n).kind == "motion" and _moves(record, n)]
    aimed = [n for n in (*_FIRST, *moving) if n in moving and record.has(set_point_of(n))]
    order = dict.fromkeys([*aimed, *(n for n in (*wanted, *_FIRST) if n in moving)])
    return list(order)[: max(FEW_OUTPUTS, len({*aimed, *wanted} & set(moving)))]


def inputs_of(record: Record) -> list[str]:
    """The inputs that move."""
    return [n for n in record.names if channel(n).kind == "input" and _moves(record, n)]


def excitation_of(name: str) -> str:
    """The channel of the excitation added at an input or a set point."""
    return f"excitation_{name}"


def signals_figure(record: Record, wanted: Sequence[str] = ()) -> Figure:
    """Outputs with their set points, inputs with what excitation added, shaded where the envelope's guard acted."""
    outputs, inputs, clock = outputs_of(record, wanted), inputs_of(record), Clock(record)
    heights = [1.35] * len(outputs) + [0.95] * len(inputs)
    figure = new_figure(sum(heights) + 0.26 * len(heights) + 0.6)
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axes, name in zip(panels, [*outputs, *inputs]):
        _shade_guard(axes, record, clock)
        moved, look = name in outputs, dict[str, Any]()
        if moved and record.has(set_point_of(name)):
            look = {"color": COMMAND, "linewidth": 1.3, "linestyle": "--", "zorder": 1.8}
            wish = shown_values(name, record[set_point_of(name)])
            line(axes, clock.times, wish, clock.cuts, **look, drawstyle="steps-post", label="set point")
        look = {"color": MEASURED if moved else INPUT, "linewidth": 1.1, "label": "output" if moved else "input"}
        look |= {} if moved else {"drawstyle": "steps-post"}
        line(axes, clock.times, shown_values(name, record[name]), clock.cuts, **look)
        if record.has(excitation_of(name)):
            added = shown_values(name, record[excitation_of(name)])
            look = {"color": EXCITATION, "linewidth": 0.8, "alpha": 0.9, "drawstyle": "steps-post", "zorder": 1.7}
            line(axes, clock.times, added, clock.cuts, **look, label="of it excitation")
        axes.set_title(quantity_label(name), loc="left")
        axes.margins(x=0.0)
        axes.locator_params(axis="y", nbins=5)
        downwards(axes, name)
        if name == "heading_rad":
            compass_ticks(axes)
    panels[-1].set_xlabel(clock.label)
    _legend(figure, panels, [_named(GUARD_SHADE, "guard acted")] if guard_acted(record).any() else [])
    return figure


def overlay_figure(records: Sequence[Record], wanted: Sequence[str] = ()) -> Figure:
    """Each output of all runs over one another, with the median at each time where they share their times."""
    shown = [records[i] for i in np.unique(np.linspace(0, len(records) - 1, min(len(records), MOST_LINES)).astype(int))]
    names = outputs_of(shown[0], wanted)
    figure = new_figure(2.3 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    longest = Clock(max(shown, key=lambda r: r.duration_s))
    for axes, name in zip(panels, names):
        for number, record in enumerate(r for r in shown if r.has(name)):
            clock = Clock(record)
            times = clock.times * (clock.size / longest.size)
            values = shown_values(name, record[name])
            look = {"color": "#0072b2", "linewidth": 0.6, "alpha": max(0.18, min(0.7, 4.0 / len(shown)))}
            line(axes, times, values, clock.cuts, points=POINTS // 2, **look, label="each run" if number == 0 else None)
        same = [r for r in shown if r.has(name) and len(r) == len(shown[0]) and np.array_equal(r.time, shown[0].time)]
        if len(same) == len(shown) > 2:
            middle = np.median([shown_values(name, r[name]) for r in same], axis=0)
            line(axes, longest.times, middle, longest.cuts, color=INK, linewidth=1.4, label="median of the runs")
        axes.set_title(quantity_label(name), loc="left")
        axes.set_xlabel(longest.label)
        axes.margins(x=0.0)
        downwards(axes, name)
    _legend(figure, panels)
    return figure


def spectra_figure(records: Sequence[Record], wanted: Sequence[str] = ()) -> Figure:
    """Welch's power spectra of outputs, inputs and excitation: median over the runs, and their range."""
    from matplotlib.ticker import NullFormatter

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
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(f"power of {channel(name).label}, {_power_unit(name)}", loc="left")
        axes.set_xlabel("frequency, rad/s")
    _legend(figure, panels)
    return figure


def spectra(records: Sequence[Record], name: str, pieces: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies above zero, rad/s, (F,), and the power densities of a channel per rad/s, (runs, F).

    Half-overlapping Hann windows, at least `pieces` in the shortest of the runs, trends removed. Runs that lack the
    channel, or are sampled otherwise than the first, are left out; empty where the channel never moves.
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
    length = min(int(2.0 * shortest / (pieces + 1)), 1024)
    if length < 8:
        return np.empty(0), np.empty((0, 0))
    results = [welch(v, fs=1.0 / dt, nperseg=length, detrend="linear") for v in found]
    return 2.0 * np.pi * results[0][0][1:], np.array([p[1:] for _, p in results]) / (2.0 * np.pi)


def rollout_figure(truth: Record, models: Mapping[str, Record], names: Sequence[str], words: str) -> Figure:
    """Outputs of the vehicle and of the models in its place, over one another, and below each the models' errors.

    words: what the black line is.
    """
    clock = Clock(truth)
    figure = new_figure(2.35 * len(names) + 0.8)
    panels = figure.subplots(2 * len(names), 1, sharex=True, height_ratios=[2.0, 0.9] * len(names), squeeze=False)[:, 0]
    for top, bottom, name in zip(panels[::2], panels[1::2], names):
        if truth.has(set_point_of(name)):
            look = {"color": COMMAND, "linewidth": 1.2, "linestyle": ":", "drawstyle": "steps-post", "zorder": 1.5}
            line(top, clock.times, shown_values(name, truth[set_point_of(name)]), clock.cuts, **look, label="set point")
        line(top, clock.times, shown_values(name, truth[name]), clock.cuts, color=MEASURED, linewidth=1.9, label=words)
        for (label, record), look in zip(models.items(), _looks(len(models))):
            if record.has(name):
                values, rows = record[name], slice(0, min(len(record), len(truth)))
                error = values[rows] - truth[name][rows]
                cuts = clock.cuts[clock.cuts < values.size]
                line(top, clock.times[rows], shown_values(name, values[rows]), cuts, linewidth=1.3, label=label, **look)
                line(bottom, clock.times[rows], shown_values(name, error), cuts, linewidth=1.0, **look)
        bottom.axhline(0.0, color=INK, linewidth=0.7)
        top.set_title(quantity_label(name), loc="left")
        bottom.set_title(f"model less vehicle, {unit_label(name)}", loc="left", color=QUIET)
        for axes in (top, bottom):
            axes.margins(x=0.0)
            axes.locator_params(axis="y", nbins=5 if axes is top else 3)
        downwards(top, name)
    panels[-1].set_xlabel(clock.label)
    _legend(figure, panels[::2])
    return figure


def growth_figure(curves: Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]], names: Sequence[str]) -> Figure:
    """Root mean square error of each model over time, in percent of the step, over all compared runs.

    curves: model -> channel -> {"time_s": (bins,), "percent": (bins,)}.
    """
    figure = new_figure(2.6 * ((len(names) + 1) // 2))
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        for (label, of), look in zip(curves.items(), _looks(len(curves))):
            if name in of:
                axes.plot(of[name]["time_s"], of[name]["percent"], linewidth=1.4, label=label, **look)
        axes.set_title(f"error of {channel(name).label}, percent of its step", loc="left")
        axes.set_xlabel("time, s")
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.0)
    _legend(figure, panels)
    return figure


def autocorrelation_figure(tests: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Autocorrelation of what each model leaves, per output, with the band in which 95 % of noise would lie.

    tests: model -> channel -> {"lags_s", "correlation", "bound"}.
    """
    names = list(dict.fromkeys(n for of in tests.values() for n in of))
    figure = new_figure(2.35 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        of = {label: test[name] for label, test in tests.items() if name in test}
        for (label, test), look in zip(of.items(), _looks(len(tests), list(tests), list(of))):
            axes.plot(test["lags_s"], test["correlation"], marker=".", markersize=4, linewidth=1.1, label=label, **look)
        widest = max(of.values(), key=lambda test: test["lags_s"][-1])
        band(axes, np.asarray(widest["lags_s"]), max(test["bound"] for test in of.values()))
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set_xlim(0.0, widest["lags_s"][-1])
        axes.set_ylim(-1.0, 1.0)
        axes.set_title(f"autocorrelation, {channel(name).label}", loc="left")
        axes.set_xlabel("lag, s")
    _legend(figure, panels)
    return figure


def input_correlation_figure(tests: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Correlation of what each model leaves with each input, per output and input, at lags of either sign.

    tests: model -> channel -> {"inputs": input -> {"lags_s", "correlation", "bound"}}.
    """
    pairs = list(dict.fromkeys((n, i) for of in tests.values() for n, test in of.items() for i in test["inputs"]))
    figure = new_figure(2.25 * ((len(pairs) + 1) // 2) + 0.3)
    panels = grid(figure, len(pairs), 2)
    for axes, (name, driver) in zip(panels, pairs):
        of = {label: t[name]["inputs"][driver] for label, t in tests.items() if driver in t.get(name, _NONE)["inputs"]}
        for (label, test), look in zip(of.items(), _looks(len(tests), list(tests), list(of))):
            axes.plot(test["lags_s"], test["correlation"], marker=".", markersize=4, linewidth=1.1, label=label, **look)
        widest = max(of.values(), key=lambda test: test["lags_s"][-1])
        band(axes, np.asarray(widest["lags_s"]), max(test["bound"] for test in of.values()))
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.axvline(0.0, color=INK, linewidth=0.7, linestyle=":")
        axes.set_xlim(widest["lags_s"][0], widest["lags_s"][-1])
        top = max(0.25, 1.15 * max(np.max(np.abs(test["correlation"])) for test in of.values()))
        axes.set_ylim(-top, top)
        axes.set_title(f"{channel(name).label} with {channel(driver).label}", loc="left")
        axes.set_xlabel("lag, s (right of 0: the input leads)")
    _legend(figure, panels)
    return figure


def guard_acted(record: Record) -> np.ndarray:
    """Whether an envelope's guard acted at each sample, (n,)."""
    return record["envelope_flag"] > 0.5 if record.has("envelope_flag") else np.zeros(len(record), dtype=bool)


_NONE: dict[str, Any] = {"inputs": {}}


def _moves(record: Record, name: str) -> bool:
    return bool(np.ptp(record[name]) > _STILL.get(channel(name).unit, 0.0))


def _shade_guard(axes, record: Record, clock: Clock) -> None:
    acted = guard_acted(record)
    edges = np.flatnonzero(np.diff(np.r_[0, acted.astype(int), 0]))
    for start, stop in zip(edges[::2], edges[1::2]):
        last = min(stop, len(record) - 1)
        axes.axvspan(clock.times[start], clock.times[last], color=GUARD_SHADE, zorder=0, linewidth=0)


def _looks(count: int, every: Sequence[str] = (), drawn: Sequence[str] = ()) -> list[dict[str, Any]]:
    """A look for each of `count` models; of the drawn ones, each the same as in a figure of every one."""
    looks = [LOOKS[i % len(LOOKS)] for i in range(count)]
    return [looks[list(every).index(name)] for name in drawn] if every else looks


def _legend(figure: Figure, panels: Iterable[Any], further: Sequence[Any] = ()) -> None:
    """One legend for all panels, each entry once."""
    entries: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    handles, labels = [*entries.values(), *further], [*entries, *(h.get_label() for h in further)]
    figure.legend(handles=handles, labels=labels, loc="outside upper left", ncols=5)


def _named(colour: str, label: str):
    shade = patch(colour)
    shade.set_label(label)
    return shade


def _power_unit(name: str) -> str:
    unit = unit_label(name)
    return f"({unit})²/(rad/s)" if "/" in unit else f"{unit}²/(rad/s)"
