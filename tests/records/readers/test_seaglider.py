"""Dives of Seagliders: groups, units, flags, the moved battery, and what is recognised."""

import tomllib
from importlib.resources import files

import h5py
import numpy as np
import pytest
import xarray as xr

from auv_gym.channels import conversion
from auv_gym.records.log import Log, Scope
from auv_gym.records.readers import netcdf
from auv_gym.records.readers.netcdf_variables import open_netcdf
from auv_gym.records.readers.seaglider import FORMAT

SINCE = {"units": "seconds since 1970-1-1 00:00:00"}
START = 1.7e9
SAMPLES = START + np.arange(0.0, 1000.0, 10.0)
CTD = START + np.arange(2.5, 1000.0, 20.0)
BEGIN = START + np.array([0.0, 300.0, 700.0])  # events: pitch and VBD, roll, pitch and roll
NAMES = tomllib.loads((files("auv_gym.records") / "mappings" / "seaglider.toml").read_text())["names"]


def chars(text: str) -> np.ndarray:
    return np.array(list(text), dtype="S1")


def dive(**changes) -> xr.Dataset:
    """A dive as of 2024: the CTD on a dimension of its own, motors in events alone; changes: None leaves one out."""
    sample, ctd, event = "sg_data_point", "ctd_data_point", "gc_event"
    data = {
        "time": (sample, SAMPLES, SINCE),
        "depth": (sample, np.linspace(0, 100, 100), {"units": "meters"}),
        "eng_depth": (sample, np.linspace(0, 1e4, 100), {"units": "cm"}),
        "eng_head": (sample, np.linspace(300, 420, 100) % 360, {"units": "degrees"}),
        "eng_pitchAng": (sample, np.full(100, -20.0), {"units": "degrees"}),
        "eng_rollAng": (sample, np.zeros(100), {"units": "degrees"}),
        "ctd_time": (ctd, CTD, SINCE),
        "temperature": (ctd, np.full(50, 10.0), {"units": "degrees_Celsius"}),
        "temperature_qc": (ctd, chars("1" * 45 + "34698")),
        "salinity": (ctd, np.full(50, 35.0), {"units": "1e-3"}),
        "salinity_qc": (ctd, chars("4" * 3 + "1" * 47)),
        "density": (ctd, np.full(50, 1027.0), {"units": "g/m^3"}),
        "gc_st_secs": (event, BEGIN, SINCE),
        "gc_flags": (event, np.array([0, 0, 1024])),
        "gc_vbd_ctl": (event, np.array([-100.0, 0.0, 0.0]), {"units": "cm"}),
        "gc_pitch_secs": (event, np.array([20.0, 0.0, 10.0])),
        "gc_vbd_secs": (event, np.array([-60.0, 0.0, 0.0])),
        "gc_roll_secs": (event, np.array([0.0, 5.0, 5.0])),
        "gc_pitch_ad_start": (event, np.array([2100.0, 1100.0, 1100.0])),
        "gc_pitch_ad": (event, np.array([1100.0, 1100.0, 3100.0])),
        "gc_vbd_ad_start": (event, np.array([2000.0, 3000.0, 3000.0])),
        "gc_vbd_ad": (event, np.array([3000.0, 3000.0, 3000.0])),
        "gc_roll_ad_start": (event, np.array([2000.0, 2000.0, 3000.0])),
        "gc_roll_ad": (event, np.array([2000.0, 3000.0, 2000.0])),
        "log_gps_time": ("gps_info", START + np.array([-900.0, -60.0, 1200.0]), SINCE),
        "log_gps_lat": ("gps_info", np.array([60.0, 60.1, 60.2])),
        "log_gps_lon": ("gps_info", np.array([-8.0, -8.1, -8.2])),
        "log_gps_driftspeed": ("gps_info", np.full(3, -1.0), {"units": "knots"}),
        "log_GPS2": ("string_52", chars("$GPS2,060608,204645,6125.645,-819.089,11,1.2,11,-8.8")),
        "wlbb_count": ("wlbb_point", np.arange(4.0)),
        "log_C_PITCH": ((), 2100), "log_PITCH_CNV": ((), 0.003),
        "log_C_VBD": ((), 2500), "log_VBD_CNV": ((), -0.25),
        "log_C_ROLL_DIVE": ((), 2000), "log_C_ROLL_CLIMB": ((), 2100), "log_ROLL_CNV": ((), 0.03),
        "start_of_climb_time": ((), 500.0),
        "avg_latitude": ((), 60.05, {"units": "degrees_north"}), "magnetic_variation": ((), -8.8),
        "depth_avg_curr_north": ((), 0.1, {"units": "m/s"}), "depth_avg_curr_east": ((), -0.2, {"units": "m/s"}),
        "depth_avg_curr_qc": ("string_1", chars("1")),
        "sg_cal_mass": ((), 52.3, {"units": "kg"}), "sg_cal_volmax": ((), 51459.0, {"units": "m^3"}),
        "sg_cal_optode_FoilCoefA0": ((), 1.0), "sg_cal_calibcomm": ("string_3", chars("SBE")),
    }  # fmt: skip
    data = {name: value for name, value in {**data, **changes}.items() if value is not None}
    attrs = {"dive_number": np.int32(7), "platform_id": "SG171", "start_time": START}
    return xr.Dataset(data, attrs=attrs)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, bytes]:
    """The same dive as NetCDF 4 and as classic NetCDF."""
    folder = tmp_path_factory.mktemp("dives")
    return {engine: write(folder / f"{engine}.nc", dive(), engine).read_bytes() for engine in ("h5netcdf", "scipy")}


