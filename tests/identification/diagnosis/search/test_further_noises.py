"""Tests of further noises: a swell, found by the spectrum of the errors, and lasting sensor errors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.deciding import COST
from identification.diagnosis import as_json, diagnose
from identification.diagnosis.search.further_noises import with_further_noises
from identification.diagnosis.search.remainder import what_is_left
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit import further_noises, greybox
from identification.fit.coloured import coloured_channels
from identification.fit.greybox import GreyBox
from identification.fit.noises import Noise
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.swell import period_of_swell
from scripts.blind import own_cruise
from scripts.blind.own_cruise import cruised
from scripts.studies.driven import CASES, truth_of

GLIDER, OFFSET = load_vehicle("slocum"), "effects.rudder.offset"
PERIOD, LASTING, PUSH = 14.0, 60.0, 2e-3  # s, s, rad/s^2
ROWS, SIZE = 1000, 0.15  # rad, of the offset


def cycle(rng: np.random.Generator, rows: int, dt: float) -> np.ndarray:
    """A stochastic cycle of deviation 1, (rows,): the real part of a complex number that rotates and decays."""
    keeps, found, z = np.exp((2j * np.pi / PERIOD - 1.0 / LASTING) * dt), np.empty(rows), 0.0
    z = rng.standard_normal() + 1j * rng.standard_normal()
    for k in range(rows):
        found[k] = z.real
        z = keeps * z + np.sqrt(1.0 - abs(keeps) ** 2) * (rng.standard_normal() + 1j * rng.standard_normal())
    return found


def log_of(push: float, seed: int = 0, fading: float = 0.0, wander: float | None = None) -> Record:
    """A glider with a rudder offset under random yaw accelerations, of a swell and of others that decay over 14 s.

    wander: deviation of lasting compass errors, rad; if given, a gyro is logged as well.
    """
    rows = ROWS
    plant, rng = replace(replace_at(GLIDER, OFFSET, SIZE), dt=1.0), np.random.default_rng(seed)
    swell, gusts = push * cycle(rng, rows, 1.0), np.zeros(rows)
    for k in range(1, rows):
        gusts[k] = np.exp(-1.0 / PERIOD) * (gusts[k - 1] + 0.4 * fading * rng.standard_normal())
    inputs = np.zeros((rows, len(plant.inputs)))
    inputs[:, plant.inputs.index("rudder_rad")] = np.repeat(rng.choice([-0.2, 0.2], rows // 25), 25)
    inputs[:, plant.inputs.index("u_mps")] = 0.5
    x, at, readings = plant.initial(np.full(len(plant.outputs), np.nan)), plant.family.states.index("r_radps"), []
    for u, a in zip(inputs, swell + gusts, strict=True):
        readings.append(plant.output(x))
        x[at] += 0.5 * a
        x = plant.step(x, u)
        x[at] += 0.5 * a
    heading = np.array(readings)[:, plant.outputs.index("heading_rad")] + 0.01 * rng.standard_normal(rows)
    channels = {name: inputs[:, j] for j, name in enumerate(plant.inputs) if name in ("rudder_rad", "u_mps")}
    if wander is not None:
        rates = np.array(readings)[:, plant.outputs.index("r_radps")] + 1e-3 * rng.standard_normal(rows)
        heading, channels = heading + wander * drifted(rng, rows, LASTING), channels | {"r_radps": rates}
    return Record.from_arrays(np.arange(rows, dtype=float), channels | {"heading_rad": heading})


def drifted(rng: np.random.Generator, rows: int, lasting: float) -> np.ndarray:
    """A first-order Gauss-Markov process of deviation 1, (rows,), one row a second; lasting: correlation time, s."""
    keeps, found = np.exp(-1.0 / lasting), rng.standard_normal(rows)
    for k in range(1, rows):
        found[k] = keeps * found[k - 1] + np.sqrt(1.0 - keeps**2) * found[k]
    return found


def bench_of(record: Record) -> Workbench:
    parts = [[slice(k, k + ROWS // 5)] for k in range(0, ROWS, ROWS // 5)]
    return Workbench(replace(GLIDER, dt=1.0), record, parts, 0.1)


def fitted(record: Record) -> tuple[Workbench, State]:
    bench = bench_of(record)
    near = bench.fit(replace_at(bench.plant, OFFSET, SIZE), ())
    return bench, near


@pytest.fixture(autouse=True)
def one_velocity_is_enough(monkeypatch):
    """Accept a swell in one velocity, as a glider has, whose filter is fast."""
    monkeypatch.setattr(further_noises, "LEAST_OF_SWELL", 1)


@pytest.fixture(scope="module")
def pushed():
    return fitted(log_of(PUSH))


def test_a_swell_is_found_with_its_period_and_noises(pushed):
    bench, state = pushed
    period = period_of_swell(bench.problem, state.point)
    assert period == pytest.approx(PERIOD, rel=0.05)
    other, (found,) = with_further_noises(bench, [state])
    assert other is not bench
    (size, time) = other.problem.noise_at(found.point).swell[other.problem.periods[-1]]["r_radps"]
    assert size == pytest.approx(PUSH, rel=0.3)  # a thousand rows hold some ten correlation times
    assert LASTING / 3.0 < time < 3.0 * LASTING
    assert other.problem.objective(found.point, ()) > bench.problem.objective(state.point, ()) + 20.0
    assert period_of_swell(other.problem, found.point) is None  # the errors have no peak any more


@pytest.mark.parametrize("fading", [0.0, 2e-3])
def test_none_is_found_in_noise_or_gusts(fading):
    for seed in range(3):
        bench, state = fitted(log_of(0.0, seed, fading))
        assert period_of_swell(bench.problem, state.point) is None
        assert with_further_noises(bench, [state]) == (bench, [state])


@pytest.mark.parametrize("peak, found", [(0.0, False), (3.0, True)])
def test_errors_that_merely_fade_have_no_peak(peak, found):
    """One spectrum falls with frequency, and another one has a peak on the slope."""
    rows, rng = 4000, np.random.default_rng(0)
    drift, keeps = np.zeros(rows), np.exp(-1.0 / 3.0)
    for k in range(1, rows):
        drift[k] = keeps * drift[k - 1] + np.sqrt(1.0 - keeps**2) * rng.standard_normal()
    errors = (drift + peak * cycle(rng, rows, 1.0))[:, None]
    point = SimpleNamespace(errors=errors, scores=np.zeros(rows), system="any")
    problem = SimpleNamespace(
        velocities=[0], channels=("heading_rad",), durations=np.ones(rows),
        finite=np.ones((rows, 1), dtype=bool), stretches=[slice(0, rows)],
        stretch_of_row=np.zeros(rows, dtype=int),
    )  # fmt: skip
    period = period_of_swell(problem, point)
    assert period == (pytest.approx(PERIOD, rel=0.05) if found else None)


def test_waves_alone_are_looked_for_before_a_search(pushed, monkeypatch):
    """Coloured errors may be due to a missing effect."""
    bench, state = pushed
    monkeypatch.setattr(further_noises, "coloured_channels", lambda *_: bench.problem.channels)
    other, (found,) = with_further_noises(bench, [state], waves_alone=True)
    noise = other.problem.noise_at(found.point)
    assert noise.swell
    assert not noise.lasting
    monkeypatch.setattr(further_noises, "period_of_swell", lambda *_: None)
    assert with_further_noises(bench, [state], waves_alone=True) == (bench, [state])


@pytest.mark.parametrize("size, sea", [(0.0, True), (0.02, False)])
def test_waves_beside_which_a_sensor_swings_are_not_there_before_a_search(size, sea):
    """With a swell in the filter its errors keep the period, so that something else has this period, too."""
    record, rng = log_of(PUSH, wander=0.0), np.random.default_rng(5)
    swinging = record["heading_rad"] + size * cycle(rng, ROWS, 1.0)
    bench, state = fitted(record.with_channels({"heading_rad": swinging}))
    assert further_noises.further_noises(bench.problem, state.plant, (), state.point)
    other, _ = with_further_noises(bench, [state], waves_alone=True)
    assert (other is not bench) == sea


@pytest.mark.parametrize("push", [0.0, PUSH])
def test_a_grey_box_tells_a_swell_beside_which_a_record_is_likelier(push, monkeypatch):
    box, log = GreyBox(replace(GLIDER, dt=1.0), [OFFSET], window=200.0), log_of(push)
    fit = box.fit(log)
    assert [period == pytest.approx(PERIOD, rel=0.05) for period in fit.noise.swell] == [True] * (push > 0.0)
    low, high = fit[OFFSET].ci95
    assert low < SIZE < high
    monkeypatch.setattr(greybox, "further_noises", lambda *_: [])
    assert (fit.log_likelihood > box.fit(log).log_likelihood + 20.0) is (push > 0.0)


def test_one_that_brings_less_than_it_costs_is_not_taken(pushed, monkeypatch):
    bench, state = pushed
    monkeypatch.setattr(further_noises, "coloured_channels", lambda *_: ())  # only the swell
    assert with_further_noises(bench, [state])[0] is not bench
    monkeypatch.setattr(further_noises, "COST", 1e6)
    assert with_further_noises(bench, [state]) == (bench, [state])


def test_rows_longer_than_a_quarter_of_any_swell_show_none(pushed, monkeypatch):
    bench, state = pushed
    monkeypatch.setattr(bench.problem, "durations", np.full(ROWS, 8.0))
    assert period_of_swell(bench.problem, state.point) is None


def test_both_of_a_pair_have_the_noises_of_the_first_and_cost_as_one(pushed):
    bench, state = pushed
    problem = bench.problem.with_noises(bench.problem.velocities, [], PERIOD)
    point = problem.begun_with(state.point)
    count, size = len(problem.channels), len(problem.pushed)
    other = point.logs.copy()
    other[count + size - 1] += 3.0  # the noise of the second of the pair
    other[-1] += 1.0
    for one, same in zip(problem._numbers(point.logs), problem._numbers(other), strict=True):
        assert np.array_equal(one, same)
    without = problem._without(point.logs, [size - 2])
    assert problem._cost(point.logs) - problem._cost(without) == pytest.approx(COST)
    assert problem._prior(point.logs)[0] == problem._prior(other)[0]
    assert problem.noise_slopes(point, point.logs)[1][[count + size - 1, -1]] == pytest.approx(0.0)
    assert not problem.pushes(point)[-2:].any()


def test_a_filter_for_samples_one_by_one_has_all_of_the_noises(pushed):
    bench, _ = pushed
    problem = PredictionErrors(bench.plant, bench.record, [slice(0, ROWS)])
    problem = problem.with_noises(problem.velocities, [0], PERIOD).with_noises([], [0], 0.0)
    logs, count = problem.first_noise(), len(problem.channels)
    logs[count : count + len(problem.pushed)] = np.log(0.1 * problem.unit)
    plan = problem.online(problem.point(bench.plant.vector, logs), 100.0)
    assert np.array_equal(plan.kicks, problem.kicks)
    assert (plan.kicks[:, 3] > 0.0).sum() == len(problem.velocities) + 1
    assert (plan.kicks[:, 0] < 0.0).sum() == 2


def test_a_problem_has_the_noises_that_were_found_elsewhere(pushed):
    bench, _ = pushed
    problem = PredictionErrors(bench.plant, bench.record, [slice(0, ROWS)])
    names = [problem.pushed[d] for d in problem.velocities]
    told = Noise(
        dict.fromkeys(problem.channels, 0.1),
        {},
        {PERIOD: dict.fromkeys(names, (0.02, 30.0))},
        {0.0: {problem.channels[0]: (0.3, 40.0)}},
    )
    there = problem.with_noises_of(told)
    wanted = problem.with_noises(problem.velocities, [], PERIOD).with_noises([], [0], 0.0)
    assert (there.pushed, there.periods.tolist()) == (wanted.pushed, wanted.periods.tolist())
    assert np.array_equal(there.kicks, wanted.kicks)
    variances, deviations, times = there._numbers(there.logs_of(told))
    assert deviations[there.swells] == pytest.approx(0.02)
    assert (deviations[-1], times[-1]) == (pytest.approx(0.3), pytest.approx(40.0))
    assert problem.with_noises_of(Noise(told.measurement, {})) is problem


def test_what_swings_in_one_velocity_alone_is_no_swell(pushed, monkeypatch):
    """A control loop may oscillate by a deadband or backlash; a vehicle with one velocity is not tested."""
    bench, state = pushed
    taken = []
    monkeypatch.setattr(further_noises, "LEAST_OF_SWELL", 2)
    monkeypatch.setattr(further_noises, "period_of_swell", lambda *_: taken.append(1))
    assert with_further_noises(bench, [state]) == (bench, [state])
    assert not taken
    added = (bench.problem.velocities, (), PERIOD)
    assert further_noises._pruned(bench.problem, state.paths, state.point, added) is None


@pytest.fixture(scope="module")
def wandering():
    return fitted(log_of(0.0, 1, wander=0.03))


def test_what_lasts_of_a_compass_s_errors_is_found_beside_a_gyro(wandering):
    bench, state = wandering
    assert coloured_channels(bench.problem, state.point)
    other, (found,) = with_further_noises(bench, [state])
    ((size, time),) = other.problem.noise_at(found.point).lasting[0.0].values()
    assert size == pytest.approx(0.03, rel=0.4)  # a thousand rows hold some fifteen correlation times
    assert LASTING / 3.0 < time < 3.0 * LASTING
    assert not what_is_left(other, found)
    assert with_further_noises(other, [found]) == (other, [found])
    assert other.problem.misread.sum() == 1  # errors of negligible strength are removed


def test_a_law_of_what_a_reading_errs_by_is_that_of_the_row_before(wandering):
    """The states and the commands of the reading's own row already depend on it."""
    bench, state = wandering
    other, (found,) = with_further_noises(bench, [state])
    problem, axis = other.problem, len(other.problem.pushed) - 1
    law = np.zeros((1, len(problem.rows)))
    law[0, 10] = 1.0
    seen = problem.pushed_by(found.point, axis, law).seen[:, :, 0]
    assert np.flatnonzero(seen.any(axis=1)).tolist() == [11]
    pushed = problem.pushed_by(found.point, 0, law).onward[:, :, 0]
    assert np.flatnonzero(pushed.any(axis=1)).tolist() == [10]


def test_noises_of_readings_are_those_that_were_given(wandering):
    bench, state = wandering
    other, (found,) = with_further_noises(bench, [state])
    noise = other.problem.noise_at(found.point)
    assert np.exp(other.problem.logs_of(noise)[-1]) == pytest.approx(next(iter(noise.lasting[0.0].values()))[1])


@pytest.mark.slow
def test_a_current_is_named_in_a_swell_and_the_swell_is_told():
    """Without a swell among the noises, the verdict is `unexplained`, with a false added inertia in roll."""
    case = "torpedo, swell"
    rng = np.random.default_rng([1, 1])
    found = diagnose(cruised(truth_of(case, rng), rng, **CASES[case].pushes), load_vehicle("vt690"))
    assert {e.path for e in found.effects} == set(CASES[case].true)
    told = as_json(found)["process_noise"]["swell"]
    assert told[0]["period_s"] == pytest.approx(own_cruise.PERIOD, rel=0.05)
    assert "as of waves" in found.summary()
