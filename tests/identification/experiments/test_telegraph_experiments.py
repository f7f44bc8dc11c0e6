"""Tests of telegraph experiments with hovering vehicles: the excitation, the log, and the models identified from it."""

import tomllib
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from auv_gym import load_vehicle, replace_at
from auv_gym.param import value_at
from auv_gym.plant.thrusters import find_thrusters
from auv_gym.records.record import Record
from controllers import Excited, autopilot
from controllers.allocation import AXES
from identification.campaign.file.plan import plan
from identification.campaign.file.reading import read_campaign
from identification.campaign.file.settings import MissionExperiment, RunSettings
from identification.campaign.running.staging import make_campaign_controller, make_campaign_vehicle, make_env
from identification.estimator import make_estimator
from identification.experiments.driving import drive
from identification.experiments.hovering import hover
from identification.experiments.kinds import KINDS
from identification.experiments.missions import run_mission
from identification.fit.greybox import GreyBox

PRESETS = ("bluerov", "bluerov2", "bluerov2_heavy")


@cache
def rov(name: str = "bluerov2_heavy"):
    return load_vehicle(name)


def telegraphed(plant, seed: int = 0, **settings) -> Record:
    return hover(plant, rng=np.random.default_rng(seed), **settings)


@pytest.mark.parametrize("name", PRESETS)
def test_the_mission_follows_its_steps_with_a_telegraph_signal_along_each_axis(name):
    record = run_mission(rov(name), np.random.default_rng(1), duration=60.0)
    for channel, most in (("north_m", 0.5), ("east_m", 0.5), ("depth_m", 0.4), ("heading_rad", 0.4)):
        away = record[channel] - record[f"{channel.rpartition('_')[0]}_cmd_{channel.rpartition('_')[2]}"]
        assert np.median(np.abs(away)) < most
    served = autopilot(rov(name)).allocation.counts
    for axis in AXES:
        assert record.has(f"excitation_{axis}") == (axis in served)
    for axis in served:
        sides = np.unique(np.round(record[f"excitation_{axis}"], 9))
        assert sides.size == 2
        assert sides[0] == -sides[1] != 0.0
    assert max(np.abs(record["roll_rad"]).max(), np.abs(record["pitch_rad"]).max()) < 1.0
    assert record["depth_m"].min() > 3.0


def test_the_wrench_in_a_log_is_that_of_the_commands_in_it():
    for settings in ({}, {"loop": "open"}):
        record = telegraphed(rov(), duration=5.0, **settings)
        thrusters = find_thrusters(rov())
        commands = np.stack([record[name] for name in thrusters.channels]).T
        wrench = np.array([thrusters.wrench @ thrusters.thrusts(row) for row in commands])
        np.testing.assert_allclose(np.stack([record[name] for name in AXES]).T, wrench, atol=1e-9)


def test_one_seed_is_one_experiment_whatever_the_effects():
    one, again, moved = (
        telegraphed(plant, 2, duration=20.0)
        for plant in (rov(), rov(), replace_at(rov(), {"effects.t1.lost": 0.3, "effects.current.north": 0.1}))
    )
    np.testing.assert_array_equal(one["depth_m"], again["depth_m"])
    for name in ("north_cmd_m", "heading_cmd_rad", "excitation_heave_N", "excitation_yaw_Nm"):
        np.testing.assert_array_equal(one[name], moved[name])
    assert np.abs(one["north_m"] - moved["north_m"]).max() > 0.01


@pytest.mark.parametrize("loop", ["closed", "open"])
def test_with_attitude_alone_measured_nothing_else_is_in_the_log_or_steered(loop):
    record = telegraphed(rov(), duration=20.0, measured="attitude", loop=loop)
    motion = {name for name in record.names if name in rov().outputs}
    assert motion == {"roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps"}
    assert not record.has("depth_cmd_m")
    if loop == "closed":
        assert np.abs(record["heave_N"]).max() < 1e-9
        assert record.has("excitation_yaw_Nm")
        assert not record.has("excitation_heave_N")