def write(path, data, engine="scipy"):
    data.to_netcdf(path, engine=engine)
    return path


def put(path, content: bytes):
    path.write_bytes(content)
    return path


def recognised(path, form=FORMAT) -> bool:
    return form.recognises(path, path.read_bytes()[:4096])


def column(log: Log, name: str) -> np.ndarray:
    found = log.column(name)
    assert found is not None
    return np.asarray(found[1])


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_one_group_a_clock(tmp_path, whole, engine):
    path = put(tmp_path / "p1710007.nc", whole[engine])
    assert recognised(path)
    assert not recognised(path, netcdf.FORMAT)
    log = FORMAT.read(path, Scope())
    assert (log.format, log.source, log.label) == ("Seaglider NetCDF", "p1710007.nc", "dive 7")
    times = {group.name: group.time for group in log.groups}
    assert next(iter(times)) == "sg_data_point"
    assert {name: (t.tolist() if t is not None else None) for name, t in times.items()} == {
        "sg_data_point": SAMPLES.tolist(), "ctd_data_point": CTD.tolist(), "gc_event": BEGIN.tolist(),
        "gps_info": [START - 900.0, START - 60.0, START + 1200.0],
    }  # fmt: skip
    assert column(log, "eng_depth")[-1] == 1e4
    assert np.isnan(column(log, "log_gps_driftspeed")).all()


def test_units_are_those_of_the_format(tmp_path, whole):
    log = FORMAT.read(put(tmp_path / "dive.nc", whole["scipy"]), Scope())
    units = {name: unit for group in log.groups for name, unit in group.units.items()}
    assert units["density"] == "kg/m3"  # the attribute says g/m^3
    assert units["gc_vbd_ctl"] == "cm3"  # the attribute says cm
    assert units["eng_depth"] == "cm"
    assert units["salinity"] == "psu"
    assert units["temperature"] == "degC"
    for theirs, ours in NAMES.items():
        assert conversion(ours, units.get(theirs)).channel.name == conversion(ours).channel.name


def test_flagged_samples_are_missing_and_counted(tmp_path, whole):
    log = FORMAT.read(put(tmp_path / "dive.nc", whole["scipy"]), Scope())
    assert np.flatnonzero(np.isnan(column(log, "temperature"))).tolist() == [45, 46, 47, 48]  # 3, 4, 6, 9; 8 is kept
    assert np.flatnonzero(np.isnan(column(log, "salinity"))).tolist() == [0, 1, 2]
    assert np.flatnonzero(np.isnan(column(log, "density"))).tolist() == [0, 1, 2]
    assert "4 of 50 samples of temperature are left out: temperature_qc calls them bad." in log.notes
    assert "3 of 50 samples of density are left out: salinity_qc calls them bad." in log.notes
    one = dive(temperature_qc=("ctd_data_point", chars("1" * 49 + "4")))
    notes = FORMAT.read(write(tmp_path / "one.nc", one), Scope()).notes
    assert "1 of 50 samples of temperature is left out: temperature_qc calls it bad." in notes
    flags = dive(temperature_qc=("ctd_data_point", np.r_[np.ones(49), 4.0]))
    log = FORMAT.read(write(tmp_path / "numbers.nc", flags), Scope())
    assert np.flatnonzero(np.isnan(column(log, "temperature"))).tolist() == [49]


