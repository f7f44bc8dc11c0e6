"""The information that excitation gives on the depth model of npsauv: a table of designs of equal amplitude and length.

    python -m scripts.studies.excitation --out excitation

The setting is the vertical plane in closed loop, as in the first paper: `auv_gym/Depth-v0` sampled every 4 s for 600 s,
pitch read to 0.1 deg, the tuned PID autopilot, and a signal added at each of the stern and the bow plane. The measure
is the normal matrix, per sample, of the regressors of the ARX depth model with na 3, nb 2 and nk 1, about their means:
three past depths in hull lengths and two past commands of each plane in fin stops. Its smallest eigenvalue is the
information on the least determined combination of coefficients; the standard error of that combination is the standard
deviation of the equation error over the square root of samples times eigenvalue. The depths are the true ones, since
noise in past depths would count as excitation.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import degrees, inf, isfinite, pi, radians
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from auv_gym.channels import channel
from auv_gym.models.linear.linearise import linearise
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits
from auv_gym.records.record import Record
from controllers.autopilots import autopilot
from controllers.composed.excited import Excited
from controllers.controller import Controller
from controllers.relay import Relay
from identification.experiments.driving import drive
from identification.experiments.excitation import make_signal
from identification.experiments.multisine import crest_factor
from identification.linear.polynomials.structure import Structure
from identification.linear.regressors import Series, regression
from scripts.studies.harness import Found, Option, Sheet, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DT, DURATION, DEPTH = 4.0, 600.0, 60.0  # s, s, m
RESOLUTION, NOISE = radians(0.1), 0.03  # rad of pitch, as in the paper; m of depth, a usual pressure sensor
PLANES = ("stern_plane_rad", "bow_plane_rad")
SHADE = "#f3f0e4"
EQUATION = Structure.of("Arx", PLANES, ("depth_m",), n_a=3, n_b=2).rows[0]


@dataclass(frozen=True)
class Design:
    """A way to excite: a kind, with settings of both planes and of each; or a band of pitch, rad, for a relay."""

    name: str
    kind: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    each: tuple[Mapping[str, Any], ...] = ({}, {})
    relay: float | None = None


@dataclass(frozen=True)
class Told:
    """The information in a run: smallest eigenvalue and condition of the normal matrix, and data of the excitation.

    The latter are its crest factor and share of power within the model's band (NaN: none), largest depth error, m, and
    pitch, rad.
    signals, spectra: of the excitation, by plane.
    """

    smallest: float
    condition: float
    crest: float
    in_band: float
    depth: float
    pitch: float
    signals: Mapping[str, Sequence[float]]
    spectra: Mapping[str, Sequence[float]]


NUMBERS = ("smallest", "condition", "crest", "in_band", "depth", "pitch")


def designs(band: tuple[float, float]) -> list[Design]:
    """All compared designs; chirps and multisines stay in the band, rad/s, and each plane has its own signal."""
    in_hz = [edge / (2.0 * pi) for edge in band]
    first, last = (round(edge * DURATION) for edge in in_hz)
    return [
        Design("none"),
        Design("PRBS, clock 4 s", "prbs", {"clock_s": 4.0}),
        Design("PRBS, clock 12 s", "prbs", {"clock_s": 12.0}),
        Design(
            "multisine, 20 lines a plane",
            "multisine",
            each=tuple({"lines": _spread(first + plane, last, 20)} for plane in (0, 1)),
        ),
        Design("chirp, linear, up and down", "chirp", each=({"band_Hz": in_hz}, {"band_Hz": in_hz[::-1]})),
        Design("chirp, log, up and down", "chirp", {"law": "log"}, ({"band_Hz": in_hz}, {"band_Hz": in_hz[::-1]})),
        Design("doublets of 24 s, by turns", "doublet", {"width_s": 12.0, "repeat_s": 120.0}, ({}, {"start_s": 60.0})),
        Design(
            "3-2-1-1 of 56 s, by turns",
            "doublet",
            {"width_s": 8.0, "widths": (3, 2, 1, 1), "repeat_s": 120.0},
            ({}, {"start_s": 60.0}),
        ),
        Design("bang-bang, 8 to 40 s", "bang_bang", {"hold_s": (8.0, 40.0)}),
        Design("bang-bang, 20 and 28 s", "bang_bang", each=({"hold_s": 20.0}, {"hold_s": 28.0})),
        Design("steps, 8 to 40 s", "steps", {"hold_s": (8.0, 40.0)}),
        Design("relay on pitch, +-1 deg", relay=radians(1.0)),
    ]


@cache
def environment() -> gymnasium.Env:
    """The depth task of npsauv as the first paper samples it."""
    effects = {"effects.sampling.inclinometer.quantisation": RESOLUTION, "effects.sampling.depth.noise": NOISE}
    return gymnasium.make("auv_gym/Depth-v0", vehicle="npsauv", dt=DT, duration=DURATION, effects=effects)


@cache
def vehicle() -> Plant:
    """The vehicle of the environment."""
    return environment().unwrapped.plant  # type: ignore[attr-defined]


@cache
def model_band() -> tuple[float, float]:
    """The angular frequencies, rad/s, of the vertical plane: from a third of its slowest pole to its fastest.

    The depth's integrator is left out, and so are poles beyond half the sampling frequency, such as the actuators'.
    """
    poles = np.abs(np.log(linearise(vehicle(), inputs=PLANES).poles().astype(complex))) / DT
    own = poles[(poles > 1e-3) & (poles < pi / DT)]
    return float(own.min()) / 3.0, float(own.max())


def attempt(design: str, seed: int, amplitude: float = 3.0) -> Told:
    """A run of a design; amplitude: deg, of each plane."""
    (chosen,) = (one for one in designs(model_band()) if one.name == design)
    pilot = autopilot(vehicle(), targets=("depth_m",))  # the tuned depth loop
    run = drive(
        environment(),
        excited(pilot, chosen, radians(amplitude), np.random.default_rng(seed)),
        seed=seed,
        targets={"depth_m": [(0.0, DEPTH)]},
        start={"depth_m": DEPTH, "heading_rad": 0.0},
    )
    if run.reason:
        raise ValueError(f"The run with {design} was cut: {run.reason}. Excite less.")
    true = run.record.with_channels({"depth_m": run.truth["depth_m"]})
    reports = [f"excitation_{name}" for name in PLANES]
    added = {n: true[r][:-1] for n, r in zip(PLANES, reports) if true.has(r) and true[r].any()}
    if chosen.relay is not None:
        added = {PLANES[0]: true[PLANES[0]][:-1] - true[PLANES[0]][:-1].mean()}
    spectra = {name: spectrum(values) for name, values in added.items()}
    smallest, condition = information(vehicle(), true)
    return Told(
        smallest,
        condition,
        max((crest_factor(values) for values in added.values()), default=float("nan")),
        share_in_band(spectra.values(), model_band()),
        float(np.abs(run.truth["depth_m"] - DEPTH).max()),
        float(np.abs(run.truth["pitch_rad"]).max()),
        added,
        spectra,
    )


def excited(pilot: Controller, design: Design, amplitude: float, rng: np.random.Generator) -> Controller:
    """The autopilot with a design's signals at both planes."""
    if design.relay is not None:
        # a positive stern plane pitches this vehicle's nose down
        return Relay(pilot, PLANES[0], "pitch_rad", -amplitude, design.relay)
    if not design.kind:
        return pilot
    shared = {"amplitude": amplitude, **design.settings}
    n = round(DURATION / DT)
    signals = {
        name: make_signal(design.kind, n, DT, rng, **{**shared, **own}) for name, own in zip(PLANES, design.each)
    }
    return Excited(pilot, signals, DT)


