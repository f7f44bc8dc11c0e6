from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, strategies as st

from auv_gym.records.record import Record, check_record, concat, records_of


def record(n=50, dt=4.0, **more):
    t = dt * np.arange(n)
    return Record.from_arrays(t, {"heading_rad": 0.1 * t, "rudder_rad": np.sin(t), **more}, attrs={"source": "made"})


def test_a_record_gives_back_its_signals_with_units():
    r = record()
    assert r.names == ("heading_rad", "rudder_rad")
    assert r.has("heading_rad")
    assert not r.has("depth_m")
    assert r["heading_rad"].dtype == np.float64
    assert r.dataset["heading_rad"].attrs == {"units": "rad", "long_name": "heading"}
    assert r.matrix(["rudder_rad", "time_s"]).flags.c_contiguous
    assert np.array_equal(r.matrix(["rudder_rad", "time_s"]), np.stack([r["rudder_rad"], r.time], axis=1))
    assert (len(r), r.duration_s, r.sample_interval, r.is_uniform()) == (50, 196.0, 4.0, True)
    assert "50 samples" in repr(r)


def test_what_a_record_gives_out_is_a_copy():
    r = record()
    r["rudder_rad"][:] = 7.0
    r.time[:] = 7.0
    assert r["rudder_rad"][0] == 0.0
    assert r.time[1] == 4.0


def test_a_missing_channel_is_named_with_those_there():
    with pytest.raises(ValueError, match=r"no channel 'heading_deg'; it has heading_rad, rudder_rad.*Did you mean"):
        record()["heading_deg"]
    with pytest.raises(ValueError, match="no channel 'depth_m'"):
        record().without(["depth_m"])


@pytest.mark.parametrize(
    "time, text",
    [
        ([0, 4, 8, 6, 10], "goes backwards at row 4: 6 s after 8 s; sort the rows, or mark a restart"),
        ([0, 4, 4, 8, 12], "stands still at row 3: 4 s after 4 s; remove the repeated row"),
        ([0, 4, np.nan, 8, 12], "missing at row 3"),
    ],
)
def test_time_that_does_not_rise_is_refused(time, text):
    with pytest.raises(ValueError, match=text):
        Record.from_arrays(time, {"depth_m": np.zeros(5)})


def test_time_may_restart_with_a_segment():
    r = Record.from_arrays([0, 4, 8, 0, 4], {"depth_m": np.arange(5.0)}, segment=["a", "a", "a", "b", "b"])
    assert r.segments == [slice(0, 3), slice(3, 5)]
    assert r.labels == ["a", "b"]
    assert r.duration_s == 12.0


def test_a_dataset_is_checked_without_repair():
    data = xr.Dataset({"depth_m": ("time_s", [0.0, np.nan, 2.0])}, {"time_s": [0.0, 1.0, 2.0]})
    with pytest.raises(ValueError, match=r"'depth_m' has no finite value at row 2 \(1 s\)"):
        Record(data)
    assert Record(data.fillna(1.0))["depth_m"].tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="coordinate time_s"):
        Record(xr.Dataset({"depth_m": ("row", [0.0, 1.0])}))
    with pytest.raises(ValueError, match="single sample"):
        Record(data.fillna(1.0).assign(segment=("time_s", [0, 0, 1])))
    with pytest.raises(ValueError, match="at least 2 samples, got 1"):
        Record(data.isel(time_s=[0]))


@pytest.mark.parametrize("values", [[1.0, 2.0], [[1.0], [2.0], [3.0]], ["a", "b", "c"]])
def test_arrays_need_one_number_per_sample(values):
    with pytest.raises(ValueError, match="'depth_m' needs"):
        Record.from_arrays([0, 1, 2], {"depth_m": values})


def test_channels_must_be_si():
    with pytest.raises(ValueError, match="'heading_rad'"):
        Record.from_arrays([0, 1], {"heading_deg": [0, 1]})