def test_the_battery_and_the_volume_are_rebuilt_from_events(tmp_path, whole):
    log = FORMAT.read(put(tmp_path / "dive.nc", whole["scipy"]), Scope())
    t = SAMPLES - START
    # one motor after the other: pitch 0 to 20 s, VBD to 80 s; when turning, roll 700 to 705 s, then pitch to 715 s
    pitch = np.interp(t, [0, 20, 705, 715], [0, -3, -3, 3])
    assert column(log, "battery_position_cm") == pytest.approx(pitch, abs=1e-9)
    vbd = np.interp(t, [20, 80], [(2000 - 2500) * -0.25, (3000 - 2500) * -0.25])
    assert column(log, "vbd_cm3") == pytest.approx(vbd, abs=1e-9)
    # counted from another centre once the climb has begun
    roll = np.interp(t, [300, 305, 700, 705], [0, 30, 30, 0]) - np.where(t > 500, 3.0, 0.0)
    assert column(log, "battery_roll_deg") == pytest.approx(roll, abs=1e-9)
    assert sum("is rebuilt from the events" in note for note in log.notes) == 3


def test_what_is_logged_by_sample_is_not_rebuilt(tmp_path):
    logged = dive(
        eng_pitchCtl=("sg_data_point", np.ones(100)),
        eng_vbdCC=("sg_data_point", np.ones(100)),
        gc_roll_ad=None,
    )
    log = FORMAT.read(write(tmp_path / "dive.nc", logged), Scope())
    assert not {"battery_position_cm", "vbd_cm3", "battery_roll_deg"} & set(log.names)
    assert any("battery_roll_deg cannot be known" in note for note in log.notes)


def test_what_is_known_once_a_dive(tmp_path, whole):
    log = FORMAT.read(put(tmp_path / "dive.nc", whole["scipy"]), Scope())
    assert log.attrs == {
        "latitude_deg": 60.05, "magnetic_variation_deg": -8.8, "start_of_climb_s": 500.0, "current_north_mps": 0.1,
        "current_east_mps": -0.2, "gps_fixes": [START - 60, 60.1, -8.1, START + 1200, 60.2, -8.2],
        "sg_cal_mass": 52.3, "sg_cal_volmax": 51459.0, "platform_id": "SG171",
        "log_C_VBD": 2500.0, "log_VBD_CNV": -0.25,
    }  # fmt: skip
    bad = dive(depth_avg_curr_qc=("string_1", chars("4")), magnetic_variation=None)
    log = FORMAT.read(write(tmp_path / "bad.nc", bad), Scope())
    assert "current_north_mps" not in log.attrs
    assert any("current is left out" in note for note in log.notes)
    assert log.attrs["magnetic_variation_deg"] == -8.8  # from the line of the GPS
    assert not any("from GPS" in note for note in log.notes)
    log = FORMAT.read(write(tmp_path / "none.nc", dive(log_gps_lat=None)), Scope())
    assert "gps_fixes" not in log.attrs
    assert any("The current cannot be known from GPS: the file does not have three fixes" in note for note in log.notes)


def test_a_first_look_and_chosen_groups(tmp_path, whole):
    path = put(tmp_path / "dive.nc", whole["h5netcdf"])
    said = []
    log = FORMAT.read(path, Scope(most=5, progress=lambda share, words: said.append((share, words))))
    samples = log.groups[0]
    assert (samples.rows, len(samples.columns["eng_head"]), samples.span) == (100, 5, (START, START + 990.0))
    assert said[0][0] == 0.0
    log = FORMAT.read(path, Scope(groups={"ctd_data_point"}))
    assert [group.name for group in log.groups] == ["ctd_data_point"]


