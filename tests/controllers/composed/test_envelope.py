"""The vertical plane of npsauv under too much excitation: limits of depth and pitch, kept and not kept."""

import copy
from math import radians

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from controllers.autopilots import autopilot
from controllers.composed.envelope import Envelope, guarded_times
from controllers.composed.excited import Excited
from controllers.composed.loops import Cascade
from controllers.pid import Pid
from controllers.trials.trial import level_flight
from identification.experiments.excitation import make_signal

DT = 0.5
LIMITS = {"depth_m": (17.0, 23.0), "pitch_rad": (radians(-10.0), radians(10.0))}
STOP = 0.349


@pytest.fixture(scope="module")
def plant():
    return load_vehicle("npsauv", dt=DT)


@pytest.fixture(scope="module")
def pilot(plant):
    """Depth by pitch by stern plane, with gains for half a second."""
    depth = Pid(-0.05, integral=-0.0005, measured="depth_m", command="pitch_rad", limit=0.3, integral_range=2.0)
    pitch = Pid(-1.3, derivative=-1.2, measured="pitch_rad", command="stern_plane_rad", rate_measured="q_radps")
    return Cascade(depth, pitch)


def excited(pilot, amplitude, seed=1, dt=DT, **more):
    signal = make_signal("prbs", round(600 / dt), dt, np.random.default_rng(seed), amplitude=amplitude, clock_s=12.0)
    return Excited(pilot, {"stern_plane_rad": signal, **more}, dt)


def fly(plant, controller, duration=600.0, target=20.0, noise=0.0, states=None):
    """True depth and pitch, what was commanded and reported, by name, at every sample."""
    x, u = level_flight(plant, 20.0)
    rng, state, rows = np.random.default_rng(5), controller.start(), []
    for k in range(round(duration / plant.dt)):
        reading = dict(zip(plant.outputs, plant.output(x).tolist(), strict=True))
        true = {"time": k * plant.dt, "depth": reading["depth_m"], "pitch": reading["pitch_rad"]}
        reading["depth_m"] += noise * rng.standard_normal()
        command, state = controller.act(state, {**reading, "dt_s": plant.dt}, {"depth_m": target})
        if states is not None:
            states.append(state)
        for column, name in enumerate(plant.inputs):
            u[column] = min(max(command.get(name, u[column]), -STOP), STOP) if name != "propeller_rpm" else u[column]
        rows.append({**true, **command})
        x = plant.step(x, u)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def farthest(run):
    return np.abs(run["depth"] - 20.0).max(), np.abs(run["pitch"]).max()


@pytest.mark.parametrize("amplitude, seed", [(0.2, 1), (0.3, 1), (0.3, 2)])
def test_limits_that_the_excited_loop_leaves_are_kept(plant, pilot, amplitude, seed):
    bare = excited(pilot, amplitude, seed)
    depth, pitch = farthest(fly(plant, bare))
    assert depth > 3.0
    assert pitch > radians(10.0)
    guarded = fly(plant, Envelope(bare, pilot, LIMITS))
    depth, pitch = farthest(guarded)
    assert depth < 3.0
    assert pitch < radians(10.0)
    # it lets the experiment go on for a good part of the time, and does not chatter
    assert 0.1 < guarded["envelope_flag"].mean() < 0.8
    spells = guarded_times(guarded["time"], guarded["envelope_flag"])
    assert min(end - begin for begin, end in spells[:-1]) >= 5.0


def test_within_its_limits_it_changes_nothing(plant, pilot):
    bare = excited(pilot, 0.05)
    guarded, free = fly(plant, Envelope(bare, pilot, LIMITS), 300.0), fly(plant, bare, 300.0)
    assert not guarded["envelope_flag"].any()
    for name in free:
        np.testing.assert_array_equal(guarded[name], free[name])


def test_it_acts_before_a_limit_is_passed_and_ends_when_all_is_calm(plant, pilot):
    envelope = Envelope(excited(pilot, 0.3), pilot, LIMITS)
    run = fly(plant, envelope)
    share = np.maximum(np.abs(run["depth"] - 20.0) / 3.0, np.abs(run["pitch"]) / radians(10.0))
    for begin, end in guarded_times(run["time"], run["envelope_flag"])[:-1]:
        at, back = round(begin / DT), round(end / DT)
        assert share[at] < 1.0
        assert (share[back + 1 - round(5.0 / DT) : back + 1] < 0.7).all()
    flags = run["envelope_depth_m_flag"] + run["envelope_pitch_rad_flag"]
    np.testing.assert_array_equal(flags > 0.0, run["envelope_flag"] > 0.0)
    assert run["envelope_depth_m_flag"].any()
    assert run["envelope_pitch_rad_flag"].any()


