from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, strategies as st
from scipy.io import savemat

from auv_gym.records.readers.text import _FILLED_IN
from auv_gym.records.reading import read_record


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


LOG = "time_s,heading_deg,rudder_deg,depth_m\n" + "".join(
    f"{4 * k},{(350 + 3 * k) % 360},{k % 5},{k}\n" for k in range(30)
)


@pytest.fixture
def log(tmp_path):
    return write(tmp_path / "log.csv", LOG)


def test_a_csv_comes_in_in_si_and_continuous(log):
    r = read_record(log, required=["heading_rad"])
    assert r.names == ("heading_rad", "rudder_rad", "depth_m")
    assert r["heading_rad"] == pytest.approx(np.radians(350 + 3 * np.arange(30)), abs=1e-12)
    assert r.attrs["source"] == "log.csv"
    assert len(r.segments) == 1


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("label", [False, True])
def test_delimiters_comments_blanks_and_empty_cells(tmp_path, delimiter, label):
    rows = ["time_s,depth_m,temperature_C,stage,run", "0,1,8.4,,1", "1,,8.5,2,1", "", "2,3,8.6,,1", "3,4,nan,NA,1"]
    text = "# made by hand\n" + "\n".join([*rows, ""]).replace(",", delimiter)
    r = read_record(write(tmp_path / "log.txt", text.replace("1\n", "one\n") if label else text))
    assert r["depth_m"].tolist() == [1, 2, 3, 4]
    assert np.isnan(r["temperature_C"]).tolist() == [False, False, False, True]
    assert r["stage"][1] == 2


VALUES = st.floats(-1e9, 1e9).filter(lambda value: value not in _FILLED_IN) | st.just(float("nan"))
COLUMN = st.lists(VALUES, min_size=6, max_size=6).filter(lambda column: np.isfinite(column).any())