def information(plant: Plant, record: Record) -> tuple[float, float]:
    """Smallest eigenvalue and condition number of the normal matrix per sample, scaled as in the module's docstring."""
    limits = dict(zip(plant.inputs, command_limits(plant)))
    problem = regression(Series.of([record], PLANES, ("depth_m",), "Arx"), EQUATION)
    scale = np.array(
        [plant.hull.length if term.channel == "depth_m" else limits[term.channel] for term in problem.terms]
    )
    columns = (problem.matrix - problem.matrix.mean(axis=0)) / scale
    values = np.linalg.svd(columns, compute_uv=False)
    tiny = values[-1] <= 10.0 * np.finfo(float).eps * max(columns.shape) * values[0]  # zero to rounding
    if tiny:
        return 0.0, inf
    return float(values[-1] ** 2 / len(columns)), float((values[0] / values[-1]) ** 2)


def frequencies(n: int) -> np.ndarray:
    """Angular frequencies of `spectrum`, rad/s."""
    return 2.0 * pi * np.fft.rfftfreq(n, DT)[1:]


def spectrum(values: np.ndarray) -> np.ndarray:
    """Power of a signal about its mean at each frequency line except zero; the sum is the mean square."""
    power = 2.0 * np.abs(np.fft.rfft(values) / values.size) ** 2
    if values.size % 2 == 0:
        power[-1] *= 0.5
    return power[1:]


def share_in_band(spectra: Iterable[np.ndarray], band: tuple[float, float]) -> float:
    """The share of the power within the band, of all planes together; NaN without power."""
    inside = total = 0.0
    for power in spectra:
        # the lines are those of an even number of samples
        at = frequencies(2 * power.size)
        inside += float(power[(at >= band[0]) & (at <= band[1])].sum())
        total += float(power.sum())
    return inside / total if total > 0.0 else float("nan")


