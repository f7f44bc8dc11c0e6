"""Tests of hulls learned from runs of a known vehicle: accuracy, range of validity, and refusals."""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.models.files import load_model, save_model
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.body.learned_hull import LearnedHull
from identification.estimator import make_estimator, summary
from identification.experiments.excitation import bang_bang
from identification.kernel_machines.hull.hull import MIRRORED, HullFit, HullLsSvm
from identification.kernel_machines.hull.hull_targets import READINGS

NOISE = dict(zip(READINGS, [0.01] * 3 + [radians(0.1)] * 3 + [radians(0.2)] * 2))


@cache
def vehicle() -> Plant:
    return replace(load_vehicle("heu_torpedo"), longest_step=0.1)  # a fifth of the time, and errors of 1e-5


@cache
def driven(seed: int, volts: float = 4.0, rudder: float = 8.0, noise: float = 0.0) -> Record:
    """A run of 40 s from rest with both pairs of fins thrown from side to side."""
    rng, n = np.random.default_rng(seed), 401
    amplitudes = {"rudder_rad": radians(rudder), "stern_plane_rad": radians(8.0)}
    values = {name: np.zeros(n) for name in vehicle().outputs}
    for name, amplitude in amplitudes.items():
        values[name] = bang_bang(n, 0.1, rng, amplitude=max(amplitude, 1e-9), hold_s=(2.0, 10.0))
    values["rudder_rad"] *= rudder > 0.0
    values["propeller_V"] = np.full(n, volts)
    record = simulate(vehicle(), Record.from_arrays(0.1 * np.arange(n), values))
    return record.with_channels({name: record[name] + noise * s * rng.standard_normal(n) for name, s in NOISE.items()})


def runs(noise: float = 0.0) -> tuple[Record, ...]:
    return tuple(driven(seed, noise=noise) for seed in range(6))


def apart(model: Plant, record: Record) -> tuple[float, float]:
    """Horizontal distance of a free run from the record at its end over the path, and rms of depth, m."""
    run = simulate(replace(model, longest_step=0.1), record)
    off = np.hypot(run["north_m"] - record["north_m"], run["east_m"] - record["east_m"])
    path = np.hypot(np.diff(record["north_m"]), np.diff(record["east_m"])).sum()
    return float(off[-1] / path), float(np.sqrt(np.mean((run["depth_m"] - record["depth_m"]) ** 2)))


@cache
def tuned() -> HullFit:
    return HullLsSvm(vehicle(), samples=500).fit(*runs())


@pytest.mark.slow
def test_a_tuned_hull_runs_as_the_vehicle_does():
    fit = tuned()
    assert np.all(fit.shares < [0.005, 0.01, 0.015, 0.005, 0.01, 0.005])
    assert fit.errors == pytest.approx(np.sqrt(np.mean(fit.machines[0].leave_one_out ** 2, axis=0)))
    position, depth = apart(fit.model, driven(50))
    assert position < 0.002
    assert depth < 0.02
    position, depth = apart(fit.model, driven(51, volts=4.5))  # a tenth faster than any of the data
    assert position < 0.01
    assert depth < 0.1
    assert "noise found in the readings: u_mps" in summary(fit)


def test_the_hull_is_the_machine_in_the_units_of_the_vehicle():
    fit = tuned()
    learned = fit.model.learned
    assert learned is not None
    x = fit.targets.velocities[::50]
    assert learned(x) == pytest.approx(fit.machines[0](x / learned.spread), rel=1e-6, abs=1e-6)
    assert fit.model == replace(vehicle(), learned=learned)
    assert len(learned.support) == 500