def test_short_runs_are_filled_and_counted():
    nan = np.nan
    r = Record.from_arrays(
        np.arange(6.0),
        {
            "depth_m": [0, nan, nan, 3, 4, 5],
            "rudder_rad": [1, 1, 2, nan, 3, 3],
            "temperature_C": [9, np.inf, 7, 6, 5, 4],
        },
    )
    assert r["depth_m"].tolist() == [0, 1, 2, 3, 4, 5]
    assert r["rudder_rad"].tolist() == [1, 1, 2, 2, 3, 3]  # inputs hold
    assert r["temperature_C"].tolist() == [9, 8, 7, 6, 5, 4]
    assert [r.dataset[name].attrs["filled"] for name in r.names] == [2, 1, 1]
    assert "dropped" not in r.attrs


def test_what_is_filled_in_between_readings_is_no_reading(tmp_path):
    """A speed of half the rate, and a reading that is lost: the values between are drawn, and tell nothing."""
    nan, time = np.nan, 0.1 * np.arange(8)
    speed = [0.0, nan, 0.2, nan, 0.4, nan, 0.6, 0.7]
    r = Record.from_arrays(
        time,
        {"depth_m": np.where(np.arange(8) == 5, nan, time), "u_dvl_mps": speed, "rudder_rad": [1, nan, *range(6)]},
        unread={"depth_m": np.arange(8) == 2},
    )
    assert r.names == ("depth_m", "u_dvl_mps", "rudder_rad")
    assert not r.has("u_dvl_mps.unread")
    assert r["u_dvl_mps"] == pytest.approx(time)
    read, deep = [True, False, True, False, True, False, True, True], [True, True, False, True, True, False, True, True]
    assert r.readings("rudder_rad").all()  # a command holds
    assert [r.interval_of(name) for name in r.names] == pytest.approx([0.1, 0.2, 0.1])
    r.save(tmp_path / "log.nc")
    for kept in (r, Record.load(tmp_path / "log.nc"), r.without("rudder_rad"), r.later(3.0), r.resample(0.1)):
        assert kept.readings("u_dvl_mps").tolist() == read
        assert kept.readings("depth_m").tolist() == deep
    assert r.select(np.arange(8) > 2).readings("u_dvl_mps").tolist() == read[3:]
    assert np.flatnonzero(r.resample(0.05).readings("depth_m")).tolist() == (2 * np.flatnonzero(deep)).tolist()
    assert r.resample(0.4).readings("u_dvl_mps").all()  # what is coarser than the readings is made of them
    plain = Record.from_arrays(time, {name: np.zeros(8) for name in r.names})
    both = concat([plain, r])
    assert both.readings("u_dvl_mps").tolist() == [True] * 8 + read
    assert both.names == r.names
    assert r.with_channels({"u_dvl_mps": np.zeros(8)}).readings("u_dvl_mps").all()
    assert r.with_readings({"u_dvl_mps": np.array(deep)}).readings("u_dvl_mps").tolist() == deep
    assert "u_dvl_mps" not in r.without(["u_dvl_mps"]).dataset
    assert set(r.without(["u_dvl_mps"]).dataset.data_vars) == {"depth_m", "depth_m.unread", "rudder_rad", "segment"}
    with pytest.raises(ValueError, match=r"one boolean per sample of 'depth_m', shape \(8,\), got float64"):
        r.with_readings({"depth_m": np.ones(8)})
    with pytest.raises(ValueError, match="no channel 'pitch_rad'"):
        r.with_readings({"pitch_rad": np.ones(8, dtype=bool)})


def test_long_runs_cut_the_record_where_the_channel_is_needed():
    depth = np.arange(20.0)
    depth[8:13] = np.nan
    r = Record.from_arrays(np.arange(20.0), {"depth_m": depth, "temperature_C": depth})
    assert [s.stop - s.start for s in r.segments] == [8, 7]
    assert r.attrs["dropped"] == 5
    loose = Record.from_arrays(np.arange(20.0), {"depth_m": np.arange(20.0), "temperature_C": depth})
    assert len(loose.segments) == 1
    assert np.isnan(loose["temperature_C"]).sum() == 5
    with pytest.raises(ValueError, match=r"'depth_m' has no value in 5 rows, 9 to 13 \(8 to 12 s\)"):
        Record.from_arrays(np.arange(20.0), {"depth_m": depth}, long_runs="raise")


def test_missing_ends_are_dropped_not_invented():
    r = Record.from_arrays(np.arange(6.0), {"depth_m": [np.nan, 1, 2, 3, 4, np.nan]})
    assert r.time.tolist() == [1, 2, 3, 4]
    assert r.attrs["dropped"] == 2


