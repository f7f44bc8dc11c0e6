"""Binary logs of Slocum gliders: sensors, units, cycles that do not count, and what is refused or cut short."""

import importlib.util
import os
import struct
import subprocess
import sys
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from auv_gym.channels import conversion
from auv_gym.records.log import Log, Scope
from auv_gym.records.readers import slocum
from auv_gym.records.readers.slocum import FORMAT, LOGS, bundled_slocum_log, current_cycles, unit_of_sensor

needs_dbdreader = pytest.mark.skipif(
    importlib.util.find_spec("dbdreader") is None, reason="the extra `slocum` is absent"
)
SENSORS = {"m_present_time": ("timestamp", 8), "m_heading": ("rad", 4), "m_battpos": ("in", 4), "m_lat": ("lat", 8),
           "m_gps_mag_var": ("rad", 4), "m_de_oil_vol": ("cc", 4)}  # fmt: skip
NAMES = tomllib.loads((files("auv_gym.records") / "mappings" / "slocum.toml").read_text())["names"]


def log_of(rows: list[dict[str, float]], end: bytes = b"X") -> bytes:
    """A log with a cycle for each row, of the sensors that it names."""
    state_bytes = -(-len(SENSORS) // 4)
    header = [
        "dbd_label:    DBD(dinkum_binary_data)file", "encoding_ver: 5", "num_ascii_tags: 14", "all_sensors: T",
        "the8x3_filename: 00000000", "full_filename: made-2024-001-0-0", "filename_extension: dbd",
        "mission_name: TEST.MI", "fileopen_time: Mon_Jan__1_00:00:00_2024", f"total_num_sensors: {len(SENSORS)}",
        f"sensors_per_cycle: {len(SENSORS)}", f"state_bytes_per_cycle: {state_bytes}", "sensor_list_crc: 00000000",
        "sensor_list_factored: 0",
    ]  # fmt: skip
    header += [f"s: T {k} {k} {size} {name} {unit}" for k, (name, (unit, size)) in enumerate(SENSORS.items())]
    cycles = []
    for row in rows:
        bits, values = 0, b""
        for name, (_, size) in SENSORS.items():
            bits = bits << 2 | (2 if name in row else 0)
            values += struct.pack("<d" if size == 8 else "<f", row[name]) if name in row else b""
        bits <<= 2 * (4 * state_bytes - len(SENSORS))
        cycles.append(b"d" + bits.to_bytes(state_bytes, "big") + values)
    known = b"sa" + struct.pack("<Hfd", 0x1234, 123.456, 123456789.12345)
    return "\n".join([*header, ""]).encode() + known + b"".join(cycles) + end


def rows_at(times) -> list[dict[str, float]]:
    """Rows with a heading that counts up, and now and then others."""
    rows = [{"m_present_time": t, "m_heading": 0.1 * k} for k, t in enumerate(times)]
    for row in rows[3::4]:
        row |= {"m_battpos": 0.5, "m_lat": 4312.3, "m_gps_mag_var": 0.1, "m_de_oil_vol": 250.0}
    return rows


def put(path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def head(path) -> bytes:
    with path.open("rb") as file:
        return file.read(4096)


@pytest.fixture(scope="module")
def ammonite() -> Log:
    return FORMAT.read(bundled_slocum_log("ammonite"), Scope())


def sensor(log: Log, name: str):
    (group,) = [group for group in log.groups if group.name == name]
    assert set(group.columns) == {name}
    assert group.time is not None
    return group


@needs_dbdreader
def test_ammonite_is_read_whole(ammonite):
    assert FORMAT.recognises(bundled_slocum_log("ammonite"), head(bundled_slocum_log("ammonite")))
    heading, depth = sensor(ammonite, "m_heading"), sensor(ammonite, "m_depth")
    assert (heading.rows, heading.near, heading.units) == (1531, 60.0, {"m_heading": "rad"})
    assert heading.time[0] == pytest.approx(1201598347.6, abs=0.1)  # 29 January 2008, 09:19 UTC
    assert np.diff(heading.time).max() < 20.0  # the row of before the log lies 25 s before the first cycle
    assert depth.columns["m_depth"].max() == pytest.approx(608, abs=1)
    assert len(ammonite.groups) == 98
    assert ammonite.label == "ammonite-2008-028-1-0"
    assert ammonite.attrs["mission"] == "GOL.MI"
    assert ammonite.attrs["latitude_deg"] == pytest.approx(43.01, abs=0.01)
    assert ammonite.notes == ()


@needs_dbdreader
def test_numbers_and_units_are_those_of_dbdreader(ammonite, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    import dbdreader

    reader = dbdreader.DBD(str(bundled_slocum_log("ammonite")), cacheDir=str(tmp_path))
    for name in ("m_heading", "m_depth", "m_fin", "c_heading", "m_lat", "m_de_oil_vol"):
        time, values = reader.get(name, decimalLatLon=False)
        group = sensor(ammonite, name)
        first = int(time[0] < sensor(ammonite, "m_heading").time[0])
        assert np.array_equal(group.time, time[first:])
        assert np.array_equal(group.columns[name], values[first:])
    units = {name: unit for group in ammonite.groups for name, unit in group.units.items()}
    assert {name: units.get(name) for name in ("m_fin", "m_pressure", "m_de_oil_vol", "m_lat", "m_battpos")} == {
        "m_fin": "rad", "m_pressure": "bar", "m_de_oil_vol": "cm3", "m_lat": None, "m_battpos": None,
    }  # fmt: skip
    assert reader.parameterUnits["m_battpos"] == "in"
    assert units.keys() < set(reader.parameterNames)


@needs_dbdreader
def test_the_mapping_fits_the_units(ammonite):
    units = {name: unit for group in ammonite.groups for name, unit in group.units.items()}
    for theirs, ours in NAMES.items():
        name = ours["to"] if isinstance(ours, dict) else ours
        assert conversion(name, units.get(theirs)).channel.name == conversion(name).channel.name, theirs
    assert NAMES["m_heading"] == "heading_rad"
    assert conversion(NAMES["m_battpos"]["to"]).channel.unit == "m"


@needs_dbdreader
def test_the_fin_turns_to_starboard_and_pitch_is_up(ammonite):
    heading, depth = sensor(ammonite, "m_heading"), sensor(ammonite, "m_depth")
    deep = np.interp(heading.time, depth.time, depth.columns["m_depth"]) > 10
    rate = np.gradient(np.unwrap(heading.columns["m_heading"]), heading.time)
    fin, pitch = (
        np.interp(heading.time, sensor(ammonite, n).time, sensor(ammonite, n).columns[n]) for n in ("m_fin", "m_pitch")
    )
    assert np.corrcoef(rate[deep], fin[deep])[0, 1] > 0.5
    sinking = np.gradient(np.interp(heading.time, depth.time, depth.columns["m_depth"]), heading.time)
    assert np.corrcoef(sinking[deep], pitch[deep])[0, 1] < -0.9


@needs_dbdreader
def test_a_made_log(tmp_path):
    path = put(tmp_path / "made.dbd", log_of(rows_at(1.7e9 + 4.0 * np.arange(20))))
    log = FORMAT.read(path, Scope())
    # of the known cycle and the one after it, nothing is kept
    heading = sensor(log, "m_heading")
    kept = heading.time - 1.7e9
    assert kept[-1] == 76.0
    assert kept[0] in (4.0, 8.0)
    assert heading.columns["m_heading"] == pytest.approx(0.1 * kept / 4.0, rel=1e-6)
    assert sensor(log, "m_lat").columns["m_lat"].tolist() == [4312.3] * 5
    assert log.attrs["latitude_deg"] == pytest.approx(43.205, abs=1e-9)
    assert log.attrs["magnetic_variation_deg"] == pytest.approx(-np.degrees(0.1), rel=1e-6)  # theirs is west
    assert log.attrs["mission"] == "TEST.MI"
    assert "m_present_time" not in log.names


@needs_dbdreader
def test_cycles_until_a_clock_that_was_set_back_catches_up_go(tmp_path):
    times = 1.7e9 + np.array([0, 4, 8, 12, 16, 20, 24, 6, 10, 14, 18, 22, 26, 30.0])
    log = FORMAT.read(put(tmp_path / "made.dbd", log_of(rows_at(times))), Scope())
    heading = sensor(log, "m_heading")
    assert (heading.time - 1.7e9).tolist()[-7:] == [8, 12, 16, 20, 24, 26, 30]
    assert heading.columns["m_heading"][-2:] == pytest.approx([1.2, 1.3])
    assert log.notes == ("The clock was set back; 5 cycles until it caught up are left out.",)


def test_which_cycles_count():
    nan = float("nan")
    assert current_cycles(np.array([5.0, 1.0, 6.0, 6.0, nan, 7.0])).tolist() == [False, False, True, False, False, True]
    assert current_cycles(np.array([])).tolist() == []


def test_units_of_sensor_lists():
    assert [unit_of_sensor(unit) for unit in ("rad", "cc", "degC", "Celsius", "sec", "volts", "rad/sec")] == [
        "rad", "cm3", "degC", "degC", "s", "V", "rad/s",
    ]  # fmt: skip
    assert [unit_of_sensor(unit) for unit in ("nodim", "enum", "lat", "in", "S/m", "X", "")] == [None] * 7
    for unit in filter(None, slocum._UNITS.values()):
        assert conversion("x", unit)


@needs_dbdreader
def test_chosen_sensors_and_a_first_look(ammonite):
    path = bundled_slocum_log("ammonite")
    log = FORMAT.read(path, Scope(groups={"m_heading", "m_pitch", "m_none"}))
    assert sorted(group.name for group in log.groups) == ["m_heading", "m_pitch"]
    said, whole = [], ammonite
    log = FORMAT.read(path, Scope(most=20, progress=lambda share, words: said.append(share)))
    heading, all_of_it = sensor(log, "m_heading"), sensor(whole, "m_heading")
    assert heading.rows == 1531
    assert np.array_equal(heading.time, all_of_it.time[:20])
    assert heading.span == (all_of_it.time[0], all_of_it.time[-1])
    assert said == [0.0]
    assert {group.name: group.rows for group in log.groups} == {group.name: group.rows for group in whole.groups}
    assert sensor(log, "m_water_vx").columns["m_water_vx"].size == 0  # comes at the end of a dive


@needs_dbdreader
@pytest.mark.parametrize("name", ["amadeus", "sebastian"])
def test_logs_that_need_a_sensor_list(name, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    path, folder = bundled_slocum_log(name), bundled_slocum_log(name).parent / "cac"
    if not (folder / "468fd1be.cac").is_file():
        with pytest.raises(ValueError, match=r"needs the sensor list 468fd1be\.cac.*make slocum-cache.*pip download"):
            FORMAT.read(path, Scope())
        return
    depth = sensor(FORMAT.read(path, Scope(groups={"m_depth"})), "m_depth")
    assert np.ptp(depth.time) == pytest.approx(70 * 60, rel=0.1)
    assert 30 < depth.columns["m_depth"].max() < 45
    copy, beside = put(tmp_path / "copy.dbd", path.read_bytes()), tmp_path / "lists"
    beside.mkdir()
    (beside / "468FD1BE.CAC").write_bytes((folder / "468fd1be.cac").read_bytes())
    monkeypatch.setattr(slocum, "_dbdreader_folder", lambda: tmp_path)
    with pytest.raises(ValueError, match="needs the sensor list"):
        FORMAT.read(copy, Scope())
    assert FORMAT.read(copy, Scope(groups={"m_depth"}, beside=beside)).groups


@needs_dbdreader
def test_nothing_is_written_and_nothing_printed(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    path = put(tmp_path / "log.mbd", bundled_slocum_log("ammonite").read_bytes()[:200_000])
    FORMAT.read(path, Scope())
    with pytest.raises(ValueError, match="damaged"):
        FORMAT.read(put(tmp_path / "bad.dbd", log_of(rows_at(1.7e9 + np.arange(9)), b"?")), Scope())
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["bad.dbd", "home", "log.mbd"]
    assert capfd.readouterr() == ("", "")


@needs_dbdreader
@pytest.mark.parametrize("cut", [0, 5, 300, 5_000])
def test_a_log_that_is_cut_short_in_its_header_is_refused(tmp_path, cut):
    path = put(tmp_path / "cut.mbd", bundled_slocum_log("ammonite").read_bytes()[:cut])
    with pytest.raises(ValueError, match=r"cut short|no Slocum log|damaged|empty") as caught:
        FORMAT.read(path, Scope())
    assert str(path) in str(caught.value)


@needs_dbdreader
@pytest.mark.parametrize("cut", [62_000, 100_001, 313_620])
def test_the_whole_cycles_of_a_log_that_is_cut_short_are_read(tmp_path, ammonite, cut):
    log = FORMAT.read(put(tmp_path / "cut.mbd", bundled_slocum_log("ammonite").read_bytes()[:cut]), Scope())
    heading, whole = sensor(log, "m_heading"), sensor(ammonite, "m_heading")
    assert 3 < heading.rows <= 1531
    assert np.array_equal(heading.columns["m_heading"], whole.columns["m_heading"][: heading.rows])
    assert len(log.notes) == 1
    assert log.notes[0].startswith("The log is cut short: its ")


@needs_dbdreader
@pytest.mark.parametrize("where", [150_000])
def test_a_log_with_damage_inside_is_refused(tmp_path, where):
    whole = bytearray(bundled_slocum_log("ammonite").read_bytes())
    whole[where : where + 400] = np.random.default_rng(3).bytes(400)
    with pytest.raises(ValueError, match="is damaged in its cycle"):
        FORMAT.read(put(tmp_path / "bad.mbd", bytes(whole)), Scope())


@needs_dbdreader
@pytest.mark.parametrize("cycles", [0, 6])
def test_zeros_after_a_good_beginning_are_refused_at_once(tmp_path, cycles):
    path = put(tmp_path / "zeros.dbd", log_of(rows_at(1.7e9 + np.arange(cycles)), b""))
    os.truncate(path, 1 << 30)
    with pytest.raises(ValueError, match="damaged"):
        FORMAT.read(path, Scope())


@needs_dbdreader
def test_a_log_without_values_is_refused(tmp_path):
    path = put(tmp_path / "short.dbd", log_of(rows_at([1.7e9, 1.7e9 + 4])))
    with pytest.raises(ValueError, match="no values after its first cycle, of 2"):
        FORMAT.read(path, Scope())
    path = put(tmp_path / "one.dbd", log_of(rows_at([1.7e9, 1.7e9 + 4]))[:-20])
    with pytest.raises(ValueError, match="is cut short in its cycle 0"):
        FORMAT.read(path, Scope())


def packed(content: bytes) -> bytes:
    import lz4.block

    blocks = [content[k : k + 32768] for k in range(0, len(content), 32768)]
    blocks = [lz4.block.compress(block, store_size=False) for block in blocks]
    return b"".join(len(block).to_bytes(2, "big") + block for block in blocks)


@needs_dbdreader
def test_compressed_logs(tmp_path, ammonite):
    content = packed(bundled_slocum_log("ammonite").read_bytes())
    path = put(tmp_path / "log.mcd", content)
    assert FORMAT.recognises(path, head(path))
    log = FORMAT.read(path, Scope())
    assert np.array_equal(
        sensor(log, "m_heading").columns["m_heading"], sensor(ammonite, "m_heading").columns["m_heading"]
    )
    log = FORMAT.read(put(path, content[:-3000]), Scope())
    assert log.notes == ("The log is cut short: its whole blocks are read.",)
    for damaged in (content[:100], content[:2000] + bytes(9000), content[:2] + b"\xff" * 5000):
        with pytest.raises(ValueError, match=r"cannot be decompressed|is damaged|cut short"):
            FORMAT.read(put(path, damaged), Scope())


@needs_dbdreader
def test_what_is_no_slocum_log(tmp_path):
    text = put(tmp_path / "text.dbd", b"time_s,depth_m\n")
    assert not FORMAT.recognises(text, head(text))
    assert not FORMAT.recognises(text, b"dbd_label: DBD_ASC(dinkum_binary_data_ascii)file\n")
    with pytest.raises(ValueError, match="is no Slocum log"):
        FORMAT.read(text, Scope())
    with pytest.raises(ValueError, match="There is no folder"):
        FORMAT.read(bundled_slocum_log("ammonite"), Scope(beside=tmp_path / "none"))
    with pytest.raises(ValueError, match=r"no log 'amonite'\. Did you mean 'ammonite'"):
        bundled_slocum_log("amonite")


def test_without_dbdreader_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install '\.\[slocum\]'"):
        bundled_slocum_log("ammonite")
    with pytest.raises(ValueError, match=r"pip install '\.\[slocum\]'"):
        FORMAT.read(put(tmp_path / "x.dbd", b"dbd_label"), Scope())


@needs_dbdreader
def test_dbdreader_is_not_imported_here():
    read = (
        "from auv_gym.records.log import Scope; from auv_gym.records.readers import slocum; import sys;"
        "slocum.FORMAT.read(slocum.bundled_slocum_log('ammonite'), Scope()); print('dbdreader' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", read], capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr
    assert all(Path(name).suffix in (".mbd", ".dbd") for name in LOGS.values())