@given(columns=st.lists(COLUMN, min_size=1, max_size=5))
def test_what_is_written_is_read(columns, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    rows = [",".join("" if np.isnan(v) else repr(v) for v in row) for row in zip(*columns)]
    header = ",".join(f"x{k}_W" for k in range(len(columns)))
    write(path, f"time_s,{header}\n" + "".join(f"{k},{row}\n" for k, row in enumerate(rows)))
    r = read_record(path)
    for k, column in enumerate(columns):
        kept = np.isfinite(column)
        assert np.array_equal(r[f"x{k}_W"][kept], np.array(column)[kept])


def test_a_column_divides_the_file(tmp_path):
    rows = [f"{name},{4 * k},{k}" for name in ("20200625-08h51m18s", "b") for k in range(5)]
    r = read_record(write(tmp_path / "log.csv", "dive_id,time_s,depth_m\n" + "\n".join(rows)))
    assert r.segments == [slice(0, 5), slice(5, 10)]
    assert r.labels == ["20200625-08h51m18s", "b"]
    rows = [f"{k // 6},{k // 4},{k},{k}" for k in range(12)]
    r = read_record(write(tmp_path / "log.csv", "segment,run,time_s,depth_m\n" + "\n".join(rows)))
    assert r.labels == ["0/0", "0/1", "1/1", "1/2"]


def test_gaps_cut_the_record(tmp_path):
    times = [*range(0, 80, 4), *range(400, 480, 4)]
    path = write(tmp_path / "log.csv", "time_s,depth_m\n" + "".join(f"{t},1\n" for t in times))
    assert len(read_record(path).segments) == 2
    assert len(read_record(path, max_gap_s=1e4).segments) == 1


@pytest.mark.parametrize(
    "arguments, settings, words",
    [
        ((123,), {}, "read_record needs the path of a log, or a list of paths, got 123"),
        ((None,), {}, "read_record needs the path of a log, or a list of paths, got None"),
        (("log.csv", 5), {}, "A mapping needs a dict .*, or the path of a TOML file, got 5"),
        (("log.csv",), {"max_gap_s": -1}, "^max_gap_s needs a number above 0 in s, got -1"),
        (("log.csv",), {"max_gap_s": "x"}, "^max_gap_s needs a number above 0 in s, got 'x'"),
    ],
)
def test_arguments_of_another_kind_are_refused(arguments, settings, words):
    with pytest.raises(ValueError, match=words):
        read_record(*arguments, **settings)


def test_time_units_dates_and_epochs(tmp_path):
    path = tmp_path / "log.csv"
    r = read_record(write(path, "time_ms,depth_m\n0,1\n500,2\n1000,3\n"))
    assert r.time.tolist() == [0.0, 0.5, 1.0]
    start = datetime(2020, 6, 25, 8, 51, 18, tzinfo=UTC).timestamp()
    for text in (
        "2020-06-25T08:51:18Z,1\n2020-06-25T10:51:20.5+02:00,2\n",
        "2020-06-25 08:51:18,1\n2020-06-25 08:51:20.5,2\n",
    ):
        r = read_record(write(path, "time,depth_m\n" + text))
        assert r.time == pytest.approx([0.0, 2.5], abs=1e-6)  # a float of 1.6e9 s resolves 2e-7 s
        assert r.attrs["start_epoch_s"] == start
    r = read_record(write(path, f"time_s,depth_m\n{start},1\n{start + 4},2\n"))
    assert (r.time.tolist(), r.attrs["start_epoch_s"]) == ([0.0, 4.0], start)


def test_a_mapping_renames_converts_and_leaves_out(tmp_path):
    path = write(tmp_path / "log.csv", "Time,Hdg,Depth (m),note\n0,350,1,start\n1,10,2,\n2,20,3,end\n")
    mapping = {"Time": "time_s", "Hdg": "heading_deg", "Depth (m)": "depth_m", "note": ""}
    r = read_record(path, mapping)
    assert r["heading_rad"] == pytest.approx(np.radians([350, 370, 380]))
    toml = write(tmp_path / "names.toml", '"Time" = "time_s"\n"Hdg" = "heading_deg"\n"*" = ""\n')
    assert read_record(path, toml).names == ("heading_rad",)
    with pytest.raises(ValueError, match=r"names the column 'Hgd', which the file does not have\. Did you mean 'Hdg'"):
        read_record(path, {"Hgd": "heading_deg"})
    with pytest.raises(ValueError, match="Two columns come in as 'time_s'"):
        read_record(path, {"Time": "time_s", "Hdg": "time_s"})
    with pytest.raises(ValueError, match="is not TOML"):
        read_record(path, write(tmp_path / "names.toml", "Time = \n"))
    with pytest.raises(
        ValueError, match=r"Cannot read the mapping .* Give a TOML file; `look --mapping-out` writes one"
    ):
        read_record(path, tmp_path / "none.toml")
    with pytest.raises(ValueError, match=r"one text per column, got \['time_s'\]"):
        read_record(path, {"Time": ["time_s"]})
    steady = read_record(path, {"Time": "time_s", "Hdg": "heading_deg", "speed_cmd_kn": 2.0, "*": ""})
    assert steady["speed_cmd_mps"] == pytest.approx([2.0 * 1852.0 / 3600.0] * 3)
    mirrored = read_record(path, {"Time": "time_s", "Hdg": "-heading_deg", "*": ""})
    assert np.diff(mirrored["heading_rad"]) == pytest.approx(-np.diff(steady["heading_rad"]))
    with pytest.raises(ValueError, match="makes 'heading_deg' constant, but the file has it"):
        read_record(path, {"Time": "time_s", "Hdg": "heading_deg", "heading_deg": 90.0})
    with pytest.raises(ValueError, match="can only be ''"):
        read_record(path, {"*": "depth_m"})


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "is empty"),
        ("time_s,depth_m\n", "at least 2 rows"),
        ("0,1\n1,2\n2,3\n", "first line holds numbers"),
        ("time_s,depth_m\n0,1\n1,2,7\n2,1\n", "Row 2 below the header has 3 cells"),
        ("time_s,depth_m\n0,1\n1,deep\n2,deeper\n", "depth_m: left out, since it holds text .'deep' at row 2"),
        ("time_s,depth_m,depth_m\n0,1,1\n1,2,2\n", "names 'depth_m' twice"),
        ("time_s,,depth_m\n0,1,1\n1,2,2\n", "without a name"),
        ("heading_deg,depth_m\n0,1\n1,2\n", "no column time_s.*'heading_deg', 'depth_m'.*map it"),
        ("clock,depth_m\n0,1\n1,2\n", "no column time_s.*`clock` looks like `time_s`"),
        ("time,depth_m\n2020-06-25,1\nlater,2\n", "got 'later' at row 2"),
        ("time_s\n0\n1\n2\n", "No column of the log could be read as a channel besides its time"),
        ("time_s,depth_fathom\n0,1\n1,2\n", "depth_fathom: left out, since its unit is not known"),
        ("time_s,heading\n0,1\n1,2\n", "heading: left out, since its unit is not known"),
        ("run,time_s,depth_m\n1,0,1\n,1,2\n1,2,3\n", "`segment` has no label at row 2"),
        ("time_s,depth_m\n0,1\n1,\n2,3\n\0", "(CSV .*), but its content is something else: it begins"),
        ("time_s,depth_m\n" + "0,1\n" * 2000 + "\0", "has binary parts"),
    ],
)
def test_a_bad_csv_is_refused_by_name(tmp_path, text, message):
    path = write(tmp_path / "log.csv", text)
    with pytest.raises(ValueError, match=message) as caught:
        read_record(path)
    assert str(path) in str(caught.value)


