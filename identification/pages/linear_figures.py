"""Figures of linear models: poles and zeros, and frequency responses.

Needs the extra `render`.  Functions return a matplotlib Figure, for `figure.savefig`; `drawing.svg` turns it into text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, pi
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel, unit_per
from auv_gym.models.linear import Polynomial, StateSpace
from identification.linear.fit import Known, LinearFit, has_errors
from identification.linear.poles import PoleInterval, pole_intervals, zeros
from identification.linear.uncertainty import ResponseBand, response_band
from identification.pages.drawing import INK, QUIET, grid, new_figure
from identification.pages.model_figures import LOOKS, legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# fits are drawn with their uncertainty, models without
Models = Mapping[str, LinearFit | Polynomial | StateSpace]
_HINT = "#b9c4cd"
_DAMPINGS = (0.1, 0.3, 0.5, 0.7, 0.9)  # ratios
_WHOLE = 1.15  # half the side of a panel that shows the whole unit circle
_CLOSE = 1.0  # side of the square around all poles; if smaller, the panel shows only that square
_FREQUENCIES = 300
_SLOW, _SLOWEST = 300.0, 3e3  # ratios of the Nyquist frequency to a Bode diagram's lowest frequency: usual and largest
_DELAY = 1e-6  # magnitude of a discrete pole below which it is a pure delay
_ALONE, _APART = (
    0.3,
    4.0,
)  # distance from 1, and that over the next pole's, of a pole that a picture of the others omits
_BEYOND_DB, _BEYOND_DEG = 20.0, 90.0  # that a band may widen a panel


def pole_zero_figure(models: Models) -> Figure:
    """Poles with their 95 % regions and zeros in the z-plane, per output and input.

    If the poles are close together, a panel shows their surroundings; otherwise it shows the unit circle.  Grey lines:
    equal damping (solid) and equal natural frequency, rad/s (dashed).
    """
    fits = _fits(models)
    pairs = pairs_of([fit.model for fit in fits.values()])
    poles = {name: pole_intervals(fit) for name, fit in fits.items()}
    columns = min(len(pairs), 3 if len(pairs) > 4 else 2)
    rows = (len(pairs) + columns - 1) // columns
    figure = new_figure((4.4 if columns < 3 else 3.5) * rows + 0.4)
    panels = grid(figure, len(pairs), columns)
    for axes, (output, given) in zip(panels, pairs):
        shown = {
            name: ([p for p in poles[name] if not p.outputs or output in p.outputs], zeros(fit.model, output, given))
            for name, fit in fits.items()
            if output in fit.model.outputs and given in fit.model.inputs
        }
        centre, half = _view(
            [p for of, _ in shown.values() for p in of], [z for _, found in shown.values() for z in found]
        )
        _hints(axes, next(iter(fits.values())).model.dt, centre, half)
        for number, name in enumerate(fits):
            if name in shown:
                _draw_poles(axes, *shown[name], name if len(fits) > 1 else "", LOOKS[number % len(LOOKS)]["color"])
        axes.set_xlim(centre - half, centre + half)
        axes.set_ylim(-half, half)
        axes.set_aspect("equal", adjustable="box")
        axes.grid(False)
        axes.locator_params(nbins=5)
        axes.set_title(_pair_words(output, given, columns), loc="left")
        axes.set_xlabel(fill(_beyond(shown, centre, half), 58 if columns < 3 else 40) or "real part", fontsize=8.5)
        axes.set_ylabel("imaginary part")
    legend(figure, panels, _marks(fits))
    return figure


def bode_figure(models: Models, omega: np.ndarray | Sequence[float] | None = None) -> Figure:
    """Bode diagram with 95 % bands: gain and phase over frequency, per output and input.

    omega: rad/s; default from well below the slowest mode to the Nyquist frequency of each model.
    """
    fits = _fits(models)
    pairs = pairs_of([fit.model for fit in fits.values()])
    first = min(_slowest(fit.model) for fit in fits.values())
    bands = {name: response_band(fit, _up_from(first, fit) if omega is None else omega) for name, fit in fits.items()}
    columns = min(len(pairs), 3 if len(pairs) > 4 else 2)
    rows = (len(pairs) + columns - 1) // columns
    figure = new_figure(3.5 * rows + 0.4)
    panels = figure.subplots(2 * rows, columns, sharex="col", squeeze=False, height_ratios=[1.5, 1.0] * rows)
    drawn = []
    for number in range(rows * columns):
        top, bottom = panels[2 * (number // columns) : 2 * (number // columns) + 2, number % columns]
        if number >= len(pairs):
            top.set_axis_off()
            bottom.set_axis_off()
            continue
        output, given = pairs[number]
        drawn.append(top)
        _draw_response(top, bottom, bands, output, given)
        unit = unit_per(output, given)
        top.set_title(
            f"{_pair_words(output, given, columns)}\ngain, dB" + (f" re 1 {unit}" if unit != "1" else ""), loc="left"
        )
        bottom.set_title("phase, deg", loc="left", color=QUIET)
        bottom.set_xlabel("frequency, rad/s")
        bottom.tick_params(labelbottom=True)
    legend(figure, drawn)
    return figure


def _slowest(model: Polynomial | StateSpace) -> float:
    """A frequency well below all of a model's modes except integrators, rad/s."""
    discrete = np.linalg.eigvals((model.state_space if isinstance(model, Polynomial) else model).a).astype(complex)
    modes = np.abs(np.log(discrete[np.abs(discrete) > _DELAY])) / model.dt
    last = pi / model.dt
    return min(last / _SLOW, 0.2 * float(modes[modes > last / _SLOWEST].min(initial=inf)))


