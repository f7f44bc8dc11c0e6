"""Vehicles that hover: they hold their place in a current, follow steps, and go on with a thruster less."""

from collections.abc import Mapping
from functools import cache

import gymnasium
import numpy as np
import pytest

from auv_gym import load_vehicle, replace_at
from controllers import Excited, autopilot, pilot_for, step_response
from controllers.composed.allocated import Allocated
from controllers.gains import Gains
from controllers.hovering.dynamics import POSE, HoverDynamics, rotation, turning
from controllers.hovering.law import HoverPid
from controllers.trials.trial import at_rest, run_trial

PRESETS = ("bluerov", "bluerov2", "bluerov2_heavy")
HOLD = {"north_m": [(0.0, 0.0)], "east_m": [(0.0, 0.0)], "depth_m": [(0.0, 5.0)], "heading_rad": [(0.0, 0.0)]}
every = pytest.mark.parametrize("name", PRESETS)


@cache
def rov(name: str = "bluerov2_heavy"):
    return load_vehicle(name)


def law_of(controller) -> HoverPid:
    assert isinstance(controller, Allocated)
    assert isinstance(controller.controller, HoverPid)
    return controller.controller


def flown(plant, controller, targets: Mapping = HOLD, duration: float = 40.0, **options) -> dict[str, np.ndarray]:
    return run_trial(plant, controller, targets, duration, start=at_rest(plant, {"depth_m": 5.0}), **options)


def looped(plants, controller, target: Mapping[str, float], read: tuple[str, ...] = ()) -> list[dict[str, float]]:
    """The readings of a run with one plant a sample; read: the channels that the controller gets, by default all."""
    x, u = at_rest(plants[0], {"depth_m": 5.0})
    memory, readings = controller.start(), []
    for plant in plants:
        readings.append(dict(zip(plant.outputs, plant.output(x).tolist(), strict=True)))
        known = {name: value for name, value in readings[-1].items() if not read or name in read}
        command, memory = controller.act(memory, {**known, "dt_s": plant.dt}, target)
        u = np.array([command.get(name, before) for name, before in zip(plant.inputs, u, strict=True)])
        x = plant.step(x, u)
    return readings


def last(run, name: str, target: float, seconds: float = 5.0) -> float:
    """The largest error at the end of a run."""
    return float(np.abs(run[name][run["time_s"] > run["time_s"][-1] - seconds] - target).max())


@every
def test_it_holds_its_place_in_a_current_without_a_steady_error(name):
    current = {"effects.current.north": 0.25, "effects.current.east": -0.166}  # 0.3 m/s
    run = flown(replace_at(rov(name), current), autopilot(rov(name)), duration=60.0)
    assert max(last(run, "north_m", 0.0), last(run, "east_m", 0.0), last(run, "depth_m", 5.0)) < 1e-4
    assert last(run, "heading_rad", 0.0) < 1e-4
    assert np.hypot(run["north_m"], run["east_m"]).max() < 0.15


@every
def test_it_holds_its_place_while_it_turns_in_a_current(name):
    """The integral stays with the current while the body turns; in body axes it would have to be found anew."""
    current = replace_at(rov(name), {"effects.current.north": 0.3})
    targets = {**HOLD, "heading_rad": [(0.0, 0.0), (30.0, 3.0)]}
    run = flown(current, autopilot(rov(name)), targets, 60.0)
    turning_now = run["time_s"] >= 30.0
    assert np.hypot(run["north_m"], run["east_m"])[turning_now].max() < 0.1
    assert last(run, "heading_rad", 3.0) < 1e-3


@every
@pytest.mark.parametrize("channel, size", [*((c, 2.0) for c in POSE[:3]), *((c, 0.4) for c in POSE[3:])])
def test_steps_settle_without_overshoot(name, channel, size):
    plant = rov(name)
    usual = tuple(HOLD)
    try:
        controller = autopilot(plant, targets=tuple(dict.fromkeys((*usual, channel))))
    except ValueError:
        assert (name, channel) == ("bluerov2", "pitch_rad")  # which its six thrusters do not serve
        return
    begin = HOLD.get(channel, [(0.0, 0.0)])[0][1]
    targets = {**HOLD, channel: [(0.0, begin), (2.0, begin + size)]}
    run = flown(plant, controller, targets, 20.0)
    after = run["time_s"] >= 2.0
    step = step_response(run["time_s"][after] - 2.0, run[channel][after], begin + size, 0.05 * size)
    pace = law_of(controller).gains.pace
    i = POSE.index(channel)
    # a critically damped reference comes within 5 % after 4.74 / frequency; at its fastest, size / fastest later
    assert step.settling_time < 6.0 / pace.frequency[i] + size / pace.fastest[i]
    assert step.overshoot < 0.03 * size
    assert abs(step.steady_error) < 1e-3 * size