def test_a_channel_without_values_and_a_record_without_samples_are_refused():
    with pytest.raises(ValueError, match="'depth_m' has no value in any of its 5 samples"):
        Record.from_arrays(np.arange(5.0), {"depth_m": np.full(5, np.nan)})
    sparse = np.full(60, np.nan)
    sparse[::20] = 1.0
    with pytest.raises(ValueError, match=r"Nothing is left of 60 samples.*'north_m' has 3 values"):
        Record.from_arrays(np.arange(60.0), {"north_m": sparse, "depth_m": np.zeros(60)})
    with pytest.raises(ValueError, match="at least 2 samples, got 0"):
        Record.from_arrays([], {"depth_m": []})


@given(
    steps=st.lists(st.floats(-3.0, 3.0), min_size=5, max_size=60),
    start=st.floats(-3, 3),
    holes=st.sets(st.integers(1, 58)),
)
def test_angles_come_out_continuous(steps, start, holes):
    truth = start + np.cumsum(steps)
    logged = np.mod(truth, 2 * np.pi)
    inner = [k for k in holes if k < truth.size - 1]
    assert Record.from_arrays(np.arange(truth.size), {"heading_rad": logged})["heading_rad"] - logged[
        0
    ] == pytest.approx(truth - truth[0], abs=1e-9)
    logged[inner] = np.nan
    known = np.delete(np.arange(truth.size), inner)
    r = Record.from_arrays(np.arange(truth.size), {"heading_rad": logged, "speed_mps": truth}, max_fill=60)
    assert np.abs(np.diff(r["heading_rad"][known])).max() <= np.pi + 1e-9


def test_angles_are_unwrapped_across_missing_values():
    truth = 0.3 * np.arange(30)
    logged = np.mod(truth, 2 * np.pi)
    logged[20:23] = np.nan  # 2 pi lies within
    assert Record.from_arrays(np.arange(30.0), {"heading_rad": logged})["heading_rad"] == pytest.approx(
        truth, abs=1e-12
    )


def test_channels_come_and_go():
    r = record()
    more = r.with_channels({"r_radps": np.zeros(50), "heading_rad": np.ones(50)})
    assert more.names == ("heading_rad", "rudder_rad", "r_radps")
    assert more["heading_rad"][3] == 1.0
    assert r["heading_rad"][3] != 1.0
    assert more.without(["r_radps", "rudder_rad"]).names == ("heading_rad",)
    with pytest.raises(ValueError, match=r"shape \(50,\), got shape \(49,\)"):
        r.with_channels({"r_radps": np.zeros(49)})


def test_select_cuts_where_the_mask_breaks():
    r = record()
    mask = np.ones(50, dtype=bool)
    mask[[10, 12, 30]] = False  # leaves sample 11 alone
    picked = r.select(mask)
    assert [s.stop - s.start for s in picked.segments] == [10, 17, 19]
    assert 44.0 not in picked.time
    assert picked.attrs == r.attrs
    assert len(r.between(40, 80)) == 10
    with pytest.raises(ValueError, match=r"Nothing is left: 0 of 50 .*\. A log needs at least 2 samples in a row"):
        r.select(r.time < 0)
    with pytest.raises(ValueError, match="one boolean per sample"):
        r.select(np.arange(50))


def test_gaps_cut_the_record():
    t = np.concatenate([np.arange(0, 40, 4.0), np.arange(100, 140, 4.0), [400.0]])
    r = Record.from_arrays(t, {"depth_m": np.arange(21.0)})
    assert [s.stop - s.start for s in r.split_gaps().segments] == [10, 10]  # the lone last sample goes
    assert len(r.split_gaps(1000.0).segments) == 1
    assert not r.is_uniform()
    assert record().split_gaps().segments == [slice(0, 50)]
    assert len(r.split_gaps(np.inf).segments) == 1
    with pytest.raises(ValueError, match="max_gap_s needs a number above 0 in s, got -1"):
        r.split_gaps(-1.0)


def test_uneven_sampling_is_no_gap():
    t = np.cumsum(np.tile([5.0, 5.0, 5.0, 60.0], 20))
    assert len(Record.from_arrays(t, {"depth_m": t}).split_gaps().segments) == 1


