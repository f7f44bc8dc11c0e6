"""Telemetry logs: the library's numbers and units, instances, senders, and damaged files."""

import os
import struct
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import auv_gym.records.readers.ardupilot as ardupilot
import auv_gym.records.readers.dataflash as dataflash
import auv_gym.records.readers.mavlink as mavlink
from auv_gym.records.log import Log, Scope
from auv_gym.records.readers.mavlink import FORMAT
from tests.records.readers.ardupilot_logs import HEAD, body, check_mapping, frames, packed, saved, sender, tlog
from tests.records.readers.outcomes import check_refused, outcome

SPELLINGS = {"cdegC": ("degC", 0.01), "hPa": ("Pa", 100.0), "cA": ("A", 0.01), "hJ": ("J", 100.0)}


def check_telemetry_against_library(log: Log, path: Path, main: tuple[int, int] = (1, 1)) -> int:
    """Compares all columns of groups of the main sender without instances; returns how many groups those are."""
    from pymavlink import mavutil

    values, stamps, units = defaultdict(lambda: defaultdict(list)), defaultdict(list), {}
    source = mavutil.mavlogfile(str(path))
    while (found := source.recv_msg()) is not None:
        if (found.get_srcSystem(), found.get_srcComponent()) == main and found.get_type() != "BAD_DATA":
            stamps[found.get_type()].append(found._timestamp)
            units[found.get_type()] = found.fieldunits_by_name
            for name in found.get_fieldnames():
                values[found.get_type()][name].append(getattr(found, name))
    source.close()
    count = 0
    for group in log.groups:
        if group.name not in values or f"{group.name}[1]" in {other.name for other in log.groups}:
            continue
        count += 1
        assert group.time is not None
        assert group.time == pytest.approx(np.array(stamps[group.name]), abs=1e-6)  # both floats of microseconds
        for name, column in group.columns.items():
            field, _, element = name.removeprefix(f"{group.name}.").partition("[")
            theirs = values[group.name][field]
            expected = np.array([row[int(element[:-1])] for row in theirs] if element else theirs, dtype=float)
            unit = units[group.name].get(field, "")
            spelled, factor = SPELLINGS.get(unit, ardupilot.UNITS.get(unit, (unit, 1.0)))
            assert group.units.get(name, "") == spelled
            if group.name == "SERVO_OUTPUT_RAW" and field.startswith("servo"):
                expected[expected == 0.0] = np.nan
            assert np.array_equal(np.asarray(column, dtype=float), expected * factor, equal_nan=True), name
    return count


@pytest.mark.parametrize("signed", [False, True])
def test_telemetry_is_what_the_library_reads(tmp_path, signed, capfd):
    path = tlog(tmp_path, packed(frames(), signed))
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    before = dict(os.environ)
    log = FORMAT.read(path, Scope())
    assert (dict(os.environ), capfd.readouterr()) == (before, ("", ""))
    assert [*tmp_path.iterdir()] == [path]
    assert log.notes == ()
    assert log.attrs == {"servo_functions": [0, 34]}
    assert check_telemetry_against_library(log, path) == 4
    assert {group.name: group.rows for group in log.groups} == {
        "ATTITUDE": 30, "BATTERY_STATUS": 15, "BATTERY_STATUS[1]": 15, "HEARTBEAT": 1, "HEARTBEAT(1.100)": 1,
        "NAMED_VALUE_FLOAT[Lights1]": 15, "NAMED_VALUE_FLOAT[PilotGain]": 15, "SCALED_PRESSURE2": 30,
        "SERVO_OUTPUT_RAW": 30,
    }  # fmt: skip
    pressure = log.column("SCALED_PRESSURE2.press_abs")
    assert pressure is not None
    assert pressure[1][0] == 101_325.0
    assert pressure[0].units["SCALED_PRESSURE2.press_abs"] == "Pa"
    gain = log.column("NAMED_VALUE_FLOAT[PilotGain].value")
    assert gain is not None
    assert np.array_equal(gain[1], 0.5 * np.arange(1, 30, 2))


def test_a_first_look_at_telemetry(tmp_path):
    path = tlog(tmp_path)
    log = FORMAT.read(path, Scope(most=5, groups=["ATTITUDE"]))
    (group,) = log.groups
    assert group.time is not None
    assert (group.rows, group.time.size) == (30, 5)
    assert group.span == pytest.approx((1_700_000_000.05, 1_700_000_001.5), abs=1e-6)


def test_two_vehicles_are_told_apart(tmp_path):
    from pymavlink.dialects.v20 import ardupilotmega as mav

    one, two = sender(1, 1), sender(2, 1)
    content: list = [(mav.MAVLink_heartbeat_message(12, 3, 81, 19, 4, 3), who, False) for who in (two, one)]
    for k in range(10):
        content += [(mav.MAVLink_attitude_message(k, 0.1, 0, 0, 0, 0, 0), one, False)] * 2
        content += [(mav.MAVLink_attitude_message(k, 0.2, 0, 0, 0, 0, 0), two, False)]
    log = FORMAT.read(tlog(tmp_path, packed(content)), Scope())
    rolls = {group.name: group.columns.get(f"{group.name}.roll") for group in log.groups}
    assert np.allclose(rolls["ATTITUDE"], 0.1)
    assert np.allclose(rolls["ATTITUDE(2.1)"], 0.2)


def test_a_message_with_a_wrong_checksum_is_left_out(tmp_path):
    content = bytearray(packed(frames()))
    content[-30] ^= 1  # in the payload of the last message
    log = FORMAT.read(tlog(tmp_path, bytes(content)), Scope())
    rows = {group.name: group.rows for group in log.groups}
    assert rows["BATTERY_STATUS[1]"] == 14
    assert log.notes == ("Left out 1 messages whose checksum is wrong.",)