def test_depth_alone_lets_heave_be_excited():
    record = telegraphed(rov(), duration=20.0, measured="depth")
    assert record.has("excitation_heave_N")
    assert not record.has("excitation_surge_N")
    assert not record.has("w_mps")


@pytest.mark.parametrize("name", PRESETS)
def test_in_open_loop_each_thruster_has_a_signal_and_the_vehicle_stays_upright(name):
    plant = rov(name)
    record = telegraphed(plant, duration=60.0, loop="open")
    for channel in find_thrusters(plant).channels:
        assert np.unique(record[channel]).size == 2
    assert np.sqrt(np.mean(record["roll_rad"] ** 2 + record["pitch_rad"] ** 2)) < 0.6
    assert np.abs(record["depth_m"] - 10.0).max() < 5.0


def test_signals_take_a_share_of_the_authority_where_that_does_not_carry_the_vehicle_off():
    law = autopilot(rov()).controller
    small = telegraphed(rov(), duration=5.0, amplitude=0.01)
    for axis in AXES:
        assert small[f"excitation_{axis}"].max() == pytest.approx(0.01 * law.dynamics.authority[AXES.index(axis)])
    large = telegraphed(rov(), duration=5.0, amplitude=1.0)
    assert large["excitation_surge_N"].max() == pytest.approx(0.3 * law.gains.proportional[0])
    held = law.gains.proportional[3] + law.dynamics.stiffness[3]
    assert large["excitation_roll_Nm"].max() == pytest.approx(0.15 * held)
    none = telegraphed(rov(), duration=5.0, amplitude=0.0)
    assert not any(name.startswith("excitation_") for name in none.names)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"loop": "half"}, "needs loop among closed, open"),
        ({"measured": "nothing"}, "needs measured among all, depth, attitude"),
        ({"amplitude": 1.5}, "amplitude from 0 to 1"),
        ({"axes": ["heave_N"], "measured": "attitude"}, "cannot excite 'heave_N'"),
        ({"dwell": 0.01}, "dwell_s above one sample"),
        ({"duration": 0.01}, r"^duration must be at least two samples \(0.1 s\), got 0.01 s\.$"),
        ({"duration": "x"}, "duration needs a number above 0 in s, got 'x'"),
    ],
)
def test_what_cannot_be_flown_is_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        telegraphed(rov(), **settings)
    with pytest.raises(ValueError, match="needs a vehicle with thrusters"):
        telegraphed(load_vehicle("remus100"))


def test_designs_are_missions_that_can_be_flown():
    kind = KINDS.of(rov().family)
    for design in kind.designs(rov()):
        experiment = design.tables(rov(), 5.0)["experiment"]
        assert experiment.pop("kind") == "mission"
        assert len(run_mission(rov(), np.random.default_rng(0), **experiment)) == 101


