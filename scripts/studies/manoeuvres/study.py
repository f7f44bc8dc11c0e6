"""Turning circles, zigzags and depth changes of the vehicles in six degrees of freedom, measured and drawn.

    python -m scripts.studies.manoeuvres --out manoeuvres
    python -m scripts.studies.manoeuvres --vehicle my_auv.toml --speed 1.2

The terms are those of IMO resolution MSC.137(76), annex, section 4.2, and of ITTC 7.5-04-02-01 (2017), section 2.2; the
midship point is the origin of the body axes. Each vehicle starts in steady level flight. The regulators of the
environments keep the depth with the stern plane in turning circles and zigzags, and the heading with the rudder in
depth changes. Bow planes stay at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import degrees, radians
from typing import TYPE_CHECKING, Any

import numpy as np

from scripts.studies.harness import Found, Option, Sheet, Study
from scripts.studies.manoeuvres.pictures import overview
from scripts.studies.manoeuvres.trials import (
    DEPTH_STEP,
    approach,
    manoeuvres,
    presets,
    turning_circle,
    turning_circle_quantities,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Measured = Mapping[str, Any]


def attempt(vehicle: str, seed: int, speed: float | None = None) -> dict[str, Any]:
    """The quantities of a vehicle in SI units, by manoeuvre."""
    found = manoeuvres(vehicle, speed)
    trial = found.trial
    return {
        "name": trial.plant.name,
        "length_m": trial.length,
        "speed_mps": trial.cruise.speed,
        "rudder_rad": trial.plant.parts.rudder.limit,
        "turning_circle": {side: turn._asdict() for side, turn in found.turns.items()},
        "zigzag": {str(angle): zigzag._asdict() for angle, zigzag in found.zigzags.items()},
        "depth_change": found.depth_change._asdict(),
    }


def _turns(name: str, shown: Callable[[float], float] = float) -> Callable[[Measured], list[float]]:
    return lambda r: [shown(turn[name]) for turn in r["turning_circle"].values()]


def _lengths(name: str) -> Callable[[Measured], list[float]]:
    return lambda r: [turn[name] / r["length_m"] for turn in r["turning_circle"].values()]


def _zigzag(angle: int, name: str, shown: Callable[[float], float] = float) -> Callable[[Measured], list[float]]:
    return lambda r: [shown(r["zigzag"][str(angle)][name])]


def _dive(name: str, shown: Callable[[float], float] = float) -> Callable[[Measured], list[float]]:
    return lambda r: [shown(r["depth_change"][name])]


def quantities() -> list[tuple[str, str, int, Callable[[Measured], list[float]]]]:
    """Rows: a quantity's name, its limit for ships, digits, and values.

    Limits are for ships over 100 m in MSC.137(76), section 5.3 (at L/V below 10 s); two values are those of the turns
    to starboard and to port.
    """
    table: list[tuple[str, str, int, Callable[[Measured], list[float]]]] = [
        ("approach speed, m/s", "", 2, lambda r: [r["speed_mps"]]),
        ("**turning circle**, rudder, deg", "", 0, lambda r: [degrees(r["rudder_rad"])]),
        ("advance, lengths", "4.5", 2, _lengths("advance")),
        ("transfer, lengths", "", 2, _lengths("transfer")),
        ("tactical diameter, lengths", "5", 2, _lengths("tactical_diameter")),
        ("steady radius, lengths", "", 2, _lengths("radius")),
        ("steady over approach speed", "", 2, _turns("speed_kept")),
        ("yaw rate, deg/s", "", 1, _turns("yaw_rate", lambda rate: abs(degrees(rate)))),
        ("drift angle, deg", "", 1, _turns("drift", degrees)),
        ("roll, deg", "", 1, _turns("roll", degrees)),
        ("largest depth error, m", "", 2, _turns("depth_error")),
    ]
    for angle, (way, first, second) in {10: ("2.5", "10", "25"), 20: ("", "25", "")}.items():
        name = f"**zigzag {angle}/{angle}**, {angle} deg after, s"
        table += [
            (name, "", 1, _zigzag(angle, "initial_time")),
            (f"{angle} deg after, lengths", way, 2, lambda r, a=angle: [_way_in_lengths(r, a)]),
            ("first overshoot, deg", first, 1, _zigzag(angle, "first_overshoot", degrees)),
            ("second overshoot, deg", second, 1, _zigzag(angle, "second_overshoot", degrees)),
            ("period, s", "", 1, _zigzag(angle, "period")),
        ]
    return [
        *table,
        (f"**{DEPTH_STEP:g} m deeper**, 10 to 90 %, s", "", 1, _dive("rise_time")),
        ("within 5 % after, s", "", 1, _dive("settling_time")),
        ("overshoot, %", "", 1, _dive("overshoot", lambda share: 100.0 * share)),
        ("largest pitch, deg", "", 1, _dive("largest_pitch", degrees)),
        ("error at the end, m", "", 2, _dive("steady_error")),
    ]


def _way_in_lengths(found: Measured, angle: int) -> float:
    return found["zigzag"][str(angle)]["initial_way"] / found["length_m"]


def sheets(found: Found) -> list[Sheet]:
    """The quantities, a column for each vehicle and the limit for ships; and published values, at design speed."""

    def text(values: list[float], digits: int) -> str:
        return " / ".join(dict.fromkeys(f"{round(value, digits) + 0.0:.{digits}f}" for value in values))

    results = [found.of(vehicle)[0] for vehicle in found.runs]
    rows = [
        [name, *(text(values(result), digits) for result in results), limit]
        for name, limit, digits, values in quantities()
    ]
    heads = ("quantity", *(f"{result['name']}>" for result in results), "ships (IMO)>")
    shown = [Sheet("quantities", "Manoeuvres (turns: to starboard / to port)", heads, rows)]
    if found.options["speed"] is None:
        heads = ("vehicle", "quantity", "here", "there", "source")
        shown.append(Sheet("published", "Beside what is published", heads, _published(results)))
    return shown


def _published(results: list[Measured]) -> list[list[str]]:
    """Rows of vehicle, quantity, value here, published value and its source, for the vehicles with known values."""
    known, table = {result["name"]: result for result in results}, []
    if "vt690" in known:
        turns = known["vt690"]["turning_circle"].values()
        rate, kept = (np.mean([abs(turn[name]) for turn in turns]) for name in ("yaw_rate", "speed_kept"))
        log = "a log of the vehicle; speed is over ground, in a current of 0.2 m/s"
        table += [
            ["vt690", "yaw rate with 20 deg of rudder, deg/s", f"{degrees(rate):.1f}", "9.4", log],
            ["vt690", "speed in that turn over speed before", f"{kept:.2f}", "0.90 (1.36 over 1.51 m/s)", log],
        ]
    if "heu_torpedo" in known:
        width = 2.0 * turning_circle_quantities(turning_circle(approach("heu_torpedo"), radians(5.0))).radius
        source = "Xu et al. 2013, ticks of the axes of figures 9 and 10; there it dives meanwhile"
        what = "width of the circle with 5 deg of rudder, m"
        table.append(["heu_torpedo", what, f"{width:.0f}", "more than 60, up to 70", source])
    # from a reprint without its references: the trials of SPC-III beside a propeller-driven vehicle of its size
    radii = [turn["radius"] / r["length_m"] for r in results for turn in r["turning_circle"].values()]
    source = "another propeller-driven vehicle, 45 deg of rudder at 1.1 m/s, in trials of the SPC-III robotic fish"
    what = "steady radius with full rudder, lengths"
    return [*table, ["all", what, f"{min(radii):.1f} to {max(radii):.1f}", "2.5", source]]


def pictures(found: Found) -> dict[str, Callable[[], Figure]]:
    """All vehicles in one."""
    results = [manoeuvres(vehicle, found.options["speed"]) for vehicle in found.runs]
    return {"manoeuvres.png": partial(overview, results)}


STUDY = Study(
    __doc__ or "",
    attempt,
    presets(),
    sheets,
    seeds=None,
    one_of="vehicle",
    any_case=True,
    options={"speed": Option(None, "approach speed, m/s; without it that of the vehicle's design command")},
    pictures=pictures,
    doing="vehicles",
)
