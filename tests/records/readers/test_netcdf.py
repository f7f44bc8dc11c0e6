"""NetCDF files of any make: groups by dimension, times, units, text, and what is refused."""

import tomllib
from importlib.resources import files

import numpy as np
import pytest
import xarray as xr
from scipy.io import netcdf_file

from auv_gym.channels import conversion
from auv_gym.records.log import Scope
from auv_gym.records.readers.netcdf import FORMAT

T = np.arange(0, 40, 4.0)


def dataset(**changes) -> xr.Dataset:
    data = {
        "HEADING": ("TIME", (350 + 3 * T) % 360, {"units": "degrees"}),
        "DEPTH": ("TIME", np.where(T == 8, -999.0, T), {"units": "m", "_FillValue": -999.0}),
        "counts": ("TIME", np.arange(10), {"units": "1"}),
        "launched": ("TIME", T, {"units": "fortnights since the flood"}),  # left out: not the time, not understood
        "packed": (
            "TIME",
            np.arange(10) * 0.1,
            {"units": "degC", "scale_factor": 0.1, "_FillValue": -1, "dtype": "i4"},
        ),
        "velocity": (("TIME", "axis"), np.arange(30.0).reshape(10, 3), {"units": "m/s"}),
        "image": (("TIME", "pixel"), np.zeros((10, 100))),
        "stage": ("TIME", np.array(["down"] * 5 + ["up"] * 5)),
        "PSAL": ("TIME", np.full(10, 35.0), {"units": "1e-3", "standard_name": "sea_water_practical_salinity"}),
        "profile": ("z", np.arange(3.0)),
        "LATITUDE": ((), 54.5, {"units": "degrees_north"}),
    }
    coords = {"TIME": ("TIME", T, {"units": "seconds since 2014-07-24 12:00:00"})}
    return xr.Dataset({**data, **changes}, coords, {"title": "a glider"})


def write(path, data=None, engine="h5netcdf"):
    data = dataset() if data is None else data
    encoding = {}
    for name, variable in data.variables.items():
        variable.attrs = dict(variable.attrs)
        encoding[name] = {key: variable.attrs.pop(key) for key in ("_FillValue", "scale_factor", "dtype")
                          if key in variable.attrs}  # fmt: skip
    data.to_netcdf(path, engine=engine, encoding=encoding)
    return path


def head(path):
    with path.open("rb") as file:
        return file.read(4096)


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_the_variables_along_time_are_a_group(tmp_path, engine):
    path = write(tmp_path / "log.nc", engine=engine)
    assert FORMAT.recognises(path, head(path))
    log = FORMAT.read(path, Scope())
    (group,) = log.groups
    assert (group.name, group.rows, group.span) == ("TIME", 10, None)
    assert group.time == pytest.approx(1406203200.0 + T, abs=1e-6)  # 24 July 2014, 12:00 UTC
    expected = xr.load_dataset(path, engine=engine, decode_times=False)
    assert set(group.columns) == {
        "HEADING", "DEPTH", "counts", "packed", "stage", "PSAL", "velocity[0]", "velocity[1]", "velocity[2]",
    }  # fmt: skip
    for name in ("HEADING", "DEPTH", "counts", "packed", "PSAL"):
        assert np.array_equal(group.columns[name], expected[name].values, equal_nan=True), name
    assert np.isnan(group.columns["DEPTH"]).sum() == 1
    assert group.columns["velocity[1]"].tolist() == np.arange(1.0, 30.0, 3.0).tolist()
    assert group.columns["stage"] == ["down"] * 5 + ["up"] * 5
    assert group.units == {
        "HEADING": "degrees", "DEPTH": "m", "packed": "degC", "PSAL": "psu",
        "velocity[0]": "m/s", "velocity[1]": "m/s", "velocity[2]": "m/s",
    }  # fmt: skip
    assert log.attrs == {"title": "a glider", "latitude_deg": 54.5}
    assert log.notes == ("Left out, as there is no time along their dimension: z (profile).",)


@pytest.mark.parametrize(
    "name, units, factor",
    [
        ("time_s", None, 1.0),
        ("time_ms", None, 1e-3),
        ("time_min", "", 60.0),
        ("time", "hours", 3600.0),
        ("Timestamp", "s", 1.0),
        ("JULD", "days since 1970-01-01T00:00:00Z", 86400.0),
        ("m_present_time", "timestamp", 1.0),
    ],
)
def test_the_time_along_a_dimension(tmp_path, name, units, factor):
    clock = (("i",), T) if units is None else (("i",), T, {"units": units})
    path = write(tmp_path / "log.nc", xr.Dataset({"m_depth": ("i", T, {"units": "m"}), name: clock}))
    (group,) = FORMAT.read(path, Scope()).groups
    assert group.time == pytest.approx(factor * T, rel=1e-12)
    assert set(group.columns) == {"m_depth"}


def test_two_clocks_of_a_slocum_make_one(tmp_path):
    science = np.where(T < 8, np.nan, T + 0.5)
    data = {
        "m_present_time": ("i", np.where(T < 8, T, np.nan), {"units": "timestamp"}),
        "sci_m_present_time": ("i", science, {"units": "timestamp"}),
        "m_gps_lat": ("i", T, {"units": "lat"}),
    }
    (group,) = FORMAT.read(write(tmp_path / "log.nc", xr.Dataset(data)), Scope()).groups
    assert group.time is not None
    assert group.time.tolist() == [0.0, 4.0, *(T[2:] + 0.5)]
    assert group.units == {}