def test_events_that_do_not_fit_together_tell_nothing(tmp_path):
    short = dive(gc_roll_ad=("other", np.ones(2)), gc_flags=("gc_event", np.array([0.0, np.nan, 0.0])))
    log = FORMAT.read(write(tmp_path / "dive.nc", short), Scope())
    assert "battery_roll_deg" not in log.names
    assert "battery_position_cm" in log.names
    assert any("battery_roll_deg cannot be known" in note for note in log.notes)


def test_what_is_no_dive(tmp_path):
    other = write(tmp_path / "other.nc", xr.Dataset({"x": ("time", [1.0, 2.0])}, {"time": ("time", [0.0, 1.0])}))
    assert not recognised(other)
    assert recognised(other, netcdf.FORMAT)
    with pytest.raises(ValueError, match="needs the variable 'time' along sg_data_point"):
        FORMAT.read(other, Scope())
    (tmp_path / "text.nc").write_text("sg_data_point")
    assert not recognised(tmp_path / "text.nc")


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize("share", [0.001, 0.05, 0.3, 0.6, 0.9, 0.99])
def test_a_file_that_is_cut_short_is_refused(tmp_path, whole, engine, share):
    path = put(tmp_path / "cut.nc", whole[engine][: int(share * len(whole[engine]))])
    assert recognised(path) in (True, False)  # but no error
    with pytest.raises(ValueError, match=r"damaged or cut short|is not NetCDF"):
        FORMAT.read(path, Scope())


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_garbage_inside_raises_no_other_error(tmp_path, whole, engine):
    content, random, refused = whole[engine], np.random.default_rng(1), 0
    for where in range(8, len(content) - 64, len(content) // 20):
        path = put(tmp_path / "bad.nc", content[:where] + random.bytes(64) + content[where + 64 :])
        try:
            assert FORMAT.read(path, Scope()).groups
        except ValueError:
            refused += 1
    assert refused > 0


def test_real_dives(shared_data):
    rows = {"p5610004.nc": (151, 0), "p1710101.nc": (722, 692), "p0050003_20080606.nc": (598, 0)}
    for name, (samples, ctd) in rows.items():
        path = shared_data / "seaglider" / name
        assert recognised(path)
        log = FORMAT.read(path, Scope())
        found = {group.name: group.rows for group in log.groups}
        assert (found["sg_data_point"], found.get("ctd_data_point", 0)) == (samples, ctd)
        assert np.nanmax(column(log, "depth")) * 100 == pytest.approx(np.nanmax(column(log, "eng_depth")), rel=6e-3)
        with open_netcdf(path) as file:
            expected = file.variables["eng_pitchAng"].numbers()
        assert np.array_equal(column(log, "eng_pitchAng"), expected)
        assert 1000 < np.nanmedian(column(log, "density")) < 1040
        assert {"sg_cal_mass", "sg_cal_volmax", "latitude_deg", "magnetic_variation_deg"} <= set(log.attrs)
        assert (set(NAMES) & set(log.names)) >= {"eng_head", "depth", "eng_vbdCC", "temperature", "salinity"}


def test_rebuilt_positions_agree_with_logged_ones(shared_data, tmp_path):
    path = tmp_path / "dive.nc"
    path.write_bytes((shared_data / "seaglider" / "p5610005.nc").read_bytes())
    logged = FORMAT.read(path, Scope())
    with h5py.File(path, "r+") as file:
        for name in ("eng_pitchCtl", "eng_rollCtl", "eng_vbdCC"):
            file.move(name, f"{name}_by_sample")
    rebuilt = FORMAT.read(path, Scope())
    for theirs, ours, resolution in (
        ("eng_pitchCtl", "battery_position_cm", 0.01),
        ("eng_rollCtl", "battery_roll_deg", 0.03),  # one count
        ("eng_vbdCC", "vbd_cm3", 0.25),
    ):
        off = np.abs(column(rebuilt, ours) - column(logged, theirs))
        # all but a few samples within a count; those few were taken while the motor moved
        assert np.mean(off < resolution) > 0.9, ours
