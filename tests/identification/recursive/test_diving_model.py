"""The diving model: equation (8) as printed and on uneven samples, equation (5) in closed form, as a Model."""

from dataclasses import replace

import numpy as np
import pytest
from dives_by_equation import NEUTRAL, TRUTH, dive_log
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

from auv_gym.model import Diverged, Model, predict, simulate
from auv_gym.records.record import Record
from identification.recursive.diving_model import DivingModel, dive, regress, regressors, settled_starts
from identification.recursive.samples import Samples

EXACT = replace(TRUTH, scheme="exact")


def held(seconds: float, interval: float, piston: float = 0.52) -> Record:
    """A piston that stays where it is."""
    time = np.arange(0.0, seconds + 0.5 * interval, interval)
    return Record.from_arrays(time, {"depth_m": np.zeros(time.size), "piston_m": np.full(time.size, piston)})


def test_the_regressor_is_the_printed_one_where_samples_are_even():
    z1, z2, x0, x1, h = 7.3, 7.1, 0.53, 0.55, 0.7
    row = np.empty(6)
    regress(z1, z2, x0, x1, h, h, row)
    printed = [2 * z1 - z2, -h * (z1 - z2), -(h**2), h * (x0 - x1), h**2 * abs(x0) * x0, h**2 * x0]
    assert row == pytest.approx(printed, rel=1e-14)


@given(st.floats(0.1, 2.0), st.floats(0.1, 2.0), st.floats(-0.2, 0.2), st.floats(-0.05, 0.05), st.floats(0.5, 0.6))
def test_on_uneven_samples_it_is_exact_for_a_parabola(h, before, rate, acceleration, piston):
    def depth(time):
        return 5.0 + rate * time + 0.5 * acceleration * time**2

    row = np.empty(6)
    regress(depth(0.0), depth(-before), piston, piston, h, before, row)
    # a constant acceleration as -d/M, without damping
    assert row @ [1.0, 0.0, -acceleration, 0.0, 0.0, 0.0] == pytest.approx(depth(h), abs=1e-12)


def test_the_difference_equation_is_what_the_regressor_says():
    record = dive_log(400, 0.0, np.random.default_rng(0))
    samples = Samples.of([record], "test", 5)
    rows = np.zeros((len(record), 6))
    regressors(samples.depth, samples.piston, samples.interval, rows)
    assert np.ptp(np.diff(record.time)) > 0.3
    assert rows[2:] @ [1.0, *TRUTH.parameters] == pytest.approx(record["depth_m"][2:], abs=1e-11)


def test_a_gap_begins_the_regressor_anew():
    record = dive_log(60, 0.0, np.random.default_rng(0))
    cut = Record.from_arrays(record.time, {name: record[name] for name in record.names}, segment=np.arange(60) >= 30)
    samples = Samples.of([cut], "test", 5)
    rows = np.zeros((60, 6))
    regressors(samples.depth, samples.piston, samples.interval, rows)
    assert np.flatnonzero(rows[:, 2] == 0.0).tolist() == [0, 1, 30, 31]


@pytest.mark.parametrize("damping", [0.1, 1e-5, 0.0, -0.02])
def test_the_exact_scheme_solves_the_differential_equation(damping):
    model = replace(EXACT, damping=damping, piston_rate=0.0)
    force = 0.52**2 * model.piston_square + 0.52 * model.piston - model.offset
    x = model.step_over(np.array([3.0, 0.05, 0.52, 0.7]), np.array([0.52]), 20.0)
    solved = solve_ivp(lambda _, y: [y[1], force - damping * y[1]], (0.0, 20.0), [3.0, 0.05], rtol=1e-11, atol=1e-12)
    assert x[:2] == pytest.approx(solved.y[:, -1], rel=1e-9)


@given(st.floats(-0.05, 3.0), st.floats(0.05, 5.0), st.floats(0.05, 5.0), st.floats(0.5, 0.6))
def test_an_exact_step_is_two_exact_steps(damping, first, second, piston):
    model, x, u = replace(EXACT, damping=damping), np.array([5.0, 0.1, piston, 0.7]), np.array([piston])
    once = model.step_over(x, u, first + second)
    twice = model.step_over(model.step_over(x, u, first), u, second)
    assert twice[:2] == pytest.approx(once[:2], rel=1e-10, abs=1e-10)


