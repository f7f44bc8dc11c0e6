"""Figures of a diagnosis as inline SVG: the log, the model's runs over it, the growth of their errors, the track.

Needs the extra `render`. A function takes a Diagnosis and returns a matplotlib Figure; `svg` turns that into text.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from itertools import pairwise
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.records.record import Record
from identification.diagnosis.judge.result import Stage
from identification.diagnosis.judge.verdict import Diagnosis
from identification.fit.validation import FreeRuns
from identification.pages import drawing
from identification.pages.drawing import (
    AFTER,
    BEFORE,
    COMMAND,
    INPUT,
    MEASURED,
    POINTS,
    QUIET,
    Clock,
    compass_ticks,
    downwards,
    grid,
    line,
    nearest_turns,
    new_figure,
    patch,
    quantity_label,
    shown_values,
    thinned,
    with_unit,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GIVEN = "#9a8fb0"
PART_SHADES, SETTLE_SHADE = ("#f7f3e8", "#dbe8f4"), "#ececec"  # alternating shades for the parts of a log
CONTEXT = ("depth_m", "pitch_rad", "roll_rad", "u_mps", "w_mps", "altitude_m")
_TALL, _LOW = 36, 17  # characters that fit beside a panel of the close-up


def svg(draw: Callable[[Diagnosis], Figure], diagnosis: Diagnosis, name: str, label: str) -> str:
    """The SVG element of a figure of a diagnosis, see `drawing.svg`."""
    return drawing.svg(lambda: draw(diagnosis), name, label)


def log_figure(d: Diagnosis) -> Figure:
    """Measured outputs, inputs and auxiliary signals over time, with the windows of the log's parts shaded."""
    record, plant = d.record, d.given.plant
    outputs = list(d.after.every.channels)
    inputs = [n for n in plant.inputs if record.has(n) and drives(n, plant.family.required)]
    context = [n for n in CONTEXT if record.has(n) and n not in outputs]
    heights = [1.5, *[1.0] * (len(outputs) - 1), *[1.0] * len(inputs), *[0.62] * len(context)]
    figure = new_figure(sum(heights) + 0.26 * len(heights) + 0.6)
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    clock = Clock(record)
    for axes, name in zip(panels, [*outputs, *inputs, *context]):
        shade_windows(axes, d, clock)
        colour = MEASURED if name in outputs else INPUT if name in inputs else QUIET
        line(axes, clock.times, shown_values(name, record[name]), clock.cuts, color=colour, linewidth=1.0)
        axes.set_title(quantity_label(name), loc="left")
        axes.margins(x=0.0)
        axes.locator_params(axis="y", nbins=3 if name in context else 5)
        downwards(axes, name)
        if name == "heading_rad":
            _draw_commanded_heading(axes, record, clock)
            compass_ticks(axes)
    panels[-1].set_xlabel(clock.label)
    figure.legend(handles=window_patches(d), loc="outside upper left", ncols=2)
    return figure


def _draw_commanded_heading(axes, record: Record, clock: Clock) -> None:
    """Draw the commanded heading, if it was logged, within half a turn of the measured one."""
    if not record.has("heading_cmd_rad"):
        return
    near = np.rad2deg(nearest_turns(record["heading_cmd_rad"], record["heading_rad"]))
    line(axes, clock.times, near, clock.cuts, color=COMMAND, linewidth=1.0, linestyle="--", zorder=1.5)
    axes.set_title(f"{quantity_label('heading_rad')} (dashed: commanded)", loc="left")


def drives(name: str, required: Collection[str]) -> bool:
    """Whether an input is a command or another signal required for simulation, and not a motion."""
    kind = channel(name).kind
    return kind == "input" or (name in required and kind != "motion")


