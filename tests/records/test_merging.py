from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.records.attitude import QUATERNION, angles, from_angles
from auv_gym.records.merging import merged
from auv_gym.records.streams import Stream, in_order

NAMES = ("pitch_rad", "roll_rad", "temperature_C", "salinity_psu", "altitude_m")


def stream(time, name="", **values):
    time = np.asarray(time, dtype=float)
    return Stream(time, {k: np.asarray(v, dtype=float) for k, v in values.items()}, name)


def interleaved(*streams):
    """One table of the rows of streams, with blank cells in the columns of the others."""
    time = np.unique(np.concatenate([one.time for one in streams]))
    values = {}
    for one in streams:
        for name, column in one.values.items():
            values[name] = np.full(time.size, np.nan)
            values[name][np.searchsorted(time, one.time)] = column
    return Stream(time, values)


def test_commands_are_held_and_measurements_interpolated():
    fast = stream(np.arange(0, 10, 0.5), "imu", heading_rad=np.arange(20) * 0.1)
    slow = stream([0.0, 1.0, 2.0, 3.0, 4.0], "depth", depth_m=[0, 2, 4, 6, 8])
    command = stream([1.2, 3.1], "fins", rudder_rad=[0.1, -0.2])
    r = merged([fast, slow, command], "heading_rad")
    assert r.time.tolist() == fast.time.tolist()
    assert r.values["depth_m"][:9] == pytest.approx(2 * fast.time[:9])
    assert np.isnan(r.values["depth_m"][9:]).all()  # nothing is known after its last sample
    assert np.isnan(r.values["rudder_rad"][:3]).all()  # nor of a command before its first
    assert r.values["rudder_rad"][3:].tolist() == [0.1] * 4 + [-0.2] * 13
    assert any("at the times of heading_rad" in line for line in r.notes)


def test_stamps_that_only_rounding_tells_apart_are_of_one_time():
    """Seconds since 1970 as a float, and as whole seconds and nanoseconds: a command is not a row late for that."""
    exact = 1.7e9 + 0.1 * np.arange(500)
    rounded = exact + 2.4e-7 * (np.arange(500) % 3)
    base = stream(exact, "state", heading_rad=np.arange(500) * 0.01)
    steps = np.where(np.arange(500) % 2, 0.3, -0.3)
    r = merged([base, stream(rounded, "fins", rudder_rad=steps), stream(rounded, "gyro", r_radps=steps)], "heading_rad")
    assert r.values["rudder_rad"].tolist() == steps.tolist()
    assert r.values["r_radps"] == pytest.approx(steps, abs=1e-5)
    late = merged([base, stream(exact + 0.001, "fins", rudder_rad=steps)], "heading_rad")
    assert late.values["rudder_rad"][1:].tolist() == steps[:-1].tolist()


def test_what_is_measured_more_rarely_than_the_rows_is_told_with_its_interval():
    base = stream(
        np.arange(0, 10, 0.5), "imu", heading_rad=np.arange(20), pitch_rad=np.where(np.arange(20) % 3, np.nan, 0.1)
    )
    rare = stream(np.arange(0, 10, 2.0) + 0.1, "depth", depth_m=np.arange(5), rudder_rad=np.arange(5))
    often = stream(np.arange(0, 10, 0.1), "gyro", r_radps=np.arange(100))
    found = merged([base, rare, often], "heading_rad")
    assert found.intervals == pytest.approx({"depth_m": 2.0})
    assert list(found.unread) == ["pitch_rad"]


def test_what_was_read_at_the_times_of_some_rows_tells_nothing_at_the_others():
    """Which rows these are is known, whether their cells are blank or another topic has fewer messages."""
    every = np.arange(1, 20, 3)
    cells = np.full(20, np.nan)
    cells[every] = 0.1 * every
    time = np.arange(0, 10, 0.5)
    base = stream(time, "imu", heading_rad=np.arange(20), pitch_rad=cells)
    dvl = stream(time[every] + 1e-7, "dvl", v_mps=0.1 * every)
    late = stream(np.r_[time[every], 9.99], "sonar", depth_m=np.zeros(len(every) + 1))
    outside = stream(np.r_[-9.9, time[every], 70.2], "gps", north_m=np.zeros(len(every) + 2))
    found = merged([base, dvl, late, outside], "heading_rad")
    for name in ("pitch_rad", "v_mps", "north_m"):
        assert np.flatnonzero(~found.unread[name]).tolist() == every.tolist(), name
    assert list(found.intervals) == ["depth_m"]  # one of its readings lies between rows
    assert found.values["pitch_rad"][1:20] == pytest.approx(0.1 * np.arange(1, 20))
    assert found.values["v_mps"][every] == pytest.approx(0.1 * every, abs=1e-6)


