import numpy as np
import pytest

from auv_gym.model import elapsed_over_gaps, inputs_of
from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.record_check import (
    FEW,
    check_excitation,
    check_ranges,
    described,
    needs_of,
    refusal,
    wrong_for,
)
from auv_gym.plant.thruster_commands import command_remarks
from auv_gym.plant.thrusters import find_thrusters
from auv_gym.records.gliding import glide_attack
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record, concat
from auv_gym.records.understanding import Needs
from identification.diagnosis import diagnose
from identification.fit.greybox import GreyBox

FLOAT = load_vehicle("qiandao_float")
TIME = np.arange(0.0, 600.0, 0.7)


def _record(segment=None, **changes):
    piston = 0.55 + 0.05 * np.sign(np.sin(TIME / 60.0))
    channels = {"depth_m": 20.0 + 5.0 * np.sin(TIME / 60.0), "piston_m": piston, **changes}
    return Record.from_arrays(TIME, channels, segment=segment)


def _out_of_range(plant, record) -> str:
    """Why a record leaves the vehicle's ranges, or nothing."""
    try:
        check_ranges(plant, record)
    except ValueError as error:
        return str(error)
    return ""


def test_a_record_within_the_ranges_passes():
    assert _out_of_range(FLOAT, _record()) == ""
    assert refusal(FLOAT, _record()) == ""


def test_a_piston_in_millimetres_for_a_part_of_the_log_is_refused_with_the_place():
    labels = np.where(TIME < 300.0, "one", "two")
    piston = np.where(TIME < 300.0, 0.52, 520.0) + 0.0 * TIME
    with pytest.raises(
        ValueError, match=r"from 0.5 to 0.6 m; piston_m is 520 at 300 s of two.*unit, throughout the log"
    ):
        check_ranges(FLOAT, _record(segment=labels, piston_m=piston))


@pytest.mark.parametrize("fit", [lambda r: diagnose(r, FLOAT), lambda r: GreyBox(FLOAT, ["hull.drag_linear"]).fit(r)])
def test_a_depth_above_the_surface_is_refused_by_diagnosis_and_fit(fit):
    with pytest.raises(ValueError, match=r"qiandao_float has depth from -5 to inf m; depth_m is -\d.*sign"):
        fit(_record(depth_m=-20.0 - 5.0 * np.sin(TIME / 60.0)))


@pytest.mark.parametrize(
    "still, words",
    [
        (("roll_rad",), "roll_rad never changes, as no sensor's readings do: it is left out."),
        (("roll_rad", "depth_m"), "roll_rad and depth_m never change, as no sensor's readings do: they are left out."),
        ((), ""),
    ],
)
def test_outputs_that_never_change_are_left_out(still, words):
    """As columns that somebody filled with zeros; but not inputs, nor what the vehicle must have."""
    torpedo, time = load_vehicle("vt690"), np.arange(0.0, 60.0, 0.1)
    moving = np.sin(time)
    channels = dict.fromkeys(("heading_rad", "rudder_rad", "roll_rad", "r_radps"), 0.1 * moving)
    channels |= {"depth_m": 20.0 + moving, "stern_plane_rad": 0.0 * time, "speed_cmd_mps": 1.5 + 0.0 * time}
    kept = described(torpedo, Record.from_arrays(time, channels | dict.fromkeys(still, 0.0 * time)))
    assert {name for name in channels if not kept.has(name)} == set(still)
    assert [line for line in kept.notes if "never change" in line] == ([words] if words else [])


def test_a_few_wild_readings_are_left_out_and_more_are_refused():
    depth = 20.0 + 5.0 * np.sin(TIME / 60.0)
    wild = np.where(np.isin(np.arange(TIME.size), (100, 101, 500)), -300.0, depth)
    check_ranges(FLOAT, _record(depth_m=wild), FEW)
    kept = described(FLOAT, _record(depth_m=wild))
    assert len(kept) == TIME.size - 3
    assert kept["depth_m"].min() > 14.0
    assert kept.notes[-1].endswith("0.3 % where depth_m is beyond -5 to inf m.")
    many = np.where(np.arange(TIME.size) % 50 == 0, -300.0, depth)
    assert len(described(FLOAT, _record(depth_m=many))) == TIME.size  # nothing is left out silently
    with pytest.raises(ValueError, match=r"depth_m is -300 at 0 s \(18 of 858 samples are beyond\)"):
        check_ranges(FLOAT, _record(depth_m=many), FEW)
    with pytest.raises(ValueError, match=r"3 of 858 samples are beyond"):
        check_ranges(FLOAT, _record(depth_m=wild))