def test_an_environment_is_driven_with_a_signal_at_the_wrench():
    env = gymnasium.make("auv_gym/StationKeeping-v0", duration=10.0)
    plant = env.unwrapped.plant
    signal = np.where(np.arange(400) // 20 % 2 == 0, 8.0, -8.0)
    run = drive(env, Excited(autopilot(plant), {"heave_N": signal}, plant.dt), seed=0)
    flips = np.diff(run.record["excitation_heave_N"])
    moved = np.diff(run.record["heave_N"])[flips != 0.0] / flips[flips != 0.0]
    assert moved == pytest.approx(1.0, abs=0.1)  # what the loop itself does in a sample is a tenth of it
    assert np.abs(run.truth["depth_m"] - run.record["depth_cmd_m"]).max() < 0.2


def test_a_campaign_excites_the_wrench_of_an_environment():
    settings = RunSettings.model_validate(
        {
            "experiment": {"kind": "env", "id": "StationKeeping", "duration_s": 5.0},
            "vehicle": {"preset": "bluerov2_heavy"},
            "controller": {"kind": "pid", "lost": {"t1": 1.0}},
            "excitation": ({"kind": "telegraph", "at": "yaw_Nm", "amplitude": 1.0, "dwell_s": 0.5},),
            "seed": 3,
        }
    )
    env = make_env(settings, None)
    run = drive(env, make_campaign_controller(settings, env), seed=3)
    assert set(np.unique(run.record["excitation_yaw_Nm"])) == {-1.0, 1.0}
    assert (run.record["t1_share"] == 0.0).all()


def recovered(truth: dict[str, float], **settings) -> None:
    fit = GreyBox(rov(), tuple(truth)).fit(telegraphed(replace_at(rov(), truth), **settings))
    for path, value in truth.items():
        low, high = fit[path].ci95
        assert low <= value <= high, (path, low, value, high)
        assert abs(value - value_at(rov(), path)) > 10.0 * fit[path].error  # the log tells it from what was given


def test_a_grey_box_finds_yaw_damping_inertia_buoyancy_thrust_and_arms_from_attitude_and_rates_in_open_loop():
    truth = {"hull.yaw.r_r": -1.2, "hull.added_mass.n_rdot": -0.3, "hull.z_b": -0.014}
    truth |= {"effects.t1.lost": 0.15, "parts.t5.y": 0.25}
    recovered(truth, duration=30.0, measured="attitude", loop="open")


@pytest.mark.slow
def test_a_grey_box_finds_damping_and_added_mass_from_all_sensors_in_closed_loop():
    recovered({"hull.surge.u_u": -110.0, "hull.added_mass.z_wdot": -15.0}, duration=21.0)


def linear_yaw():
    """A vehicle whose yaw is I r' + 1 r = N, without delay at its thrusters."""
    changes = {f"parts.t{k}.lag": 0.0 for k in range(1, 9)}
    return replace_at(rov(), {"hull.yaw.r_r": 0.0, "hull.yaw.r": -1.0, **changes})


@pytest.mark.parametrize("method, settings", [("arx", {"n_a": 1, "n_b": 1}), ("n4sid", {"order": 1, "refine": True})])
def test_linear_methods_find_the_pole_and_the_gain_of_yaw(method, settings):
    record = telegraphed(linear_yaw(), 1, duration=60.0, measured="attitude", axes=["yaw_Nm"])
    fit = make_estimator(method, settings, inputs=["yaw_Nm"], outputs=["r_radps"]).fit(record)
    model = fit.model if method == "n4sid" else fit.model.to_state_space()
    gain = float((model.c @ np.linalg.solve(np.eye(len(model.a)) - model.a, model.b)).item())
    low, high = sorted(abs(limit) for limit in fit.estimates[0].ci95)  # a1, which is less the pole, or the pole
    assert low <= np.exp(-0.05 * 1.0 / (0.37 + 0.222)) <= high
    assert gain == pytest.approx(1.0, abs=1e-3)  # four standard errors of the gain that N4SID states


def test_the_campaign_of_a_telegraph_experiment_can_be_run():
    """Its run, for ten seconds, has what its fits need."""
    file = Path(__file__).parents[3] / "scripts" / "campaigns" / "rov_telegraph.toml"
    runs = plan(read_campaign(file))
    assert [run.seed for run in runs] == [1, 2]
    experiment, given = runs[0].settings.experiment, runs[0].settings.vehicle
    assert isinstance(experiment, MissionExperiment)
    assert given is not None
    settings = experiment.settings | {"duration": 10.0}
    vehicle = make_campaign_vehicle(given, file.parent)
    record = run_mission(vehicle, np.random.default_rng(1), **settings)
    fits = tomllib.loads(file.read_text(encoding="utf-8"))["fit"]
    assert all(record.has(name) for fit in fits for name in (*fit.get("inputs", ()), *fit.get("outputs", ())))
    assert vehicle.effects.t1.lost == 0.1