def test_the_data_are_within_reach_and_faster_runs_are_not():
    learned = tuned().model.learned
    assert learned is not None
    distances = learned.distance(tuned().targets.velocities)
    assert (distances <= 1.0).mean() >= 0.99
    assert distances.max() > 0.5
    assert learned.distance(np.array([[1.6, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0] > 1.0


def test_a_hull_of_few_centres_is_fitted_to_all_samples():
    chosen = tuned().settings[0]
    fit = HullLsSvm(vehicle(), penalty=chosen.penalty, sigma=chosen.sigma, size=150).fit(*runs())
    learned = fit.model.learned
    assert learned is not None
    assert len(learned.support) == 150
    assert len(fit.machines[0].leave_one_out) == len(fit.targets)
    position, depth = apart(fit.model, driven(50))
    assert position < 0.004
    assert depth < 0.05


@pytest.mark.parametrize(
    "settings",
    [
        {"penalty": 1e6, "sigma": 8.0},
        {"penalty": 1e6, "sigma": 8.0, "size": 100},
        pytest.param({}, marks=pytest.mark.slow),
        pytest.param({"size": 100}, marks=pytest.mark.slow),
        pytest.param({"tuning": "leave_one_out"}, marks=pytest.mark.slow),
        pytest.param({"tuning": "leave_one_out", "size": 100}, marks=pytest.mark.slow),
    ],
)
def test_each_force_may_have_a_machine_of_its_own(settings):
    fit = HullLsSvm(vehicle(), samples=250, separate=True, **settings).fit(*runs()[:3])
    learned = fit.model.learned
    assert learned is not None
    assert learned.sigma == pytest.approx([one.sigma for one in fit.settings])
    assert (len(set(fit.settings)) == 1) == ("sigma" in settings)
    x = fit.targets.velocities[::50]
    expected = np.column_stack([machine(x / learned.spread) for machine in fit.machines])
    assert learned(x) == pytest.approx(expected, rel=1e-5, abs=1e-5)  # bells of 1e9 cancel


def test_machines_that_are_alike_are_one():
    given = HullLsSvm(vehicle(), penalty=1e6, sigma=8.0, samples=200)
    together, apart_ = given.fit(*runs()[:2]), replace(given, separate=True).fit(*runs()[:2])
    x = together.targets.velocities[::20]
    assert apart_.model.learned is not None
    assert together.model.learned is not None
    assert apart_.model.learned(x) == pytest.approx(together.model.learned(x), abs=1e-6)  # bells of 1e6 cancel
    assert apart_.errors == pytest.approx(together.errors)


def test_a_mirrored_hull_is_as_strong_to_port_as_to_starboard():
    fit = HullLsSvm(vehicle(), penalty=1e5, sigma=8.0, mirrored=True).fit(driven(0))
    learned = fit.model.learned
    assert learned is not None
    x = np.random.default_rng(0).uniform(-0.1, 0.1, (20, 6)) + [1.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert learned(x * MIRRORED) == pytest.approx(learned(x) * MIRRORED, abs=1e-5)


def test_with_a_trend_the_bells_have_little_left_to_do_and_faster_runs_hold():
    fit = HullLsSvm(vehicle(), penalty=1e4, sigma=8.0, size=200, trend=True).fit(*runs(noise=1.0))
    learned = fit.model.learned
    assert learned is not None
    x = fit.targets.velocities[::50]
    left = fit.machines[0](x / learned.spread)
    assert learned(x) == pytest.approx(left + np.abs(x[:, :1]) * x @ learned.trend, rel=1e-6, abs=1e-6)
    assert np.std(left[:, 1]) < 0.3 * np.std(learned(x)[:, 1])
    position, depth = apart(fit.model, driven(51, volts=4.5))
    assert position < 0.05
    assert depth < 0.5


@pytest.mark.slow
def test_leave_one_out_tunes_for_the_inside():
    loose = HullLsSvm(vehicle(), samples=300, tuning="leave_one_out").fit(*runs()[:3])
    outward = HullLsSvm(vehicle(), samples=300).fit(*runs()[:3])
    assert np.exp(np.mean(np.log(loose.shares / outward.shares))) < 1.0


@pytest.mark.slow
def test_with_noise_it_is_smoother_and_still_runs():
    fit = HullLsSvm(vehicle(), samples=500).fit(*runs(noise=1.0))
    assert fit.settings[0].sigma > 2.0 * tuned().settings[0].sigma
    position, depth = apart(fit.model, driven(50))
    assert position < 0.03
    assert depth < 0.5


def test_it_is_made_by_name_and_saved(tmp_path):
    made = make_estimator("hull_ls_svm", {"penalty": 1e5, "sigma": "10", "samples": 100}, plant=vehicle())
    assert made == HullLsSvm(vehicle(), penalty=1e5, sigma=10.0, samples=100)
    fit = made.fit(driven(0))
    save_model(fit.model, tmp_path / "hull.npz")
    again = load_model(tmp_path / "hull.npz")
    assert isinstance(again, Plant)
    assert isinstance(again.learned, LearnedHull)
    assert np.array_equal(simulate(again, driven(1))["depth_m"], simulate(fit.model, driven(1))["depth_m"])


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"penalty": 1e5}, "tunes penalty and sigma together"),
        ({"penalty": -1.0, "sigma": 1.0}, "needs penalty > 0"),
        ({"penalty": 1.0, "sigma": 0.0}, "finite sigma > 0"),
        ({"tuning": "by hand"}, "tuning to be outward or leave_one_out, got 'by hand'"),
        ({"samples": 10}, "samples of at least 30, got 10"),
        ({"size": 1}, "whole size of 2 or more"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        HullLsSvm(vehicle(), **settings)


def test_runs_in_one_plane_alone_are_refused():
    with pytest.raises(ValueError, match="got v_mps and p_radps and r_radps constant: excite both pairs of fins"):
        HullLsSvm(vehicle()).fit(driven(0, rudder=0.0))