def _up_from(first: float, fit: LinearFit) -> np.ndarray:
    last = pi / fit.model.dt
    return np.minimum(np.geomspace(first, last, _FREQUENCIES), last)


def pairs_of(models: Sequence[Polynomial | StateSpace]) -> list[tuple[str, str]]:
    """All pairs of output and input that at least one of the models has."""
    return list(dict.fromkeys((output, given) for m in models for output in m.outputs for given in m.inputs))


def _fits(models: Models) -> dict[str, LinearFit]:
    if not models:
        raise ValueError("A figure of linear models needs at least one, got none.")
    return {name: Known(m) if isinstance(m, Polynomial | StateSpace) else m for name, m in models.items()}


def _pair_words(output: str, given: str, columns: int) -> str:
    return fill(f"{channel(output).label} by {channel(given).label}", {1: 120, 2: 60}.get(columns, 36))


def _draw_poles(axes, poles: Sequence[PoleInterval], found: np.ndarray, name: str, colour: str) -> None:
    spots = [z for p in poles for z in ((p.value, p.value.conjugate()) if p.pair else (p.value,))]
    for pole in poles:
        border = pole.ellipse()
        for edge in (border, border.conj()) if pole.pair else (border,):
            if edge.size > 2:
                axes.fill(np.real(edge), np.imag(edge), color=colour, alpha=0.2, linewidth=0, zorder=2.0)
                axes.plot(np.real(edge), np.imag(edge), color=colour, linewidth=0.7, alpha=0.7, zorder=2.1)
            elif edge.size:
                axes.plot(
                    np.real(edge), np.imag(edge), "-|", color=colour, linewidth=4, alpha=0.35, markersize=9, zorder=2.0
                )
    marks: dict[str, Any] = {"color": colour, "linestyle": "none", "zorder": 3.0}
    label = f"poles of {name}" if name else "poles"
    axes.plot(np.real(spots), np.imag(spots), marker="x", markersize=7, markeredgewidth=1.6, label=label, **marks)
    axes.plot(np.real(found), np.imag(found), marker="o", markersize=6.5, markerfacecolor="none", **marks)