@pytest.mark.slow
def test_a_lost_thruster_that_is_known_of_does_not_disturb():
    plant = rov()
    broken = replace_at(plant, {"effects.t1.lost": 1.0, "effects.current.north": 0.2, "effects.current.east": -0.2})
    known = flown(broken, autopilot(plant, lost={"t1": 1.0}), duration=60.0)
    unknown = flown(broken, autopilot(plant), duration=60.0)
    for run in (known, unknown):  # the integral finds what is missing even where nobody knows
        assert max(last(run, "north_m", 0.0), last(run, "east_m", 0.0), last(run, "heading_rad", 0.0)) < 1e-4
    assert np.abs(known["heading_rad"]).max() < 0.02
    assert np.abs(unknown["heading_rad"]).max() > 0.3
    assert (known["t1_share"] == 0.0).all()
    half = flown(
        replace_at(plant, {"effects.t1.lost": 0.5, "effects.current.north": 0.2}), autopilot(plant, lost={"t1": 0.5})
    )
    assert np.abs(half["heading_rad"]).max() < 0.01


def test_noise_of_its_sensors_moves_it_little():
    run = flown(rov(), autopilot(rov()), rng=np.random.default_rng(0))
    assert max(np.std(run["depth_m"]), np.std(run["heading_rad"])) < 0.01


def test_poles_are_where_frequency_and_damping_say():
    controller = autopilot(rov(), frequency={"surge": 0.8, "yaw": 1.2}, damping=0.7)
    gains, dynamics = law_of(controller).gains, law_of(controller).dynamics
    for i, frequency in ((0, 0.8), (5, 1.2)):
        mass, damping = dynamics.mass[i, i], dynamics.damping[i]
        poles = np.roots([mass, damping + gains.derivative[i], gains.proportional[i], gains.integral[i]])
        pair = frequency * (-0.7 + 1j * np.sqrt(1.0 - 0.49))
        np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex([pair, pair.conjugate(), -0.2 * frequency]))
    assert gains.derivative[2] == law_of(autopilot(rov(), damping=0.7)).gains.derivative[2]  # heave was not named


def test_the_feedforward_is_what_the_hull_of_the_paper_resists_with():
    dynamics = law_of(autopilot(rov())).dynamics
    np.testing.assert_allclose(
        dynamics.resistance(np.array([0.4, 0, 0, 0, 0, 0]), 0.0, 0.0)[0], 13.7 * 0.4 + 141 * 0.16, rtol=1e-3
    )
    still = dynamics.resistance(np.zeros(6), 0.1, 0.0)
    assert still[3] == pytest.approx(131.588 * 0.01 * np.sin(0.1), rel=1e-3)
    assert dynamics.resistance(np.zeros(6), 0.0, 0.0)[2] == pytest.approx(131.588 - 13.5 * 9.82, abs=1e-3)
    assert dynamics.stiffness[3:5] == pytest.approx([1.316, 1.316], rel=1e-3)


def test_without_feedforward_a_step_overshoots():
    """What is fed forward is there for this: the PID alone would push on."""
    plant, targets = rov(), {**HOLD, "north_m": [(0.0, 0.0), (2.0, 2.0)]}
    whole = autopilot(plant)

    class Weightless(HoverDynamics):
        def resistance(self, velocity, roll, pitch, depth=0.0):
            return np.zeros(6)

    law = law_of(whole)
    bare = Allocated(
        HoverPid(Weightless(plant, law.dynamics.allocation), law.gains, law.channels, law.level),
        whole.allocation,
        whole.thrusters,
    )
    with_, without = (flown(plant, c, targets, 20.0)["north_m"].max() - 2.0 for c in (whole, bare))
    assert with_ < 0.01
    assert without > 0.05


@pytest.mark.slow
def test_what_thrusters_cannot_reach_is_not_integrated():
    """A pull of 150 N for 20 s, more than the thrusters have, then none: it comes back without shooting over."""
    plant = rov()
    pulled = replace_at(plant, {"effects.load.force_x": -150.0})

    def came_back(controller) -> float:
        target = {name: steps[0][1] for name, steps in HOLD.items()}
        readings = looped([pulled] * 400 + [plant] * 1200, controller, target)
        return max(reading["north_m"] for reading in readings[400:])

    class Deaf:
        """A controller that is not told what was short."""

        def __init__(self, inner):
            self.inner = inner

        def start(self):
            return self.inner.start()

        def act(self, state, reading, target):
            heard = {name: value for name, value in reading.items() if "_short_" not in name}
            return self.inner.act(state, heard, target)

    whole = autopilot(plant)
    deaf = Allocated(Deaf(law_of(whole)), whole.allocation, whole.thrusters)
    assert came_back(whole) < 0.1 * came_back(deaf)


