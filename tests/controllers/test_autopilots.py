"""Autopilots of every preset: they settle, with noise and on changed vehicles; and what they refuse."""

from dataclasses import replace
from math import radians
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import list_vehicles, load_vehicle, save_vehicle
from auv_gym.plant.cruise import command_ranges, find_cruise
from controllers.autopilots import autopilot, usual_autopilot
from controllers.composed.scheduled import Scheduled
from controllers.controller import Controller
from controllers.gains import Gains, gains_for, read_gains, write_gains
from controllers.kinds import KINDS
from controllers.kinds.body import steady_speed_commands
from controllers.predictive.gpc import Gpc
from controllers.trials.settling import step_response
from controllers.trials.trial import NOISE, at_rest, level_flight, run_trial

DEEP = 50.0  # m, where torpedoes start
FILES = {"tethys": Path(__file__).parents[2] / "examples" / "vehicles" / "tethys.toml"}  # gains of vehicles in files
ENTRIES = [(entry.vehicle, entry.dt) for entry in read_gains()]
TORPEDOES = [entry for entry in ENTRIES if entry[0] in FILES or load_vehicle(entry[0]).family.kind == "body"]


def compiled(vehicle: str, *others: object):
    """A case, slow where the vehicle is compiled for this test only: that of a file."""
    return pytest.param(vehicle, *others, marks=[pytest.mark.slow] * (vehicle in FILES))


LOOPS = [compiled(e.vehicle, e.dt, kind) for e in read_gains() if (e.vehicle, e.dt) in TORPEDOES for kind in e.loops]
# s after which depth, heading and speed are within 5 % of a step of `torpedo_run`, or two standard deviations of noise
SETTLED = {
    ("heu_torpedo", 0.1): (30.0, 10.0, 5.0),
    ("npsauv", 0.1): (45.0, 25.0, 60.0),
    ("npsauv", 4.0): (50.0, 40.0, 60.0),
    ("remus100", 0.1): (25.0, 8.0, 5.0),
    ("tethys", 0.2): (30.0, 12.0, 10.0),
    ("vt690", 0.1): (25.0, 12.0, 5.0),
}
OVERSHOOT = {"depth_m": 0.05, "heading_rad": 0.06, "u_mps": 0.15}  # of the step
# s, from the first value to the second
OTHERS = {
    "slocum": (0.0, 0.9, 60.0),
    "ganeshblue": (0.0, 0.9, 30.0),
    "ganeshblue_corrected": (0.0, 0.9, 120.0),
    "qiandao_float": (20.0, 40.0, 300.0),
    "mermaid": (200.0, 300.0, 3000.0),
}


def torpedo_run(plant, kind="pid", side=1.0, noise=NOISE, on=None):
    """Three lengths deeper and 50 deg aside at once, then 15 % slower by itself; on: the plant flown, if another."""
    cruise, on = find_cruise(plant), plant if on is None else on
    duration = 60.0 * max(plant.hull.length / cruise.speed, 2.0 * plant.dt)
    controller, start = autopilot(plant, kind), level_flight(on, DEEP)
    deeper, aside, slower = DEEP + 3.0 * plant.hull.length, side * radians(50.0), 0.85 * cruise.speed
    runs = [
        run_trial(on, controller, targets, duration, start=start, rng=np.random.default_rng(5), noise=noise)
        for targets in (
            {"depth_m": [(0.0, deeper)], "heading_rad": [(0.0, aside)], "u_mps": [(0.0, cruise.speed)]},
            {"depth_m": [(0.0, DEEP)], "heading_rad": [(0.0, 0.0)], "u_mps": [(0.0, slower)]},
        )
    ]
    result = {}
    for name, target, before, run in (
        ("depth_m", deeper, DEEP, runs[0]),
        ("heading_rad", aside, 0.0, runs[0]),
        ("u_mps", slower, cruise.speed, runs[1]),
    ):
        size = abs(target - before)
        band = max(0.05 * size, 2.0 * NOISE[name])
        result[name] = step_response(run["time_s"], run[name], target, band), size
    return runs[0], result