def sheets(found: Found) -> list[Sheet]:
    """A row for each design, medians over the seeds; in a file, every run in SI units."""
    medians = {name: {n: float(np.median([run[n] for run in found.of(name)])) for n in NUMBERS} for name in found.runs}
    reference = medians.get(REFERENCE, {}).get("smallest", float("nan"))
    rows, every = [], []
    for design, middle in medians.items():
        smallest = [run["smallest"] for run in found.of(design)]
        rows.append(
            [
                design,
                f"{middle['smallest']:.1e}" if middle["smallest"] > 0.0 else "0",
                f"{min(smallest):.1e} to {max(smallest):.1e}" if max(smallest) > 0.0 else "0",
                f"{middle['smallest'] / reference:.2f}",
                f"{middle['condition']:.1e}" if isfinite(middle["condition"]) else "none",
                f"{middle['crest']:.2f}" if isfinite(middle["crest"]) else "",
                f"{100.0 * middle['in_band']:.0f} %" if isfinite(middle["in_band"]) else "",
                f"{middle['depth']:.1f}",
                f"{degrees(middle['pitch']):.1f}",
            ]
        )
        for seed, run in found.runs[design].items():
            every.append([design, str(seed), *(f"{run[name]:.6g}" for name in NUMBERS)])
    low, high = model_band()
    title = (
        f"Excitation of npsauv's depth: {DURATION:g} s, {DT:g} s samples, +-{found.options['amplitude']:g} deg at both "
        f"planes, band {low:.3f} to {high:.2f} rad/s"
    )
    return [
        Sheet("designs", title, HEADS, rows),
        Sheet("runs", "Every run", ("design", "seed", *NUMBERS), every, printed=False),
    ]


REFERENCE = "PRBS, clock 4 s"
HEADS = (
    *("design", "smallest eigenvalue>", "range>", "over PRBS>", "condition>", "crest factor>", "power in band>"),
    *("depth, m>", "pitch, deg>"),
)


def _spread(first: int, last: int, count: int) -> list[int]:
    """`count` of every other line from the first on, spread as far up as possible."""
    there = np.arange(first, last + 1, 2)
    return [int(k) for k in there[np.unique(np.round(np.linspace(0, there.size - 1, count)).astype(int))]]


def excitation_figure(found: Found) -> Figure:
    """A row for each design: the signals of the first seed, and the spectra, means over the seeds."""
    from matplotlib.figure import Figure

    from identification.pages.drawing import AFTER, INPUT, QUIET

    colours = dict(zip(PLANES, (AFTER, INPUT)))
    results = {}
    for design in found.runs:
        first, *others = found.of(design)
        if first["signals"]:
            mean = {n: np.mean([run["spectra"][n] for run in (first, *others)], axis=0) for n in first["spectra"]}
            results[design] = ({name: np.array(values) for name, values in first["signals"].items()}, mean)
    figure = Figure(figsize=(11.0, 1.25 * len(results) + 0.7), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.02, hspace=0.0)  # type: ignore[union-attr]
    cells = figure.subplots(len(results), 3, sharex="col", sharey="col", gridspec_kw={"width_ratios": (1, 1, 1.1)})
    cells = np.atleast_2d(cells)
    largest = max(float(power.max()) for _, spectra in results.values() for power in spectra.values())
    peak = float(np.degrees(max(np.abs(v).max() for signals, _ in results.values() for v in signals.values())))
    for (design, (signals, spectra)), (stern, bow, power) in zip(results.items(), cells):
        for axes, name in zip((stern, bow), PLANES):
            if name in signals:
                values = np.degrees(signals[name])
                axes.step(DT * np.arange(values.size), values, where="post", color=colours[name], linewidth=1.0)
            else:
                axes.text(0.5, 0.5, "left to the controller", transform=axes.transAxes, ha="center", color=QUIET)
            axes.set_yticks([-peak, 0.0, peak], [f"{value:.3g}" for value in (-peak, 0.0, peak)])
            axes.set_ylim(-1.2 * peak, 1.2 * peak)
        power.axvspan(*model_band(), color=SHADE, zorder=0)
        for name, values in spectra.items():
            at = frequencies(2 * values.size)
            shown = np.where(values > 1e-9 * largest, np.degrees(1.0) ** 2 * values, np.nan)
            power.semilogx(at, shown, ".", markersize=3.0, color=colours[name])
        power.set_yscale("log")
        power.set_ylim(1e-5 * largest * np.degrees(1.0) ** 2, 2.0 * largest * np.degrees(1.0) ** 2)
        stern.set_ylabel(design.replace(", ", ",\n"), rotation=0, ha="right", va="center")
    for axes, title in zip(
        cells[0],
        (
            *(f"added at the {channel(name).label}, deg" for name in PLANES),
            "power, deg² (shaded: the model's band)",
        ),
    ):
        axes.set_title(title, loc="left")
    for axes, label in zip(cells[-1], ("time, s", "time, s", "angular frequency, rad/s")):
        axes.set_xlabel(label)
    return figure


def pictures(found: Found) -> dict[str, Callable[[], Figure]]:
    """The picture, if some design adds a signal."""
    added = any(run["signals"] for design in found.runs for run in found.of(design))
    return {"excitation.png": lambda: excitation_figure(found)} if added else {}


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(one.name for one in designs((0.01, 1.0))),
    sheets,
    seeds=5,
    one_of="design",
    options={"amplitude": Option(3.0, "of each plane, deg", least=1e-3)},
    pictures=pictures,
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