def test_a_channel_without_target_is_left_alone_and_roll_and_pitch_are_kept_level():
    controller = autopilot(rov(), targets=("depth_m",))
    reading = {"depth_m": 5.0, "roll_rad": 0.1, "pitch_rad": 0.0, "heading_rad": 1.0, "dt_s": 0.05}
    command, _ = controller.act(controller.start(), reading, {"depth_m": 5.0})
    world = rotation(0.1, 0.0, 1.0) @ [command["surge_cmd_N"], command["sway_cmd_N"], command["heave_cmd_N"]]
    assert np.abs(world[:2]).max() < 1e-9
    assert world[2] == pytest.approx(131.588 - 13.5 * 9.82, abs=1e-3)  # its weight under water
    assert command["yaw_cmd_Nm"] == 0.0
    assert command["roll_cmd_Nm"] < 0.0
    quiet, _ = controller.act(controller.start(), reading, {})
    assert quiet["heave_cmd_N"] == 0.0


def test_without_speed_sensors_it_takes_differences():
    plant, controller = rov(), autopilot(rov())
    target = {"north_m": 1.0, "east_m": 0.0, "depth_m": 5.0, "heading_rad": 0.5}
    reading = looped([plant] * 400, controller, target, POSE)[-1]
    assert reading["north_m"] == pytest.approx(1.0, abs=0.01)
    assert reading["heading_rad"] == pytest.approx(0.5, abs=0.01)


def test_a_missing_reading_is_bridged():
    controller = autopilot(rov())
    reading = dict.fromkeys(rov().outputs, 0.0) | {"dt_s": 0.05}
    target = {name: steps[0][1] for name, steps in HOLD.items()}
    _, memory = controller.act(controller.start(), reading, target)
    command, memory = controller.act(memory, {**reading, "north_m": np.nan, "u_dvl_mps": np.nan}, target)
    assert np.isfinite(list(command.values())).all()
    command, _ = controller.act(memory, reading, target)
    assert np.isfinite(list(command.values())).all()


def test_a_signal_at_the_wrench_moves_the_thrusters_by_that():
    plant, signal = rov(), np.full(10, 6.0)
    plain = autopilot(plant)
    excited = Excited(plain, {"heave_N": signal}, plant.dt)
    reading = {**dict.fromkeys(plant.outputs, 0.0), "dt_s": plant.dt}
    target = dict.fromkeys(HOLD, 0.0)
    one, _ = plain.act(plain.start(), reading, target)
    other, _ = excited.act(excited.start(), reading, target)
    assert other["heave_N"] - one["heave_N"] == pytest.approx(6.0)
    assert other["excitation_heave_N"] == 6.0
    assert other["t5_share"] != one["t5_share"]
    with pytest.raises(ValueError, match="No place for an excitation of rudder_rad"):
        Excited(plain, {"rudder_rad": signal}, plant.dt)


@every
def test_plans_hold_depth_and_heading_without_offset(name):
    plant = replace_at(rov(name), {"effects.load.net_buoyancy": 5.0, "effects.load.moment_z": 0.5})
    targets = {"depth_m": [(0.0, 5.0), (10.0, 6.0)], "heading_rad": [(0.0, 0.0), (10.0, 1.0)]}
    run = flown(plant, autopilot(rov(name), "gpc", ("depth_m", "heading_rad")), targets, 40.0)
    assert last(run, "depth_m", 6.0) < 1e-3
    assert last(run, "heading_rad", 1.0) < 1e-3
    assert run["depth_m"].max() < 6.1
    assert run["heading_rad"].max() < 1.1


def test_plans_hold_a_place_in_a_current():
    current = replace_at(rov(), {"effects.current.north": 0.2, "effects.current.east": -0.2})
    run = flown(current, autopilot(rov(), "gpc"), duration=40.0)
    assert max(last(run, "north_m", 0.0), last(run, "east_m", 0.0)) < 1e-4
    assert max(np.abs(run["roll_rad"]).max(), np.abs(run["pitch_rad"]).max()) < 0.1


def test_rotations_are_those_of_the_simulator():
    from auv_gym.physics.frames import euler_rates, velocity_ned

    rng = np.random.default_rng(4)
    for roll, pitch, heading in rng.uniform(-1.2, 1.2, (5, 3)):
        body = rng.standard_normal(3)
        np.testing.assert_allclose(rotation(roll, pitch, heading) @ body, velocity_ned(*body, roll, pitch, heading))
        rates = euler_rates(*body, roll, pitch)
        np.testing.assert_allclose(turning(roll, pitch) @ rates, body, atol=1e-12)