def _marks(fits: Mapping[str, LinearFit]) -> list:
    """Legend entries for the marks that all models share."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    known: dict[str, Any] = {"color": QUIET if len(fits) > 1 else LOOKS[0]["color"]}
    marks: list[Any] = [Line2D([], [], marker="o", markerfacecolor="none", linestyle="none", label="zeros", **known)]
    if any(fit.vector.size and has_errors(fit) for fit in fits.values()):
        marks.append(Patch(alpha=0.25, linewidth=0, label="95 % region of a pole", **known))
    return marks


def _view(poles: Sequence[PoleInterval], found: Sequence[complex]) -> tuple[float, float]:
    """Centre on the real axis and half the side of the square that a panel shows."""
    poles = sorted((p for p in poles if not p.delay), key=lambda p: abs(p.value - 1.0))
    away = [abs(p.value - 1.0) for p in poles]
    fast = [k for k in range(2, len(away)) if away[k] > max(_ALONE, _APART * away[k - 1])]
    poles = poles[: fast[0]] if fast else poles
    spots = [p.value for p in poles]
    edges = [z for p in poles for z in p.ellipse() if abs(z - p.value) < 0.25]
    for points in (spots + edges + list(found), spots + edges, spots):
        if spots:
            x, y = np.real(points), np.abs(np.imag(points))
            half = max(0.5 * float(np.ptp(x)), float(y.max()), 0.01) * 1.25
            if 2.0 * half < _CLOSE:
                return float(0.5 * (x.min() + x.max())), half
    furthest = max((abs(z) for z in spots), default=0.0)
    return 0.0, max(_WHOLE, min(1.1 * furthest, 2.0))


def _hints(axes, dt: float, centre: float, half: float) -> None:
    """Draw the unit circle, and lines of equal damping and equal natural frequency with their values."""
    turn = np.exp(1j * np.linspace(-pi, pi, 2001))
    axes.plot(np.real(turn), np.imag(turn), color=INK, linewidth=0.9, zorder=1.4)
    axes.axhline(0.0, color=_HINT, linewidth=0.7, zorder=1.2)
    reach = min(abs(complex(centre - half, half) - 1.0), pi)
    for ratio in _DAMPINGS:
        along = np.linspace(0.0, pi / np.sqrt(1.0 - ratio**2), 1500)
        _hint(
            axes,
            np.exp(along * complex(-ratio, np.sqrt(1.0 - ratio**2))),
            f"ζ {ratio:g}" if ratio > 0.2 else "",
            "-",
            centre,
            half,
            0.6,
        )
    step = _round_step(reach / dt / 4.0)
    for count in range(1, int(pi / dt / step) + 1):
        if count * step * dt > 1.6 * reach and half < _WHOLE:
            break
        ratio = np.linspace(0.0, 1.0, 400)
        ring = np.exp(count * step * dt * (-ratio + 1j * np.sqrt(1.0 - ratio**2)))
        _hint(
            axes,
            ring,
            f"{count * step:.3g} rad/s" if count == 1 else f"{count * step:.3g}",
            (0, (4, 3)),
            centre,
            half,
            0.0,
        )


def _hint(axes, curve: np.ndarray, text: str, style: Any, centre: float, half: float, at: float) -> None:
    """Draw a line and its mirror image, labelled at this share of its visible part."""
    for part in (curve, curve.conj()):
        axes.plot(np.real(part), np.imag(part), color=_HINT, linewidth=0.6, linestyle=style, zorder=1.1)
    x, y = np.real(curve), np.imag(curve)
    inside = (np.abs(x - centre) < 0.93 * half) & (y > 0.05 * half) & (y < 0.93 * half)
    seen = curve[inside]
    if text and seen.size > 3:
        spot = seen[int(at * (seen.size - 1))]
        white = {"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8}
        axes.text(
            spot.real, spot.imag, text, color=QUIET, fontsize=7.0, ha="center", va="center", bbox=white, zorder=1.3
        )


def _round_step(size: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not larger than this."""
    power = 10.0 ** np.floor(np.log10(size))
    return float(max(k * power for k in (1.0, 2.0, 5.0) if k * power <= size * (1.0 + 1e-9)))


