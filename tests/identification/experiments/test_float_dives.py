"""Simulated dives of floats: what they record, and that the plant's own rollout repeats them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from auv_gym.model import Diverged, inputs_of, simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from controllers.pid import Pid
from identification.experiments.float_dives import Swim, depth_control, oil_mission, summer_lake, summer_sea

NOISELESS = {"noise": 0.0, "temperature_profile": summer_lake}


def dive(targets=(20.0, 10.0), seed=0, changes=(), **settings):
    plant = replace_at(load_vehicle("qiandao_float"), dict(changes))
    return depth_control(plant, targets, rng=np.random.default_rng(seed), **settings)


def mission(seed=0, changes=(), depths=(150.0, 400.0), **settings):
    return oil_mission(
        replace_at(load_vehicle("mermaid"), dict(changes)), depths, rng=np.random.default_rng(seed), **settings
    )


def test_the_record_of_depth_control_is_what_was_asked_for():
    record = dive(hold=[400.0, 300.0])
    assert record.names == ("depth_m", "piston_m", "depth_cmd_m")
    assert record.duration_s == pytest.approx(700.0, abs=0.7)
    assert set(record["depth_cmd_m"]) == {10.0, 20.0}
    assert record["depth_cmd_m"][record.time < 399.0].max() == 20.0
    assert (record["depth_cmd_m"][record.time > 400.7] == 10.0).all()
    assert record["piston_m"].min() >= 0.5
    assert record["piston_m"].max() <= 0.6
    assert record.attrs == {"source": "simulated", "vehicle": "qiandao_float", "depth_noise_m": 0.02}
    warm = dive(temperature_profile=summer_lake)
    np.testing.assert_allclose(warm["temperature_C"], [summer_lake(z) for z in warm["depth_m"]], atol=0.5)


def test_samples_are_closer_near_the_target():
    record = dive()
    near = np.abs(record["depth_m"] - record["depth_cmd_m"]) < 0.8
    np.testing.assert_allclose(np.diff(record.time), np.where(near, 0.36, 0.7)[:-1], atol=1e-9)
    assert 0.2 < near.mean() < 0.9
    other = dive(dt=1.0, near=(2.0, 0.5))
    assert set(np.round(np.diff(other.time), 9)) == {0.5, 1.0}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"effects.piston.dead_time": 6.0, "effects.piston.gain": 1.1},
        {"effects.piston.lag": 4.0, "effects.piston.slowness": 100.0},
        {"effects.piston.backlash": 6e-3},
        {"effects.volume.expansion": 1e-6, "effects.volume.expansion_lag": 60.0},
        {"effects.volume.leak": 1e-8, "effects.water.heave_sin": 0.01, "effects.depth.lag": 2.0},
    ],
)
def test_a_free_run_of_the_same_plant_repeats_the_dive(changes):
    """Sample by sample with uneven commands kept in the state, or in one rollout: the same numbers."""
    record = dive(changes=changes, start=5.0, **NOISELESS)
    run = simulate(replace_at(load_vehicle("qiandao_float"), changes), record)
    np.testing.assert_allclose(run["depth_m"], record["depth_m"], rtol=0.0, atol=1e-9)


def test_the_controller_acts_on_the_noisy_depth():
    pid = Pid(-0.01, measured="depth_m", command="piston_m", limit=0.05, neutral=0.55, middle=0.55)
    record = dive(controller=pid)
    wanted = np.clip(0.55 - 0.01 * (record["depth_cmd_m"] - record["depth_m"]), 0.5, 0.6)
    np.testing.assert_allclose(record["piston_m"], wanted, atol=1e-12)


def test_noise_has_the_stated_size():
    record = dive(noise=0.05, hold=1500.0)
    run = simulate(load_vehicle("qiandao_float"), record)
    assert np.std(np.diff(record["depth_m"] - run["depth_m"])) == pytest.approx(0.05 * np.sqrt(2.0), rel=0.05)


def test_one_seed_is_one_dive():
    one, again, other = dive(seed=3), dive(seed=3), dive(seed=4)
    np.testing.assert_array_equal(one["depth_m"], again["depth_m"])
    assert one["depth_m"][0] != other["depth_m"][0]
    heavy = dive(seed=3, changes={"effects.volume.offset": -2e-5})
    assert one["depth_m"][0] == heavy["depth_m"][0]  # the same noise
    assert heavy["piston_m"][-50:].mean() == pytest.approx(one["piston_m"][-50:].mean() + 0.01, abs=1e-3)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"targets": []}, "needs targets"),
        ({"targets": [10.0, 20.0], "hold": [100.0]}, "needs targets and for each a hold"),
        ({"hold": 0.5}, "longer than a sample"),
        ({"noise": -1.0}, "noise >= 0"),
        ({"dt": -1.0}, "dt > 0"),
        ({"near": (0.8, 0.0)}, "near"),
        ({"targets": [-1.0]}, "from 0 m down"),
    ],
)
def test_depth_control_refuses_bad_settings(settings, words):
    with pytest.raises(ValueError, match=words):
        dive(**settings)


def test_each_experiment_is_for_its_own_floats():
    with pytest.raises(ValueError, match="take oil_mission"):
        depth_control(load_vehicle("mermaid"), [100.0], rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="take depth_control"):
        oil_mission(load_vehicle("qiandao_float"), rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="from 50 to 3000 m"):
        mission(depths=[10.0])
    with pytest.raises(ValueError, match="noise and resolution"):
        mission(noise=-0.1)


def test_a_run_that_leaves_the_finite_numbers_says_so():
    plant = load_vehicle("qiandao_float")
    broken = replace(plant, parameters=replace(plant.parameters, hull=replace(plant.hull, mass=float("nan"))))
    with pytest.raises(Diverged, match="depth_m is not finite"):
        depth_control(
            broken,
            [5.0],
            rng=np.random.default_rng(0),
            hold=20.0,
            controller=Pid(-0.01, measured="depth_m", command="piston_m"),
        )


def test_a_mission_goes_down_parks_and_comes_up():
    record = mission()
    assert record.labels == ["dive 1", "dive 2"]
    for segment, target in zip(record.segments, (150.0, 400.0), strict=True):
        depth, time = record["depth_m"][segment], record.time[segment]
        assert time[0] == 0.0
        assert 3.0 < depth[0] < 9.0
        assert target <= depth.max() + 1.0 < target + 150.0
        assert depth[-1] < 15.0
        assert np.diff(record["oil_volume_m3"][segment]).min() > -26e-6
        assert np.diff(record["oil_volume_m3"][segment]).max() > 40e-6
        assert (np.diff(time) <= 325.0 + 1e-9).all()
        shallow = record["depth_m"][segment] < 60.0
        assert np.diff(time)[shallow[:-1]].max() <= 60.0
    np.testing.assert_allclose(
        record["oil_volume_m3"], record["pumped_volume_m3"] - record["valved_volume_m3"], atol=1e-15
    )
    assert np.round(record["depth_m"] / 0.01) * 0.01 == pytest.approx(record["depth_m"])


def test_valved_volume_is_summed_with_its_depth():
    record = mission()
    for segment in record.segments:
        steps = np.diff(record["valved_volume_m3"][segment], prepend=0.0)
        expected = np.cumsum(steps * record["depth_m"][segment])
        np.testing.assert_allclose(record["valved_depth_m4"][segment], expected, rtol=1e-9)


@pytest.mark.parametrize("changes", [{}, {"effects.volume.expansion": 1e-6, "effects.volume.expansion_lag": 600.0}])
def test_a_free_run_with_the_dives_own_volume_repeats_it(changes):
    plant = replace_at(load_vehicle("mermaid"), changes)
    record = oil_mission(plant, [300.0], rng=np.random.default_rng(1), noise=0.0, resolution=0.0)
    depth = record["depth_m"]

    def run(volume):
        return plant.run(record, record.segments, np.array([[depth[0], 0.05, volume]]))[:, 0]

    volume = float(np.asarray(brentq(lambda v: run(v)[10] - depth[10], -200e-6, -50e-6, xtol=1e-16)))
    assert -150e-6 < volume < -90e-6
    np.testing.assert_allclose(run(volume), depth, atol=1e-6)


def test_missions_of_floats_that_lack_something_end_as_well():
    for changes in ({"effects.volume.compressibility": 1.5e-7}, {"effects.volume.compressibility": -1e-7}):
        record = mission(changes=changes, depths=(500.0,))
        assert record["depth_m"][-1] < 15.0
    again = mission(depths=(500.0,))
    assert again["depth_m"][0] == mission(depths=(500.0,))["depth_m"][0]


def test_profiles_are_warm_above_and_cold_below():
    for profile in (summer_lake, summer_sea):
        values = [profile(z) for z in np.linspace(0.0, 100.0, 50)]
        assert (np.diff(values) <= 0.0).all()
        assert values[0] - values[-1] > 8.0


def test_a_swim_keeps_the_times_of_its_commands():
    plant = replace(replace_at(load_vehicle("qiandao_float"), "effects.piston.dead_time", 2.0), dt=0.5)
    swim = Swim.start(plant, 10.0)
    for duration in (0.5, 0.7, 0.36):
        swim = swim.onward({"piston_m": 0.55}, duration)
    np.testing.assert_allclose(swim.given[-3:], [0.0, 0.5, 1.2])
    assert swim.time == pytest.approx(1.56)
    assert "elapsed_s" in plant.inputs
    assert inputs_of(plant, dive()).shape[1] == len(plant.inputs)