def test_sensors_with_rows_of_their_own_in_one_file(tmp_path):
    """Attitude every 5 s, CTD every 10 s, and a buoyancy engine every 20 s, as in the table of a laboratory."""
    found = {f"{k},{k / 20},,": k for k in range(0, 2000, 5)}
    found |= {f"{k + 0.4},,{k + 0.4},": k + 0.4 for k in range(0, 2000, 10)}
    found |= {f"{k + 0.7},,,{k + 0.7}": k + 0.7 for k in range(0, 2000, 20)}
    rows = sorted(found, key=lambda row: found[row])
    path = write(tmp_path / "log.csv", "\n".join(["time_s,pitch_deg,depth_m,buoyancy_volume_cm3", *rows, ""]))
    r = read_record(path, required=["depth_m", "pitch_rad"])
    assert r.time.tolist() == r["depth_m"].tolist() == [k + 0.4 for k in range(0, 2000, 10)]
    assert r["pitch_rad"] == pytest.approx(np.radians(r.time / 20))
    assert r["buoyancy_volume_m3"][1:-1] == pytest.approx(1e-6 * r.time[1:-1])
    assert r.interval_of("buoyancy_volume_m3") == pytest.approx(20.0)


def test_long_runs_without_values_cut_or_raise(tmp_path):
    rows = "".join(f"{k},{'' if 10 <= k < 20 else k}\n" for k in range(30))
    path = write(tmp_path / "log.csv", "time_s,depth_m\n" + rows)
    assert [s.stop - s.start for s in read_record(path).segments] == [10, 10]
    with pytest.raises(ValueError, match="'depth_m' has no value in 10 rows, 11 to 20"):
        read_record(path, long_runs="raise")


def test_files_that_are_not_there_or_of_no_known_kind(tmp_path, log):
    with pytest.raises(ValueError, match=r"There is no file .*Did you mean 'log\.csv'"):
        read_record(tmp_path / "logg.csv")
    with pytest.raises(ValueError, match="is a folder"):
        read_record(tmp_path)
    with pytest.raises(ValueError, match=r"'\.xls', which is no known format"):
        read_record(write(tmp_path / "log.xls", "\0x"))
    with pytest.raises(ValueError, match=r"no channel r_radps, which is needed; it has .*'heading_rad'.* Name it in a"):
        read_record(log, required=["r_radps"])
    with pytest.raises(ValueError, match=r"no channels p_radps and q_radps, which are needed; .* Name them in a mapp"):
        read_record(log, required=["p_radps", "q_radps"])