@pytest.mark.parametrize(
    "name, settings, words",
    [
        ("bluerov2", {"targets": ("depth_m", "pitch_rad")}, "do not serve pitch_Nm, which pitch_rad takes"),
        ("bluerov", {"lost": {"t6": 1.0}}, "that are left do not serve sway_N"),
        ("bluerov", {"lost": {"t9": 1.0}}, "no thruster 't9' that could be lost"),
        ("bluerov", {"lost": {"t1": 2.0}}, "lost share of t1 is between 0 and 1"),
        ("bluerov", {"frequency": -1.0}, "frequency= needs a number in rad/s above 0"),
        ("bluerov", {"frequency": {"forward": 1.0}}, "by axis"),
        ("bluerov", {"damping": 0.0}, "damping= needs a ratio such as 1 above 0"),
        ("bluerov", {"gains": "mine.toml"}, "File of gains mine.toml cannot be used"),
        ("bluerov", {"pitch_limit": 0.2}, "for vehicles that dive by pitch"),
        ("bluerov", {"targets": ("u_mps",)}, "has no loop for 'u_mps'"),
    ],
)
def test_settings_that_cannot_be_are_refused(name, settings, words):
    with pytest.raises(ValueError, match=words):
        autopilot(rov(name), **settings)


def test_a_setting_that_a_law_does_not_have_is_no_setting():
    with pytest.raises(TypeError, match="frequency"):
        autopilot(load_vehicle("remus100"), frequency=1.0)
    with pytest.raises(ValueError, match="S-plane control is there for"):
        autopilot(rov(), "s_plane")


@pytest.mark.parametrize("kind", ["pid", "gpc"])
def test_a_sample_in_which_the_vehicle_swings_is_refused(kind):
    with pytest.raises(ValueError, match=r"swings about level with 1\.9 rad/s, .* at least every 0\.32 s, got 0\.5 s"):
        autopilot(load_vehicle("bluerov2_heavy", dt=0.5), kind)
    slow = load_vehicle("bluerov2_heavy", dt=0.2)
    run = flown(slow, autopilot(slow, kind), {**HOLD, "north_m": [(0.0, 0.0), (5.0, 1.0)]}, 60.0)
    assert last(run, "north_m", 1.0) < 0.02


@pytest.mark.parametrize("task", ["StationKeeping", "Pose"])
@pytest.mark.parametrize(
    "name, kind",
    [
        ("bluerov2_heavy", "pid"),
        ("bluerov2_heavy", "gpc"),
        ("bluerov2", "pid"),
    ],
)
def test_it_steers_the_environments_of_such_vehicles(task, name, kind):
    env = gymnasium.make(f"auv_gym/{task}-v0", vehicle=name, duration=40.0)
    act = pilot_for(env, kind).begin(env)
    observation, info = env.reset(seed=5)
    ended, away = False, np.inf
    while not ended:
        observation, _, terminated, truncated, info = env.step(act(observation, info))
        ended = terminated or truncated
        away = max(abs(info["state"][n] - info["target"][n]) for n in ("north_m", "east_m", "depth_m"))
    assert info["reason"] == ""
    assert away < 0.01


def test_actions_that_a_controller_does_not_command_are_refused():
    env = gymnasium.make("auv_gym/Heading-v0", vehicle="remus100", actions=["rudder_rad", "propeller_rpm"])
    with pytest.raises(ValueError, match=r"of this environment are rudder_rad, propeller_.*: leave out actions="):
        pilot_for(env, "pid")


def test_gains_have_frequency_and_damping_by_axis_and_settings_go_before_them():
    axes = {"yaw": {"frequency": 1.1, "damping": 1.5}, "heave": {"frequency": 0.7}}
    gains = Gains("bluerov2_heavy", 0.05, loops={"pid": axes})
    frequency, damping = {"yaw": 1.1, "heave": 0.7}, {"yaw": 1.5}
    tuned, set_by_hand, plain = (
        law_of(autopilot(rov("bluerov2_heavy"), **settings)).gains
        for settings in ({"gains": gains}, {"frequency": frequency, "damping": damping}, {})
    )
    assert np.array_equal(tuned.proportional, set_by_hand.proportional)
    assert np.array_equal(tuned.derivative, set_by_hand.derivative)
    changed = np.flatnonzero(tuned.proportional != plain.proportional)
    assert changed.tolist() == [2, 5]
    given = law_of(autopilot(rov("bluerov2_heavy"), gains=gains, frequency={"heave": 2.0})).gains
    assert np.array_equal(given.pace.frequency[[2]], [2.0])