def test_while_the_guard_acts_nothing_is_excited(plant, pilot):
    bow = {"bow_plane_rad": np.full(1200, 0.1)}
    signal = excited(pilot, 0.3).signals["stern_plane_rad"]
    both = Excited(pilot, {"stern_plane_rad": signal, **bow}, DT, at_rest={"bow_plane_rad": 0.02})
    run = fly(plant, Envelope(both, pilot, LIMITS))
    guarding = run["envelope_flag"] > 0.0
    assert not run["excitation_stern_plane_rad"][guarding].any()
    np.testing.assert_allclose(run["bow_plane_rad"], np.where(guarding, 0.02, 0.12))
    np.testing.assert_array_equal(run["excitation_stern_plane_rad"][~guarding], signal[~guarding])


def test_noise_does_not_trip_it(plant, pilot):
    """Differences of 0.1 m of noise alone are 0.3 m/s, and 1 m within the lookahead."""
    bare = excited(pilot, 0.05)
    smooth = fly(plant, Envelope(bare, pilot, LIMITS), 300.0, noise=0.1)
    assert not smooth["envelope_flag"].any()
    loud, quiet = (fly(plant, Envelope(excited(pilot, 0.3), pilot, LIMITS), 300.0, noise=n) for n in (0.1, 0.0))
    spells = [len(guarded_times(run["time"], run["envelope_flag"])) for run in (loud, quiet)]
    assert 0 < spells[0] < 1.3 * spells[1]
    assert farthest(loud)[0] < 1.1 * 3.0
    envelopes = (Envelope(bare, pilot, LIMITS, smoothing=time) for time in (0.0, 3.0))
    raw, smoothed = (fly(plant, envelope, 200.0, noise=0.3) for envelope in envelopes)
    assert raw["envelope_flag"].any()
    assert not smoothed["envelope_flag"].any()


def test_hand_over_is_without_a_bump_where_the_load_needs_trim(plant, pilot):
    """A guard of the same law has the same integral: what changes is the excitation and nothing else."""
    heavy, states = replace_at(plant, {"effects.load.net_buoyancy": 100.0}), []
    run = fly(heavy, Envelope(excited(pilot, 0.3), pilot, LIMITS), states=states)
    assert all(state.controller.controller == state.guard for state in states)
    assert abs(states[-1].guard.outer.integral) > 0.01  # rad of pitch that carry 100 N
    alone = run["stern_plane_rad"] - run["excitation_stern_plane_rad"]
    jumps, changes = np.abs(np.diff(alone)), np.diff(run["envelope_flag"]) != 0.0
    assert np.count_nonzero(changes) > 10
    assert jumps[changes].max() <= 1.1 * jumps[~changes].max()


def test_a_target_outside_is_not_followed_and_winds_nothing_up(plant, pilot):
    envelope = Envelope(pilot, pilot, LIMITS)
    run = fly(plant, envelope, 900.0, target=30.0)
    assert run["depth"].max() < 23.0 * 1.02
    state, reading = envelope.start(), {"depth_m": 22.9, "pitch_rad": 0.0, "q_radps": 0.0, "dt_s": DT}
    for _ in range(2000):
        _, state = envelope.act(state, {**reading, "depth_m": 23.5}, {"depth_m": 30.0})
    assert (
        abs(state.controller.outer.integral) <= 0.0005 * 1.4 * 2000 * DT
    )  # the error to the nearest depth inside, not that to 30 m
    held = Envelope(pilot, pilot, LIMITS, safe={"depth_m": 20.0})
    command, _ = held.act(held.start(), {**reading, "depth_m": 23.5}, {"depth_m": 30.0})
    assert command["pitch_cmd_rad"] == pytest.approx(0.05 * 3.5)


def test_the_tuned_pilot_at_four_seconds_stays_within_ten_metres_and_five_degrees():
    """The experiment of paper 1, with an amplitude that leaves five degrees of pitch."""
    plant = load_vehicle("npsauv", dt=4.0)
    pilot, rng = autopilot(plant, targets=("depth_m",)), np.random.default_rng(3)
    signals = {
        name: make_signal("prbs", 150, 4.0, rng, amplitude=0.06) for name in ("stern_plane_rad", "bow_plane_rad")
    }
    limits = {"depth_m": (10.0, 30.0), "pitch_rad": (radians(-5.0), radians(5.0))}
    bare = Excited(pilot, signals, 4.0)
    guarded = fly(plant, Envelope(bare, pilot, limits, rates={"pitch_rad": "q_radps"}, calm=4.0))
    assert farthest(fly(plant, bare))[1] > radians(5.0)
    assert farthest(guarded)[0] < 10.0
    assert farthest(guarded)[1] < 1.1 * radians(5.0)


