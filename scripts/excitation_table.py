"""What excitation tells about the depth model of npsauv: every design at the same amplitude and length, in one table.

    python -m scripts.excitation_table --out figures

The vertical plane in closed loop, as in the first paper: `auv_gym/Depth-v0` sampled every 4 s for 600 s, pitch read to
0.1 deg, the tuned PID autopilot at work, and a signal added at the stern plane and another at the bow plane. What is
counted is the normal matrix of the regressors of the ARX depth model with na 3, nb 2 and nk 1: three past depths in
hull lengths, two past commands of each plane in fin stops, all about their means, per sample. Its smallest eigenvalue
is what the run tells about the combination of coefficients of which it tells least; the error of that combination is
the standard deviation of the equation error over the square root of samples times eigenvalue. Depths are the true ones:
noise in past depths would count as excitation.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees, inf, pi, radians
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from auv_gym.cli.options.console import steps_bar
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

DT, DURATION, DEPTH = 4.0, 600.0, 60.0  # s, s, m
RESOLUTION, NOISE = radians(0.1), 0.03  # rad of pitch, as in the paper; m of depth, a usual pressure sensor
PLANES = ("stern_plane_rad", "bow_plane_rad")
EQUATION = Structure.of("Arx", PLANES, ("depth_m",), n_a=3, n_b=2).rows[0]


@dataclass(frozen=True)
class Design:
    """A way to excite: a kind, settings of both planes and of each; or a band of pitch, rad, in which to relay."""

    name: str
    kind: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    each: tuple[Mapping[str, Any], ...] = ({}, {})
    relay: float | None = None


class Told(NamedTuple):
    """What a run tells: smallest eigenvalue, condition of the normal matrix; the excitation's crest factor and share
    of power within the model's band (NaN: none); largest depth error, m, and pitch, rad.
    """

    smallest: float
    condition: float
    crest: float
    in_band: float
    depth: float
    pitch: float


class Result(NamedTuple):
    """A design, what its runs tell, one a seed, and the first one's excitation by plane."""

    design: Design
    told: Sequence[Told]
    signals: Mapping[str, np.ndarray]
    spectra: Mapping[str, np.ndarray]


def designs(band: tuple[float, float]) -> list[Design]:
    """All that are compared; chirps and multisines keep to the band, rad/s, and planes have signals of their own."""
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


