"""The integrator's order, dead time inside and across samples, and windows that remember what was commanded."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.param import replace_at
from auv_gym.plant import Plant, Runs, load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import linear_yaw_coefficients, yaw_inertia

SLOCUM = load_vehicle("slocum")
DAMPING, RUDDER = linear_yaw_coefficients(SLOCUM.family.view(SLOCUM.vector).hull)  # 1/s, 1/s^2


def with_quadratic_damping(rate: float) -> Plant:
    """slocum with rate |r| r taken from its yaw acceleration; rate in 1/rad."""
    moment = rate * yaw_inertia(SLOCUM.family.view(SLOCUM.vector).hull)
    return replace_at(SLOCUM, "effects.yaw.quadratic_damping", moment)


def record(rudder, dt=4.0, **channels) -> Record:
    rudder = np.asarray(rudder, dtype=float)
    return Record.from_arrays(dt * np.arange(rudder.size), {"rudder_rad": rudder, **channels})


def free_run(plant: Plant, made: Record, start=(0.0, 0.0, 0.0, 0.0)) -> np.ndarray:
    return plant.run(made, made.segments, np.array([start]))


def order(error_at, steps) -> float:
    """Slope of log error over log step between the first and the last step."""
    errors = [error_at(step) for step in steps]
    assert all(errors), "an error of zero has no order"
    return math.log(errors[0] / errors[-1]) / math.log(steps[0] / steps[-1])


@pytest.mark.parametrize("channel", [0, 1])
def test_fourth_order_on_decaying_yaw_with_quadratic_damping(channel):
    k, c, r0, t = -DAMPING, 1.0, 0.1, 16.0
    plant, made = with_quadratic_damping(c), record([0.0, 0.0], dt=t)
    decayed = c * r0 * (1.0 - math.exp(-k * t)) / k
    exact = math.log1p(decayed) / c, r0 * math.exp(-k * t) / (1.0 + decayed)  # Bernoulli's equation

    def error(step):
        return abs(free_run(replace(plant, longest_step=step), made, (0, r0, 0, 0))[-1, channel] - exact[channel])

    assert order(error, [0.25, 0.125]) == pytest.approx(4.0, abs=0.1)


def error_with_moving_rudder(lag, slowness, channel):
    """Error at a step against a run of a much smaller one, which is 4096 times closer than at 0.125 s.

    The turn keeps its side: where r changes sign, |r| r has a corner.
    """
    effects = {"effects.rudder.lag": lag, "effects.rudder.slowness": slowness}
    plant, made = replace_at(with_quadratic_damping(2.0), effects), record([0.0, 0.4, 0.1, 0.1], dt=8.0)

    def run(step):
        return free_run(replace(plant, longest_step=step), made, (0.0, 0.02, 0.0, 0.0))[-1, channel]

    exact = run(1.0 / 64.0)
    return lambda step: abs(run(step) - exact)


@pytest.mark.parametrize("channel", [0, 1])
@pytest.mark.parametrize("lag", [0.7, 3.0])
def test_fourth_order_with_a_lagging_rudder(lag, channel):
    assert order(error_with_moving_rudder(lag, 0.0, channel), [0.25, 0.125]) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("channel", [0, 1])
@pytest.mark.parametrize("lag, slowness", [(3.0, 30.0), (0.0, 17.0)])
def test_the_corner_of_a_rate_limit_does_not_spoil_the_order(lag, slowness, channel):
    # the corner falls anywhere in its step, so that the ratio of two errors scatters
    assert order(error_with_moving_rudder(lag, slowness, channel), [1.0, 0.125]) > 3.5


def test_rudder_with_lag_against_the_closed_form():
    lag, t = 3.0, 20.0
    k, step = -DAMPING, 0.3
    plant = replace(replace_at(SLOCUM, "effects.rudder.lag", lag), longest_step=0.05)
    end = free_run(plant, record([0.0, step, step], dt=t))[-1]
    # r' = -k r + b step (1 - exp(-t/lag)), from rest
    a = 1.0 / lag
    rate = RUDDER * step * ((1 - math.exp(-k * t)) / k - (math.exp(-a * t) - math.exp(-k * t)) / (k - a))
    assert end[1] == pytest.approx(rate, abs=1e-9)  # fourth order: (0.05 s / 12 s)^4


def heading_after_step(elapsed: float, size: float) -> float:
    """Exact heading of the linear yaw equation, rad, a time in s after the rudder has jumped."""
    k = -DAMPING
    return RUDDER * size / k * (elapsed - (1 - math.exp(-k * elapsed)) / k) if elapsed > 0.0 else 0.0


@given(dead_time=st.floats(0.0, 15.0) | st.sampled_from([4.0, 8.0, 1e-9, 4.0 - 1e-9, 4.0 + 1e-9]))
def test_dead_time_shifts_the_response_exactly(dead_time):
    plant = replace(replace_at(SLOCUM, "effects.rudder.dead_time", dead_time), longest_step=0.25)
    made = record([0.0] + [0.3] * 8)
    exact = [heading_after_step(t - 4.0 - dead_time, 0.3) for t in made.time]
    # fourth order: (0.25 s / 12 s)^4 of angles of order 1
    assert free_run(plant, made)[:, 0] == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("dead_time", [0.0, 1.3, 4.0, 5.7, 8.0, 12.0])
def test_the_response_is_smooth_in_the_dead_time(dead_time):
    made = record([0.0] + [0.3] * 8)

    def heading(delay):
        return free_run(replace(replace_at(SLOCUM, "effects.rudder.dead_time", delay), longest_step=0.25), made)[-1, 0]

    small, k = 1e-4, -DAMPING
    exact = -RUDDER * 0.3 / k * (1 - math.exp(-k * (made.time[-1] - 4.0 - dead_time)))
    above = (heading(dead_time + small) - heading(dead_time)) / small
    assert above == pytest.approx(exact, abs=2e-5)
    if dead_time > 0.0:
        below = (heading(dead_time) - heading(dead_time - small)) / small
        # half of the second derivative, b 0.3 < 0.01, times the distance of 2e-4, and the integrator's error
        assert above == pytest.approx(below, abs=2e-5)


def test_a_dead_time_outlives_the_next_command():
    plant = replace(replace_at(SLOCUM, "effects.rudder.dead_time", 6.0), longest_step=0.1)
    made = record([0.0, 0.3, -0.2, 0.0, 0.1, 0.1, 0.1, 0.1])
    changes = [(4.0, 0.3), (8.0, -0.5), (12.0, 0.2), (16.0, 0.1)]
    exact = [sum(heading_after_step(t - at - 6.0, size) for at, size in changes) for t in made.time]
    assert free_run(plant, made)[:, 0] == pytest.approx(exact, abs=1e-8)  # (0.1 s / 12 s)^4


def test_uneven_samples_are_integrated_to_their_own_times():
    rng = np.random.default_rng(5)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 7.0, 20))])
    made = Record.from_arrays(time, {"rudder_rad": np.where(time > 0.0, 0.3, 0.0)})
    plant = replace(replace_at(SLOCUM, "effects.rudder.dead_time", 2.5), longest_step=0.1)
    exact = [heading_after_step(t - time[1] - 2.5, 0.3) for t in time]
    assert free_run(plant, made)[:, 0] == pytest.approx(exact, abs=1e-7)  # (0.1 s / 12 s)^4, of angles up to 2


EFFECTS = {
    "dead time": {"effects.rudder.dead_time": 5.0},
    "lag": {"effects.rudder.lag": 3.0, "effects.rudder.slowness": 10.0},
    "backlash": {"effects.rudder.backlash": 0.1},
    "stiction": {"effects.rudder.stiction": 0.1},
}


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_a_window_remembers_what_was_commanded_before_it(effects):
    made = record(0.4 * np.sin(0.7 * np.arange(40)))
    plant = replace_at(SLOCUM, effects)
    whole = free_run(plant, made)
    # the heading and rate at row 20 are states here: no compass effect, no rudder term in the heading rate
    part = plant.run(made, [slice(20, 40)], whole[20:21])
    assert part == pytest.approx(whole[20:], abs=1e-12)


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_segments_do_not_hear_of_each_other(effects):
    rudder = 0.4 * np.cos(0.7 * np.arange(40))
    made = Record.from_arrays(4.0 * np.arange(40), {"rudder_rad": rudder}, segment=np.repeat([0, 1], 20))
    plant, starts = replace_at(SLOCUM, effects), np.zeros((2, 4))
    both = plant.run(made, made.segments, starts)
    alone = plant.run(record(rudder[20:]), [slice(0, 20)], starts[:1])
    assert both[20:] == pytest.approx(alone, abs=1e-12)  # times differ by 80 s


def test_several_parameter_vectors_run_as_they_would_alone():
    made = record(0.4 * np.sin(0.7 * np.arange(30)))
    plants = [SLOCUM, *(replace_at(SLOCUM, effects) for effects in EFFECTS.values())]
    windows = [slice(0, 12), slice(12, 30)]
    runs, starts = Runs.over(SLOCUM, made, windows), np.zeros((len(plants), 2, 4))
    starts[:, 1, 1] = 0.01
    together = SLOCUM.run_many(runs, np.stack([plant.vector for plant in plants]), starts)
    for plant, start, found in zip(plants, starts, together, strict=True):
        assert np.array_equal(plant.run(made, windows, start), found)


@pytest.mark.parametrize("window", [slice(5, 5), slice(10, 25), slice(0, 41), slice(-3, 4)])
def test_a_window_outside_a_segment_is_refused(window):
    made = Record.from_arrays(4.0 * np.arange(40), {"rudder_rad": np.zeros(40)}, segment=np.repeat([0, 1], 20))
    with pytest.raises(ValueError, match="inside a segment"):
        Runs.over(SLOCUM, made, [window])


def test_vectors_and_starts_of_the_wrong_shape_are_refused():
    made = record(np.zeros(5))
    runs = Runs.over(SLOCUM, made, made.segments)
    for vectors, starts in [(np.zeros((1, 3)), np.zeros((1, 1, 4))), (SLOCUM.vector[None], np.zeros((1, 2, 4)))]:
        with pytest.raises(ValueError, match="run_many needs parameter vectors of shape"):
            SLOCUM.run_many(runs, vectors, starts)
