from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, strategies as st
from scipy.io import savemat

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
    rows = ["time_s,depth_m,temperature_C,stage,run", "0,1,,,1", "1,,8.5,2,1", "", "2,3,,,1", "3,4,nan,NA,1"]
    text = "# made by hand\n" + "\n".join([*rows, ""]).replace(",", delimiter)
    r = read_record(write(tmp_path / "log.txt", text.replace("1\n", "one\n") if label else text))
    assert r["depth_m"].tolist() == [1, 2, 3, 4]
    assert np.isnan(r["temperature_C"]).tolist() == [True, False, True, True]
    assert r["stage"][1] == 2


@given(
    columns=st.lists(
        st.lists(st.floats(-1e9, 1e9) | st.just(float("nan")), min_size=6, max_size=6), min_size=1, max_size=5
    )
)
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
    with pytest.raises(ValueError, match=r"names the column 'Hgd', which the file lacks\. Did you mean 'Hdg'"):
        read_record(path, {"Hgd": "heading_deg"})
    with pytest.raises(ValueError, match="Two columns come in as 'time_s'"):
        read_record(path, {"Time": "time_s", "Hdg": "time_s"})
    with pytest.raises(ValueError, match="is not TOML"):
        read_record(path, write(tmp_path / "names.toml", "Time = \n"))
    with pytest.raises(ValueError, match="Cannot read the mapping"):
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
        (
            "time_s,depth_m\n0,1\n1,2\n2",
            "Row 3 below the header has 1 cells, the header has 2. The file seems cut short",
        ),
        ("time_s,depth_m\n0,1\n1,2,7\n2,1\n", "Row 2 below the header has 3 cells"),
        ("time_s,depth_m\n0,1\n1,deep\n2,3\n", "'depth_m' needs numbers, got 'deep' at row 2"),
        ("time_s;depth_m\n0;1,5\n1;2,5\n", "decimal comma"),
        ("time_s,depth_m,depth_m\n0,1,1\n1,2,2\n", "names 'depth_m' twice"),
        ("time_s,,depth_m\n0,1,1\n1,2,2\n", "without a name"),
        ("heading_deg,depth_m\n0,1\n1,2\n", "no column time_s.*'heading_deg', 'depth_m'.*map it"),
        ("time,depth_m\n0,1\n1,2\n", "no column time_s"),
        ("time,depth_m\n2020-06-25,1\nlater,2\n", "got 'later' at row 2"),
        ("time_s\n0\n1\n2\n", "no signal besides its time"),
        ("time_s,depth_ft\n0,1\n1,2\n", "unknown unit suffix '_ft'"),
        ("time_s,heading\n0,1\n1,2\n", "'heading' does not say its unit"),
        ("time_s,heading_deg,heading_rad\n0,1,1\n1,2,2\n", "comes in as 'heading_rad', which another does too"),
        ("time_s,depth_m\n0,1\n4,2\n2,3\n", "goes backwards at row 3: 2 s after 4 s"),
        ("time_s,depth_m\n0,1\n,2\n2,3\n", "missing at row 2"),
        ("run,time_s,depth_m\n1,0,1\n,1,2\n1,2,3\n", "`segment` has no label at row 2"),
        ("time_s,depth_m\n0,1\n1,\n2,3\n\0", "is binary"),
    ],
)
def test_a_bad_csv_is_refused_by_name(tmp_path, text, message):
    path = write(tmp_path / "log.csv", text)
    with pytest.raises(ValueError, match=message) as caught:
        read_record(path)
    assert str(path) in str(caught.value)


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
        read_record(write(tmp_path / "log.xls", "x"))
    with pytest.raises(ValueError, match=r"no channel 'r_radps'; it has heading_rad"):
        read_record(log, required=["r_radps"])


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
        found = r["heading_rad" if engine == "scipy" else "HEADING_rad"]
        assert np.mod(found, 2 * np.pi) == pytest.approx(np.radians((350 + 3 * t) % 360))
        assert r["rudder_rad"] == pytest.approx(np.radians(0.1 * t))
        assert set(r.names) == {"rudder_rad", "depth_m", "heading_rad" if engine == "scipy" else "HEADING_rad"}
        assert r.time.tolist() == t.tolist()
        assert r.attrs["start_epoch_s"] == datetime(2014, 7, 24, 12, tzinfo=UTC).timestamp()
    data["depth_m"].attrs["units"] = "seconds"
    data.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(ValueError, match="another quantity"):
        read_record(path)
    data.drop_vars("TIME").to_netcdf(path, engine="h5netcdf")
    with pytest.raises(ValueError, match="no variable time_s"):
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
    savemat(path, {"t": np.arange(5.0), "depth_m": np.arange(5.0)[:, None]})
    with pytest.raises(ValueError, match="One set of vectors with a time_s is needed, got 0; there are t, depth_m"):
        read_record(path)
    assert read_record(path, {"t": "time_s"})["depth_m"].tolist() == [0, 1, 2, 3, 4]
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
    with pytest.raises(ValueError, match="is not NetCDF"):
        read_record(tmp_path / "text.nc")
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    with pytest.raises(ValueError, match=r"version 7\.3 are not read: save with"):
        read_record(tmp_path / "new.mat")


def test_the_measured_torpedo_record(shared_data):
    r = read_record(shared_data / "auv690" / "auv690_2022-07-28_part1_10Hz.csv", required=["heading_rad", "depth_m"])
    assert len(r) == 21991
    assert r.sample_interval == pytest.approx(0.1, abs=1e-3)
    assert np.isfinite(r.matrix(["heading_rad", "pitch_rad", "rudder_cmd_rad", "u_dvl_mps"])).all()
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