def test_every_preset_has_gains_at_its_own_sample_time_or_needs_none():
    plants = [
        plant for plant in map(load_vehicle, list_vehicles()) if plant.family.body is None or plant.family.body.piloted
    ]
    tuned = [plant for plant in plants if KINDS.of(plant.family).placed is None]
    assert {(plant.name, plant.dt) for plant in tuned} <= set(ENTRIES)
    assert not {plant.name for plant in plants if plant not in tuned} & {name for name, _ in ENTRIES}
    assert ("npsauv", 4.0) in ENTRIES


def test_the_published_gains_of_the_s_plane_are_used():
    loops = gains_for("heu_torpedo", 0.1).loops["s_plane"]
    published = {"speed": (0.8, 0.1, 0.02), "heading": (0.9, 1.7, 0.0024), "depth": (2.3, 2.4, 0.00006)}
    assert {name: (law["k1"], law["k2"], law["k3"]) for name, law in loops.items()} == published


@pytest.mark.parametrize("vehicle, dt, kind", LOOPS)
def test_a_torpedo_settles_with_noise(vehicle, dt, kind):
    plant = load_vehicle(FILES.get(vehicle, vehicle), dt=dt)
    run, steps = torpedo_run(plant, kind)
    for (name, (step, size)), limit in zip(steps.items(), SETTLED[vehicle, dt], strict=True):
        assert step.settling_time < limit, name
        assert step.overshoot < OVERSHOOT[name] * size + NOISE[name], name
        assert step.swing < 2.0 * NOISE[name] + 0.01 * size, name  # no limit cycle
    for name, (low, _, high) in zip(plant.inputs, command_ranges(plant), strict=True):
        slack = 1e-12 * (high - low)
        assert low - slack <= run[name].min() <= run[name].max() <= high + slack
    if kind == "pid":
        assert run["pitch_rad"].min() > -0.35 - 0.12  # the set point's limit, and what the hull does beyond it


@pytest.mark.parametrize("side", [0.8, 1.2])
@pytest.mark.parametrize("vehicle, dt", [compiled(*entry) for entry in TORPEDOES])
def test_the_same_gains_hold_on_a_changed_vehicle(vehicle, dt, side):
    plant = load_vehicle(FILES.get(vehicle, vehicle), dt=dt)
    strength = "lift_slope" if vehicle in FILES else "moment"  # of a fin by its geometry, or by its coefficients
    fins = (f"parts.rudder.{strength}", f"parts.stern_plane.{strength}")
    damping = ("hull.yaw.ur", "hull.yaw.uv", "hull.pitch.uq", "hull.pitch.uw", "hull.surge.u_u")
    changes = {**dict.fromkeys(fins, side), **dict.fromkeys(damping, 2.0 - side)}
    changed = replace_at(plant, {path: value_at(plant, path) * factor for path, factor in changes.items()})
    _, steps = torpedo_run(plant, on=changed)
    for (name, (step, size)), limit in zip(steps.items(), SETTLED[vehicle, dt], strict=True):
        assert step.settling_time < 2.0 * limit, name
        assert step.overshoot < 2.0 * OVERSHOOT[name] * size + NOISE[name], name


@pytest.mark.parametrize("vehicle, dt", [entry for entry in ENTRIES if entry not in TORPEDOES])
def test_gliders_and_floats_settle_with_noise(vehicle, dt):
    plant = load_vehicle(FILES.get(vehicle, vehicle), dt=dt)
    name = KINDS.of(plant.family).targets[0]
    first, target, limit = OTHERS[vehicle]
    rng = np.random.default_rng(3)
    run = run_trial(
        plant, autopilot(plant), {name: [(0.0, target)]}, 4.0 * limit, start=at_rest(plant, {name: first}), rng=rng
    )
    size = abs(target - first)
    step = step_response(run["time_s"], run[name], target, max(0.05 * size, 2.0 * NOISE[name]))
    assert step.settling_time < limit
    assert step.overshoot < 0.05 * size + NOISE[name]
    assert step.swing < 2.0 * NOISE[name] + 0.01 * size


