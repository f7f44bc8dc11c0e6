"""Figures of the residuals of a diagnosis: over time, their correlations, and with what they correlate.

Needs the extra `render`.  A function takes a Diagnosis and returns a matplotlib Figure.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from identification.diagnosis.judge.verdict import Diagnosis
from identification.fit.validation import input_correlation
from identification.pages.diagnosis_figures import series, shade_windows, window_patches, window_words
from identification.pages.drawing import (
    AFTER,
    INK,
    Clock,
    band,
    grid,
    line,
    new_figure,
    quantity_label,
    shown_values,
    unit_label,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLEAR = 0.1  # correlation below which a signal is not worth a picture
DOTS = 500  # in a scatter plot


def residual_figure(d: Diagnosis) -> Figure:
    """Measured minus model over time, before and after, from starts fitted to whole windows; one panel per output."""
    names, clock = d.after.fitted.channels, Clock(d.record)
    figure = new_figure(1.75 * len(names) + 0.7)
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for c, (axes, name) in enumerate(zip(panels, names)):
        shade_windows(axes, d, clock)
        for label, stage, look in series(d):
            runs = stage.fitted
            cuts = np.flatnonzero(np.diff(runs.window)) + 1
            line(
                axes,
                clock.times[runs.rows],
                shown_values(name, runs.residual[:, c]),
                cuts,
                label=label,
                **{**look, "linewidth": 0.75 * look["linewidth"]},
            )
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set_title(with_unit(f"residual of {d.after.fitted.label(name)}", name), loc="left")
        axes.margins(x=0.0)
    panels[-1].set_xlabel(clock.label)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles=[*handles, *window_patches(d)], labels=[*labels, *window_words(d)], loc="outside upper left", ncols=4
    )
    return figure


def autocorrelation_figure(d: Diagnosis) -> Figure:
    """Autocorrelation of the residual, per output, with the 95 % band of a white residual."""
    names = d.after.fitted.channels
    figure = new_figure(2.5 * ((len(names) + 1) // 2))
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        for (label, stage, look), shift in zip(series(d), (-0.2, 0.2)):
            white = stage.whiteness[name]
            lags = white.lags * d.record.sample_interval
            width = 0.38 * d.record.sample_interval
            shift = shift * d.record.sample_interval if len(series(d)) > 1 else 0.0
            axes.bar(lags + shift, white.correlation, width=width, color=look["color"], zorder=2.0, label=label)
        band(axes, lags, d.after.whiteness[name].bound)
        axes.set_xlim(0.0, lags[-1] + d.record.sample_interval)
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set_ylim(-1.0, 1.0)
        axes.set_title(f"autocorrelation, {d.after.fitted.label(name)}", loc="left")
        axes.set_xlabel("lag, s")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def input_correlation_figure(d: Diagnosis) -> Figure:
    """Correlation of the least explained output's residual with each varying input, at positive and negative lags."""
    runs, names = d.after.fitted, varying_inputs(d)
    output = runs.channels.index(least_explained(d))
    figure = new_figure(2.35 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        for label, stage, look in series(d):
            residual, signal = stage.fitted.residual[:, output], d.record[name][runs.rows]
            lags, values, bound = input_correlation(residual, signal, runs.window)
            seconds = lags * d.record.sample_interval
            axes.plot(seconds, values, marker=".", label=label, **look)
        band(axes, seconds, bound)
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.axvline(0.0, color=INK, linewidth=0.7, linestyle=":")
        axes.set_xlim(seconds[0], seconds[-1])
        axes.set_title(f"correlation with {channel(name).label}", loc="left")
        axes.set_xlabel("lag, s (right of 0: the input leads)")
    low = min(axes.get_ylim()[0] for axes in panels)
    high = max(axes.get_ylim()[1] for axes in panels)
    for axes in panels:
        axes.set_ylim(min(low, -0.2), max(high, 0.2))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def correlate_figure(d: Diagnosis) -> Figure:
    """Rate of an output's residual against the signal that it correlates with most, with its trend."""
    names = correlated_outputs(d)
    figure = new_figure(2.8 * ((len(names) + 1) // 2))
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        label, value = next(iter(d.remains[name]["rate_correlates_with"].items()))
        signal, rate = _rate_against(d, name, label)
        step = max(signal.size // DOTS, 1)
        axes.plot(
            signal[::step], rate[::step], ".", color=AFTER, alpha=0.4, markersize=6, markeredgewidth=0, label="sample"
        )
        order = np.array_split(np.argsort(signal), min(10, max(signal.size // 10, 1)))
        axes.plot(
            [signal[k].mean() for k in order],
            [rate[k].mean() for k in order],
            "o-",
            color=INK,
            markersize=4,
            linewidth=1.4,
            label="mean of each tenth",
        )
        axes.axhline(0.0, color=INK, linewidth=0.7)
        spread = np.quantile(np.abs(rate), 0.995)
        axes.set_ylim(-1.15 * spread, 1.15 * spread)
        axes.set_title(f"rate of the residual of {d.after.fitted.label(name)}, {_rate_unit(name)}", loc="left")
        axes.set_xlabel(f"{signal_label(label)} (correlation {value:+.2f})")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def least_explained(d: Diagnosis) -> str:
    """The output with the largest residual relative to its noise floor."""
    return max(d.after.fitted.channels, key=lambda name: d.remains[name]["rms"] / d.remains[name]["noise_floor"])


def correlated_outputs(d: Diagnosis) -> list[str]:
    """The outputs whose residual correlates with a logged signal, or else the one that does so most, if any."""
    found = {n: abs(next(iter(r["rate_correlates_with"].values()), 0.0)) for n, r in d.remains.items()}
    clear = [n for n, size in found.items() if size > CLEAR]
    strongest = max(found, key=lambda n: found[n])
    return clear or ([strongest] if found[strongest] > 0.0 else [])


def varying_inputs(d: Diagnosis) -> list[str]:
    """The inputs of the vehicle that the record holds and that move in its windows."""
    rows = d.after.fitted.rows
    return [n for n in d.given.plant.inputs if d.record.has(n) and np.ptp(d.record[n][rows]) > 0.0]


def signal_label(label: str) -> str:
    """The words for a signal of `remains`: a channel, or its sine or cosine."""
    found = re.fullmatch(r"(sin|cos)\((\w+)\)", label)
    words = {"sin": "sine", "cos": "cosine"}
    return f"{words[found[1]]} of {channel(found[2]).label}" if found else quantity_label(label)


def _rate_against(d: Diagnosis, name: str, label: str) -> tuple[np.ndarray, np.ndarray]:
    """A signal of `remains` and the rate of the residual per second, inside the windows, in units for display."""
    runs = d.after.fitted
    residual = runs.residual[:, runs.channels.index(name)]
    rate = np.gradient(residual) / d.record.sample_interval
    change = runs.window[1:] != runs.window[:-1]
    inner = np.isfinite(rate) & ~(np.r_[True, change] | np.r_[change, True])
    found = re.fullmatch(r"(sin|cos)\((\w+)\)", label)
    other = found[2] if found else label
    signal = d.record[other][runs.rows]
    shown = {"sin": np.sin, "cos": np.cos}[found[1]](signal) if found else shown_values(other, signal)
    inner &= np.isfinite(shown)
    return shown[inner], shown_values(name, rate[inner])


def _rate_unit(name: str) -> str:
    unit = unit_label(name)
    return f"{unit}²" if unit.endswith("/s") else "1/s" if unit == "1" else f"{unit}/s"