def overview_figure(d: Diagnosis) -> Figure:
    """The model's free runs in all windows over the measured outputs; the first output is drawn in strips."""
    names, clock = d.after.every.channels, Clock(d.record)
    strips = int(np.clip(round(sum(len(w) for w in d.windows) / 15), 1, 4))
    heights = [1.45] * strips + [1.15] * (len(names) - 1)
    figure = new_figure(sum(heights) + 0.32 * len(heights) + 0.7)
    panels = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    edges = np.linspace(clock.times[0], clock.times[-1], strips + 1)
    spans = [*pairwise(edges), *[(edges[0], edges[-1])] * (len(names) - 1)]
    for number, (axes, span) in enumerate(zip(panels, spans)):
        name = names[max(number - strips + 1, 0)]
        shade_windows(axes, d, clock, span)
        _runs(axes, d, name, clock, span)
        axes.set_xlim(span)
        axes.locator_params(axis="y", nbins=5)
        if number in (0, *range(strips, len(panels))):
            axes.set_title(quantity_label(name), loc="left")
        if name == "heading_rad":
            compass_ticks(axes)
        downwards(axes, name)
    panels[-1].set_xlabel(clock.label)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles=[*handles, *window_patches(d)], labels=[*labels, *window_words(d)], loc="outside upper left", ncols=5
    )
    return figure


def zoom_figure(d: Diagnosis) -> Figure:
    """An output and the first input in up to three unseen windows: worst before, a typical one, worst after."""
    picked, record, name = example_windows(d), d.record, most_improved(d)
    output = d.after.unseen.channels.index(name)
    driver = (*d.given.plant.family.required, *d.given.plant.inputs)[0]
    figure = new_figure(4.0)
    panels = figure.subplots(2, len(picked), sharex="col", height_ratios=(2.6, 1.0), squeeze=False)
    for column, (title, number) in enumerate(picked):
        rows = d.after.unseen.rows[d.after.unseen.window == number]
        seconds = record.time[rows] - record.time[rows[0]]
        start = seconds[np.argmax(d.after.unseen.scored[d.after.unseen.window == number])]
        top, bottom = panels[:, column]
        for axes in (top, bottom):
            axes.axvspan(0.0, start, color=SETTLE_SHADE, zorder=0, linewidth=0)
            axes.set_xlim(0.0, seconds[-1])
        measured = record[name][rows]
        top.plot(seconds, shown_values(name, measured), color=MEASURED, linewidth=1.8, label="measured")
        for label, stage, look in series(d):
            runs = stage.unseen
            model = runs.model[runs.window == number, output]
            top.plot(seconds, shown_values(name, _nearest_turn(name, model, measured)), label=label, **look)
        bottom.step(seconds, shown_values(driver, record[driver][rows]), where="post", color=INPUT, linewidth=1.3)
        top.set_title(title, loc="left", fontweight="bold")
        top.locator_params(axis="y", nbins=6)
        bottom.locator_params(axis="y", nbins=4)
        if name == "heading_rad":
            compass_ticks(top)
        downwards(top, name)
        bottom.set_xlabel("time since the window's start, s")
    panels[0, 0].set_ylabel(fill(quantity_label(name), _TALL))
    panels[1, 0].set_ylabel(fill(quantity_label(driver), _LOW))
    handles, labels = panels[0, 0].get_legend_handles_labels()
    handles, labels = [*handles, patch(SETTLE_SHADE)], [*labels, "start fitted here, not scored"]
    figure.legend(handles=handles, labels=labels, loc="outside upper left", ncols=5)
    return figure