def test_the_difference_scheme_is_of_first_order():
    ends = []
    for h in (0.4, 0.2, 0.1, 0.05):
        record = held(40.0, h)
        ends.append(simulate(TRUTH, record)["depth_m"][-1] - simulate(EXACT, record)["depth_m"][-1])
    orders = np.log2(np.abs(np.array(ends[:-1]) / ends[1:]))
    assert orders[-1] == pytest.approx(1.0, abs=0.1)


def test_a_step_of_the_piston_kicks_the_rate_by_n3():
    x = np.array([5.0, 0.02, 0.54, 0.7])
    dive(x, 0.56, 1e-9, EXACT.parameters, False)
    assert x[1] == pytest.approx(0.02 + 0.3 * 0.02, abs=1e-9)


@pytest.mark.parametrize("model", [TRUTH, EXACT])
def test_it_is_a_model(model):
    assert isinstance(model, Model)
    x, u = model.initial(np.array([4.0])), np.array([0.53])
    before = x.copy()
    assert model.output(x) == [4.0]
    assert np.array_equal(model.step(x, u), model.step(x, u))
    assert np.array_equal(x, before)
    assert model.output(model.correct(model.step(x, u), np.array([4.2]))) == [4.2]
    assert np.array_equal(model.correct(x, np.array([np.nan])), x)


@pytest.mark.parametrize("model", [TRUTH, EXACT])
def test_a_compiled_run_is_its_steps(model):
    record = dive_log(300, 0.0, np.random.default_rng(1), model)
    simulated = simulate(model, record)
    assert simulated["depth_m"] == pytest.approx(record["depth_m"], abs=1e-10)
    assert predict(model, simulated, 5)["depth_m"] == pytest.approx(simulated["depth_m"], abs=1e-10)


def test_the_published_table_does_not_balance_and_diverges_as_a_difference_equation():
    published = DivingModel(3.95, 0.489, 0.0008, 0.0021, 0.1516, scheme="difference")
    for unit in (1.0, 1000.0):
        piston = unit * np.linspace(0.5, 0.6, 11)
        for sign in (1.0, -1.0):
            force = published.piston_square * piston**2 + sign * published.piston * piston
            assert np.all(np.abs(force) - 0.489 > 100.0 if unit > 1.0 else np.abs(force) < 0.2)
    record = held(1000.0, 0.7)
    with pytest.raises(Diverged, match="depth_m"):
        simulate(published, record)
    assert np.isfinite(simulate(replace(published, scheme="exact"), record)["depth_m"]).all()


def test_starts_of_a_log_in_mid_dive_are_fitted():
    whole = dive_log(400, 0.0, np.random.default_rng(2), EXACT)
    log = whole.select(np.arange(len(whole)) >= 40)
    noisy = log.with_channels({"depth_m": log["depth_m"] + 0.01 * np.random.default_rng(3).standard_normal(len(log))})
    starts = settled_starts(EXACT, noisy, noisy.segments, settle=20.0)
    run = EXACT.run(noisy, noisy.segments, starts)[:, 0]
    # the step of the piston just before the log is not known: at most 2.8 mm, a rate of 0.3 * 2.8 mm/s
    assert np.max(np.abs(run - log["depth_m"])) < 0.05
    assert np.max(np.abs(simulate(EXACT, noisy)["depth_m"] - log["depth_m"])) > 0.5


@pytest.mark.parametrize(
    "changes, words",
    [({"damping": np.nan}, "finite damping"), ({"dt": 0.0}, "dt > 0"), ({"scheme": "euler"}, "scheme 'exact'")],
)
def test_settings_that_cannot_be_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        replace(TRUTH, **changes)


def test_a_state_or_input_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"shape \(4,\)"):
        TRUTH.step(np.zeros(3), np.array([NEUTRAL]))
    with pytest.raises(ValueError, match="piston_m"):
        TRUTH.step(np.zeros(4), np.zeros(2))