def test_a_reading_that_drops_out_is_coasted_over():
    envelope = Envelope(Pid(1.0), Pid(1.0), {"heading_rad": (-0.5, 0.5)}, smoothing=0.0, lookahead=0.0, calm=2.0)
    state, flags = envelope.start(), []
    for value in (np.nan, 0.0, 0.1, np.nan, np.nan, np.nan, 0.0, 0.0, 0.0, 0.0):
        command, state = envelope.act(state, {"heading_rad": value, "dt_s": 1.0}, {"heading_rad": 0.0})
        flags.append(command["envelope_flag"])
    # at 0.1 rad/s, after three without a reading it is 0.4 rad and would be 0.5 a sample later
    assert flags == [0, 0, 0, 0, 0, 1, 1, 1, 0, 0]
    assert state.tracks["heading_rad"].value == pytest.approx(0.0)


def test_limits_of_a_heading_may_lie_over_south():
    envelope = Envelope(Pid(1.0), Pid(1.0), {"heading_rad": (3.0, 3.4)}, lookahead=0.0)
    state = envelope.start()
    for heading, flag in ((3.1, 0.0), (-3.1, 0.0), (-2.8, 1.0)):
        command, _ = envelope.act(state, {"heading_rad": heading, "dt_s": 0.1}, {"heading_rad": 3.2})
        assert command["envelope_flag"] == flag


def test_it_is_pure(pilot):
    envelope = Envelope(excited(pilot, 0.3), pilot, LIMITS)
    reading, target = {"depth_m": 20.0, "pitch_rad": 0.0, "q_radps": 0.0, "dt_s": DT}, {"depth_m": 20.0}
    _, state = envelope.act(envelope.start(), reading, target)
    kept = copy.deepcopy(state)
    later = {**reading, "pitch_rad": 0.15}
    assert envelope.act(state, later, target) == envelope.act(state, later, target)
    assert state == kept
    assert envelope.act(state, later, target)[0]["envelope_pitch_rad_flag"] == 1.0
    assert envelope.targets == ("depth_m",)
    assert envelope.commands == ("stern_plane_rad",)


def test_guarded_times_of_a_flag():
    time = 2.0 * np.arange(8)
    assert guarded_times(time, [1, 1, 0, 0, 1, 0, 1, 1]) == [(0.0, 4.0), (8.0, 10.0), (12.0, 14.0)]
    assert guarded_times(time, np.zeros(8)) == []


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"limits": {}}, "needs limits"),
        ({"limits": {"depth_m": (25.0, 5.0)}}, "low before high, got"),
        ({"limits": {"depth_m": (0.0, np.inf)}}, "finite limits of depth_m"),
        ({"limits": {"depth": (0.0, 5.0)}}, "depth"),
        ({"release": 1.0}, "release between 0 and 1"),
        ({"calm": -1.0}, "calm >= 0 s"),
        ({"rates": {"roll_rad": "p_radps"}}, "rate of roll_rad, which has no limits"),
        ({"safe": {"depth_m": 40.0}}, "safe target of depth_m inside"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Envelope(Pid(1.0), Pid(1.0), **{"limits": LIMITS, **settings})


def test_a_channel_that_nobody_reads_is_refused():
    envelope = Envelope(Pid(1.0), Pid(1.0), LIMITS)
    with pytest.raises(ValueError, match="limits depth_m, which is not read: readings are heading_rad, dt_s"):
        envelope.act(envelope.start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 0.0})


@pytest.mark.parametrize("seed", [1, 2])
def test_whoever_rests_is_told_the_targets_of_the_one_who_acts(seed):
    """Else the integrals of the resting loop run away under an excited set point, and each hand-over is a kick."""
    slow = load_vehicle("npsauv", dt=4.0)
    loop = autopilot(slow, "pid", targets=("depth_m",), pitch_limit=0.04)
    steps = make_signal("prbs", 150, 4.0, np.random.default_rng(seed), amplitude=4.0, clock_s=60.0)
    moved = excited(loop, 0.03, seed, dt=4.0, depth_m=steps)
    _, free = farthest(fly(slow, moved))
    guarded = fly(slow, Envelope(moved, loop, {"pitch_rad": (-0.0873, 0.0873)}, rates={"pitch_rad": "q_radps"}))
    _, pitch = farthest(guarded)
    assert 0.1 < guarded["envelope_flag"].mean() < 0.9
    assert pitch < 1.1 * free
