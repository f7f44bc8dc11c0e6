from dataclasses import dataclass
from math import pi

import gymnasium
import numpy as np
import pytest

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.channels import channel, set_point_of, truth_of
from auv_gym.model import simulate
from auv_gym.plant import load_vehicle
from controllers.pid import Pid, float_depth_pid, heading_pid
from identification.experiments.driving import checked_steps, commanded, drive, versions_used


@dataclass(frozen=True)
class Fixed:
    """Commands that never change, beside a report that counts the calls and a list of what was heard."""

    command: dict
    heard: list

    def start(self):
        return 0

    def act(self, state, reading, target):
        self.heard.append((dict(reading), dict(target)))
        return {**self.command, "calls_s": float(state)}, state + 1


def made(name, **options):
    return gymnasium.make(f"auv_gym/{name}-v0", **options)


def test_names_of_set_points_and_truths():
    assert set_point_of("depth_m") == "depth_cmd_m"
    assert set_point_of("u_mps") == "u_cmd_mps"
    assert set_point_of("heading_rad") == "heading_cmd_rad"
    assert truth_of("heading_rad") == "heading_true_rad"
    assert channel("heading_true_rad").angle
    assert channel("u_cmd_mps").held
    assert channel("excitation_stern_plane_rad").held
    assert not channel("u_true_mps").held
    with pytest.raises(ValueError, match="unit"):
        set_point_of("depth")


def test_a_record_row_holds_a_reading_and_the_command_that_follows_it():
    env = made("GliderHeading", duration=200.0)
    plant = env.unwrapped.plant
    run = drive(env, heading_pid(plant), seed=4)
    record = run.record
    assert run.reason == ""
    assert len(record) == 51
    np.testing.assert_array_equal(np.diff(record.time), 4.0)
    # the plant, told the recorded commands, goes where it went: any shift of rows would show
    replayed = simulate(plant, record)
    np.testing.assert_allclose(replayed["heading_rad"], record["heading_rad"], atol=1e-9)
    np.testing.assert_allclose(run.truth["heading_rad"], record["heading_rad"], atol=1e-9)
    assert record["rudder_rad"][-1] == record["rudder_rad"][-2]
    assert record.has("heading_cmd_rad")
    assert record.attrs["env"] == "auv_gym/GliderHeading-v0"
    assert record.attrs["seed"] == 4
    assert record.attrs["versions"] == versions_used()


def test_the_same_seed_is_the_same_run():
    runs = [
        drive(made("FloatDepth", duration=60.0), float_depth_pid(made("FloatDepth").unwrapped.plant), seed=s)
        for s in (3, 3, 4)
    ]
    np.testing.assert_array_equal(runs[0].record["depth_m"], runs[1].record["depth_m"])
    assert not np.array_equal(runs[0].record["depth_m"], runs[2].record["depth_m"])


def test_uneven_samples_reach_the_controller_and_the_record():
    env = made("FloatDepth", duration=120.0, near=(2.0, 0.35), depths=(1.0, 20.0))
    heard = []
    steps = {"depth_m": [(0.0, 6.0), (60.0, 30.0)]}
    run = drive(env, Fixed({"piston_m": 0.5}, heard), seed=1, targets=steps, start={"depth_m": 5.0})
    intervals = np.diff(run.record.time)
    assert set(np.round(intervals, 6)) == {0.35, 0.7}
    told = [reading["dt_s"] for reading, _ in heard]
    np.testing.assert_allclose(told[1:], intervals[: len(told) - 1])
    assert [target["depth_m"] for _, target in heard] == [
        6.0 if t < 60.0 else 30.0 for t in run.record.time[: len(heard)]
    ]
    assert run.record["depth_m"][0] == 5.0
    np.testing.assert_array_equal(run.record["calls_s"][:-1], np.arange(len(heard)))


def test_inputs_that_nobody_touches_are_not_recorded():
    record = drive(made("FloatDepth", duration=30.0), Fixed({"piston_m": 0.5}, []), seed=1).record
    assert {n for n in record.names if channel(n).kind == "input"} == {"piston_m"}


def test_a_torpedo_keeps_the_commands_of_held_fins():
    env = made("Depth", duration=30.0)
    assert commanded(env) == ("stern_plane_rad",)
    run = drive(env, Fixed({"stern_plane_rad": 9.0}, []), seed=2, start={"heading_rad": 0.3, "depth_m": 30.0})
    limit = env.unwrapped.plant.parts.stern_plane.limit
    assert run.record["stern_plane_rad"].max() == pytest.approx(limit)  # what the vehicle got, not what was asked
    assert run.record.has("rudder_rad")
    assert run.truth["heading_rad"][0] == pytest.approx(0.3)


def test_a_cut_episode_keeps_its_rows_and_says_why():
    env = made("Depth", duration=300.0)
    run = drive(env, Fixed({"stern_plane_rad": -9.0}, []), seed=2, start={"depth_m": 10.0})
    assert run.reason
    assert run.record.attrs["reason"] == run.reason
    assert np.isfinite(run.record["depth_m"]).all()
    assert run.record.time[-1] < 299.0
    assert float(run.record.time[-1]) == run.truth.time[-1]


def test_a_controller_that_does_not_match_the_environment_is_said():
    slocum = heading_pid(load_vehicle("slocum"))
    with pytest.raises(ValueError, match=r"does not follow a target of 'depth_m'.*It follows heading_rad"):
        drive(made("GliderHeading"), slocum, seed=1, targets={"depth_m": [(0.0, 5.0)]})
    with pytest.raises(ValueError, match="Pid needs a reading of depth_m, got readings of heading_rad"):
        drive(made("GliderHeading"), Pid(1.0, measured="depth_m"), seed=1)

    class Own(Pid):
        def act(self, state, reading, target):
            return {self.command: reading["depth_m"]}, state

    with pytest.raises(ValueError, match="The controller needs 'depth_m', which is not among the readings"):
        drive(made("GliderHeading"), Own(1.0, measured="heading_rad"), seed=1)
    with pytest.raises(ValueError, match=r"drives environments of auv_gym, .*, got CartPoleEnv"):
        drive(gymnasium.make("CartPole-v1"), slocum, seed=1)


def test_what_does_not_fit_is_said():
    with pytest.raises(ValueError, match=r"waits for rudder_rad.*commands piston_m"):
        drive(made("GliderHeading"), Fixed({"piston_m": 0.0}, []), seed=1)
    for wrong in ([(1.0, 2.0)], [], [(0.0, 1.0), (0.0, 2.0)], [(0.0, float("nan"))], 5.0, [(0.0,)]):
        with pytest.raises(ValueError, match="target of depth_m needs"):
            checked_steps("depth_m", wrong)
    with pytest.raises(ValueError, match="'start' has heading_rad, r_radps, north_m, east_m, got 'depth_m'"):
        drive(made("GliderHeading"), Fixed({"rudder_rad": 0.0}, []), seed=1, start={"depth_m": 3.0})
    run = drive(
        made("GliderHeading", duration=20.0), Fixed({"rudder_rad": 0.0}, []), seed=1, start={"heading_rad": pi / 3}
    )
    assert run.record["heading_rad"][0] == pytest.approx(pi / 3)
