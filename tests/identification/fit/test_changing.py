"""Tests of vehicles whose parameters change along a record: runs in pieces equal their references."""

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Runs, load_vehicle
from auv_gym.plant.rollout import bind_family
from identification.experiments.float_dives import oil_mission
from identification.experiments.heading_control import closed_loop
from identification.experiments.missions import run_mission
from identification.fit.changing import ChangingPlant, Course, change, changed, named_when
from identification.fit.prediction_errors import PredictionErrors

OFFSET, BIAS, LEAK = "effects.rudder.offset", "effects.rudder.deadband", "effects.volume.leak"


@pytest.fixture(scope="module")
def glider():
    plant = load_vehicle("slocum")
    return plant, closed_loop(plant, rng=np.random.default_rng(3), duration=400.0)


def changing(plant, paths, edge, shares):
    return ChangingPlant.of(plant, {"after": paths}, {"after": Course((edge,), shares)})


def test_programs_are_compiled_for_one_layout_in_memory(glider):
    """Another memory layout would trigger another compilation, which takes ten seconds."""
    plant, record = glider
    rollout = bind_family(plant.family).rollout
    known = len(getattr(rollout, "signatures", []))  # from earlier tests; plain Python has none
    two = PredictionErrors(plant, record, record.segments)
    one = PredictionErrors(plant, record.without({*record.names} - {*plant.inputs, "heading_rad"}), record.segments)
    assert len(two.channels) > len(one.channels) == 1
    for problem in (one, two, PredictionErrors(plant, record, record.segments, stride=5)):
        assert problem.rows.flags.c_contiguous
        assert problem.measured.flags.c_contiguous
        assert problem.finite.flags.c_contiguous
        assert problem.counts.flags.c_contiguous
        problem.point(plant.vector, problem.first_noise())
    late = changing(plant, [OFFSET], len(record) // 2, (0.0, 1.0))
    windows = record.windows(100.0)
    moved = np.array([late.vector, replace_at(late, change("after", OFFSET), 0.05).vector])
    late.run_many(Runs.over(late, record, windows), moved, np.zeros((2, len(windows), len(plant.family.states))))
    assert len(getattr(rollout, "signatures", [])) <= max(known, 1)


def errors_of(plant, record, values, near=None, stride=1):
    problem = PredictionErrors(plant, record, record.segments, stride=stride)
    point = problem.point(plant.vector, problem.first_noise()) if near is None else near
    return problem.with_gains(point, replace_at(plant, values).vector).errors, point


@pytest.mark.parametrize("shares", [(0.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.3)])
def test_what_has_leaked_in_stays_and_what_has_not_is_not_there_at_once(shares):
    """The reference counts the time only while it leaks, and always within a sample: it errs by a third of a second."""
    plant = load_vehicle("qiandao_float")
    record = run_mission(plant, np.random.default_rng(3), duration=120.0)
    edges, rate = (len(record) // 3, len(record) // 2), 3e-7
    course = Course(edges, shares)
    changing = ChangingPlant.of(plant, {"amid": [LEAK]}, {"amid": course}, record)
    leaking = np.r_[0.0, course.over(np.arange(len(record)))[:-1]]  # over the interval before each row
    counted = record.with_channels({"elapsed_s": np.cumsum(np.diff(record.time, prepend=0.0) * leaking)})

    def depths(plant, record, values):
        runs, start = Runs.over(plant, record, record.segments), np.array([[[10.0, 0.0, 0.0]]])
        return plant.run_many(runs, replace_at(plant, values).vector[None], start)[0, :, 0]

    wanted = depths(plant, counted, {LEAK: rate})
    np.testing.assert_allclose(depths(changing, record, {change("amid", LEAK): rate}), wanted, atol=0.02)
    assert np.abs(wanted - depths(plant, record, {})).max() > 0.1
    at_once = ChangingPlant.of(plant, {"amid": [LEAK]}, {"amid": course})
    assert np.abs(depths(at_once, record, {change("amid", LEAK): rate}) - wanted).max() > 0.1


@pytest.mark.parametrize("stride", [1, 7])
def test_a_change_that_acts_all_along_is_the_parameter_itself(glider, stride):
    plant, record = glider
    both = changing(plant, [OFFSET], len(record) // 2, (1.0, 1.0))
    found, _ = errors_of(both, record, {change("after", OFFSET): 0.05}, stride=stride)
    wanted, _ = errors_of(plant, record, {OFFSET: 0.05}, stride=stride)
    np.testing.assert_array_equal(found, wanted)


def test_dives_go_on_with_the_volume_of_the_dive_before_a_change():
    plant = load_vehicle("mermaid")
    record = oil_mission(plant, (300.0, 500.0), rng=np.random.default_rng(1))
    windows = [w for s in record.segments for w in (slice(s.start, s.start + 9), slice(s.start + 9, s.stop))]
    both, near = changing(plant, [LEAK], record.segments[0].start + 9, (1.0, 1.0)), {}
    for name, vehicle, path in (("whole", plant, LEAK), ("pieces", both, change("after", LEAK))):
        problem = PredictionErrors(vehicle, record, windows)
        point = problem.point(vehicle.vector, problem.first_noise())
        near[name] = problem.with_gains(point, replace_at(vehicle, path, 1e-9).vector).errors
        assert problem.carried.any()
    np.testing.assert_allclose(near["pieces"], near["whole"], rtol=0.0, atol=1e-9)


def test_nothing_moves_before_a_change(glider):
    plant, record = glider
    edge = len(record) // 2
    late = changing(plant, [OFFSET], edge, (0.0, 1.0))
    problem = PredictionErrors(late, record, record.segments)
    point = problem.point(late.vector, problem.first_noise())
    columns = problem.columns_of(point, [(change("after", OFFSET), 0.01)])[0]
    assert np.abs(columns[: edge + 1]).max() < 1e-12 < 1.0 < np.abs(columns[edge + 1 :]).max()


def test_within_a_row_of_several_samples_nothing_changes(glider):
    plant, record = glider
    ends = []
    for edge in (72, 77, 78):
        late = changing(plant, [OFFSET], edge, (0.0, 1.0))
        ends.append(errors_of(late, record, {change("after", OFFSET): 0.05}, stride=7)[0])
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[2] - ends[1]).max() > 0.0


def test_a_plant_has_its_values_at_a_row_and_stays_within_bounds(glider):
    plant, _ = glider
    high = spec_at(plant, BIAS).bounds[1]
    late = replace_at(changing(plant, [BIAS], 7, (0.0, 1.0)), change("after", BIAS), high)
    assert value_at(late.at_row(6), BIAS) == 0.0
    assert value_at(late.at_row(7), BIAS) == high
    less = replace_at(late, change("after", BIAS), -high)
    assert value_at(less.at_row(7), BIAS) == spec_at(plant, BIAS).bounds[0]


def test_paths_of_changes_tell_form_and_parameter():
    assert changed(change("after", OFFSET)) == ("after", OFFSET)
    assert changed(OFFSET) == ("", OFFSET)


def test_a_vehicle_that_changes_may_change_in_other_forms_too(glider):
    plant, record = glider
    row, other = change("after", OFFSET), change("late", BIAS)
    first = replace_at(changing(plant, [OFFSET], len(record) // 2, (0.0, 1.0)), row, 0.03)
    both = ChangingPlant.of(first, {"late": [BIAS]}, {"late": Course((len(record) // 4,), (0.0, 1.0))})
    assert both.changes == [row, other]
    assert value_at(both, row) == 0.03
    assert value_at(both.at_row(len(record) - 1), OFFSET) == 0.03
    assert both.plain == plant


def test_a_change_may_change_itself_where_it_acts(glider):
    """The change begins at a quarter of the record, and doubles from half-way on."""
    plant, record = glider
    quarter, half = len(record) // 4, len(record) // 2
    whole, more = change("after", OFFSET), change("late", change("after", OFFSET))
    first = changing(plant, [OFFSET], quarter, (0.0, 1.0))
    both = ChangingPlant.of(first, {"late": [whole]}, {"late": Course((half,), (0.0, 1.0))})
    both = replace_at(both, {whole: 0.03, more: 0.03})
    assert [value_at(both.at_row(row), OFFSET) for row in (0, quarter, half)] == pytest.approx([0.0, 0.03, 0.06])
    early = replace_at(both, {whole: 0.0, more: 0.03})  # a change of a change is zero before the latter begins
    assert value_at(early.at_row(quarter), OFFSET) == 0.0
    stepwise = ChangingPlant.of(
        plant,
        {"a": [OFFSET], "b": [OFFSET]},
        {"a": Course((quarter,), (0.0, 1.0)), "b": Course((half,), (0.0, 1.0))},
    )
    found, _ = errors_of(replace_at(both, {whole: 0.0, more: 0.0}), record, {whole: 0.03, more: 0.03})
    wanted, _ = errors_of(stepwise, record, {change("a", OFFSET): 0.03, change("b", OFFSET): 0.03})
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_title_has_when_it_acts_before_its_remark():
    assert named_when("rudder deadband (half width)", "in a.csv") == "rudder deadband in a.csv (half width)"
    assert named_when("trapped air, at the surface", "in a.csv") == "trapped air in a.csv, at the surface"
    assert named_when("rudder offset", "") == "rudder offset"


@pytest.mark.parametrize("path, size", [("effects.rudder.lag", 4.0), ("effects.rudder.backlash", 0.1)])
def test_actuators_go_on_from_where_a_change_finds_them(glider, path, size):
    plant, record = glider
    edge = 1 + int(np.argmax(np.abs(np.diff(record["rudder_rad"]))))  # just after the largest move
    course = Course((edge, edge + 20), (0.0, 1.0, 0.0))
    both = replace_at(ChangingPlant.of(plant, {"amid": [path]}, {"amid": course}), change("amid", path), size)
    inputs = np.stack([record[n] if record.has(n) else np.full(len(record), plant.constants[n]) for n in plant.inputs])
    x = plant.settled(plant.initial(np.zeros(len(plant.outputs)))[: len(plant.family.states)], inputs[:, 0])
    first, stepped = x[None, :], []
    for k in range(len(record)):
        now = both.at_row(k)
        stepped.append(now.output(x))
        x = now.step_over(x, inputs[:, k], plant.dt)
    np.testing.assert_allclose(both.run(record, record.segments, first), stepped, rtol=0.0, atol=1e-9)