def main(argv: Sequence[str] | None = None) -> int:
    """Fly all designs, print the table, draw the signals into a folder."""
    parser = argparse.ArgumentParser(description="The information in every excitation design, for npsauv's depth.")
    parser.add_argument("--amplitude", type=float, default=3.0, help="of each plane, deg (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="runs of each design (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="folder for the picture (PNG); default: no picture")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON, in SI units")
    given = parser.parse_args(argv)
    written = None
    try:
        if not 0.0 < given.amplitude < inf or given.seeds < 1:
            raise ValueError(
                f"--amplitude needs more than 0 deg and --seeds 1 or more, got {given.amplitude:g} and {given.seeds}."
            )
        env = environment()
        band = model_band(env.unwrapped.plant)  # type: ignore[attr-defined]
        compared = designs(band)
        with steps_bar(len(compared) * given.seeds) as advance:
            pilot = depth_pilot(env)
            results = [fly(env, pilot, d, radians(given.amplitude), given.seeds, band, advance) for d in compared]
        if given.out is not None:
            from scripts.excitation_pictures import draw

            written = draw(results, band, given.out)
    except (ValueError, OSError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps(as_json(results, band), indent=2))
    else:
        Console(highlight=False, width=max(Console().width, 150)).print(_table(results, band, given.amplitude))
    if written is not None:
        print(f"Written to {written}", file=sys.stderr)
    return 0


def environment() -> gymnasium.Env:
    """The depth task of npsauv as the first paper samples it."""
    effects = {"effects.sampling.inclinometer.quantisation": RESOLUTION, "effects.sampling.depth.noise": NOISE}
    return gymnasium.make("auv_gym/Depth-v0", vehicle="npsauv", dt=DT, duration=DURATION, effects=effects)


def depth_pilot(env: gymnasium.Env) -> Controller:
    """The tuned depth loop of the environment's vehicle."""
    return autopilot(env.unwrapped.plant, targets=("depth_m",))  # type: ignore[attr-defined]


def model_band(plant: Plant) -> tuple[float, float]:
    """The angular frequencies, rad/s, of the vertical plane: from a third of its slowest pole to its fastest.

    Left out are the depth's integrator and what is beyond half the sampling frequency, as the actuators are.
    """
    poles = np.abs(np.log(linearise(plant, inputs=PLANES).poles().astype(complex))) / plant.dt
    own = poles[(poles > 1e-3) & (poles < pi / plant.dt)]
    return float(own.min()) / 3.0, float(own.max())


def fly(
    env: gymnasium.Env,
    pilot: Controller,
    design: Design,
    amplitude: float,
    seeds: int,
    band: tuple[float, float],
    advance: Callable[[str], None] = lambda text: None,
) -> Result:
    """A design flown with as many seeds; amplitude: rad, of each plane."""
    plant = env.unwrapped.plant  # type: ignore[attr-defined]
    told, signals, power = [], [], []
    for seed in range(seeds):
        advance(design.name)
        controller = excited(pilot, design, amplitude, np.random.default_rng(seed))
        run = drive(
            env,
            controller,
            seed=seed,
            targets={"depth_m": [(0.0, DEPTH)]},
            start={"depth_m": DEPTH, "heading_rad": 0.0},
        )
        if run.reason:
            raise ValueError(f"The run with {design.name}, seed {seed}, was cut: {run.reason}. Excite less.")
        true = run.record.with_channels({"depth_m": run.truth["depth_m"]})
        reports = [f"excitation_{name}" for name in PLANES]
        added = {n: true[r][:-1] for n, r in zip(PLANES, reports) if true.has(r) and true[r].any()}
        if design.relay is not None:
            added = {PLANES[0]: true[PLANES[0]][:-1] - true[PLANES[0]][:-1].mean()}
        spectra = {name: spectrum(values) for name, values in added.items()}
        smallest, condition = information(plant, true)
        told.append(
            Told(
                smallest,
                condition,
                max((crest_factor(values) for values in added.values()), default=float("nan")),
                share_in_band(spectra.values(), band),
                float(np.abs(run.truth["depth_m"] - DEPTH).max()),
                float(np.abs(run.truth["pitch_rad"]).max()),
            )
        )
        signals.append(added)
        power.append(spectra)
    mean = {name: np.mean([spectra[name] for spectra in power], axis=0) for name in power[0]}
    return Result(design, told, signals[0], mean)


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
    """Smallest eigenvalue and condition number of the normal matrix per sample, as the module's docstring scales it."""
    limits = dict(zip(plant.inputs, command_limits(plant)))
    problem = regression(Series.of([record], PLANES, ("depth_m",), "Arx"), EQUATION)
    scale = np.array(
        [plant.hull.length if term.channel == "depth_m" else limits[term.channel] for term in problem.terms]
    )
    columns = (problem.matrix - problem.matrix.mean(axis=0)) / scale
    values = np.linalg.svd(columns, compute_uv=False)
    tiny = values[-1] <= 10.0 * np.finfo(float).eps * max(columns.shape) * values[0]  # zero but for rounding
    if tiny:
        return 0.0, inf
    return float(values[-1] ** 2 / len(columns)), float((values[0] / values[-1]) ** 2)


def frequencies(n: int) -> np.ndarray:
    """Angular frequencies of `spectrum`, rad/s."""
    return 2.0 * pi * np.fft.rfftfreq(n, DT)[1:]


def spectrum(values: np.ndarray) -> np.ndarray:
    """Power of a signal about its mean at each line but zero; the sum is the mean square."""
    power = 2.0 * np.abs(np.fft.rfft(values) / values.size) ** 2
    if values.size % 2 == 0:
        power[-1] *= 0.5
    return power[1:]


def share_in_band(spectra: Iterable[np.ndarray], band: tuple[float, float]) -> float:
    """The part of the power that lies within the band, of all planes together; NaN without power."""
    inside = total = 0.0
    for power in spectra:
        # lines come from an even number of samples
        at = frequencies(2 * power.size)
        inside += float(power[(at >= band[0]) & (at <= band[1])].sum())
        total += float(power.sum())
    return inside / total if total > 0.0 else float("nan")


def as_json(results: Sequence[Result], band: tuple[float, float]) -> dict[str, Any]:
    """Median and range over the seeds by design, in SI units."""
    return {
        "band_radps": list(band),
        "designs": {
            r.design.name: {
                name: None if not np.isfinite(values).any() else _summary(values)
                for name, values in ((n, np.array([getattr(t, n) for t in r.told])) for n in Told._fields)
            }
            for r in results
        },
    }


def rows(results: Sequence[Result]) -> list[list[str]]:
    """The table's cells: a design, then median (and range of the first) over the seeds."""
    reference = float(np.median([t.smallest for t in results[1].told]))
    table = []
    for r in results:
        smallest = np.array([t.smallest for t in r.told])
        middle = {name: float(np.median([getattr(t, name) for t in r.told])) for name in Told._fields}
        table.append(
            [
                r.design.name,
                f"{middle['smallest']:.1e}" if middle["smallest"] > 0.0 else "0",
                f"{smallest.min():.1e} to {smallest.max():.1e}" if smallest.max() > 0.0 else "0",
                f"{middle['smallest'] / reference:.2f}",
                f"{middle['condition']:.1e}" if np.isfinite(middle["condition"]) else "none",
                f"{middle['crest']:.2f}" if np.isfinite(middle["crest"]) else "",
                f"{100.0 * middle['in_band']:.0f} %" if np.isfinite(middle["in_band"]) else "",
                f"{middle['depth']:.1f}",
                f"{degrees(middle['pitch']):.1f}",
            ]
        )
    return table


HEADS = (
    "design", "smallest eigenvalue", "range", "over PRBS", "condition", "crest factor", "power in band", "depth, m",
    "pitch, deg",
)  # fmt: skip


def _spread(first: int, last: int, count: int) -> list[int]:
    """So many of every other line from the first on, as far up as they go."""
    there = np.arange(first, last + 1, 2)
    return [int(k) for k in there[np.unique(np.round(np.linspace(0, there.size - 1, count)).astype(int))]]


def _summary(values: np.ndarray) -> dict[str, float | None]:
    found = {"median": float(np.median(values)), "low": float(values.min()), "high": float(values.max())}
    return {name: value if np.isfinite(value) else None for name, value in found.items()}


def _table(results: Sequence[Result], band: tuple[float, float], amplitude: float) -> Table:
    seeds = len(results[0].told)
    table = Table(
        title=f"Excitation of npsauv's depth: {DURATION:g} s, {DT:g} s samples, +-{amplitude:g} deg at both planes, "
        f"{seeds} seeds, band {band[0]:.3f} to {band[1]:.2f} rad/s",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for head in HEADS:
        table.add_column(head, justify="left" if head == "design" else "right")
    for row in rows(results):
        table.add_row(*row)
    return table


if __name__ == "__main__":
    sys.exit(main())
