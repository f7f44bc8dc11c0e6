"""Logs with process noise: what pushes the vehicle, how strongly, and how the study counts."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from controllers.pid import heading_pid
from scripts.studies.harness import Found
from scripts.studies.process_noise import logs
from scripts.studies.process_noise.attempts import judged
from scripts.studies.process_noise.experiments import VEHICLES
from scripts.studies.process_noise.flights import Experiment, fly
from scripts.studies.process_noise.levels import TOLERANCE
from scripts.studies.process_noise.logs import LEAST, TAUS, draw, single_effects
from scripts.studies.process_noise.pushes import unit_paths, velocities
from scripts.studies.process_noise.rates import mean, rate
from scripts.studies.process_noise.study import STUDY
from scripts.studies.process_noise.tables import CASES


@pytest.fixture(autouse=True)
def short_logs(monkeypatch):
    """Logs of half the length."""
    short = {name: replace(vehicle, duration=0.5 * vehicle.duration) for name, vehicle in VEHICLES.items()}
    monkeypatch.setattr(logs, "VEHICLES", short)


def test_paths_are_stationary_with_their_correlation_time():
    taus, dt = np.array([5.0, 40.0]), 0.5
    paths = unit_paths(np.random.default_rng(0).standard_normal((200_000, 2)), taus, dt)
    for path, tau in zip(paths.T, taus):
        lag = round(tau / dt)
        # 200 000 samples of 0.5 s are 1250 times the longer tau: deviations of 3 % and 4 %
        assert np.mean(path**2) == pytest.approx(1.0, abs=0.12)
        assert np.mean(path[lag:] * path[:-lag]) == pytest.approx(np.exp(-1.0), abs=0.12)
    first = unit_paths(np.random.default_rng(1).standard_normal((1, 500)), np.full(500, 5.0), dt)
    assert np.std(first) == pytest.approx(1.0, abs=0.12)  # from the first sample on; 500 draws give it to 3 %


def test_a_constant_push_acts_as_a_moment_does_to_second_order():
    push, errors = 1e-3, []
    for dt in (0.1, 0.05):  # its yaw rate settles in 0.4 s
        plant = replace(load_vehicle("ganeshblue"), dt=dt, longest_step=0.05)
        time = dt * np.arange(round(2.0 / dt) + 1)
        experiment = Experiment(
            time,
            {},
            heading_pid(plant),
            wanted={"heading_rad": np.zeros(time.size)},
            limits={"rudder_rad": (-0.5, 0.5)},
            sensors={"heading_rad": 0.0},
            given={"u_mps": np.full(time.size, 0.3)},
        )
        calm = np.zeros((time.size, 1))
        hull = plant.hull
        inertia = hull.inertia - 0.5 * hull.density * hull.length**5 * hull.n_rdot
        moment = replace_at(plant, "effects.yaw.moment", push * inertia)
        pushed = fly(plant, experiment, ("r_radps",), calm + push, calm, commands=calm)
        turned = fly(moment, experiment, ("r_radps",), calm, calm, commands=calm)
        errors.append(abs(pushed.record["heading_rad"][-1] - turned.record["heading_rad"][-1]))
    assert turned.record["heading_rad"][-1] > 5e-4  # rad: it does turn
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("family", ["glider", "float"])
def test_the_true_model_errs_as_wanted_and_only_a_controller_answers(family):
    times, command = 2.0, {"glider": "rudder_rad", "float": "piston_m"}[family]
    closed, calm = (draw(family, 3, "closed", False, times=t) for t in (times, 0.0))
    assert closed.free_run == pytest.approx(times, rel=TOLERANCE)
    assert calm.free_run < 0.5
    (shown,) = closed.shown.values()
    assert shown >= closed.free_run**2 - calm.free_run**2 > 0.0  # the only push makes all of it
    assert not calm.pushes.any()
    assert list(closed.process) == list(velocities(closed.plant))
    assert all(deviation > 0.0 and TAUS[0] <= tau <= TAUS[1] for deviation, tau in closed.process.values())
    assert np.ptp(closed.record[command] - calm.record[command]) > 0.0
    opened, untouched = (draw(family, 3, "open", False, times=t) for t in (times, 0.0))
    assert np.array_equal(opened.record[command], untouched.record[command])
    assert not np.array_equal(opened.record[opened.plant.family.leading], untouched.record[opened.plant.family.leading])


@pytest.mark.parametrize("exact", [False, True])
def test_a_controller_that_sees_the_true_state_does_not_answer_noise(exact):
    vehicle = VEHICLES["glider"]
    experiment = replace(vehicle.experiment(vehicle, np.random.default_rng(0)), exact=exact)
    rng, rows = np.random.default_rng(1), len(experiment.time)
    pushes = np.zeros((rows, 1))
    one, other = (
        fly(vehicle.plant, experiment, ("r_radps",), pushes, rng.standard_normal((rows, len(experiment.sensors))))
        for _ in range(2)
    )
    assert np.array_equal(one.record["rudder_rad"], other.record["rudder_rad"]) == exact
    assert not np.array_equal(one.record["heading_rad"], other.record["heading_rad"])


def test_draws_repeat_and_doubt_the_coefficients_that_are_asked_for():
    one, again = (draw("glider", 5, "closed", False, times=0.0, wrong=0.1) for _ in range(2))
    assert np.array_equal(one.record["heading_rad"], again.record["heading_rad"])
    for path in one.plant.family.coefficients:
        assert abs(value_at(one.believed, path) / value_at(one.plant, path) - 1.0) == pytest.approx(0.1)
    assert one.effect == ""
    assert draw("glider", 5, "closed", False, times=0.0).believed == one.plant


def test_an_effect_is_as_large_as_the_log_can_show(monkeypatch):
    def errors(plant, record, paths, process, sensors):
        assert process["r_radps"][0] > 0.0
        return {path: 0.3 * spec_at(plant, path).probe if path.startswith("effects.") else 1.0 for path in paths}

    monkeypatch.setattr(logs, "standard_errors", errors)
    case = draw("glider", 2, "open", True)
    assert case.effect in single_effects(case.believed, case.record)
    spec = spec_at(case.plant, case.effect)
    assert case.size == value_at(case.plant, case.effect)
    assert LEAST * case.error <= abs(case.size - spec.neutral) <= 10.0 * case.error
    assert spec.bounds[0] < case.size < spec.bounds[1]
    assert value_at(case.believed, case.effect) == spec.neutral
    assert case.free_run == pytest.approx(1.0, rel=TOLERANCE)


def test_a_vehicle_that_is_unstable_by_itself_has_no_open_loop():
    with pytest.raises(ValueError, match=r"remus100 \(closed, exact\)"):
        draw("remus100", 0, "open", False)
    assert "clean: remus100, closed" in CASES
    assert "clean: remus100, open" not in CASES
    assert len(CASES) == 3 * 11


def test_names_are_right_where_they_mean_the_effect():
    assert judged("a", {"a": {"a"}}, ()) == {"right": True, "false": []}
    assert judged("a", {"b": {"b", "a"}, "c": {"c"}}, ()) == {"right": True, "false": ["c"]}
    assert judged("a", {}, (("a", "b"),)) == {"right": True, "false": []}
    assert judged("a", {"b": {"b"}}, ()) == {"right": False, "false": ["b"]}
    assert judged("", {"b": {"b"}}, ()) == {"right": False, "false": ["b"]}


def test_the_tables_give_bias_coverage_and_rates_with_intervals():
    def fitted(value):
        estimate = {"error": 1.0, "ci95": [value - 2.0, value + 2.0], "truth": 0.0, "side": 1.0, "problem": ""}
        return {"effects.yaw.moment": {**estimate, "value": value}, "hull.n_r": {**estimate, "value": 0.5 * value}}

    told = {"effect": "effects.yaw.moment", "process": {"r_radps": [1.0, 10.0]}, "shown": {"r_radps": 0.5}}
    estimated = {
        seed: {**told, "fits": {"filter": fitted(value), "free runs": {}}, "found": found}
        for seed, (value, found) in enumerate([(-1.0, {"r_radps": [1.4, 9.0]}), (3.0, {})])
    }
    said = {**told, "shown": {"r_radps": 0.05}, "found": {}}
    said |= {"verdict": "none", "named": [], "right": False, "false": []}
    runs = {
        "parameters: glider, closed": estimated,
        "clean: glider, closed": {0: said},
        "names: glider, open": {0: said},
    }
    parameters, noise, clean, named = STUDY.sheets(Found(runs, {"times": 1.0}))
    assert [row[2:6] for row in parameters.rows] == [
        ["the effect", "2", mean([-1.0, 3.0]), rate([True, False])],
        ["all coefficients", "2", "-", "50.0"],
        ["hull.n_r", "2", mean([-0.5, 1.5]), rate([True, False])],
    ]
    assert noise.rows[:2] == [
        ["parameters", "glider", "closed", "r_radps", "2", "2", rate([True, False]), "1.40", "1"],
        ["clean", "glider", "closed", "r_radps", "1", "0", "-", "-", "0"],
    ]
    assert clean.rows == [["glider", "closed", "1", rate([True]), rate([True]), "0.00", ""]]
    assert named.rows == [["glider", "open", "1", rate([False]), rate([False]), "0.00", "yaw.moment (1)"]]
    assert mean([1.0, 3.0]) == "2.00 (-10.71 to 14.71)"  # 12.71 standard errors at one degree of freedom
    assert rate([]) == mean([]) == "-"


def test_every_vehicle_of_the_study_has_the_loops_and_velocities_it_names():
    for vehicle in VEHICLES.values():
        assert set(vehicle.judged) <= set(velocities(vehicle.plant))
        assert set(vehicle.loops) <= {"closed", "exact", "open"}