def test_rows_of_one_time_that_contradict_each_other_are_told_by_channel():
    notes = []
    twice = np.r_[0:10, 10, 10, 10:20].astype(float)
    row = np.arange(twice.size, dtype=float)
    found = in_order(stream(twice, depth_m=np.where(row == 11, 99.9, 5.0), pitch_rad=0.1 + 0 * row), notes)
    assert found.values["depth_m"][10] == 5.0
    assert notes == [
        "2 rows have the time of the row before and were merged with it; they differ in depth_m in 2 of these rows, "
        "where the last value is kept."
    ]


def test_rows_that_all_have_one_time_are_refused_with_words():
    with pytest.raises(ValueError, match=r"All 50 rows have the same time.* give another column as time_s"):
        merged([stream(np.full(50, 7.0), depth_m=np.arange(50.0))])


def test_rows_without_any_time_are_refused_with_words():
    with pytest.raises(ValueError, match=r"None of the 50 rows has a time.* give another column as time_s"):
        merged([stream(np.full(50, np.nan), depth_m=np.arange(50.0))])


def test_dated_rows_in_no_order_are_sorted_and_a_clock_without_dates_is_left_as_it_is():
    time = np.random.default_rng(1).permutation(200) * 10.0
    shuffled, notes = stream(time, depth_m=time), []
    found = in_order(replace(shuffled, dated=True), notes)
    assert found.time.tolist() == found.values["depth_m"].tolist() == sorted(time)
    assert notes == ["The rows were in no order and were sorted by their dates."]
    in_order(shuffled, notes)
    assert "late or out of order" in notes[1]
    back = stream(np.r_[0:100, 50:150], depth_m=np.arange(200))  # set back once, as when it is set by GPS
    assert in_order(replace(back, dated=True), notes).part[-1] == 1


def test_measurements_are_not_interpolated_across_a_gap():
    base = stream(np.arange(0, 60.0), "a", heading_rad=np.zeros(60))
    t = np.r_[0:20, 40:60].astype(float) + 0.5
    r = merged([base, stream(t, "b", pitch_rad=t)], "heading_rad")
    inside = (base.time > 20) & (base.time < 40)
    assert np.isnan(r.values["pitch_rad"][inside]).all()
    assert r.values["pitch_rad"][1:20] == pytest.approx(base.time[1:20])


def test_a_motion_sampled_too_slowly_is_not_made_up():
    base = stream(np.arange(0, 100, 0.1), "a", heading_rad=np.zeros(1000))
    slow = stream(np.arange(0, 100, 5.0), "b", depth_m=np.arange(20))  # regular, but 50 intervals of the base apart
    assert np.isfinite(merged([base, slow], "heading_rad").values["depth_m"]).sum() == 20  # its own samples alone
    water = Stream(slow.time, {"temperature_C": np.arange(20.0)}, "b")  # it does little in between
    assert np.isfinite(merged([base, water], "heading_rad").values["temperature_C"]).sum() > 900
    aside = Stream(slow.time + 0.03, slow.values, "b")  # in the rows next to its samples
    found = merged([base, aside], "heading_rad").values["depth_m"]
    assert np.array_equal(np.flatnonzero(np.isfinite(found))[:4], [50, 100, 150, 200])
    assert np.nanmax(np.abs(found - base.time / 5.0)) < 0.01
    near = Stream(slow.time, slow.values, "b", near=60.0)  # a reader may know better
    assert np.isfinite(merged([base, near], "heading_rad").values["depth_m"]).sum() > 900


def test_headings_are_interpolated_through_north():
    base = stream([0.0, 0.5, 1.0], "a", depth_m=[0, 0, 0])
    r = merged([base, stream([0.0, 1.0], "b", heading_rad=np.radians([350, 10]))], "depth_m")
    assert np.mod(np.degrees(r.values["heading_rad"][1]) + 180, 360) - 180 == pytest.approx(0.0, abs=1e-9)