def test_netcdf_variables_with_units(tmp_path):
    path = tmp_path / "log.nc"
    t = np.arange(0, 40, 4.0)
    data = xr.Dataset(
        {
            "HEADING": ("TIME", (350 + 3 * t) % 360, {"units": "degrees"}),
            "rudder_rad": ("TIME", 0.1 * t, {"units": "degree"}),
            "depth_m": ("TIME", t, {"units": "m"}),
            "longitude": ((), 7.0, {"units": "degrees_east"}),
            "profile": ("z", np.arange(3.0)),
        },
        {"TIME": ("TIME", t, {"units": "seconds since 2014-07-24 12:00:00"})},
    )
    data.to_netcdf(path, engine="h5netcdf")
    for engine, name in (("h5netcdf", "a.nc"), ("scipy", "b.cdf")):
        data.to_netcdf(tmp_path / name, engine=engine)
        r = read_record(tmp_path / name, {"HEADING": "heading_deg", "profile": ""} if engine == "scipy" else None)
        assert np.mod(r["heading_rad"], 2 * np.pi) == pytest.approx(np.radians((350 + 3 * t) % 360))
        assert r["rudder_rad"] == pytest.approx(np.radians(0.1 * t))
        assert set(r.names) == {"rudder_rad", "depth_m", "heading_rad"}
        assert r.time.tolist() == t.tolist()
        assert r.attrs["start_epoch_s"] == datetime(2014, 7, 24, 12, tzinfo=UTC).timestamp()
    data["depth_m"].attrs["units"] = "seconds"
    data.to_netcdf(path, engine="h5netcdf")
    assert "depth_m: left out, since its unit by the file, 'seconds', does not fit its name." in read_record(path).notes
    data.drop_vars("TIME").to_netcdf(path, engine="h5netcdf")
    with pytest.raises(ValueError, match="no column time_s"):
        read_record(path)


def test_netcdf_that_a_record_wrote(tmp_path, log):
    r = read_record(log)
    r.select(np.arange(30) != 12).save(tmp_path / "log.nc")
    back = read_record(tmp_path / "log.nc")
    assert len(back.segments) == 2
    assert np.array_equal(back["heading_rad"], r["heading_rad"][np.arange(30) != 12])


def test_mat_vectors_and_a_structure(tmp_path):
    path = tmp_path / "log.mat"
    signals = {"time_s": np.arange(10.0), "heading_deg": 36.0 * np.arange(10), "gain": 3.0}
    savemat(path, signals)
    assert read_record(path)["heading_rad"] == pytest.approx(np.radians(36.0 * np.arange(10)))
    labels = np.array(["a"] * 4 + ["b"] * 6, dtype=object)
    savemat(path, {"log": {**signals, "dive_id": labels}, "note": "x"})
    r = read_record(path)
    assert r.names == ("heading_rad",)
    assert r.labels == ["a", "b"]
    savemat(path, {"tt": np.arange(5.0), "depth_m": np.arange(5.0)[:, None]})
    with pytest.raises(ValueError, match=r"no column time_s.*'tt', 'depth_m'"):
        read_record(path)
    assert read_record(path, {"tt": "time_s"})["depth_m"].tolist() == [0, 1, 2, 3, 4]
    savemat(path, {"time_s": np.arange(5.0), "depth_m": np.arange(6.0)})
    with pytest.raises(ValueError, match="one length"):
        read_record(path)


def test_damaged_binaries_are_refused(tmp_path, log):
    savemat(tmp_path / "whole.mat", {"time_s": np.arange(500.0), "depth_m": np.random.default_rng(1).normal(size=500)})
    read_record(log).save(tmp_path / "whole.nc")
    for name in ("whole.mat", "whole.nc"):
        whole = (tmp_path / name).read_bytes()
        for share in (0.02, 0.3, 0.6, 0.9):
            cut = tmp_path / f"cut{name[-4:] if name.endswith('.mat') else '.nc'}"
            cut.write_bytes(whole[: int(share * len(whole))])
            with pytest.raises(ValueError, match="cut"):
                read_record(cut)
    (tmp_path / "text.nc").write_text("time_s,depth_m\n")
    with pytest.raises(
        ValueError,
        match=r"\(NetCDF or Seaglider NetCDF\), but its content is something else: it begins with 'time_s,depth_m'",
    ):
        read_record(tmp_path / "text.nc")
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    with pytest.raises(ValueError, match=r"version 7\.3 are not read: save with"):
        read_record(tmp_path / "new.mat")