def _beyond(shown: Mapping[str, tuple[Sequence[PoleInterval], np.ndarray]], centre: float, half: float) -> str:
    """Words for the poles and zeros that a panel leaves out."""
    poles = [p.value for of, _ in shown.values() for p in of]
    found = [complex(z) for _, of in shown.values() for z in of if np.imag(z) >= 0.0]
    words = []
    for word, values in (("pole", poles), ("zero", found)):
        away = [z for z in values if abs(z.real - centre) > half or abs(z.imag) > half]
        told = [f"{z.real:.3g}" + (f" ± {z.imag:.3g}j" if z.imag > 0.0 else "") for z in away]
        counted = [f"{t} ({told.count(t)} times)" if told.count(t) > 1 else t for t in dict.fromkeys(told)]
        words += [f"{word}{'s' * (len(told) > 1)} {', '.join(counted)}"] if told else []
    text = "; ".join(words).replace("-", "−")
    return f"real part (beyond: {text})" if text else ""


def _draw_response(top, bottom, bands: Mapping[str, ResponseBand], output: str, given: str) -> None:
    """Draw gain in dB and phase in degrees of every model that has the pair."""
    first: np.ndarray | None = None
    gains, phases, nyquist = [], [], 0.0
    for number, (name, band) in enumerate(bands.items()):
        if output not in band.outputs or given not in band.inputs:
            continue
        at = (slice(None), band.outputs.index(output), band.inputs.index(given))
        nyquist = max(nyquist, float(band.omega[-1]))
        if not band.gain[at].any():
            continue
        look = LOOKS[number % len(LOOKS)]
        gain, phase = (_decibels(band.gain[at]), np.rad2deg(band.phase[at]))
        turn = 360.0 * np.round(phase[0] / 360.0 if first is None else (phase[0] - first[0]) / 360.0)
        first = phase - turn if first is None else first
        edges = (
            [_decibels(edge[at]) for edge in band.gain_bounds],
            [np.rad2deg(e[at]) - turn for e in band.phase_bounds],
        )
        shown = {"color": look["color"], "alpha": 0.2, "linewidth": 0, "zorder": 1.6}
        for axes, values, (low, high), kept in ((top, gain, edges[0], gains), (bottom, phase - turn, edges[1], phases)):
            known = bool(np.isfinite(low).all()) and bool((high > low).any())
            if known:
                far = 1e3  # beyond any panel, but finite for drawing
                axes.fill_between(band.omega, np.maximum(low, values - far), np.minimum(high, values + far), **shown)
            axes.semilogx(band.omega, values, linewidth=1.4, label=name, **look)
            kept.append((values, low if known else values, high if known else values))
    if not gains:
        top.text(0.5, 0.5, "no response", transform=top.transAxes, ha="center", color=QUIET)
    for axes, kept, beyond in ((top, gains, _BEYOND_DB), (bottom, phases, _BEYOND_DEG)):
        if kept:
            values, low, high = (np.concatenate(part) for part in zip(*kept))
            floor = max(float(values.min()), float(values.max()) - 150.0) if axes is top else float(values.min())
            bottom_edge = max(float(low.min()), floor - beyond)
            top_edge = min(float(high.max()), float(values.max()) + beyond)
            margin = 0.05 * max(top_edge - bottom_edge, 1.0)
            axes.set_ylim(bottom_edge - margin, top_edge + margin)
    if gains:
        top.set_xlim(min(float(band.omega[0]) for band in bands.values()) or None, nyquist)
    _phase_ticks(bottom)


def _decibels(gain: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return 20.0 * np.log10(np.maximum(gain, 1e-300))


def _phase_ticks(axes) -> None:
    from matplotlib.ticker import MultipleLocator

    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(MultipleLocator(next((s for s in (5, 15, 45, 90, 180) if (high - low) / s <= 6), 360)))