@pytest.mark.parametrize(
    "damage", [b"\0" * 5000, bytes(range(256)) * 8, b"\xfd" * 400, b"\xfe\x1c" * 200], ids=["zeros", "all", "fd", "fe"]
)
def test_damage_in_the_middle_of_telemetry_costs_what_it_hits(tmp_path, damage):
    content = packed(frames())
    cut = len(content) // 2
    log = FORMAT.read(tlog(tmp_path, content[:cut] + damage + content[cut:]), Scope())
    rows = {group.name: group for group in log.groups}
    assert 28 <= rows["ATTITUDE"].rows <= 30
    assert np.isin(rows["ATTITUDE"].columns["ATTITUDE.roll"].astype("f4"), (0.1 * np.arange(30)).astype("f4")).all()
    assert any("are no messages" in note for note in log.notes)


@pytest.mark.parametrize("module, limit", [(ardupilot, "_MOST_TRIES"), (mavlink, "_MOST_SUMS")])
def test_damaged_telemetry_is_given_up_in_the_end(tmp_path, monkeypatch, module, limit):
    false = struct.pack(">Q", 1_700_000_000_000_000) + b"\xfd\x1c\0\0\0\1\1\x1e\0\0" + b"\1" * 20
    path = tlog(tmp_path, packed(frames(5)) + false * 60 + packed(frames(5)))
    assert {g.name: g.rows for g in FORMAT.read(path, Scope()).groups}["ATTITUDE"] >= 9
    monkeypatch.setattr(module, limit, 3)
    assert {g.name: g.rows for g in FORMAT.read(path, Scope()).groups}["ATTITUDE"] <= 5


@pytest.mark.parametrize("lost", [1, 5, 17, 40, 60, 100])
def test_telemetry_that_is_cut_short_gives_what_is_whole(tmp_path, lost):
    log = FORMAT.read(tlog(tmp_path, packed(frames())[:-lost]), Scope())
    assert {group.name: group.rows for group in log.groups}["ATTITUDE"] in (29, 30)
    assert log.notes == ("The file is cut short within its last message, which is left out.",)


def test_zeros_after_telemetry_are_passed_over(tmp_path):
    path = tlog(tmp_path)
    os.truncate(path, 1 << 28)
    log = FORMAT.read(path, Scope())
    assert {group.name: group.rows for group in log.groups}["ATTITUDE"] == 30
    assert "are no messages" in log.notes[0]


def test_messages_of_another_dialect_are_left_out_with_a_note(tmp_path):
    other = struct.pack(">Q", 1_700_000_000_000_000) + b"\xfd\1\0\0\0\1\1\xff\xff\x0f\0\0\0"
    log = FORMAT.read(tlog(tmp_path, packed(frames(2)) + other + packed(frames(2))), Scope())
    assert log.notes == ("Left out 1 kinds of messages that ArduPilot's MAVLink dialect does not have.",)


BAD = {
    "empty": (b"", "is empty"),
    "text": (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", "no MAVLink frames"),
    "zeros": (b"\0" * 5000, "no MAVLink frames"),
    "short": (b"\0" * 9, "no MAVLink frames"),
    "one wrong": (
        struct.pack(">Q", 1) + b"\xfd\x1c\0\0\0\1\1\x1e\0\0" + b"\1" * 30,
        "no message with numbers whose checksum",
    ),
}


@pytest.mark.parametrize("content, words", BAD.values(), ids=BAD)
def test_what_is_no_telemetry_is_refused_in_a_sentence(tmp_path, content, words, capfd):
    path = tlog(tmp_path, content)
    check_refused(FORMAT, path, words, capfd)


@given(st.integers(0, 3000), st.binary(max_size=60))
def test_any_cut_of_telemetry_and_any_bytes_after_it_are_read_or_refused(tmp_path_factory, cut, rest):
    path = tlog(tmp_path_factory.mktemp("cut"), packed(frames(10))[:cut] + rest)
    found = outcome(FORMAT, path)
    assert str(path) in found if isinstance(found, str) else found.groups


def test_without_the_library_only_telemetry_is_refused(tmp_path, monkeypatch):
    of_autopilot, telemetry = saved(tmp_path, HEAD + body(3)), tlog(tmp_path)
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.ardupilotmega", None)
    assert dataflash.FORMAT.read(of_autopilot, Scope()).groups
    with pytest.raises(ValueError, match=r"pymavlink, which is not installed; .*: pip install '\.\[ardupilot\]'"):
        FORMAT.read(telemetry, Scope())


def test_the_measured_telemetry(shared_data):
    path = shared_data / "ardusub" / "small.tlog"
    with path.open("rb") as file:
        assert FORMAT.recognises(path, file.read(4096))
    log = FORMAT.read(path, Scope())
    assert check_telemetry_against_library(log, path) > 30
    rows = {group.name: group.rows for group in log.groups}
    assert (rows["ATTITUDE"], rows["SERVO_OUTPUT_RAW"], rows["HEARTBEAT"]) == (5245, 528, 263)
    assert log.notes == ("Left out 4 messages whose checksum is wrong.",)
    channels = check_mapping(log, "mavlink")
    assert {"roll_rad", "heading_rad", "depth_m", "r_radps", "t8_us", "temperature_C", "heading_cmd_rad"} <= channels
    time = log.column("ATTITUDE.time_boot_ms")[1] * 1e-3
    growth = np.gradient(log.column("ATTITUDE.roll")[1], time, edge_order=1)
    usable = np.isfinite(growth) & (np.abs(growth) < 1.0)
    assert np.corrcoef(growth[usable], log.column("ATTITUDE.rollspeed")[1][usable])[0, 1] > 0.95