def test_the_measured_torpedo_record(shared_data):
    r = read_record(shared_data / "auv690" / "auv690_2022-07-28_part1_10Hz.csv", required=["heading_rad", "depth_m"])
    assert len(r) == 21991
    assert r.sample_interval == pytest.approx(0.1, abs=1e-3)
    assert np.isfinite(r.matrix(["heading_rad", "pitch_rad", "rudder_rad", "u_dvl_mps"])).all()
    assert np.abs(np.diff(r["heading_rad"])).max() < np.pi


@pytest.mark.parametrize("name, dives", [("free_drift_dives", 9), ("fixed_point_february_dives", 12)])
def test_the_measured_float_records(shared_data, name, dives):
    path = shared_data / "mermaid" / f"{name}.csv"
    plain = {"dive_id": "dive_id", "time_s": "time_s", "*": ""}
    ours = read_record(path, {"pressure_dbar": "depth_dbar", **plain}, max_gap_s=1e6)
    theirs = read_record(path, {"depth_m": "depth_m", **plain}, max_gap_s=1e6)
    assert len(ours.labels) == dives
    # The float's own depth is pressure times a constant that depends on its latitude.
    deep = theirs["depth_m"] > 20
    assert ours["depth_m"][deep] == pytest.approx(theirs["depth_m"][deep], rel=1e-2)


def test_profiles_without_time_are_refused(shared_data):
    with pytest.raises(ValueError, match=r"no column time_s.*'pressure_dbar'"):
        read_record(shared_data / "mermaid" / "ctd_profiles_1dbar.csv")


def test_a_nearly_empty_column_is_left_out_and_said(tmp_path):
    rows = "".join(f"{k},{k},{9 if k == 5 else ''},{k}\n" for k in range(100))
    path = write(tmp_path / "log.csv", "time_s,heading_deg,pitch_deg,vacuum_inHg\n" + rows)
    r = read_record(path, required=["heading_rad"])
    assert r.names == ("heading_rad",)
    assert len(r) == 100
    assert "vacuum_inHg: left out, since its unit is not known." in r.notes
    assert any("pitch_rad: left out, since it has values at 1 of 100 samples only" in line for line in r.notes)
    with pytest.raises(ValueError, match="Nothing is left of"):  # a vehicle that requires it cannot be served
        read_record(path, required=["heading_rad", "pitch_rad"])


def test_what_a_vehicle_requires_may_cut_what_it_does_not_may_cost_little(tmp_path):
    rows = "".join(f"{k},{k},{'' if 10 <= k < 15 else k},{'' if k < 30 else k}\n" for k in range(100))
    path = write(tmp_path / "log.csv", "time_s,heading_deg,pitch_deg,roll_deg\n" + rows)
    r = read_record(path, required=["heading_rad"])
    assert r.names == ("heading_rad", "pitch_rad")  # 5 samples of 100, and 30
    assert len(r) == 95
    assert len(read_record(path, required=["heading_rad", "roll_rad"])) == 70


@pytest.mark.parametrize("path", ["https://example.com/a.csv", Path("http://example.com/a.csv")])
def test_an_address_is_no_file(path):
    with pytest.raises(ValueError, match="is an address, not a file: download it first"):
        read_record(path)


@pytest.mark.parametrize(
    "name, command", [("log.csv.gz", "gunzip"), ("log.zip", "unzip"), ("log.7z", "7z x"), ("log.tar", "tar xf")]
)
def test_a_packed_log_is_to_be_unpacked(tmp_path, name, command):
    path = tmp_path / name
    path.write_bytes(b"\x1f\x8b\x08\x00\x00" * 20)
    with pytest.raises(ValueError, match=rf"is packed\. Unpack it first: {command} {path}"):
        read_record(path)