def test_a_few_impossible_inputs_are_left_out():
    plant = load_vehicle("slocum")
    t = np.arange(0.0, 1200.0, 4.0)
    rudder = 0.2 * np.sin(t / 40.0)
    rudder[150] = 1e9
    record = Record.from_arrays(t, {"heading_rad": np.sin(t / 90.0), "rudder_rad": rudder})
    check_ranges(plant, record, FEW)
    found = described(plant, record)
    assert len(found) == t.size - 1
    assert found["rudder_rad"].max() < 0.3
    assert any("0.3 % where rudder_rad is impossible" in note for note in found.notes)


def test_a_dive_without_buoyancy_actions_is_refused():
    with pytest.raises(ValueError, match=r"Nothing excites the vehicle: piston_m is constant at 0.55 m"):
        diagnose(_record(piston_m=np.full(TIME.size, 0.55)), FLOAT)


def test_a_vehicle_that_needs_no_input_is_excited_by_those_that_were_logged():
    glider = load_vehicle("seawing")
    assert glider.family.required == ()
    time = np.arange(600.0)
    slides = Record.from_arrays(time, {"depth_m": time, "battery_m": 0.03 * np.sign(np.sin(time / 60.0))})
    check_excitation(glider, slides)
    with pytest.raises(ValueError, match=r"battery_m is constant at 0.01 m"):
        check_excitation(glider, Record.from_arrays(time, {"depth_m": time, "battery_m": np.full(600, 0.01)}))
    with pytest.raises(ValueError, match=r"the log has none of ballast_m3, battery_m, battery_rad\. Use a log with"):
        check_excitation(glider, Record.from_arrays(time, {"depth_m": time}))


def test_a_vehicle_says_what_it_takes_from_a_log():
    needs = needs_of(load_vehicle("npsauv"))
    assert needs.required == ("heading_rad", "rudder_rad", "stern_plane_rad", "propeller_rpm")
    assert {"pitch_rad", "depth_m", "bow_plane_rad"} <= set(needs.wanted)
    assert needs.attack is None


def test_a_vehicle_with_a_polar_gives_the_speed_with_its_angle_of_attack(tmp_path):
    glider = load_vehicle("seawing")
    needs, wings = needs_of(glider), glider.parts.wings
    assert needs.attack is not None
    time, pitch = np.arange(0.0, 600.0, 4.0), -0.4
    alpha = float(needs.attack(np.array([pitch]))[0])
    assert alpha == pytest.approx(float(glide_attack(pitch, wings.drag_0, wings.drag_2, wings.lift_1, wings.lift_0)))
    assert 0.01 < alpha < 0.2
    rows = "".join(f"{t:.1f},{pitch},{-0.5 * np.sin(pitch - alpha) * t:.9f},0.1\n" for t in time)
    (tmp_path / "log.csv").write_text("time_s,pitch_rad,depth_m,heading_rad\n" + rows)
    record = read_record(tmp_path / "log.csv", required=Needs(("heading_rad",), attack=needs.attack))
    assert record["u_mps"] == pytest.approx(0.5, abs=1e-6)
    assert "less the angle of attack" in record.attrs["derived"]
    assert not read_record(tmp_path / "log.csv", required=["heading_rad"]).has("u_mps")