def test_without_a_time_every_dimension_is_a_group_for_a_mapping(tmp_path):
    path = write(tmp_path / "log.nc", dataset().drop_vars("TIME"))
    log = FORMAT.read(path, Scope())
    assert [(group.name, group.time) for group in log.groups] == [("TIME", None), ("z", None)]
    dates = xr.Dataset(
        {"time": ("i", np.array(["2020-06-25T08:00:00", "2020-06-25T08:00:01"])), "x": ("i", [1.0, 2.0])}
    )
    (group,) = FORMAT.read(write(tmp_path / "dates.nc", dates), Scope()).groups
    assert group.time is None
    assert group.columns["time"] == ["2020-06-25T08:00:00", "2020-06-25T08:00:01"]
    scalars = xr.Dataset({"a": 1.0, "b": 2.0})
    with pytest.raises(ValueError, match=r"no variable time_s or time along one dimension; the variables are 'a', 'b'"):
        FORMAT.read(write(tmp_path / "scalars.nc", scalars), Scope())


def test_a_first_look_and_chosen_groups(tmp_path):
    path = write(
        tmp_path / "log.nc", dataset(t2=("k", np.arange(5.0), {"units": "s since 2020-01-01"}), x=("k", T[:5]))
    )
    log = FORMAT.read(path, Scope(most=4))
    by_name = {group.name: group for group in log.groups}
    assert (by_name["TIME"].rows, len(by_name["TIME"].columns["HEADING"])) == (10, 4)
    assert (by_name["k"].rows, len(by_name["k"].columns["x"])) == (5, 4)
    assert by_name["TIME"].span == (1406203200.0, 1406203236.0)
    assert [group.name for group in FORMAT.read(path, Scope(groups={"k"})).groups] == ["k"]


def test_a_leading_dimension_of_one_goes(tmp_path):
    data = xr.Dataset(
        {"temperature": (("profile", "obs"), T[None])}, {"time": (("profile", "obs"), T[None], {"units": "s"})}
    )
    (group,) = FORMAT.read(write(tmp_path / "log.nc", data), Scope()).groups
    assert group.name == "obs"
    assert group.columns["temperature"].tolist() == T.tolist()


def test_values_that_were_never_written_are_missing(tmp_path):
    path = tmp_path / "log.nc"
    with netcdf_file(path, "w") as file:
        file.createDimension("time", 3)
        for name, values in (("time", [0.0, 1.0, 2.0]), ("depth", [1.0, 9.96921e36, 3.0])):
            variable = file.createVariable(name, "f4", ("time",))
            variable[:] = values
        file.variables["time"].units = "s"
    (group,) = FORMAT.read(path, Scope()).groups
    assert np.isnan(group.columns["depth"]).tolist() == [False, True, False]
    assert group.columns["depth"].dtype.isnative


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize("share", [0.002, 0.02, 0.3, 0.6, 0.9, 0.99])
def test_a_file_that_is_cut_short_is_refused(tmp_path, engine, share):
    whole = write(tmp_path / "whole.nc", engine=engine).read_bytes()
    path = tmp_path / "cut.nc"
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"is damaged or cut short|is not NetCDF"):
        FORMAT.read(path, Scope())


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_garbage_inside_is_refused_or_read_but_no_other_error(tmp_path, engine):
    whole = bytearray(write(tmp_path / "whole.nc", engine=engine).read_bytes())
    random = np.random.default_rng(1)
    refused = 0
    for where in range(8, len(whole) - 64, len(whole) // 20):
        damaged = bytearray(whole)
        damaged[where : where + 64] = random.bytes(64)
        path = tmp_path / "bad.nc"
        path.write_bytes(damaged)
        try:
            assert FORMAT.read(path, Scope()).groups
        except ValueError:
            refused += 1
    assert refused > 2


@pytest.mark.parametrize("start", [b"CDF\1", b"CDF\2", b"\x89HDF\r\n\x1a\n"])
def test_zeros_after_the_magic_are_refused_at_once(tmp_path, start):
    path = tmp_path / "zeros.nc"
    with path.open("wb") as file:
        file.write(start)
        file.truncate(1 << 30)
    assert FORMAT.recognises(path, head(path))
    with pytest.raises(ValueError, match=r"damaged or cut short|no variable time_s"):
        FORMAT.read(path, Scope())


def test_a_header_that_promises_too_much_is_refused(tmp_path):
    import h5py

    path = tmp_path / "huge.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("time", shape=(10**12,), dtype="f8", chunks=(1024,)).attrs["units"] = "s"
        file.create_dataset("depth", shape=(10**12,), dtype="f8", chunks=(1024,))
    with pytest.raises(ValueError, match="too many for a log"):
        FORMAT.read(path, Scope())


def test_what_is_no_netcdf(tmp_path):
    path = tmp_path / "text.nc"
    path.write_text("time_s,depth_m\n")
    assert not FORMAT.recognises(path, head(path))
    with pytest.raises(ValueError, match="is not NetCDF"):
        FORMAT.read(path, Scope())
    scalar = write(tmp_path / "scalar.nc", xr.Dataset({"depth": ((), 3.0)}))
    with pytest.raises(ValueError, match="no variable time_s or time along one dimension; the variables are 'depth'"):
        FORMAT.read(scalar, Scope())
    calendar = xr.Dataset({"x": ("time", T)}, {"time": ("time", T, {"units": "fortnights since the flood"})})
    with pytest.raises(ValueError, match="The times in 'time' cannot be read"):
        FORMAT.read(write(tmp_path / "calendar.nc", calendar), Scope())


def test_the_mapping_names_channels():
    names = tomllib.loads((files("auv_gym.records") / "mappings" / "glider_netcdf.toml").read_text())["names"]
    assert {conversion(name).channel.name for name in names.values()} == {
        "depth_m", "pressure_dbar", "heading_rad", "pitch_rad", "roll_rad", "salinity_psu", "temperature_C",
        "altitude_m", "density_kgpm3",
    }  # fmt: skip