def test_attitudes_are_interpolated_along_the_shortest_turn():
    half = np.radians(80.0) / 2  # pitch from 80 to 100 degrees: through the vertical
    q = np.array([[np.cos(a), 0, np.sin(a), 0] for a in (half, np.radians(100.0) / 2)])
    q[1] *= -1  # the same attitude with the other sign
    base = stream([0.0, 0.5, 1.0], "a", depth_m=[0, 0, 0])
    r = merged([base, stream([0.0, 1.0], "b", **dict(zip(QUATERNION, q.T)))], "depth_m")
    middle = np.array([[r.values[name][1] for name in QUATERNION]])
    assert np.abs(middle[0]) == pytest.approx([np.cos(np.pi / 4), 0, np.sin(np.pi / 4), 0], abs=1e-12)
    assert angles(middle)[1] == pytest.approx([np.pi / 2])


def test_late_rows_are_sorted_in_and_reported():
    time = np.array([0, 1, 2, 4, 3, 5, 6, 7.0])
    notes = []
    s = in_order(stream(time, depth_m=time), notes)
    assert s.time.tolist() == sorted(time)
    assert s.values["depth_m"].tolist() == sorted(time)
    assert s.part.max() == 0
    assert notes == ["1 row came late or out of order and was sorted into place."]


@given(seed=st.integers(0, 999), jitter=st.floats(0.0, 0.45))
def test_jitter_of_less_than_an_interval_never_cuts(seed, jitter):
    rng = np.random.default_rng(seed)
    time = np.arange(60.0) + rng.uniform(-2 * jitter, 2 * jitter, 60)
    notes = []
    s = in_order(stream(time, depth_m=time), notes)
    assert s.part.max() == 0
    assert (np.diff(s.time) > 0).all()
    assert s.values["depth_m"].tolist() == s.time.tolist()


@pytest.mark.parametrize("back", [3.0, 20.0, 1e6])
def test_a_clock_that_was_set_back_cuts_the_record(back):
    time = np.r_[np.arange(50.0), np.arange(50.0, 100.0) - back]
    notes = []
    s = in_order(stream(time, depth_m=np.arange(100.0)), notes)
    assert s.part.tolist() == [0] * 50 + [1] * 50
    assert s.values["depth_m"].tolist() == list(range(100))
    assert notes == ["The clock went back once; the record is cut there."]


def test_rows_of_one_time_are_merged():
    notes = []
    s = in_order(stream([0, 1, 1, 2], depth_m=[0, 1, np.nan, 2], pitch_rad=[0, np.nan, 5, 6]), notes)
    assert s.time.tolist() == [0, 1, 2]
    assert s.values["depth_m"].tolist() == [0, 1, 2]
    assert s.values["pitch_rad"].tolist() == [0, 5, 6]
    assert notes == ["1 row has the time of the row before and was merged with it."]


def test_rows_without_a_time_are_left_out():
    notes = []
    s = in_order(stream([0, np.nan, 2], "imu", depth_m=[0, 1, 2]), notes)
    assert s.values["depth_m"].tolist() == [0, 2]
    assert notes == ["1 row of imu without a time left out."]


def test_where_all_clocks_went_back_the_parts_correspond():
    time = np.r_[np.arange(0, 10, 0.5), np.arange(2, 12, 0.5)]
    a = stream(time, "a", heading_rad=np.arange(40))
    b = stream(time[::2] + 0.1, "b", depth_m=np.arange(20))
    r = merged([a, b], "heading_rad")
    assert r.segment.tolist() == [0] * 20 + [1] * 20
    known = np.isfinite(r.values["depth_m"])
    # in either part, depth follows the rows that were logged beside it: twice as many headings
    assert r.values["depth_m"][known] == pytest.approx(r.values["heading_rad"][known] / 2 - 0.1, abs=1e-9)


def test_where_only_one_clock_went_back_its_rows_wait_until_it_has_caught_up():
    a = stream(np.arange(0, 30, 0.5), "a", heading_rad=np.arange(60))
    t = np.r_[np.arange(0, 15.0), np.arange(10.0, 30.0)]
    r = merged([a, stream(t, "b", depth_m=t)], "heading_rad")
    known = np.isfinite(r.values["depth_m"])
    assert r.values["depth_m"][known] == pytest.approx(r.time[known])
    assert any("b left out until its clock had caught up" in line for line in r.notes)


def test_columns_that_skip_rows_are_brought_to_those_of_the_leading_one():
    t = np.arange(40.0)
    heading = np.where(t % 4 == 0, t, np.nan)
    pitch = np.where(t % 4 == 2, 0.01 * t, np.nan)
    r = merged([stream(t, heading_rad=heading, pitch_rad=pitch)])
    assert r.time.tolist() == t[::4].tolist()
    assert r.values["pitch_rad"][1:] == pytest.approx(0.01 * r.time[1:])
    assert np.isnan(r.values["pitch_rad"][0])