@pytest.mark.parametrize("kind", ["pid", "s_plane"])
def test_a_symmetrical_vehicle_turns_to_port_as_to_starboard(kind):
    plant = load_vehicle("heu_torpedo")
    right, _ = torpedo_run(plant, kind, noise={})
    left, _ = torpedo_run(plant, kind, noise={}, side=-1.0)
    for name in ("heading_rad", "r_radps", "rudder_rad"):
        assert right[name] == pytest.approx(-left[name], abs=1e-6)
    assert right["depth_m"] == pytest.approx(left["depth_m"], abs=1e-6)


def test_the_pitch_limit_of_a_campaign_and_the_bow_planes():
    plant = load_vehicle("npsauv", dt=4.0)
    start = level_flight(plant, DEEP)
    controller = autopilot(plant, targets=("depth_m",), pitch_limit=radians(5.0))
    run = run_trial(plant, controller, {"depth_m": [(0.0, DEEP + 8.0)]}, 400.0, start=start)
    assert radians(-6.0) < run["pitch_rad"].min() < radians(-4.0)
    assert run["depth_m"][-1] == pytest.approx(DEEP + 8.0, abs=0.2)
    share = gains_for("npsauv", 4.0).bow_share
    assert run["bow_plane_rad"] == pytest.approx(share * run["stern_plane_rad"])
    assert np.ptp(run["bow_plane_rad"]) > 0.05


def test_targets_choose_the_loops():
    plant = load_vehicle("remus100")
    controller = autopilot(plant, targets=("pitch_rad", "heading_rad"))
    assert isinstance(controller, Controller)
    reading = {**dict.fromkeys(plant.outputs, 0.0), "dt_s": 0.1}
    command, _ = controller.act(controller.start(), reading, {"pitch_rad": 0.1, "heading_rad": 0.1, "u_mps": 1.0})
    assert set(command) == {"stern_plane_rad", "rudder_rad"}
    everything = autopilot(plant)
    command, _ = everything.act(everything.start(), reading, {"depth_m": 0.0})
    assert set(command) == {"pitch_cmd_rad", "stern_plane_rad"}


def test_a_float_with_an_unknown_trim_comes_to_its_depth():
    plant = replace_at(load_vehicle("mermaid"), "effects.volume.offset", 2e-5)
    run = run_trial(
        plant, autopilot(plant), {"depth_m": [(0.0, 300.0)]}, 40_000.0, start=at_rest(plant, {"depth_m": 200.0})
    )
    assert run["depth_m"][-1] == pytest.approx(300.0, abs=1.0)
    assert np.abs(run["oil_volume_m3"]).max() <= 2e-4


@pytest.mark.parametrize("vehicle", ["remus100", "npsauv", "heu_torpedo", "vt690"])
def test_the_speed_fed_forward_is_held(vehicle):
    plant = load_vehicle(vehicle)
    points = steady_speed_commands(plant)
    assert (np.diff(np.array(points), axis=0) > 0.0).all()
    speeds, commands = np.array(points).T
    design = plant.parts.propeller.design
    # level flight needs some pitch and plane, whose drag the points leave out
    assert np.interp(design, commands, speeds) == pytest.approx(find_cruise(plant).speed, rel=0.05)


def test_what_an_autopilot_refuses(tmp_path):
    plant = load_vehicle("heu_torpedo")
    with pytest.raises(ValueError, match=r"No autopilot of kind 'lqr'.*Kinds: pid, s_plane, gpc"):
        autopilot(plant, "lqr")
    with pytest.raises(ValueError, match=r"no loop for 'roll_rad'.*Targets: depth_m, heading_rad, u_mps, pitch_rad"):
        autopilot(plant, targets=("roll_rad",))
    with pytest.raises(ValueError, match="move the same plane"):
        autopilot(plant, targets=("depth_m", "pitch_rad"))
    with pytest.raises(ValueError, match="six degrees of freedom, got 'slocum'"):
        autopilot(load_vehicle("slocum"), "s_plane")
    with pytest.raises(ValueError, match="have no s_plane"):
        autopilot(load_vehicle("npsauv", dt=4.0), "s_plane")
    with pytest.raises(ValueError, match=r"within a factor of 2 of a sample time of 1 s; there are some at 0.1 s, 4 s"):
        autopilot(load_vehicle("npsauv", dt=1.0))
    save_vehicle(replace(plant, name="mine"), tmp_path / "mine.toml")
    with pytest.raises(
        ValueError, match=r"No gains of 'mine'.*gains=gains_for\('remus100', 0\.1\).*`auv-gym tune VEHICLE\.toml --dt"
    ):
        autopilot(load_vehicle(tmp_path / "mine.toml"))
    assert autopilot(load_vehicle(tmp_path / "mine.toml"), gains=gains_for("remus100", 0.1))
    given = Gains("mine", 0.1, loops={"pid": {"pitch": {"proportional": -1.2}}})
    with pytest.raises(ValueError, match=r"have no pid\.heading, but pid\.pitch: add it to the gains that you give"):
        autopilot(load_vehicle(tmp_path / "mine.toml"), gains=given)


