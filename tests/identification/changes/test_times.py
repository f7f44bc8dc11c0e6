"""Tests of the likeliest row of a time."""

from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.changes import times
from identification.changes.times import Located, finer_rows, moved_to_best
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.heading_control import closed_loop
from identification.fit.changing import ChangingPlant, Course
from scripts.blind.changing import Changing


@pytest.mark.parametrize("pushed, reached", [(True, 43), (False, 40)])
def test_beside_random_accelerations_the_next_rows_are_tried_with_other_noises(monkeypatch, pushed, reached):
    """With the filter's gains held, the search stops at row 40 or two rows farther on; the likeliest row is 43."""
    worth, asked = {40: 0.0, 41: 5.0, 43: 9.0}, []
    bench = SimpleNamespace(
        problem=SimpleNamespace(pushing=lambda point: [0] if pushed else []),
        gain=lambda before, after: worth.get(after.point, -1.0) - worth.get(before.point, -1.0),
    )

    def moved(bench, state, form, number):
        row = 43 if state.point == 41 else state.point
        return bench, SimpleNamespace(point=row), Located(row, row - 1, row + 1)

    def refitted(bench, state, form, number, row):
        asked.append(row)
        return None if row == 44 else (bench, SimpleNamespace(point=row))  # the log ends there

    monkeypatch.setattr(times, "_moved", moved)
    monkeypatch.setattr(times, "_refitted_at", refitted)
    _, state, found = moved_to_best(bench, SimpleNamespace(point=40), "from3", 0)  # type: ignore[arg-type]
    assert (state.point, found.row) == (reached, reached)
    assert asked == ([39, 41, 42, 44] if pushed else [])


def test_a_jump_is_sought_between_the_screened_times():
    """A compass error of 0.2 rad from 300 s on: a fit with it from 288 s on, as screened, gains nothing."""
    plant, bias = load_vehicle("slocum"), "effects.compass.bias"
    moving = Changing.glider(plant, lambda t: replace_at(plant, bias, 0.2) if t >= 300.0 else plant)
    record = closed_loop(moving, rng=np.random.default_rng(5), duration=600.0)
    edge = int(np.searchsorted(record.time, 288.0))
    names = {"from1": [bias], "until1": [bias], "growing": [bias]}
    courses = {"from1": Course((edge,), (0.0, 1.0)), "until1": Course((edge,), (1.0, 0.0))}
    courses["growing"] = Course((edge, edge + 9), (0.2, 0.5, 0.8))
    changing = ChangingPlant.of(plant, names, courses)
    bench = Workbench(changing, record, parts_of(plant, record), 0.1)
    state = bench.fit(bench.plant, ())
    loud = [Candidate(form, (f"changes.{form}.{bias}",)) for form in names]
    found = finer_rows(bench, state, (), loud, 10.0)
    assert found.keys() == {"from1", "until1"}  # `growing` has no time of its own
    evidence, row = found["from1"]
    assert record.time[row] == 300.0
    assert evidence > 5.0 * screen(bench.problem, state.point, (), loud[:1], 10.0)[0].evidence
    there = bench.fit(replace_at(bench.plant, loud[0].paths[0], 0.2), loud[0].paths)
    assert "from1" not in finer_rows(bench, there, there.paths, loud, 10.0)  # it is fitted already
