"""The tables of tuned gains: words with units, and no wider than a terminal of 80 columns."""

import pytest
from rich.console import Console

from auv_gym.cli.identify import printed
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from controllers.gains import Gains
from controllers.tuning.requirements import QUANTITIES, parse_requirements
from controllers.tuning.response import Response
from controllers.tuning.spread import known_intervals
from controllers.tuning.tuning import Judged, Trying
from identification.pages.tuning_page import quantity_tables, requirement_table, tuning_summary

LOOPS = ("north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad", "u_mps")
WIDE = 0.331  # as a delay margin is printed in its three digits


@pytest.fixture
def found():
    """A result with as many loops as there are, and a corner case that is worse than the vehicle."""
    plant = load_vehicle("slocum")
    asked = parse_requirements(["sensitivity_peak<=1.25", "phase_margin_deg>=45"], LOOPS)
    tried = [
        Trying(Response(None, None, True), None, dict.fromkeys(QUANTITIES, WIDE * size)) for size in (1.0, *[20.0] * 18)
    ]
    return Judged(
        plant=plant,
        law="pid",
        gains=Gains("slocum", 4.0),
        requirements=asked,
        intervals=known_intervals(plant),
        plants=(plant, *[replace_at(plant, "hull.n_delta", 0.0006)] * 18),
        names=("the vehicle itself", *(f"corner {k + 1}" for k in range(18))),
        loops=dict.fromkeys(LOOPS, tuple(tried)),
        corners=18,
        refused=(),
        seed=0,
    )


def test_tables_fit_80_columns_and_are_in_words(found):
    for shown in (requirement_table(found), *quantity_tables(found)):
        cells = [*shown.heads, *(cell for row in shown.rows for cell in row)]
        assert not [cell for cell in cells if "_" in cell]
        narrow, wide = Console(width=80), Console(width=300)
        texts = []
        for console in (narrow, wide):
            with console.capture() as capture:
                console.print(printed("Quantities", shown))
            texts.append([line.rstrip() for line in capture.get().splitlines()])
        assert texts[0] == texts[1]  # nothing is cut or wrapped


def test_units_stand_beside_their_words(found):
    first = [row[0] for row in quantity_tables(found)[0].rows]
    assert first[:4] == ["gain margin, dB", "phase margin, deg", "delay margin, s", "sensitivity peak"]


def test_the_summary_says_what_failed_on_which_vehicle_and_what_to_do(found):
    lines = tuning_summary(found)
    assert "sensitivity peak ≤ 1.25 in the heading loop (met on 1 of 19 vehicles)" in lines[0]
    assert (
        lines[1]
        == "The gains were tested on the vehicle itself and 18 vehicles drawn from the 95 % intervals of 2 parameters."
    )
    worst = "The worst vehicle is corner 1 (parameters at the ends of their intervals), with a sensitivity peak of 6.62"
    assert f"{worst} in the north loop." in lines[2]
    assert "rudder effectiveness N_dr 0.000600 (given: 0.000220)" in lines[2]
    assert "more evaluations" in lines[3]
    assert "The widest one is that of rudder effectiveness N_dr (hull.n_delta), 0.0000791 to 0.000612" in lines[3]
