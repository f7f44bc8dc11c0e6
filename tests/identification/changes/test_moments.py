"""Tests of when a parameter changed between missions: between two logs, within one, or where the two sides meet."""

import json
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import concat
from identification.changes import missions
from identification.changes.forms import Sized
from identification.changes.joined import joined_sides
from identification.changes.missions import Changed, Common, Comparison, compare_missions, sides_of, timed
from identification.changes.moments import Moment, OfLog, Within
from identification.changes.page import write_comparison
from identification.changes.wording import as_json, summary
from identification.diagnosis.log.checking import Asked
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.heading_control import closed_loop
from identification.fit.changing import ChangingPlant, Course, change
from scripts.blind.changing import Changing

OFFSET, SIZE = "effects.rudder.offset", 0.03
NAMES = (("b1", "b2"), ("a1", "a2"))
WORN = Changed(
    OFFSET, "rudder offset", "rad", Sized(0.0, (-0.001, 0.001)), Sized(0.03, (0.029, 0.031)),
    Sized(0.03, (0.028, 0.032)), 200.0,
)  # fmt: skip


def log(seed, name, *sizes, at=0.0):
    """A log of 500 s with an offset; with two sizes, the second from a time on."""
    plants = [replace_at(load_vehicle("slocum"), OFFSET, size) for size in sizes]
    moving = Changing.glider(plants[0], lambda t: plants[-1] if t >= at else plants[0])
    record = closed_loop(moving, rng=np.random.default_rng(seed), duration=500.0)
    return record.with_labels([name] * len(record.segments))


def logs_of(begins, at=0.0, seed=1):
    """Two logs before and two after, in which an offset begins with the log of this name, or within it."""
    names = [name for side in NAMES for name in side]
    logs = []
    for k, name in enumerate(names):
        sizes = (0.0,) if k < names.index(begins) else (0.0, SIZE) if name == begins and at else (SIZE,)
        logs.append(log(seed + k, name, *sizes, at=at))
    return concat(logs[:2]), concat(logs[2:])


@pytest.mark.parametrize(
    "begins, at, between",
    [("a1", 0.0, None), ("a2", 0.0, ("a1", "a2")), ("b2", 0.0, ("b1", "b2")), ("a1", 240.0, ("a1", "a1"))],
)
def test_a_step_is_found_where_it_was_and_the_sides_are_kept_where_they_are_right(monkeypatch, begins, at, between):
    logs, plant = logs_of(begins, at), load_vehicle("slocum")
    joined, edge = joined_sides(dict(zip(("before", "after"), logs, strict=True)), plant, Asked(trust=True))
    courses = {"before": Course((edge,), (1.0, 0.0)), "after": Course((edge,), (0.0, 1.0))}
    changing = ChangingPlant.of(plant, {form: [OFFSET] for form in courses}, courses)
    bench = Workbench(changing, joined.record, joined.parts, 0.1, joined.every_window)
    state = bench.fit(bench.plant, (*plant.coefficients, change("after", OFFSET)))
    sides = sides_of(joined.record, edge, NAMES)
    assert [one.label for one in sides.logs] == ["b1", "b2", "a1", "a2"]
    same = Common(OFFSET, "rudder offset", "rad", Sized(0.015, (0.01, 0.02)), 50.0, (OFFSET, "effects.yaw.moment"))
    with monkeypatch.context() as strictly:
        strictly.setattr(missions, "SLIGHTLY", 100.0)
        assert timed(bench, state, same, sides, 50) is same
    kept = timed(bench, state, same, sides, 50)
    found = timed(bench, state, WORN, sides, 50)
    if between is None:
        assert kept is same
        assert replace(found, moment=None, sizes=()) == WORN
        assert found.moment == Moment(("b2", "a1"))
    else:
        assert isinstance(kept, Changed)  # it is not the same on both sides, although no change between them shows
        assert (kept.moment, kept.tied, kept.surely) == (found.moment, ("effects.yaw.moment",), False)
        assert found.moment.between == between
        assert found.moment.evidence > 20.0
        for size, truth in ((found.before, 0.0), (found.after, SIZE), (found.change, SIZE)):
            assert abs(size.value - truth) < 0.001  # several standard errors
            assert size.ci95[1] - size.ci95[0] < 0.002
    if at:
        first, last = found.moment.ci95
        assert first.log == found.moment.time.log == last.log == begins
        assert first.time <= at <= last.time
        assert last.time - first.time < 60.0
    sizes = {one.log: one for one in found.sizes}
    assert list(sizes) == ["b1", "b2", "a1", "a2"]
    assert abs(sizes["b1"].value) < 0.001
    assert sizes["a2"].ci95[0] < 0.031


