"""Figures of models: their runs beside the vehicle's, prediction error over the horizon, and residual tests.

Needs the extra `render`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel, set_point_of
from auv_gym.records.record import Record
from identification.pages.drawing import (
    COMMAND,
    INK,
    MEASURED,
    QUIET,
    Clock,
    band,
    downwards,
    grid,
    line,
    new_figure,
    quantity_label,
    shown_values,
    with_unit,
)
from identification.pages.drawn_channels import excited_set_point
from identification.pages.page import Drawing, drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Looks of the models in order of appearance; both colours and line styles differ.
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "#0072b2", "linestyle": "-"},
    {"color": "#d55e00", "linestyle": (0, (5, 1.4))},
    {"color": "#00785a", "linestyle": (0, (1.5, 1.2))},
    {"color": "#b0558f", "linestyle": (0, (5, 1.2, 1.2, 1.2))},
    {"color": "#b07d00", "linestyle": (0, (8, 2))},
)
BAND = "#b8d4e8"
_EDGES = 400  # points along the edge of a band
_WIDENED = 0.5  # share of a panel's height by which a band may extend it
_SHOWN = 1e-5  # of the largest error; smaller errors are rounding


def rollout_figure(
    truth: Record,
    models: Mapping[str, Record],
    names: Sequence[str],
    words: str,
    bands: Mapping[str, Mapping[str, np.ndarray]] | None = None,
) -> Figure:
    """Outputs of the vehicle and of the models in its place in one panel, and the models' errors below.

    words: the meaning of the black line.  bands: by model and output, the 95 % half width around the model's line,
    (n,).
    """
    clock = Clock(truth)
    figure = new_figure(2.35 * len(names) + 0.8)
    panels = figure.subplots(2 * len(names), 1, sharex=True, height_ratios=[2.0, 0.9] * len(names), squeeze=False)[:, 0]
    look: dict[str, Any]
    for top, bottom, name in zip(panels[::2], panels[1::2], names):
        if truth.has(set_point_of(name)):
            look = {"color": COMMAND, "linewidth": 1.2, "linestyle": ":", "drawstyle": "steps-post", "zorder": 1.5}
            line(
                top,
                clock.times,
                shown_values(name, excited_set_point(truth, name)),
                clock.cuts,
                **look,
                label="set point",
            )
        line(top, clock.times, shown_values(name, truth[name]), clock.cuts, color=MEASURED, linewidth=1.9, label=words)
        for (label, record), look in zip(models.items(), looks(len(models))):
            if record.has(name):
                values, rows = record[name], slice(0, min(len(record), len(truth)))
                error = values[rows] - truth[name][rows]
                cuts = clock.cuts[clock.cuts < values.size]
                line(top, clock.times[rows], shown_values(name, values[rows]), cuts, linewidth=1.3, label=label, **look)
                line(bottom, clock.times[rows], shown_values(name, error), cuts, linewidth=1.0, **look)
        for label, of in (bands or {}).items():  # after all lines, which determine the range of a panel
            if name in of and models[label].has(name):
                values, rows = models[label][name], slice(0, min(len(models[label]), len(truth), of[name].size))
                half, cuts = shown_values(name, of[name][rows]), clock.cuts[clock.cuts < rows.stop]
                for axes, middle in ((top, values[rows]), (bottom, values[rows] - truth[name][rows])):
                    _shade(axes, clock.times[rows], shown_values(name, middle), half, cuts)
        bottom.axhline(0.0, color=INK, linewidth=0.7)
        top.set_title(quantity_label(name), loc="left")
        bottom.set_title(with_unit("model minus measured", name), loc="left", color=QUIET)
        for axes in (top, bottom):
            axes.margins(x=0.0)
            axes.locator_params(axis="y", nbins=5 if axes is top else 3)
        downwards(top, name)
    panels[-1].set_xlabel(clock.label)
    legend(figure, panels[::2])
    return figure


def _shade(axes, times: np.ndarray, middle: np.ndarray, half: np.ndarray, cuts: np.ndarray) -> None:
    """Draw a band; it may extend its panel only as far as the lines stay readable."""
    low, high = axes.get_ylim()
    room = _WIDENED * (high - low)
    for part in np.split(np.arange(times.size), cuts):
        kept = part[:: max(part.size // _EDGES, 1)]
        edges = np.clip([middle[kept] - half[kept], middle[kept] + half[kept]], low - 2.0 * room, high + 2.0 * room)
        axes.fill_between(times[kept], *edges, color=BAND, linewidth=0, zorder=1.2, label="95 % band of the fit")
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, low - room), min(top, high + room))


def horizon_figure(sweeps: Mapping[str, Mapping[str, Mapping[float, float]]]) -> Figure:
    """RMS prediction error against the horizon, per output, one line for each model.

    sweeps: model -> channel -> horizon in s -> error in SI.
    """
    from matplotlib.ticker import NullFormatter

    names = list(dict.fromkeys(name for of in sweeps.values() for name in of))
    figure = new_figure(2.6 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        largest = 0.0
        for number, (label, of) in enumerate(sweeps.items()):
            if name in of:
                seconds, errors = np.array(list(of[name].items())).T
                largest = max(largest, float(shown_values(name, errors).max()))
                look = LOOKS[number % len(LOOKS)]
                axes.loglog(seconds, shown_values(name, errors), marker="o", markersize=3, label=label, **look)
        if largest > 0.0:
            axes.set_ylim(bottom=max(axes.get_ylim()[0], _SHOWN * largest))
        axes.set_title(f"{with_unit(f'error of {channel(name).label}', name)} (RMS)", loc="left")
        axes.set_xlabel("seconds ahead")
        for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("{x:g}" if high < 10.0 * low else NullFormatter())
    legend(figure, panels)
    return figure


def autocorrelation_figure(tests: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Autocorrelation of each model's residual, per output, with the 95 % band of white noise.

    tests: model -> channel -> {"lags_s", "correlation", "bound"}.
    """
    names = list(dict.fromkeys(n for of in tests.values() for n in of))
    figure = new_figure(2.35 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        of = {label: test[name] for label, test in tests.items() if name in test}
        for (label, test), look in zip(of.items(), looks(len(tests), list(tests), list(of))):
            axes.plot(test["lags_s"], test["correlation"], marker=".", markersize=4, linewidth=1.1, label=label, **look)
        widest = max(of.values(), key=lambda test: test["lags_s"][-1])
        band(axes, np.asarray(widest["lags_s"]), max(test["bound"] for test in of.values()))
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set_xlim(0.0, widest["lags_s"][-1])
        axes.set_ylim(-1.0, 1.0)
        axes.set_title(f"autocorrelation, {channel(name).label}", loc="left")
        axes.set_xlabel("lag, s")
    legend(figure, panels)
    return figure


def input_correlation_figure(tests: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Correlation of each model's residual with each input, per output and input, at positive and negative lags.

    tests: model -> channel -> {"inputs": input -> {"lags_s", "correlation", "bound"}}.
    """
    pairs = list(dict.fromkeys((n, i) for of in tests.values() for n, test in of.items() for i in test["inputs"]))
    figure = new_figure(2.25 * ((len(pairs) + 1) // 2) + 0.3)
    panels = grid(figure, len(pairs), 2)
    for axes, (name, driver) in zip(panels, pairs):
        of = {label: t[name]["inputs"][driver] for label, t in tests.items() if driver in t.get(name, _NONE)["inputs"]}
        for (label, test), look in zip(of.items(), looks(len(tests), list(tests), list(of))):
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
    legend(figure, panels)
    return figure


def residual_drawings(tests: Mapping[str, Mapping[str, Any]]) -> list[Drawing]:
    """Figures of the results of `residual_tests`, by model if there are several."""
    drawings = [
        drawn(
            lambda: autocorrelation_figure(tests),
            "autocorrelation",
            "Autocorrelation of residuals, per output.",
            "Autocorrelation of each residual. Inside the grey band, it is consistent with white noise.",
        )
    ]
    if any(test["inputs"] for of in tests.values() for test in of.values()):
        drawings.append(
            drawn(
                lambda: input_correlation_figure(tests),
                "input-correlation",
                "Correlation of residuals with inputs at lags of either sign.",
                "Cross-correlation of each residual with an input. Beyond the band at positive lags: a response to the "
                "input that the model is missing. At negative lags: feedback, as the controller reacts to the output.",
            )
        )
    return drawings


_NONE: dict[str, Any] = {"inputs": {}}


def looks(count: int, every: Sequence[str] = (), drawn: Sequence[str] = ()) -> list[dict[str, Any]]:
    """A look for each of `count` models; models named in `drawn` look the same as in a figure of `every` model."""
    found = [LOOKS[i % len(LOOKS)] for i in range(count)]
    return [found[list(every).index(name)] for name in drawn] if every else found


def legend(figure: Figure, panels: Iterable[Any], further: Sequence[Any] = ()) -> None:
    """Draw one legend for all panels, with each entry once."""
    entries: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    handles, labels = [*entries.values(), *further], [*entries, *(h.get_label() for h in further)]
    figure.legend(handles=handles, labels=labels, loc="outside upper left", ncols=5)