def test_a_missing_channel_is_named_with_what_looks_like_it(tmp_path):
    path = write(tmp_path / "log.csv", "time_s,heading_deg,m_fin\n0,1,2\n1,2,3\n2,3,4\n")
    with pytest.raises(ValueError, match=r"no channel rudder_rad.*`m_fin` looks like `rudder_rad`.*auv-gym look"):
        read_record(path, required=["heading_rad", "rudder_rad"])


def test_a_command_serves_where_the_input_was_not_measured(tmp_path):
    path = write(tmp_path / "log.csv", "time_s,heading_deg,rudder_cmd_deg\n0,1,2\n1,2,3\n2,3,4\n")
    r = read_record(path, required=["heading_rad", "rudder_rad"])
    assert r["rudder_rad"] == pytest.approx(np.radians([2, 3, 4]))
    assert "rudder_rad: rudder_cmd_rad, since it is not measured" in r.attrs["derived"]
    assert not read_record(path).has("rudder_rad")


def test_a_set_point_never_serves_as_a_measurement(tmp_path):
    path = write(tmp_path / "log.csv", "time_s,depth_m,heading_cmd_deg,rudder_deg\n0,1,2,3\n1,2,3,4\n2,3,4,5\n")
    with pytest.raises(ValueError, match="no channel heading_rad") as raised:
        read_record(path, required=["heading_rad", "rudder_rad"])
    assert "looks like" not in str(raised.value)
    assert "constant" not in str(raised.value)


def test_a_sensor_that_is_slower_than_the_rows_is_known_as_such(tmp_path):
    rows = [f"{0.5 * k},{0.1 * k},{0.2 * k if k % 4 == 0 else ''}" for k in range(40)]
    (tmp_path / "log.csv").write_text("time_s,heading_rad,depth_m\n" + "\n".join(rows))
    read = read_record(tmp_path / "log.csv")
    assert (read.interval_of("heading_rad"), read.interval_of("depth_m")) == (0.5, 2.0)
    assert np.isfinite(read["depth_m"]).all()


def test_several_files_are_one_record_on_one_clock(tmp_path):
    for day, more in ((1, "pitch_deg"), (2, "roll_deg")):
        rows = "".join(f"2024-05-0{day}T00:00:{k:02d},{day * k},{k}\n" for k in range(10))
        write(tmp_path / f"{day}.csv", f"time,depth_m,{more}\n{rows}")
    r = read_record([tmp_path / "2.csv", tmp_path / "1.csv"])
    assert r.labels == ["1.csv", "2.csv"]
    assert r.time[[0, 10]].tolist() == [0.0, 86400.0]
    assert r.names == ("depth_m",)
    assert "pitch_rad: left out, since not all of the files have it." in r.notes
    assert r.attrs["start_epoch_s"] == datetime(2024, 5, 1, tzinfo=UTC).timestamp()
    with pytest.raises(ValueError, match="got none"):
        read_record([])


@pytest.mark.parametrize("scale, words", [(1.0, "seconds"), (1e3, "milliseconds"), (1e6, "micro"), (1e9, "nano")])
def test_a_time_without_a_unit_is_recognised_by_its_size(tmp_path, scale, words):
    rows = "".join(f"{int((1.7e9 + k) * scale)},{k}\n" for k in range(9))
    r = read_record(write(tmp_path / "log.csv", f"Timestamp,depth_m\n{rows}"))
    assert r.time == pytest.approx(np.arange(9.0), abs=1e-6)
    assert r.attrs["start_epoch_s"] == pytest.approx(1.7e9)
    assert any(line.startswith("Timestamp: taken as the time, in ") and words in line for line in r.notes)