def test_what_begins_late_in_one_side_is_found_and_only_if_times_are_asked_for():
    """Half of the logs after have it, so neither side as a whole shows it."""
    logs, plant = logs_of("a2", seed=1000), load_vehicle("slocum")
    found = compare_missions(*logs, plant, names=NAMES)
    (only,) = found.changed
    assert (only.path, only.moment.between, found.common) == (OFFSET, ("a1", "a2"), ())
    assert only.change.ci95[0] < SIZE < only.change.ci95[1]
    assert OFFSET not in [u.path for u in found.unchanged]
    assert " It changed between a1 and a2 (95 % interval " in summary(found)[0]
    assert as_json(found)["changed"][0]["moment"]["between"] == ["a1", "a2"]
    assert compare_missions(*logs, plant, names=NAMES, times=False).changed == ()


def told(moment, sizes=()):
    return Comparison(load_vehicle("slocum"), NAMES, (replace(WORN, moment=moment, sizes=sizes),), (), (), 50, {})


def test_when_it_changed_is_in_the_summary_the_file_and_the_page(tmp_path):
    assert "It changed" not in summary(told(None))[0]
    usual = summary(told(Moment(("b2", "a1"))))[0]
    assert usual.endswith(" It changed between b2 and a1: no other time explains the logs better.")
    other = Moment(("a1", "a2"), 90.0, None, (Within("a1", 472.0), Within("a2", 52.4)))
    line = summary(told(other))[0]
    assert line.endswith(" It changed between a1 and a2 (95 % interval 472 s of a1 to 52 s of a2).")
    inside = Moment(("a1", "a1"), 90.0, Within("a1", 240.0), (Within("a1", 232.0), Within("a1", 248.0)))
    sizes = tuple(OfLog(name, size, (size - 0.01, size + 0.01)) for name, size in (("b1", 0.0), ("a1", 0.03)))
    line = summary(told(inside, sizes))[0]
    assert " It changed within a1, 240 s after its beginning (95 % interval 232 to 248 s)." in line
    assert line.endswith(" In each log: b1 0 deg, a1 1.72 deg.")
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    written = write_comparison(told(inside, sizes), tmp_path)
    (only,) = json.loads(written["changes.json"].read_text())["changed"]
    assert only["moment"]["time"] == {"log": "a1", "time": 240.0}
    assert only["moment"]["ci95"][1] == {"log": "a1", "time": 248.0}
    assert only["sizes"][1] == {"log": "a1", "value": 0.03, "ci95": [0.03 - 0.01, 0.03 + 0.01]}
    page = written["report.html"].read_text()
    assert "within a1, 240 s after its beginning" in page
    assert "rudder offset in" in page


def test_sides_of_keep_their_names():
    before, after = logs_of("a1")
    record, edge = concat([before, after.with_labels([""] * len(after.segments))]), len(before)
    logs = sides_of(record, edge, (("x", "y"), ("later.nc",))).logs
    assert [(one.label, one.rows.start >= edge) for one in logs] == [("b1", False), ("b2", False), ("later.nc", True)]
    assert [one.rows.stop for one in logs][-1] == len(record)


@pytest.mark.slow
def test_steps_are_dated_right_in_most_logs_and_never_where_the_sides_are_right():
    """Twelve comparisons of four logs; the time of an offset that begins within a log is drawn from its middle part."""
    plant, right, held = load_vehicle("slocum"), [], []
    for seed in range(100, 112):
        rng = np.random.default_rng(seed)
        begins, at = (
            ("a1", 0.0) if seed % 3 == 0 else ("a2", 0.0) if seed % 3 == 1 else ("a1", rng.uniform(100.0, 350.0))
        )
        found = compare_missions(*logs_of(begins, at, 10 * seed), plant, names=NAMES)
        own = [c for c in found.changed if c.path == OFFSET]
        wanted = ("a1", "a1") if at else ("b2", "a1") if begins == "a1" else ("a1", "a2")
        right.append(len(own) == 1 and own[0].moment.between == wanted)
        if at and right[-1]:
            first, last = own[0].moment.ci95
            held.append(first.time <= at <= last.time + 4.0)
        print(seed, wanted, at, [(c.path, c.moment) for c in found.changed], [c.path for c in found.common])
    assert sum(right) >= 11
    assert sum(held) >= len(held) - 1
