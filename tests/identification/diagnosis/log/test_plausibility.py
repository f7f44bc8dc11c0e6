"""Tests of doubts about a log: slips are named, and correct logs pass."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.deciding import BAD, FACTOR, SLIP_GAIN
from identification.diagnosis import diagnose
from identification.diagnosis.log.plausibility import Match, _fitted, _possible, log_doubts
from identification.diagnosis.log.slips import Slip, impossible_units, possible_slips, undone
from identification.diagnosis.log.thruster_slips import likely_slips, thruster_slips
from identification.experiments.hovering import hover
from identification.experiments.missions import run_mission
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows
from scripts.studies.slips import doubts, log_of, slipped


def slip_called(record, plant, text) -> Slip:
    return next(s for s in possible_slips(record, plant) if s.text.startswith(text))


@pytest.fixture(scope="module")
def logs():
    plants = {
        name: load_vehicle(name) for name in ("ganeshblue", "slocum", "qiandao_float", "mermaid", "vt690", "seaglider")
    }
    return {name: (plant, log_of(plant)) for name, plant in plants.items()}


def test_clean_logs_raise_no_doubt(logs):
    for plant, record in logs.values():
        assert doubts(record, plant) == (), plant.name


@pytest.mark.parametrize(
    "vehicle, text",
    [
        ("ganeshblue", "the rudder acts with the opposite sign"),
        ("ganeshblue", "heading_rad looks mirrored"),
        ("ganeshblue", "depth_m looks mirrored"),
        ("ganeshblue", "north_m and east_m look exchanged"),
        ("slocum", "rudder_rad looks like degrees"),
        ("slocum", "u_mps looks like knots, not"),
        ("slocum", "time runs at half the rate"),
        ("qiandao_float", "piston_m looks mirrored"),
        ("qiandao_float", "the piston moves the wrong way"),
        ("qiandao_float", "depth_m looks mirrored"),
        ("mermaid", "oil_volume_m3 looks mirrored"),
        ("seaglider", "the volume of the buoyancy engine moves the wrong way"),
    ],
)
def test_a_slip_is_named_and_can_be_undone(logs, vehicle, text):
    plant, record = logs[vehicle]
    slip = slip_called(record, plant, text)
    wrong = slipped(record, slip, plant)
    (doubt,) = doubts(wrong, plant)
    assert doubt.text == slip.text
    assert doubt.gain >= SLIP_GAIN
    assert doubt.channels == slip.channels
    mended = undone(wrong, doubt.slip, plant)
    for name in slip.channels:
        assert mended[name] == pytest.approx(record[name], abs=1e-9 * np.ptp(record[name]) + 1e-12)
    assert doubts(mended, plant) == ()


def test_units_that_make_values_impossible_are_named_together_and_first(logs):
    plant, record = logs["slocum"]
    angles = ("rudder_rad", "heading_rad")
    given = {name: np.degrees(record[name]) for name in angles} | {"u_mps": 100.0 * record["u_mps"]}
    wrong = Record.from_arrays(record.time, {name: record[name] for name in record.names} | given)
    (doubt,) = doubts(wrong, plant)
    assert set(doubt.channels) == {*angles, "u_mps"}
    assert doubt.firm
    for words in ("look like degrees, not rad", "u_mps looks like centimetres per second, not m/s"):
        assert words in doubt.text
    mended = undone(wrong, doubt.slip, plant)
    for name in ("rudder_rad", "u_mps"):  # the angles were unwrapped as radians
        assert mended[name] == pytest.approx(record[name])


@pytest.mark.parametrize("factor, unit", [(1000.0, "millimetres"), (100.0, "centimetres")])
def test_the_unit_of_a_depth_follows_from_speed_and_pitch_and_is_left_open_without_them(logs, factor, unit):
    plant, record = logs["slocum"]
    wrong = record.with_channels({"depth_m": factor * (record["depth_m"] + 200.0)})
    slip = impossible_units(wrong, plant)
    assert slip.text == f"depth_m looks like {unit}, not m"
    assert slip.factors == (1.0 / factor,)
    slip = impossible_units(wrong.without(["u_mps"]), plant)
    assert slip.text == "depth_m looks like centimetres or millimetres, not m"
    assert slip.mend == "multiply depth_m by 0.01 or 0.001, whichever is right"
    assert not slip.factors


def test_an_angle_that_counts_turns_is_no_slip_of_units(logs):
    plant, record = logs["slocum"]
    for shift in (10.0, 100.0):
        turned = record.with_channels({"heading_rad": record["heading_rad"] + 2.0 * np.pi * shift})
        assert impossible_units(turned, plant) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "the rudder acts with the opposite sign",
        "the stern plane acts with the opposite sign",
        "rudder_rad and stern_plane_rad look exchanged",
        "roll_rad and pitch_rad look exchanged",
        "u_mps and v_mps look exchanged",
        "heading_rad looks like degrees",
        "q_radps looks mirrored",
        "u_dvl_mps looks mirrored",
        "depth_m looks ten times too large",
        "depth_m looks like feet",
        "time runs at half the rate",
        "time runs at twice the rate",
    ],
)
def test_a_slip_in_six_degrees_of_freedom_is_named(logs, text):
    plant, record = logs["vt690"]
    slip = slip_called(record, plant, text)
    (doubt,) = doubts(slipped(record, slip, plant), plant)
    assert slip.text in (doubt.text, *doubt.instead)


def test_a_signal_that_is_mostly_noise_counts_where_it_is_asked_for():
    plant, rng, window = load_vehicle("vt690"), np.random.default_rng(0), np.repeat([0, 1], 400)
    noise, slope = rng.normal(0.0, 0.01, 800), np.linspace(0.0, 1.0, 800)
    match = Match(plant)
    match.add("u_dvl_mps", 1.5 + noise, 3.0**2, window)  # the run has the opposite sign
    match.add("v_dvl_mps", noise, 0.01**2, window)
    match.add("w_dvl_mps", slope + noise, 0.01**2, window)
    assert match.errors == {"w_dvl_mps": pytest.approx(0.0, abs=1e-3)}
    assert match.stray == ("u_dvl_mps",)
    assert match.still["v_dvl_mps"] < BAD
    assert match.telling(match.stray).errors.keys() == {"u_dvl_mps", "w_dvl_mps"}
    assert match.telling(match.stray).total > 0.49 > match.total


@pytest.mark.parametrize(
    "vehicle, path, value",
    [
        ("ganeshblue", "effects.rudder.gain", 1.6),
        ("ganeshblue", "effects.rudder.offset", 0.06),
        ("ganeshblue", "effects.rudder.dead_time", 3.0),
        ("ganeshblue", "effects.current.east", 0.06),
        ("slocum", "effects.compass.bias", 0.12),
        ("slocum", "effects.compass.lag", 3.0),
        ("qiandao_float", "effects.piston.gain", 1.6),
        ("qiandao_float", "effects.piston.dead_time", 12.0),
        ("mermaid", "effects.oil.pump_gain", -0.12),
        ("mermaid", "effects.water.gradient", 6e-3),
    ],
)
def test_effects_and_wrong_coefficients_are_no_slips(logs, vehicle, path, value):
    plant, _ = logs[vehicle]
    wrong = {name: 0.8 * value_at(plant, name) for name in plant.family.coefficients}
    assert doubts(log_of(replace_at(plant, {**wrong, path: value}), seed=2), plant) == ()


@pytest.mark.parametrize("text", ["time runs at twice the rate", "time runs at half the rate"])
def test_a_slipped_clock_that_leaves_only_noise_is_doubted_firmly(logs, text):
    plant, record = logs["slocum"]
    (doubt,) = doubts(slipped(record, slip_called(record, plant, text), plant), plant)
    assert doubt.text.startswith(text)
    assert doubt.firm


@pytest.mark.parametrize("path, value", [("effects.rudder.lost_travel", 1.0), ("effects.rudder.gain", 0.05)])
def test_a_rudder_that_hardly_acts_is_not_taken_for_one_in_other_units(logs, path, value):
    plant, _ = logs["slocum"]
    found = doubts(run_mission(replace_at(plant, path, value), np.random.default_rng(3), duration=1200.0), plant)
    assert [doubt.text for doubt in found] == ["rudder_rad looks like degrees, not rad"]
    assert not found[0].firm


def test_only_signs_and_columns_are_beyond_any_effect(logs):
    plant, record = logs["ganeshblue"]
    assert slip_called(record, plant, "time runs at twice").scales
    assert slip_called(record, plant, "rudder_rad looks like degrees").scales
    assert not slip_called(record, plant, "the rudder acts").scales
    assert not slip_called(record, plant, "north_m and east_m look exchanged").scales


def late(plant):
    """A log of a float whose piston moves too little and too late; a clock twice too fast nearly explains it."""
    return replace_at(plant, {"effects.piston.gain": 0.35, "effects.piston.dead_time": 10.6})


def test_a_clock_that_leaves_more_than_noise_is_doubted_with_reserve(logs):
    plant, _ = logs["qiandao_float"]
    (doubt,) = doubts(log_of(late(plant)), plant)
    assert doubt.text.startswith("time runs at twice")
    assert not doubt.firm


@pytest.mark.slow
def test_effects_that_explain_all_come_before_the_clock(logs):
    plant, _ = logs["qiandao_float"]
    found = diagnose(log_of(late(plant)), plant)
    named = {path for group in found.tied for path in group} | {effect.path for effect in found.effects}
    assert found.doubts == ()
    assert found.verdict in ("named", "tied")
    assert named.issuperset({"effects.piston.gain", "effects.piston.dead_time"})


def test_a_coefficient_within_its_factor_is_no_slip(logs):
    plant, _ = logs["ganeshblue"]
    path = plant.family.coefficients[-1]
    low, high = spec_at(plant, path).bounds
    strong = float(np.clip(0.7 * FACTOR * value_at(plant, path), low, high))
    assert doubts(log_of(replace_at(plant, path, strong)), plant) == ()


def test_a_coefficient_that_is_hardly_known_may_differ_by_more():
    plant, path = replace(load_vehicle("slocum"), deviations={}), "hull.n_delta"
    log = log_of(replace_at(plant, path, 2.0 * FACTOR * value_at(plant, path)))

    def found(deviations):
        vehicle = replace(plant, deviations=deviations)
        problem = Shooting(vehicle, log, free_run_windows(vehicle, log, vehicle.window))
        return value_at(_fitted(problem, vehicle, [path], 10)[0], path) / value_at(plant, path)

    assert found({}) == pytest.approx(FACTOR)
    assert found({path: abs(value_at(plant, path))}) == pytest.approx(2.0 * FACTOR, rel=0.1)


def test_a_mended_record_keeps_how_far_apart_its_readings_are(logs):
    glider, log = logs["ganeshblue"]
    log = log.with_channels({"depth_m": log["heading_rad"]}).with_intervals({"heading_rad": 20.0})
    exchanged = undone(log, Slip("", "", ("heading_rad", "depth_m"), exchanged=True), glider)
    assert (exchanged.interval_of("depth_m"), exchanged.interval_of("heading_rad")) == (20.0, log.sample_interval)
    slower = undone(log, Slip("", "", (), clock=2.0), glider)
    assert (slower.interval_of("heading_rad"), slower.sample_interval) == (40.0, 2.0 * log.sample_interval)
    assert exchanged.readings("depth_m").tolist() == slower.readings("heading_rad").tolist()
    assert exchanged.readings("depth_m").tolist() == log.readings("heading_rad").tolist()


def test_degrees_taken_as_radians_are_unfolded(logs):
    plant, record = logs["slocum"]  # changes by more than 180/57.3 degrees from sample to sample
    slip = slip_called(record, plant, "heading_rad looks like degrees")
    wrong = slipped(record, slip, plant)
    assert np.abs(np.diff(np.degrees(record["heading_rad"]))).max() > np.pi
    error = undone(wrong, slip, plant)["heading_rad"] - record["heading_rad"]
    assert np.median(np.abs(np.diff(error))) < 1e-9  # an occasional wrong step, by a turn of 2 pi degrees
    assert np.abs(np.diff(error)).max() < np.radians(4.1 * np.pi)


def test_a_log_whose_samples_have_the_times_of_others_is_doubted(logs):
    """As far as a fit can tell, such a compass is merely very noisy."""
    plant, record = logs["slocum"]
    order = np.random.default_rng(0).permutation(len(record))
    scattered = record.with_channels({name: record[name][order] for name in record.names})
    (doubt,) = log_doubts(scattered, plant, ())
    assert doubt.text == "heading jumps at random from one sample to the next"
    assert not log_doubts(record, plant, ())


@pytest.fixture(scope="module")
def telegraphed():
    """A log with only rates and attitude, in which each thruster is moved separately."""
    plant = load_vehicle("bluerov")
    rng = np.random.default_rng(2)
    return plant, hover(plant, rng=rng, duration=30.0, measured="attitude", loop="open", amplitude=0.4)


@pytest.mark.slow
def test_every_slip_of_a_thruster_is_the_likeliest_by_a_regression(telegraphed):
    plant, record = telegraphed
    assert likely_slips(list(thruster_slips(record, plant)), record, plant) == []
    slips = list(thruster_slips(record, plant))
    assert len(slips) == 6 + 15
    for slip in slips:
        wrong = slipped(record, slip, plant)
        first, *_ = likely_slips(list(thruster_slips(wrong, plant)), wrong, plant)
        assert first.text == slip.text
        np.testing.assert_allclose(undone(wrong, first, plant)["t1_us"], record["t1_us"])


@pytest.mark.slow
@pytest.mark.parametrize("text", ["t1_us acts with the opposite sign", "t2_us and t5_us look exchanged"])
def test_a_slip_of_a_thruster_is_named(telegraphed, text):
    plant, record = telegraphed
    (slip,) = (s for s in thruster_slips(record, plant) if s.text.startswith(text))
    wrong = slipped(record, slip, plant)
    (doubt,) = log_doubts(wrong, plant, free_run_windows(plant, wrong, plant.window), plant.settle)
    assert doubt.text == slip.text
    assert doubt.firm
    assert log_doubts(record, plant, free_run_windows(plant, record, plant.window), plant.settle) == ()


@pytest.mark.slow
def test_a_vehicle_with_one_thruster_shows_that_it_is_turned_round(telegraphed):
    """While no other thruster moves, a factor of either sign explains the log equally well."""
    plant, record = telegraphed
    still = {f"t{k}_us": np.full(len(record), 1500.0) for k in (2, 3, 4, 5, 6)}
    log = simulate(plant, record.with_channels(still)).with_channels({n: record[n] for n in ("t1_us",)} | still)
    assert likely_slips(list(thruster_slips(log, plant)), log, plant) == []
    (slip,) = thruster_slips(log, plant)
    wrong = slipped(log, slip, plant)
    assert [one.text for one in likely_slips(list(thruster_slips(wrong, plant)), wrong, plant)] == [slip.text]


@pytest.mark.slow
def test_thrusters_that_are_commanded_alike_cannot_be_exchanged(telegraphed):
    plant, record = telegraphed
    alike = record.with_channels({"t2_us": record["t1_us"], "t3_us": np.full(len(record), 1500.0)})
    texts = [slip.text for slip in thruster_slips(alike, plant)]
    assert "t1_us and t2_us look exchanged" not in texts
    assert not any("t3_us" in text for text in texts)
    assert list(thruster_slips(record, load_vehicle("remus100"))) == []


def test_a_vehicle_that_loops_may_have_rolled_over_many_times():
    time = np.arange(0.0, 40.0, 0.05)
    roll, looping = 0.7 * time, 1.4 * np.sin(1.3 * time)
    plant = load_vehicle("bluerov")
    assert _possible(Record.from_arrays(time, {"roll_rad": roll, "pitch_rad": looping}), plant)
    assert not _possible(Record.from_arrays(time, {"roll_rad": roll, "pitch_rad": 0.1 * looping}), plant)
    assert not _possible(Record.from_arrays(time, {"roll_rad": roll}), plant)
    assert not _possible(Record.from_arrays(time, {"roll_rad": roll, "pitch_rad": 57.3 * looping}), plant)


def test_a_roll_about_a_whole_turn_is_as_good_as_one_about_zero():
    """A glider that swings over its stern at the surface dives with a whole turn in its unwrapped roll."""
    plant, time = load_vehicle("seaglider"), np.arange(0.0, 40.0, 0.05)
    pitch, roll = -0.4 * np.ones(time.size), 0.3 * np.sin(0.2 * time)
    for turns in (-2, 1):
        turned = Record.from_arrays(time, {"roll_rad": roll + turns * 2.0 * np.pi, "pitch_rad": pitch})
        assert _possible(turned, plant)
    assert not _possible(Record.from_arrays(time, {"roll_rad": np.degrees(roll), "pitch_rad": pitch}), plant)


@pytest.mark.parametrize("vehicle, possible", [("bluerov2_heavy", True), ("remus100", False)])
def test_a_vehicle_that_thrusters_hold_may_drift_astern(vehicle, possible):
    time = np.arange(0.0, 40.0, 0.05)
    speed = 0.1 * np.sin(0.2 * time) - 0.05
    assert _possible(Record.from_arrays(time, {"u_mps": speed}), load_vehicle(vehicle)) is possible
    assert not _possible(Record.from_arrays(time, {"u_mps": speed - 20.0}), load_vehicle(vehicle))


@pytest.mark.slow
def test_a_thruster_turned_round_is_named_where_the_vehicle_drifts_astern():
    plant = load_vehicle("bluerov2_heavy")
    record = log_of(plant, 5)
    assert np.median(record["u_mps"]) < 0.0
    slip = next(thruster_slips(record, plant))
    (doubt,) = doubts(slipped(record, slip, plant), plant)
    assert doubt.text == slip.text


@pytest.mark.parametrize(
    "text", ["u_dvl_mps, v_dvl_mps and w_dvl_mps look like knots, not", "rudder_rad and stern_plane"]
)
def test_slips_are_noticed_beside_sensors_slower_than_the_log(logs, text):
    """Interpolated values are less noisy than readings, and would make the sensors look too accurate."""
    plant, record = logs["vt690"]
    slow = [n for n in record.names if n.endswith("mps") and not n.endswith("cmd_mps")] + ["north_m", "east_m"]
    read = np.arange(len(record)) % 3 == 0
    values = {name: np.interp(record.time, record.time[read], record[name][read]) for name in slow}
    thinned = record.with_channels(values).with_readings(dict.fromkeys(slow, read))
    assert doubts(thinned, plant) == ()
    wrong = slipped(thinned, slip_called(thinned, plant, text), plant)
    (doubt,) = doubts(wrong, plant)
    assert doubt.text.startswith(text)
    assert doubt.firm