def test_units_below_the_header_decimal_commas_and_a_cut_last_row(tmp_path):
    text = "time_s;heading;depth_m\ns;deg;m\n0;350,5;1,0\n1;351,5;1,5\n2;352,5;2,0\n3;35"
    r = read_record(write(tmp_path / "log.csv", text))
    assert r["heading_rad"] == pytest.approx(np.radians([350.5, 351.5, 352.5]))
    assert r["depth_m"].tolist() == [1.0, 1.5, 2.0]
    assert "Decimal commas are read as points in 'heading', 'depth_m'." in r.notes
    assert any("The last row has 2 of 3 cells" in line for line in r.notes)


def test_a_record_keeps_its_notes_and_attributes_in_its_file(tmp_path):
    rows = "".join(f"{0.1 * k},{k / 7!r},{k}\n" for k in range(50))
    r = read_record(write(tmp_path / "log.csv", f"time_s,depth_m,odd\n{rows}"))
    r.save(tmp_path / "log.nc")
    back = read_record(tmp_path / "log.nc")
    assert back.notes == r.notes
    assert len(r.notes) == 1
    assert back.attrs == r.attrs
    assert np.array_equal(back["depth_m"], r["depth_m"])
    assert np.array_equal(back.time, r.time)


def test_of_two_columns_of_a_channel_the_one_with_values_is_taken(tmp_path):
    rows = "".join(f"{k},,{k}\n" for k in range(9))
    r = read_record(write(tmp_path / "log.csv", f"time_s,heading_deg,heading_rad\n{rows}"), required=["heading_rad"])
    assert r["heading_rad"] == pytest.approx(np.unwrap(np.arange(9.0)))
    assert "heading_deg: left out, since none of its 9 samples has a value." in r.notes


def test_rows_whose_date_is_missing_are_left_out(tmp_path):
    rows = "2024-05-01T00:00:00,1\n,2\n2024-05-01T00:00:02,3\n"
    r = read_record(write(tmp_path / "log.csv", f"time,depth_m\n{rows}"))
    assert r["depth_m"].tolist() == [1, 3]
    assert "1 row without a time left out." in r.notes


def test_a_first_row_of_decimal_commas_is_no_row_of_units(tmp_path):
    text = "Time (s);Heading [deg];Depth (m)\n0,0;350,5;1,0\n0,5;351,5;1,5\n1,0;352,5;2,0\n"
    r = read_record(write(tmp_path / "log.csv", text))
    assert r.time.tolist() == [0.0, 0.5, 1.0]
    assert r["heading_rad"] == pytest.approx(np.radians([350.5, 351.5, 352.5]))
    assert "Decimal commas are read as points in 'Time (s)', 'Heading [deg]', 'Depth (m)'." in r.notes


def test_common_names_with_a_unit_that_fits_are_understood(tmp_path):
    text = "time_s,Yaw [deg],Yaw rate (deg/s),Prop RPM,Odd rate (deg/s)\n0,10,1,900,4\n1,11,2,910,5\n2,13,3,905,6\n"
    r = read_record(write(tmp_path / "log.csv", text))
    assert r["heading_rad"] == pytest.approx(np.radians([10, 11, 13]))
    assert r["r_radps"] == pytest.approx(np.radians([1, 2, 3]))
    assert r["propeller_rpm"].tolist() == [900, 910, 905]
    assert r["odd_rate_radps"] == pytest.approx(np.radians([4, 5, 6]))  # without the brackets


def test_a_column_called_as_the_channel_is_comes_before_one_with_another_name_of_it(tmp_path):
    r = read_record(write(tmp_path / "log.csv", "time_s,yaw_deg,heading_deg\n0,10,20\n1,11,21\n2,13,23\n"))
    assert r["heading_rad"] == pytest.approx(np.radians([20, 21, 23]))
    assert any("heading_rad is taken from heading_deg" in line for line in r.notes)


def test_another_name_with_a_unit_of_something_else_is_no_such_channel(tmp_path):
    r = read_record(write(tmp_path / "log.csv", "time_s,yaw_m,depth_m\n0,10,20\n1,11,21\n2,13,23\n"))
    assert not r.has("heading_rad")