def test_a_volume_that_is_upside_down_about_its_neutral_is_refused_as_such():
    """A Seaglider's volume counts from its largest: with the sign of its column turned, it goes below its smallest."""
    glider = load_vehicle("seaglider")
    low, neutral, high = (getattr(glider.hull, f"engine_{name}") for name in ("low", "neutral", "high"))
    upright = _record(buoyancy_volume_m3=np.where(np.sin(TIME / 60.0) > 0.0, low, high))
    check_ranges(glider, upright)
    assert abs(2.0 * neutral - low - high) > 0.1 * (high - low)  # it is not in the middle
    turned = upright.with_channels({"buoyancy_volume_m3": 2.0 * neutral - upright["buoyancy_volume_m3"]})
    with pytest.raises(ValueError, match=rf"looks mirrored about its neutral {neutral:.4g}\.$"):
        check_ranges(glider, turned)


def _volumes(glider):
    """A glider's engine at work, and the volume at which the vehicle is neutral."""
    low, neutral, high = (getattr(glider.hull, f"engine_{name}") for name in ("low", "neutral", "high"))
    return np.where(np.sin(TIME / 60.0) > 0.0, 0.8 * low + 0.2 * high, 0.3 * low + 0.7 * high), neutral


@pytest.mark.parametrize(
    "factor, words", [(1e-6, "1,000,000 times too small, as m3 in a column of cm3"), (1e-3, "lit")]
)
def test_a_volume_in_too_small_a_unit_is_refused_though_it_is_within_its_range(factor, words):
    glider = load_vehicle("seaglider")
    volumes, _ = _volumes(glider)
    with pytest.raises(ValueError, match=rf"buoyancy_volume_m3 hardly moves: it spans .* -0.00083 to 0 m3.*{words}"):
        check_ranges(glider, _record(buoyancy_volume_m3=factor * volumes))


def test_a_volume_in_too_small_a_unit_that_was_moved_to_its_neutral_is_refused():
    glider = load_vehicle("seaglider")
    volumes, neutral = _volumes(glider)
    with pytest.raises(ValueError, match="m3 in a column of cm3"):
        check_ranges(glider, _record(buoyancy_volume_m3=neutral + 1e-6 * (volumes - neutral)))


def test_actuators_of_any_vehicle_are_held_against_their_ranges():
    glider = load_vehicle("seawing")
    ballast = Record.from_arrays(TIME, {"depth_m": TIME, "ballast_m3": 4e-10 * np.sin(TIME / 60.0)})
    with pytest.raises(ValueError, match=r"ballast_m3 hardly moves: it spans 8e-10 m3.*cm3"):
        check_ranges(glider, ballast)


def test_fins_in_degrees_that_were_taken_for_radians_are_refused_and_those_at_their_stops_are_not():
    torpedo = load_vehicle("npsauv")
    stop = value_at(torpedo, "parts.rudder.limit")
    angles = np.clip(2.0 * stop * np.sin(TIME / 60.0), -stop, stop)
    log = {"heading_rad": 0.0 * TIME, "stern_plane_rad": angles, "propeller_rpm": 1300.0 + 0.0 * TIME}
    check_ranges(torpedo, _record(rudder_rad=1.5 * angles, **log))  # some controllers ask for more than there is
    with pytest.raises(ValueError, match=r"rudder_rad goes from -20 to 20 rad.* 57.3 times too large, as degrees"):
        check_ranges(torpedo, _record(rudder_rad=np.degrees(angles), **log))


@pytest.mark.parametrize("volume", [-3e-4, 0.0, -5.05e-4])
def test_a_volume_that_is_held_is_no_unit(volume):
    glider, noise = load_vehicle("seaglider"), 2e-7 * np.sin(TIME)  # a sensor's
    assert _out_of_range(glider, _record(buoyancy_volume_m3=np.full(TIME.size, volume))) == ""
    assert _out_of_range(glider, _record(buoyancy_volume_m3=min(volume, -1e-4) + noise)) == ""


def test_a_first_look_says_what_a_diagnosis_would_refuse_or_leave_out():
    glider, volumes = load_vehicle("seaglider"), _volumes(load_vehicle("seaglider"))[0]
    depth, pitch = 200.0 - 100.0 * np.cos(TIME / 90.0), -0.4 * np.sin(TIME / 90.0)
    flown = _record(depth_m=depth, pitch_rad=pitch, buoyancy_volume_m3=volumes)
    assert refusal(glider, flown) == ""
    (line,) = wrong_for(glider, flown.with_channels({"pitch_rad": np.where(TIME < 400.0, 0.02, pitch)}))
    assert line.startswith("73 % of the log is left out, since seaglider does not describe it")
    assert wrong_for(glider, flown) == []
    turned = flown.with_channels({"pitch_rad": -pitch})
    assert wrong_for(glider, turned) == [refusal(glider, turned)]
    assert refusal(glider, turned).startswith("100 % of the log is left out")
    assert wrong_for(glider, _record()) == []  # what is missing is told elsewhere


