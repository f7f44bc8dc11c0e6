from math import pi

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.rendering import Scene, Target
from auv_gym.rendering.depth import _depths
from auv_gym.rendering.plan import _view, kept, outline
from auv_gym.rendering.scales import number, outward, round_step, shortest, tick_text, ticks
from auv_gym.rendering.sheet import Box, mixed

BOX = Box(60.0, 80.0, 590.0, 380.0)
metres = st.floats(-1e5, 1e5)


def at(points, **fields) -> Scene:
    points = np.atleast_2d(np.asarray(points, dtype=float))
    return Scene(trail=points, time=np.arange(len(points)), attitude=(0.0, 0.0, 0.0), speed=1.0, **fields)


@given(st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=8))
def test_the_plan_holds_the_whole_track_north_up_and_east_right_in_equal_scale(points):
    view = _view(at(points), BOX)
    assert BOX.shrunk(20.0).holds(view.place(np.array(points))).all()
    here, north, east = view.place(np.array([[5.0, 7.0], [5.0 + view.metres, 7.0], [5.0, 7.0 + view.metres]]))
    assert north - here == pytest.approx([0.0, -1.0], abs=1e-6)
    assert east - here == pytest.approx([1.0, 0.0], abs=1e-6)


def test_the_view_holds_the_route_unless_it_is_far_away():
    near, far = [[0.0, 700.0, 5.0]], [[0.0, 70_000.0, 5.0]]
    for waypoints, inside in ((near, True), (far, False)):
        view = _view(at([0.0, 0.0, 0.0], target=Target(waypoints=waypoints, radius=50.0)), BOX)
        assert BOX.holds(view.place(np.array(waypoints))).all() == inside


def test_the_view_stays_the_same_over_most_steps():
    track = np.column_stack([0.6 * np.arange(500), 0.08 * np.arange(500), np.zeros(500)])
    views = [_view(at(track[:n]), BOX) for n in range(1, 500)]
    changes = sum(a != b for a, b in zip(views[1:], views[:-1]))
    assert 3 < changes < 60


def test_the_ray_to_the_target_heading_is_in_view():
    for heading in np.linspace(0.0, 2.0 * pi, 9):
        view = _view(at([[0.0, 0.0, 0.0], [90.0, 40.0, 0.0]], target=Target(heading=heading)), BOX)
        tip = view.place(np.array([[90.0, 40.0]])) + 80.0 * np.array([np.sin(heading), -np.cos(heading)])
        assert BOX.holds(tip).all()


def test_the_vehicle_s_nose_points_along_its_heading():
    for heading in (0.0, 0.5 * pi, 3.0, -1.0):
        points = outline((100.0, 200.0), heading, 40.0)
        nose = points[np.argmax(np.hypot(*(points - points[len(points) // 2]).T))]
        assert points[0] - (100.0, 200.0) == pytest.approx([20.0 * np.sin(heading), -20.0 * np.cos(heading)])
        assert nose == pytest.approx(points[0], abs=2.0)  # the far end from the stern is the nose


@given(st.floats(-5.0, 6000.0), st.floats(0.0, 500.0), st.none() | st.floats(0.0, 6000.0))
def test_the_depth_strip_holds_the_track_and_a_target_that_is_near(start, span, wanted):
    top, bottom, step = _depths(at([[0, 0, start], [0, 0, start + span]], target=Target(depth=wanted)))
    assert top <= start
    assert bottom >= start + span
    assert 1 <= (bottom - top) / step <= 9
    if wanted is not None and abs(wanted - start) < max(8.0 * span, 50.0):
        assert top <= wanted <= bottom
    if wanted is not None and start - max(100.0 * span, 100.0) > wanted:
        assert wanted < top


@given(st.integers(1, 100_000))
def test_a_thinned_line_keeps_its_ends_and_its_order(count):
    indices = kept(count)
    assert indices[0] == 0
    assert indices[-1] == count - 1
    assert (np.diff(indices) > 0).all()
    assert len(indices) <= 1501
    assert kept(0).size == 0


@given(st.floats(1e-6, 1e9))
def test_a_round_step_is_one_two_or_five(least):
    step = round_step(least)
    assert least * (1.0 - 1e-8) <= step < 2.5 * least * (1.0 + 1e-8)
    assert f"{step:.0e}"[0] in "125"


def test_ticks_are_multiples_and_limits_extend_to_them():
    assert ticks(-3.0, 7.0, 2.0) == pytest.approx([-2.0, 0.0, 2.0, 4.0, 6.0])
    assert ticks(0.1, 0.3, 0.1) == pytest.approx([0.1, 0.2, 0.3])
    assert outward(-3.0, 7.0, 2.0) == (-4.0, 8.0)
    assert outward(0.1, 0.3, 0.1) == pytest.approx((0.1, 0.3))


def test_numbers_are_written_with_a_true_minus_and_without_a_negative_zero():
    assert number(-0.04, 1) == "0.0"
    assert number(0.04, 1, signed=True) == "0.0"
    assert number(-12.34, 1) == "−12.3"
    assert number(12.34, 1, signed=True) == "+12.3"
    assert tick_text(0.25, 0.05) == "0.25"
    assert tick_text(-200.0, 100.0) == "−200"
    assert [shortest(value) for value in (20.0, 13.6, 1525.0, 0.125, 0.0)] == ["20", "13.6", "1525", "0.12", "0"]


def test_colours_mix_between_the_two():
    assert mixed("#000000", "#ffffff", 0.25) == pytest.approx((0.75, 0.75, 0.75))
    assert mixed("#0072b2", "#f7f9fb", 1.0 + 1e-15) == pytest.approx((0.0, 114 / 255, 178 / 255))
