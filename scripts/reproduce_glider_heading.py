"""The heading model of the GaneshBlue glider: its coefficients and its pool runs, analytic against corrected.

Source: Putri, Latifa, Trilaksono and Hidayat, "Modelling and Identification of Underwater Glider for Heading Angle
Correction": equations (14) and (15), tables I and II, figures 4, 10 and 11.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from math import degrees, radians
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from auv_gym.model import simulate
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import yaw_rates
from auv_gym.writing import replacing

ANALYTIC, CORRECTED = "ganeshblue", "ganeshblue_corrected"
RUDDERS_DEG = (15.0, 30.0, -15.0, -30.0)
PRINTED = {"damping": -2.732, "rudder": -0.381, "ratio": 6.7}  # ratio: of the steady turns, from equation (15)


class Reproduction(NamedTuple):
    """Coefficients of (14), steady turn per rudder of both models, their ratio, and the runs by vehicle and rudder."""

    damping: float
    rudder: float
    turn_analytic: float
    turn_corrected: float
    runs: Mapping[tuple[str, float], Record]

    @property
    def ratio(self) -> float:
        return self.turn_analytic / self.turn_corrected


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Reproduce the GaneshBlue heading model and its pool runs.")
    parser.add_argument("--out", type=Path, help="folder for the figures (PNG); default: no figures")
    parser.add_argument("--duration", type=float, default=25.0, help="length of a run, s (default %(default)s)")
    given = parser.parse_args(arguments)
    try:
        found = reproduce(given.duration)
        written = draw(found, given.out) if given.out is not None else []
    except (ValueError, OSError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    console = Console(highlight=False)
    console.print(_coefficients(found), _pool_runs(found))
    for path in written:
        console.print(f"Written to {path}", markup=False, soft_wrap=True)
    return 0


def reproduce(duration: float = 25.0) -> Reproduction:
    """The published numbers as the plants give them; duration: s, of each run at constant rudder."""
    analytic, corrected = (load_vehicle(name, dt=0.1) for name in (ANALYTIC, CORRECTED))
    damping, rudder = yaw_rates(analytic.family.view(analytic.vector).hull)
    runs = {
        (plant.name, angle): pool_run(plant, radians(angle), duration)
        for plant in (analytic, corrected)
        for angle in RUDDERS_DEG
    }
    return Reproduction(damping, rudder, steady_turn(analytic), steady_turn(corrected), runs)


def pool_run(plant: Plant, rudder: float, duration: float) -> Record:
    """A run at constant rudder, rad, from straight ahead at heading zero."""
    time = np.arange(0.0, duration + 0.5 * plant.dt, plant.dt)
    at_rest = dict.fromkeys(plant.outputs, np.zeros(time.size))
    return simulate(plant, Record.from_arrays(time, {**at_rest, "rudder_rad": np.full(time.size, rudder)}))


def steady_turn(plant: Plant, rudder: float = radians(15.0)) -> float:
    """Yaw rate per rudder angle at the end of a long run, 1/s."""
    heading = pool_run(plant, rudder, 200.0)["heading_rad"]
    return float((heading[-1] - heading[-2]) / plant.dt / rudder)


def draw(found: Reproduction, folder: Path) -> list[Path]:
    """Heading over time, analytic and corrected, one figure for each side of the rudder; the files written."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for side, sign in (("positive", 1.0), ("negative", -1.0)):
        figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.8), sharex=True, layout="constrained")
        for ax, size in zip(axes, (15.0, 30.0)):
            for vehicle, style, label in ((ANALYTIC, "--", "analytic (14)"), (CORRECTED, "-", "corrected (15)")):
                run = found.runs[vehicle, sign * size]
                ax.plot(run.time, np.degrees(run["heading_rad"]), style, linewidth=1.8, label=label)
            ax.set_title(f"rudder {sign * size:+.0f} deg", fontsize=11)
            ax.set_xlabel("time, s")
            ax.grid(alpha=0.3)
        axes[0].set_ylabel("heading, deg")
        axes[0].legend(frameon=False)
        path = folder / f"glider_heading_{side}_rudder.png"
        with replacing(path) as new:
            figure.savefig(new, format="png", dpi=150)
        plt.close(figure)
        written.append(path)
    return written


def _coefficients(found: Reproduction) -> Table:
    table = Table(title="GaneshBlue, equation (14): r' = a r + b rudder", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("quantity")
    for head in ("computed", "paper"):
        table.add_column(head, justify="right")
    table.add_row("a, 1/s", f"{found.damping:.3f}", f"{PRINTED['damping']:.3f}")
    table.add_row("b, 1/s^2", f"{found.rudder:.3f}", f"{PRINTED['rudder']:.3f}")
    table.add_row("steady yaw rate per rudder, analytic, 1/s", f"{found.turn_analytic:.4f}", "")
    table.add_row("steady yaw rate per rudder, corrected, 1/s", f"{found.turn_corrected:.4f}", "")
    table.add_row("analytic over corrected", f"{found.ratio:.2f}", f"{PRINTED['ratio']:.1f}")
    return table


def _pool_runs(found: Reproduction) -> Table:
    duration = next(iter(found.runs.values())).duration_s
    table = Table(title=f"Heading after {duration:g} s at constant rudder", title_justify="left", box=SIMPLE_HEAD)
    for head in ("rudder, deg", "analytic, deg", "corrected, deg"):
        table.add_column(head, justify="right")
    for angle in RUDDERS_DEG:
        ends = (degrees(found.runs[name, angle]["heading_rad"][-1]) for name in (ANALYTIC, CORRECTED))
        table.add_row(f"{angle:+.0f}", *(f"{end:.1f}" for end in ends))
    return table


if __name__ == "__main__":
    sys.exit(main())