def test_a_volume_of_another_engine_is_not_taken_for_another_unit():
    explorer, volumes = load_vehicle("seaexplorer"), _volumes(load_vehicle("seaglider"))[0]
    with pytest.raises(ValueError, match=r"unit, throughout the log, and whether seaexplorer is the right vehicle\.$"):
        check_ranges(explorer, _record(buoyancy_volume_m3=volumes))
    with pytest.raises(ValueError, match=r"throughout the log; it looks like cm3"):
        check_ranges(explorer, _record(buoyancy_volume_m3=1e6 * 0.4 * volumes))


def test_samples_before_the_first_command_do_not_refuse_a_log():
    """As in a bag that begins before its commands, read before the vehicle's channels are known."""
    rov, time = load_vehicle("bluerov2_heavy"), np.arange(0.0, 60.0, 0.05)
    columns = {f"{name}_rad": 0.1 * np.sin(time + k) for k, name in enumerate(("roll", "pitch", "heading"))}
    columns |= {f"{name}_radps": 0.1 * np.cos(time + k) for k, name in enumerate("pqr")}
    columns |= {f"t{k}_share": 0.5 * np.sign(np.sin(k * time)) * (k > 1) for k in range(1, 9)}  # the first one rests
    record = Record.from_arrays(time, columns)
    for k in range(1, 9):
        record.dataset[f"t{k}_share"].values[:6] = np.nan
    assert refusal(rov, record) == ""
    assert len(wrong_for(rov, record)) == 1


def test_a_gap_in_a_log_does_not_restart_a_leak():
    plant = replace_at(FLOAT, "effects.volume.leak", 2e-8)
    whole = _record()
    cut = whole.select((TIME < 300.0) | (TIME > 312.0))
    elapsed = inputs_of(plant, cut)[:, plant.inputs.index("elapsed_s")]
    assert np.array_equal(elapsed, cut.time)
    assert len(cut.segments) == 2
    start = np.zeros(len(plant.family.states))
    second = cut.segments[1]
    late = slice(int(np.searchsorted(TIME, cut.time[second.start])), TIME.size)
    same = plant.run(whole, [late], start[None])
    assert np.array_equal(plant.run(cut, [second], start[None]), same)


@pytest.mark.parametrize("labels, again", [(("one", "two"), True), (("one", "one"), False)])
def test_time_starts_again_with_another_label_and_with_a_clock_that_does(labels, again):
    early = TIME < 300.0
    kept = early | (TIME > 312.0)
    record = _record(segment=np.where(early, *labels)).select(kept)
    begun = record.time[record.segments[1].start] if again else 0.0
    expected = record.time - np.where(record.time > 300.0, begun, 0.0)
    assert np.array_equal(elapsed_over_gaps(record), expected)
    twice = concat([record, record])
    assert np.array_equal(elapsed_over_gaps(twice), np.tile(expected, 2))


def test_wild_readings_that_are_left_out_restart_nothing_and_join_no_dives():
    depth = np.where(np.isin(np.arange(TIME.size), (100, 101, 700)), -300.0, 20.0 + 5.0 * np.sin(TIME / 60.0))
    kept = described(FLOAT, _record(segment=np.where(TIME < 300.0, "one", "two"), depth_m=depth))
    begun = np.where(kept.time < 300.0, 0.0, TIME[TIME >= 300.0][0])
    assert np.array_equal(kept["elapsed_s"], kept.time - begun)