def test_a_command_that_is_logged_when_it_changes_holds_in_the_rows_between():
    t = np.arange(10.0)
    changed = np.where(np.isin(t, [1, 5]), t, np.nan)
    r = merged([stream(t, heading_rad=0.1 * t, rudder_cmd_rad=0.01 * changed, temperature_C=changed)])
    assert np.isnan(r.values["rudder_cmd_rad"][0])
    assert r.values["rudder_cmd_rad"][1:] == pytest.approx([0.01] * 4 + [0.05] * 5)
    assert r.values["temperature_C"][1:6] == pytest.approx(t[1:6])  # a measurement is interpolated
    assert np.flatnonzero(~r.unread["temperature_C"]).tolist() == [1, 5]
    assert np.isnan(r.values["temperature_C"]).sum() == 5


@pytest.mark.parametrize("lost", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("interval", [0.5, 1.0, 2.0, 4.0, 8.0, 12.0])
def test_sensors_with_rows_of_their_own_are_brought_to_those_of_the_leading_one(interval, lost):
    """Faster or slower, and whichever readings were lost: no channel depends on where its rows happen to stand."""
    rng = np.random.default_rng(1)
    every = np.arange(0.0, 2000.0, 4.0)
    others = np.arange(0.3, 2000.0, interval)
    depth, pitch = every[rng.uniform(size=every.size) >= lost], others[rng.uniform(size=others.size) >= lost]
    apart = [
        stream(depth, depth_m=0.1 * depth, temperature_C=0.01 * depth),
        stream(pitch, "attitude", pitch_rad=1e-4 * pitch, heading_rad=2e-4 * pitch),
        stream(pitch[::3] + 0.1, "engine", buoyancy_volume_m3=1e-6 * pitch[::3], rudder_cmd_rad=pitch[::3]),
    ]
    r, as_streams = merged([interleaved(*apart)], "depth_m"), merged(apart, "depth_m")
    assert r.time.tolist() == depth.tolist()
    for name, values in as_streams.values.items():
        assert np.array_equal(r.values[name], values, equal_nan=True), name
    assert (r.intervals, list(r.unread)) == (as_streams.intervals, list(as_streams.unread))
    known = np.isfinite(r.values["pitch_rad"])
    assert known.mean() > (0.98 if interval < 8.0 else 0.8)
    assert r.values["pitch_rad"][known] == pytest.approx(1e-4 * depth[known])
    assert r.notes[-1].startswith("All signals are given at the times of depth_m, every 4 s; ")
    assert r.notes[-1].endswith(" other rows had no reading of it.")


def test_a_burst_of_other_sensors_between_two_rows_leaves_no_hole():
    """Were their rows kept, the leading channel would be missing in five rows in a row, and the record cut there."""
    t = np.arange(0.0, 600.0)
    bursts = [stream(t[::5] + 0.1 * (k + 1), **{name: 1e-3 * t[::5]}) for k, name in enumerate(NAMES)]
    r = merged([interleaved(stream(t, depth_m=t), *bursts)], "depth_m")
    assert r.values["depth_m"].tolist() == r.time.tolist() == t.tolist()
    for k, name in enumerate(NAMES):
        assert r.values[name][1:596] == pytest.approx(1e-3 * (t[1:596] - 0.1 * (k + 1)))


def test_commands_of_an_interleaved_table_are_held():
    depth, fast, slow = np.arange(0.0, 400.0, 4.0), np.arange(0.3, 400.0), np.arange(2.3, 400.0, 40.0)
    table = interleaved(
        stream(depth, depth_m=depth), stream(fast, rudder_rad=fast), stream(slow, depth_cmd_m=slow, dvl_good=slow > 200)
    )
    r = merged([table], "depth_m")
    assert r.values["rudder_rad"][1:].tolist() == (np.floor(depth[1:] - 0.3) + 0.3).tolist()
    held = slow[np.searchsorted(slow, depth[1:]) - 1]
    assert r.values["depth_cmd_m"][1:].tolist() == held.tolist()
    assert r.values["dvl_good"][1:].tolist() == (held > 200).tolist()


def test_attitudes_of_an_interleaved_table_are_interpolated_along_the_shortest_turn():
    depth, fast = np.arange(0.0, 400.0, 4.0), np.arange(0.3, 401.0)
    turned = np.column_stack([np.cos(0.05 * fast), 0 * fast, np.sin(0.05 * fast), 0 * fast])  # loops of pitch
    roll, pitch, heading = angles(turned)
    table = interleaved(stream(depth, depth_m=depth), stream(fast, roll_rad=roll, pitch_rad=pitch, heading_rad=heading))
    r = merged([table], "depth_m")
    found = from_angles(*(r.values[name][1:] for name in ("roll_rad", "pitch_rad", "heading_rad")))
    truth = np.column_stack([np.cos(0.05 * depth), 0 * depth, np.sin(0.05 * depth), 0 * depth])[1:]
    assert np.abs(np.sum(found * truth, axis=1)) == pytest.approx(np.ones(len(truth)), abs=1e-12)


def test_a_channel_that_is_read_in_every_row_does_not_lead_for_that():
    t = np.arange(0.0, 40.0, 0.1)
    r = merged([stream(t, pitch_rad=t, depth_m=np.where(np.arange(400) % 10 == 3, t, np.nan))], "depth_m")
    assert r.time.tolist() == t[3::10].tolist()
    assert r.values["pitch_rad"].tolist() == r.values["depth_m"].tolist() == r.time.tolist()


def test_rows_in_which_the_leading_channel_is_missing_stay():
    """They are missing samples of one table, which a record fills, or tells of."""
    t, rng = np.arange(500.0), np.random.default_rng(1)
    lost, other = rng.uniform(size=500) < 0.2, rng.uniform(size=500) < 0.1
    table = stream(
        t, depth_m=np.where(lost, np.nan, t), pitch_rad=np.where(other, np.nan, t), u_mps=np.where(t % 5, np.nan, t)
    )
    r = merged([table], "depth_m")
    assert r.time.tolist() == t.tolist()
    assert np.isnan(r.values["depth_m"]).tolist() == lost.tolist()
    assert np.isnan(r.values["pitch_rad"]).tolist() == other.tolist()
    assert r.values["u_mps"][:496] == pytest.approx(t[:496])
    assert not r.notes


def test_rows_of_sensors_that_no_mapping_names_are_left_out():
    t = np.arange(400.0)
    r = merged([stream(t, depth_m=np.where(t % 4 == 1, t, np.nan))])
    assert r.values["depth_m"].tolist() == r.time.tolist() == t[1::4].tolist()


def test_a_leading_channel_without_readings_leaves_no_rows():
    assert merged([stream(np.arange(9.0), depth_m=np.full(9, np.nan), pitch_rad=np.ones(9))], "depth_m").time.size == 0


def test_without_a_vehicle_heading_leads_then_depth():
    a, b = stream([0, 1], "a", pitch_rad=[0, 0]), stream([0, 0.5, 1], "b", depth_m=[0, 1, 2])
    assert merged([a, b]).leading == "depth_m"
    c = stream([0, 1], "c", heading_rad=[0, 0])
    assert merged([a, b, c]).leading == "heading_rad"
    assert merged([a]).leading == "pitch_rad"


def test_nothing_to_merge():
    r = merged([stream([], depth_m=[])])
    assert r.time.size == 0
    assert r.values == {}


@pytest.mark.parametrize(
    "sent, changes, known_until",
    [
        (np.arange(50) / 5.0, False, 10.2),
        (np.r_[np.arange(25) / 5.0, 7.8 + np.arange(11) / 5.0], False, 15.8),  # twice the longest pause, 3 s
        (np.arange(50) / 5.0, True, np.inf),  # sent when it changes
        (np.arange(9) / 5.0, False, np.inf),  # too few messages to tell
    ],
)
def test_a_command_that_is_sent_again_and_again_is_unknown_once_that_has_ended(sent, changes, known_until):
    time = np.arange(300) / 10.0
    values = 0.1 * (np.arange(sent.size) % 2 if changes else np.arange(sent.size) > 5)
    made = merged([stream(time, heading_rad=0.1 * time), stream(sent, "commands", rudder_rad=values)])
    known = np.isfinite(made.values["rudder_rad"])
    assert np.array_equal(known, time <= known_until + 1e-6)
    ended = [f"rudder_rad: last sent {time[-1] - sent[-1]:.3g} s before the log ends, and unknown after that."]
    assert [line for line in made.notes if "sent" in line] == ended * bool(np.isfinite(known_until))


def test_a_set_point_that_is_no_longer_sent_holds_to_the_end():
    time = np.arange(300) / 10.0
    made = merged([stream(time, heading_rad=0.1 * time), stream(time[:50], "commands", heading_cmd_rad=np.ones(50))])
    assert np.isfinite(made.values["heading_cmd_rad"]).all()
    assert not any("sent" in line for line in made.notes)