def test_gains_of_the_nearest_sample_time_are_taken():
    assert gains_for("npsauv", 0.15).dt == 0.1
    assert gains_for("npsauv", 2.0).dt == 4.0
    assert autopilot(load_vehicle("npsauv"), dt=4.0) != autopilot(load_vehicle("npsauv"))


def test_a_file_of_gains_is_read_back_bit_for_bit(tmp_path):
    path = tmp_path / "gains.toml"
    mine = Gains(
        'a "name"', 0.3, -0.5, {"pid": {"heading": {"proportional": 1.0 / 3.0}}, "s_plane": {"depth": {"k1": 2.0}}}
    )
    write_gains((mine, *read_gains()), path)
    assert {(e.vehicle, e.dt): e for e in read_gains(path)} == {(e.vehicle, e.dt): e for e in (mine, *read_gains())}
    plant = load_vehicle("slocum")
    assert autopilot(plant, gains=path) == autopilot(plant)
    assert autopilot(plant, gains=gains_for("slocum", 4.0)) == autopilot(plant)


@pytest.mark.parametrize(
    "text", ["[[vehicle]", "[[vehicle]]\nname = 'x'", "vehicle = 3", "[[vehicle]]\nname='x'\ndt_s=-1"]
)
def test_a_file_that_is_no_file_of_gains_is_refused(tmp_path, text):
    path = tmp_path / "gains.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"gains.toml cannot be used.*\[\[vehicle\]\]"):
        read_gains(path)
    with pytest.raises(ValueError, match="it cannot be read"):
        read_gains(tmp_path / "none.toml")


@pytest.mark.parametrize("task, vehicle, close", [("Depth", "heu_torpedo", 0.1), ("FloatDepth", "mermaid", 1.0)])
def test_in_an_environment_it_comes_to_the_target(task, vehicle, close):
    env = gymnasium.make(
        f"auv_gym/{task}-v0", vehicle=vehicle, effects={"effects.sampling.depth.noise": 0.03}
    ).unwrapped
    controller = autopilot(env.plant)
    state, (_, info), over = controller.start(), env.reset(seed=1), False
    while not over:
        dt = info.get("dt_s", env.plant.dt)
        command, state = controller.act(state, {**info["reading"], "dt_s": dt}, info["target"])
        *_, terminated, over, info = env.step(env.action_for(command))
        assert not terminated
    assert info["state"]["depth_m"] == pytest.approx(info["target"]["depth_m"], abs=close)


def test_level_flight_stays_level():
    plant = load_vehicle("remus100")
    x, u = level_flight(plant, DEEP)
    for _ in range(100):
        x = plant.step(x, u)
    assert plant.output(x)[plant.outputs.index("depth_m")] == pytest.approx(DEEP, abs=1e-4)


def test_a_vehicle_without_gains_is_flown_by_predictive_control():
    own = replace(load_vehicle("remus100"), name="mine")
    with pytest.raises(ValueError, match="No gains of 'mine'"):
        autopilot(own)
    assert all(isinstance(loop, Scheduled | Gpc) for loop in usual_autopilot(own).controllers)
    assert usual_autopilot(load_vehicle("remus100")) == autopilot(load_vehicle("remus100"))


@pytest.mark.parametrize("vehicle", ["slocum", "qiandao_float"])
def test_a_limit_of_pitch_is_refused_where_nothing_pitches(vehicle):
    with pytest.raises(ValueError, match="for vehicles that dive by pitch"):
        autopilot(load_vehicle(vehicle), pitch_limit=0.1)