@given(dt=st.floats(0.5, 9.0), jitter=st.lists(st.floats(-0.3, 0.3), min_size=40, max_size=40))
def test_resampling_a_line_gives_the_line(dt, jitter):
    t = np.arange(40.0) + jitter
    r = Record.from_arrays(t, {"depth_m": 3.0 - 0.5 * t, "rudder_rad": np.arange(40.0)}, segment=np.arange(40) // 20)
    even = r.resample(dt)
    assert even["depth_m"] == pytest.approx(3.0 - 0.5 * even.time, abs=1e-9)
    assert even.is_uniform(1e-6)
    assert set(even["rudder_rad"]) <= set(np.arange(40.0))
    assert len(even.segments) == 2
    for old, new in zip(r.segments, even.segments):
        assert r.time[old][0] == even.time[new][0]
        assert r.time[old][-1] - dt * (1 + 1e-9) < even.time[new][-1] <= r.time[old][-1] + 1e-5


def test_a_channel_keeps_how_far_apart_its_readings_are(tmp_path):
    r = record(n=40, dt=0.5)
    assert (r.interval_of("heading_rad"), r.resample(2.0).interval_of("heading_rad")) == (0.5, 2.0)
    fine = r.resample(0.1)
    assert fine.interval_of("heading_rad") == fine.resample(0.05).interval_of("heading_rad") == 0.5
    assert fine.resample(2.0).interval_of("heading_rad") == 2.0
    assert fine.interval_of("rudder_rad") == pytest.approx(0.1)  # a command is known in between, too
    fine.save(tmp_path / "fine.nc")
    both = concat([r, fine])
    for kept in (Record.load(tmp_path / "fine.nc"), fine.between(1.0, 9.0), both, fine.without("rudder_rad")):
        assert kept.interval_of("heading_rad") == 0.5
    assert r.with_intervals({"heading_rad": 3.0}).interval_of("heading_rad") == 3.0
    assert r.readings("heading_rad").all()
    rare = r.with_intervals({"heading_rad": 2.0})
    assert np.flatnonzero(rare.readings("heading_rad")).tolist() == list(range(0, 40, 4))
    parted = rare.select(np.arange(40) != 18)
    assert np.flatnonzero(parted.readings("heading_rad")).tolist() == [0, 4, 8, 12, 16, 18, 22, 26, 30, 34, 38]
    with pytest.raises(ValueError, match="positive interval of 'heading_rad' in s, got 0"):
        r.with_intervals({"heading_rad": 0.0})
    with pytest.raises(ValueError, match="no channel 'pitch_rad'"):
        r.interval_of("pitch_rad")


def test_resampling_holds_inputs_and_keeps_an_even_record():
    r = record(dt=0.1)
    assert np.array_equal(r.resample(0.1)["rudder_rad"], r["rudder_rad"])
    fine = r.resample(0.05)
    assert np.array_equal(fine["rudder_rad"][1::2], r["rudder_rad"][:-1])
    assert fine.dataset["rudder_rad"].attrs["units"] == "rad"
    with pytest.raises(ValueError, match="as long as one step"):
        r.resample(1e4)
    with pytest.raises(ValueError, match="positive"):
        r.resample(0.0)
    with pytest.raises(ValueError, match="at most 10000000"):
        r.resample(1e-9)


def test_windows_fill_each_segment():
    r = record(100).select(np.arange(100) != 64)  # segments of 64 and 35 samples at 4 s
    assert [(w.start, w.stop) for w in r.windows(120)] == [(0, 30), (30, 60), (64, 94)]
    assert [w.stop - w.start for w in record(60, dt=0.1).windows(2.0)] == [20, 20, 20]  # 0.1 k is not exact
    assert record().windows(1e4) == []
    with pytest.raises(ValueError, match="positive"):
        r.windows(0)


@given(seconds=st.floats(10, 200), jitter=st.lists(st.floats(-1.5, 1.5), min_size=80, max_size=80))
def test_windows_are_disjoint_and_no_longer_than_asked(seconds, jitter):
    r = Record.from_arrays(4.0 * np.arange(80) + jitter, {"depth_m": np.zeros(80)}, segment=np.arange(80) // 37)
    windows = r.windows(seconds)
    assert all(a.stop <= b.start for a, b in pairwise(windows))
    assert all(r.time[w.stop - 1] - r.time[w.start] <= seconds for w in windows)
    assert all(any(s.start <= w.start and w.stop <= s.stop for s in r.segments) for w in windows)


def test_a_record_survives_its_file(tmp_path):
    r = record(temperature_C=np.where(np.arange(50) < 20, np.nan, 8.0)).select(np.arange(50) != 25)
    path = tmp_path / "log.nc"
    r.save(path)
    back = Record.load(path)
    assert np.array_equal(back.time, r.time)
    assert back.segments == r.segments
    assert back.labels == r.labels
    assert back.attrs == r.attrs
    assert all(np.array_equal(back[name], r[name], equal_nan=True) for name in r.names)
    assert back.dataset["heading_rad"].attrs["units"] == "rad"
    assert [p.name for p in tmp_path.iterdir()] == ["log.nc"]  # nothing left aside


def test_saving_and_loading_say_what_is_wrong(tmp_path):
    with pytest.raises(ValueError, match="Choose a folder that exists"):
        record().save(tmp_path / "none" / "log.nc")
    with pytest.raises(ValueError, match="There is no file"):
        Record.load(tmp_path / "log.nc")
    (tmp_path / "bad.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(ValueError, match="cut short"):
        Record.load(tmp_path / "bad.nc")
    record().dataset[["heading_rad"]].drop_attrs(deep=False).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match="not written by"):
        Record.load(tmp_path / "other.nc")


def test_concat_puts_segments_in_a_row():
    a, b = record(10), record(20).select(np.arange(20) != 7)
    both = concat([a, b])
    assert [s.stop - s.start for s in both.segments] == [10, 7, 12]
    assert both.attrs["source"] == "made"
    assert np.array_equal(both["rudder_rad"], np.concatenate([a["rudder_rad"], b["rudder_rad"]]))
    with pytest.raises(ValueError, match="differ in depth_m"):
        concat([a, record(depth_m=np.zeros(50))])
    with pytest.raises(ValueError, match="at least one"):
        concat([])


def test_on_a_grid_commands_are_not_late_by_rounding():
    """Stamps in seconds since 1970 are a multiple of 2.4e-7 s."""
    time = 1.7e9 + 0.1 * np.arange(300) + 2.4e-7 * (np.arange(300) % 3)
    steps = np.where(np.arange(300) % 2, 0.3, -0.3)
    record = Record.from_arrays(time - time[0], {"heading_rad": 0.01 * np.arange(300), "rudder_rad": steps})
    assert record.resample(0.1)["rudder_rad"].tolist() == steps.tolist()


def test_a_record_is_a_mapping_of_channels_and_no_sequence_of_samples():
    r = record()
    assert all(name in r for name in r.names)
    assert list(r) == list(r.names)
    assert 0 not in r
    with pytest.raises(ValueError, match=r"read by channel, such as record\['depth_m'\], got record\[0\]"):
        r[0]
    assert len(concat(r)) == len(r)


@pytest.mark.parametrize(
    "given, words",
    [
        ([], "needs at least one record, got none"),
        ("log.nc", "needs records, got a str: read_record reads a log"),
        ([[1, 2]], r"needs records, got a list: give its items one by one, as in fit\(\*records\)"),
        (3, "needs records, got a int"),
    ],
)
def test_other_data_than_records_are_refused(given, words):
    with pytest.raises(ValueError, match=f"A fit {words}"):
        records_of("A fit", given)


@pytest.mark.parametrize(
    "given, words",
    [
        ("mission.csv", r"got 'mission.csv': read_record\('mission.csv'\) reads it"),
        (Path("mission.csv"), r"got 'mission.csv': read_record\('mission.csv'\) reads it"),
        (pd.DataFrame(), "got a DataFrame: Record.from_arrays makes one of arrays"),
        ([record()], "got a list: join several with concat"),
    ],
)
def test_something_else_than_a_record_is_refused(given, words):
    with pytest.raises(ValueError, match=f"A diagnosis needs a record, {words}"):
        check_record("A diagnosis", given)
    check_record("A diagnosis", record())


def test_a_record_is_saved_under_its_own_ending(tmp_path):
    with pytest.raises(ValueError, match=r"The file of a record ends in \.nc, got 'log\.csv': rename it"):
        record().save(tmp_path / "log.csv")
