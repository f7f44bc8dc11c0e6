"""The heading model of the GaneshBlue glider: its coefficients and its pool runs, analytic against corrected.

    python -m scripts.reproduce.glider_heading --out glider_heading

Source: Putri, Latifa, Trilaksono and Hidayat, "Modelling and Identification of Underwater Glider for Heading Angle
Correction": equations (14) and (15), tables I and II, figures 4, 10 and 11.
"""

from __future__ import annotations

import sys
from functools import partial
from math import degrees, radians
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.model import simulate
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import linear_yaw_coefficients
from scripts.studies.harness import Found, Option, Sheet, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ANALYTIC, CORRECTED = "ganeshblue", "ganeshblue_corrected"
CASE = "pool runs"
RUDDERS_DEG = (15.0, 30.0, -15.0, -30.0)
PRINTED = {"damping": -2.732, "rudder": -0.381, "ratio": 6.7}  # ratio: of the steady turns, from equation (15)


def attempt(case: str, seed: int, duration: float = 25.0) -> dict[str, Any]:
    """The published numbers as the plants give them; duration: s, of each run at constant rudder.

    Coefficients of (14), steady turn per rudder of both models, and the last headings by vehicle and rudder.
    """
    analytic, corrected = vehicles()
    damping, rudder = linear_yaw_coefficients(analytic.family.view(analytic.vector).hull)
    ends = {
        plant.name: [pool_run(plant, radians(angle), duration)["heading_rad"][-1] for angle in RUDDERS_DEG]
        for plant in (analytic, corrected)
    }
    turns = {"turn_analytic": steady_turn(analytic), "turn_corrected": steady_turn(corrected)}
    return {"damping": damping, "rudder": rudder, **turns, "ends": ends}


def vehicles() -> tuple[Plant, Plant]:
    """The analytic and the corrected one."""
    return load_vehicle(ANALYTIC, dt=0.1), load_vehicle(CORRECTED, dt=0.1)


def pool_run(plant: Plant, rudder: float, duration: float) -> Record:
    """A run at constant rudder, rad, from straight ahead at heading zero."""
    time = np.arange(0.0, duration + 0.5 * plant.dt, plant.dt)
    at_rest = dict.fromkeys(plant.outputs, np.zeros(time.size))
    return simulate(plant, Record.from_arrays(time, {**at_rest, "rudder_rad": np.full(time.size, rudder)}))


def steady_turn(plant: Plant, rudder: float = radians(15.0)) -> float:
    """Yaw rate per rudder angle at the end of a long run, 1/s."""
    heading = pool_run(plant, rudder, 200.0)["heading_rad"]
    return float((heading[-1] - heading[-2]) / plant.dt / rudder)


def sheets(found: Found) -> list[Sheet]:
    """Coefficients beside the paper's, and where the pool runs end."""
    (one,) = found.of(CASE)
    quantities = [
        ["a, 1/s", f"{one['damping']:.3f}", f"{PRINTED['damping']:.3f}"],
        ["b, 1/s^2", f"{one['rudder']:.3f}", f"{PRINTED['rudder']:.3f}"],
        ["steady yaw rate per rudder, analytic, 1/s", f"{one['turn_analytic']:.4f}", ""],
        ["steady yaw rate per rudder, corrected, 1/s", f"{one['turn_corrected']:.4f}", ""],
        ["analytic over corrected", f"{one['turn_analytic'] / one['turn_corrected']:.2f}", f"{PRINTED['ratio']:.1f}"],
    ]
    runs = [
        [f"{angle:+.0f}", *(f"{degrees(one['ends'][name][number]):.1f}" for name in (ANALYTIC, CORRECTED))]
        for number, angle in enumerate(RUDDERS_DEG)
    ]
    title = f"Heading after {found.options['duration']:g} s at constant rudder"
    heads = ("rudder, deg>", "analytic, deg>", "corrected, deg>")
    equation = "GaneshBlue, equation (14): r' = a r + b rudder"
    return [
        Sheet("coefficients", equation, ("quantity", "computed>", "paper>"), quantities),
        Sheet("pool_runs", title, heads, runs),
    ]


def figure(sign: float, duration: float) -> Figure:
    """Heading over time, analytic and corrected, to one side of the rudder."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True)
    for ax, size in zip(axes, (15.0, 30.0)):
        for plant, style, label in zip(vehicles(), ("--", "-"), ("analytic (14)", "corrected (15)")):
            run = pool_run(plant, radians(sign * size), duration)
            ax.plot(run.time, np.degrees(run["heading_rad"]), style, linewidth=1.8, label=label)
        ax.set_title(f"rudder {sign * size:+.0f} deg", fontsize=11)
        ax.set_xlabel("time, s")
    axes[0].set_ylabel("heading, deg")
    axes[0].legend(frameon=False)
    return figure


STUDY = Study(
    __doc__ or "",
    attempt,
    (CASE,),
    sheets,
    seeds=None,
    one_of="",
    options={"duration": Option(25.0, "length of a run, s", least=1.0)},
    pictures=lambda found: {
        f"glider_heading_{side}_rudder.png": partial(figure, sign, found.options["duration"])
        for side, sign in (("positive", 1.0), ("negative", -1.0))
    },
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