@pytest.mark.parametrize("push, said", [(0.025, 1), (0.25, 0), (0.0, 0)])
def test_thrusters_that_stay_in_their_dead_zone_are_remarked(push, said):
    time = np.arange(100.0)
    shares = {f"t{k}_share": push * np.sign(np.sin(k * time + 0.1)) for k in range(1, 9)}
    lines = command_remarks(load_vehicle("bluerov2_heavy"), Record.from_arrays(time, shares))
    assert sum("No thruster is commanded more than 2.5 % of its full thrust" in line for line in lines) == said


def _commands(vehicle, values, still=()):
    """A log in which thrusters follow sines between two values; those in `still` stay in the middle."""
    least, most = values
    thrusters = find_thrusters(load_vehicle(vehicle)).channels
    middle, time = 0.5 * (least + most), np.arange(0.0, 60.0, 0.1)
    waves = {name: middle + 0.5 * (most - least) * np.sin(time + k) for k, name in enumerate(thrusters)}
    waves |= {name: np.full(time.size, middle) for name in still}
    measured = ("roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps")
    return Record.from_arrays(time, waves | {name: 0.1 * np.sin(time) for name in measured})


@pytest.mark.parametrize(
    "vehicle, values, words",
    [
        ("bluerov", (-1.0, 1.0), "they look like shares from -1 to 1"),
        ("bluerov", (-100.0, 100.0), "they look like percent from -100 to 100"),
        ("bluerov", (-400.0, 400.0), "they look like pulse lengths less 1500 us"),
        ("bluerov", (500.0, 2500.0), "check their unit"),
        ("bluerov2_heavy", (-90.0, 90.0), "they look like percent from -100 to 100"),
        ("bluerov2_heavy", (1000.0, 2000.0), "they look like pulse lengths in us"),
    ],
)
def test_thruster_commands_in_another_unit_are_refused_with_the_unit_that_they_look_like(vehicle, values, words):
    plant, log = load_vehicle(vehicle), _commands(vehicle, values)
    rest = {"bluerov": "1100 to 1900 us, and rests at 1500", "bluerov2_heavy": "-1 to 1, and rests at 0"}[vehicle]
    with pytest.raises(ValueError, match=rf"{vehicle} takes commands of {rest}; those of this log \(t1_.*{words}\."):
        check_ranges(plant, log, FEW)
    assert words in refusal(plant, log)


@pytest.mark.slow  # the programs of the first BlueROV
def test_pulses_beyond_their_range_now_and_then_are_remarked():
    rov, log = load_vehicle("bluerov"), _commands("bluerov", (1150.0, 1850.0))
    check_ranges(rov, log, FEW)
    assert command_remarks(rov, log) == []
    pulses = log["t3_us"].copy()
    pulses[[100, 200]] = 900.0, 2100.0
    check_ranges(rov, wild := log.with_channels({"t3_us": pulses}), FEW)
    (line,) = command_remarks(rov, wild)
    assert line.startswith("t3_us goes from 900 to 2100 us, but its thruster takes 1100 to 1900.")
    assert "(2 of 600 samples), the thrust at its end is assumed" in line


def test_nine_channels_for_eight_thrusters_and_thrusters_at_rest_are_remarked():
    rov, log = load_vehicle("bluerov2_heavy"), _commands("bluerov2_heavy", (-0.5, 0.5), still=("t2_share", "t8_share"))
    still, extra = command_remarks(rov, log.with_channels({"t9_share": log["t1_share"]}))
    assert still.startswith("t2_share and t8_share do not move. This log shows nothing about their gain")
    assert extra.startswith("bluerov2_heavy has 8 thrusters (t1_share, ")
    assert "the log also has t9_share, which is not used." in extra


@pytest.mark.parametrize("vehicle, middle", [("bluerov2_heavy", 0.0), ("bluerov", 1500.0)])
def test_a_log_in_which_no_thruster_ever_moves_is_refused(vehicle, middle):
    plant, log = load_vehicle(vehicle), _commands(vehicle, (middle, middle))
    with pytest.raises(
        ValueError, match=rf"Nothing excites the vehicle: t1_\w+ to t[68]_\w+ are constant at {middle:g}.*it moves\."
    ):
        check_excitation(plant, described(plant, log))
    assert "Nothing excites the vehicle" in refusal(plant, log)