def growth_figure(d: Diagnosis) -> Figure:
    """RMS error in unseen parts against the time since the window's start, per output."""
    names = d.after.unseen.channels
    figure = new_figure(2.9 * ((len(names) + 1) // 2))
    panels = grid(figure, len(names), 2)
    for c, (axes, name) in enumerate(zip(panels, names)):
        axes.axvspan(0.0, d.settle, color=SETTLE_SHADE, zorder=0, linewidth=0)
        tops = []
        for label, stage, look in series(d):
            seconds, error = error_growth(stage.unseen, d.record, d.window, c)
            axes.plot(seconds, shown_values(name, error), marker="o", markersize=3, label=label, **look)
            tops.append(np.nanmax(shown_values(name, error)))
        if all(stage is not d.given for _, stage, _ in series(d)):
            seconds, error = error_growth(d.given.unseen, d.record, d.window, c)
            axes.plot(
                seconds, shown_values(name, error), color=GIVEN, linewidth=1.2, linestyle=":", label="vehicle as given"
            )
            tops.append(min(np.nanmax(shown_values(name, error)), 2.5 * max(tops)))
        axes.set_xlim(0.0, d.window)
        axes.set_ylim(0.0, 1.08 * max(tops))
        axes.set_title(f"{with_unit(f'error of {d.after.unseen.label(name)}', name)} (RMS)", loc="left")
        axes.set_xlabel("time since the window's start, s")
    handles, labels = panels[0].get_legend_handles_labels()
    handles, labels = [*handles, patch(SETTLE_SHADE)], [*labels, "start fitted here, not scored"]
    figure.legend(handles=handles, labels=labels, loc="outside upper left", ncols=4)
    return figure


def track_figure(d: Diagnosis) -> Figure:
    """Plan view of the measured track with the model's free runs in unseen parts, north up."""
    figure = new_figure(4.6)
    axes = figure.subplots()
    clock, runs = Clock(d.record), d.after.unseen
    keep = thinned(d.record["north_m"], POINTS, clock.cuts)
    track = [np.append(d.record[name], np.nan)[keep] for name in ("east_m", "north_m")]
    axes.plot(*track, color=MEASURED, linewidth=1.6, label="measured")
    for label, stage, look in series(d):
        east, north = (stage.unseen.model[:, runs.channels.index(n)] for n in ("east_m", "north_m"))
        keep = thinned(north, POINTS, np.flatnonzero(np.diff(runs.window)) + 1)
        axes.plot(np.append(east, np.nan)[keep], np.append(north, np.nan)[keep], label=label, **look)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("north, m", loc="left")
    axes.set_xlabel("east, m")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def example_windows(d: Diagnosis) -> list[tuple[str, int]]:
    """Two or three different windows, chosen by unseen runs: their titles and numbers among all windows."""
    output = d.after.unseen.channels.index(most_improved(d))
    drawn = series(d)
    before, after = (_window_errors(stage.unseen, output) for stage in (drawn[0][1], drawn[-1][1]))
    order = np.argsort(before)
    if len(drawn) == 1:
        picked = [("Largest error", order[-1]), ("A typical window", order[(order.size - 1) // 2])]
    else:
        wanted = np.argsort(after)
        picked = [
            ("Largest error before", order[-1]),
            ("A typical window", order[(order.size - 1) // 2]),
            ("Largest error after", wanted[-1]),
        ]
    found: dict[int, str] = {}
    for title, number in picked:
        together = {"Largest error before", "Largest error after"} == {found.get(int(number)), title}
        found[int(number)] = "Largest error before and after" if together else found.get(int(number), title)
    return [(title, number) for number, title in found.items()]


def most_improved(d: Diagnosis) -> str:
    """The output whose error in unseen parts shrank most; the first output if nothing was added to the vehicle."""
    names = d.after.unseen.channels
    if not d.changed:
        return names[0]
    return max(names, key=lambda name: d.before.scores[name].rmse / max(d.after.scores[name].rmse, 1e-12))


def error_growth(runs: FreeRuns, record: Record, window: float, output: int) -> tuple[np.ndarray, np.ndarray]:
    """Time since the window's start, s, and RMS residual of an output around that time, both (bins,)."""
    time = record.time[runs.rows]
    first = np.r_[True, runs.window[1:] != runs.window[:-1]]
    since = time - time[first][np.cumsum(first) - 1]
    width = max(record.sample_interval, window / 24.0)
    bins = np.minimum((since / width).astype(int), int(np.ceil(window / width)) - 1)
    squares = runs.residual[:, output] ** 2
    keep = np.isfinite(squares)
    count = np.bincount(bins[keep])
    filled = count > 0
    mean_square = np.bincount(bins[keep], squares[keep])[filled] / count[filled]
    middle = np.bincount(bins[keep], since[keep])[filled] / count[filled]
    return middle, np.sqrt(mean_square)


def series(d: Diagnosis) -> list[tuple[str, Stage, dict[str, Any]]]:
    """The model's lines to draw: name, stage and look; a single line if nothing was added to the vehicle."""
    before = {"color": BEFORE, "linewidth": 2.2, "linestyle": (0, (4, 1.2))}  # wider, to show below the other
    after = {"color": AFTER, "linewidth": 1.3}
    if d.changed:
        first = "model as given" if d.before is d.given else "model before"
        return [(first, d.before, before), ("model after", d.after, after)]
    return [("refitted model", d.after, after)]


def _runs(axes, d: Diagnosis, name: str, clock: Clock, span: tuple[float, float]) -> None:
    """Draw the measured output and the free runs of the windows that overlap a span of time."""
    record, output = d.record, d.after.every.channels.index(name)
    inside = np.flatnonzero((clock.times >= span[0]) & (clock.times <= span[1]))
    cuts = np.flatnonzero(np.isin(inside, clock.cuts))
    line(
        axes,
        clock.times[inside],
        shown_values(name, record[name][inside]),
        cuts,
        color=MEASURED,
        linewidth=1.5,
        label="measured",
    )
    for label, stage, look in series(d):
        runs = stage.every
        shown = np.isin(runs.rows, inside)
        window, rows = runs.window[shown], runs.rows[shown]
        cuts = np.flatnonzero(np.diff(window)) + 1
        parts = [
            _nearest_turn(name, m, record[name][r])
            for m, r in zip(np.split(runs.model[shown, output], cuts), np.split(rows, cuts))
        ]
        line(
            axes,
            clock.times[rows],
            shown_values(name, np.concatenate(parts)),
            cuts,
            label=label,
            **{**look, "linewidth": 0.75 * look["linewidth"]},
        )


def _nearest_turn(name: str, model: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """A run of the model shifted by whole turns so that it starts beside the measured angle."""
    if not channel(name).angle or model.size == 0:
        return model
    return model - 2.0 * np.pi * np.round((model[0] - measured[0]) / (2.0 * np.pi))


def shade_windows(axes, d: Diagnosis, clock: Clock, span: tuple[float, float] | None = None) -> None:
    """Draw the windows as bands over the whole height, in shades that alternate by part."""
    low, high = span or (-np.inf, np.inf)
    for number, windows in enumerate(d.windows):
        bars = [(clock.times[w.start], clock.times[w.stop - 1] - clock.times[w.start]) for w in windows]
        bars = [(start, length) for start, length in bars if start + length >= low and start <= high]
        axes.broken_barh(
            bars,
            (0.0, 1.0),
            transform=axes.get_xaxis_transform(),
            facecolor=PART_SHADES[number % 2],
            linewidth=0,
            zorder=0,
        )


def window_words(d: Diagnosis) -> list[str]:
    """The meaning of each shade: windows of parts 1, 3, 5 or of parts 2, 4, 6."""
    numbers = [str(k + 1) for k in range(len(d.windows))]
    return [f"windows of part{'s' * (len(own) > 1)} {', '.join(own)}" for own in (numbers[0::2], numbers[1::2]) if own]


def window_patches(d: Diagnosis) -> list:
    words = window_words(d)
    patches = [patch(shade) for shade in PART_SHADES[: len(words)]]
    for shade, text in zip(patches, words):
        shade.set_label(text)
    return patches


def _window_errors(runs: FreeRuns, output: int) -> np.ndarray:
    """RMS residual of an output in each window, (W,), over the scored rows."""
    keep = runs.scored & np.isfinite(runs.residual[:, output])
    squares = np.where(keep, runs.residual[:, output], 0.0) ** 2
    return np.sqrt(np.bincount(runs.window, squares) / np.maximum(np.bincount(runs.window, keep), 1))
