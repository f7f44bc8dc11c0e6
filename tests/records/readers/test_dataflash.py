"""Dataflash logs: the library's numbers and units, instances, and damaged files."""

import os
import struct
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import auv_gym.records.readers.ardupilot as ardupilot
import auv_gym.records.readers.dataflash as dataflash
import auv_gym.records.readers.mavlink as mavlink
from auv_gym.channels import conversion
from auv_gym.records.log import Log, Scope
from auv_gym.records.readers.dataflash import FORMAT
from tests.records.readers.ardupilot_logs import (
    HEAD,
    body,
    check_mapping,
    definition,
    frames,
    layout,
    message,
    packed,
    saved,
    tlog,
)
from tests.records.readers.outcomes import check_refused, outcome

# what the library calls a unit, where we spell it in another way: ours, and our number over its number
SPELLINGS = {
    "": ("", 1.0), "UNKNOWN": ("", 1.0), "µs": ("us", 1.0), "degheading": ("deg", 1.0), "deglatitude": ("deg", 1.0),
    "deglongitude": ("deg", 1.0), "m/s/s": ("m/s2", 1.0), "cm/s/s": ("m/s2", 0.01), "d%": ("%", 0.1),
    "cdeg": ("deg", 0.01), "cdegheading": ("deg", 0.01), "100 Pa": ("Pa", 100.0),
}  # fmt: skip


def by_library(path: Path) -> tuple[dict[str, dict[str, list]], dict[str, dict[str, str]]]:
    """The numbers and the units that pymavlink reads, by group and field."""
    from pymavlink.DFReader import DFReader_binary

    values: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    units: dict[str, dict[str, str]] = {}
    with DFReader_binary(str(path)) as log:
        while (found := log.recv_msg()) is not None:
            fmt = found.fmt
            group = fmt.name if fmt.instance_field is None else f"{fmt.name}[{getattr(found, fmt.instance_field)}]"
            units[group] = dict(zip(fmt.columns, fmt.units or [""] * len(fmt.columns)))
            for name in fmt.columns:
                values[group][name].append(getattr(found, name))
    return values, units


def check_against_library(log: Log, path: Path) -> int:
    """Compares all columns, times and units; returns how many rows there are."""
    values, units = by_library(path)
    numeric = {
        name: {field for field, column in fields.items() if not isinstance(column[0], (str, bytes)) and len(fields) > 1}
        for name, fields in values.items()
        if name not in ("FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG")
    }
    assert {group.name for group in log.groups} == set(numeric)
    for group in log.groups:
        theirs, unit_of = values[group.name], units[group.name]
        assert group.time is not None
        assert np.array_equal(group.time, np.array(theirs["TimeUS"]) * 1e-6)
        instance = {field for field in numeric[group.name] if unit_of[field] == "instance"}
        assert set(group.columns) == {f"{group.name}.{field}" for field in numeric[group.name] - instance - {"TimeUS"}}
        for name, column in group.columns.items():
            field = name.removeprefix(f"{group.name}.")
            unit, factor = SPELLINGS.get(unit_of[field], (unit_of[field], 1.0))
            assert group.units.get(name, "") == unit, name
            expected = np.array(theirs[field], dtype=float)
            if group.name == "RCOU":
                expected[expected == 0.0] = np.nan
            # a factor is applied as a product here and in the line above; no rounding may differ
            assert np.array_equal(np.asarray(column, dtype=float), expected * factor, equal_nan=True), name
    return sum(group.rows for group in log.groups)


def test_numbers_times_and_units_are_those_of_the_library(tmp_path):
    path = saved(tmp_path, HEAD + body())
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    log = FORMAT.read(path, Scope())
    assert check_against_library(log, path) == 80
    found = log.column("ATT.Yaw")
    assert found is not None
    assert found[0].units == {"ATT.Roll": "deg", "ATT.Pitch": "deg", "ATT.Yaw": "deg"}
    assert found[1][1] == 359.98
    assert log.notes == ()
    assert log.attrs == {"servo_functions": [33, 34, 0, 59]}


def test_an_output_of_zero_is_no_pulse(tmp_path):
    log = FORMAT.read(saved(tmp_path, HEAD + body(6)), Scope())
    outputs = {group.name: group for group in log.groups}["RCOU"].columns
    assert np.array_equal(outputs["RCOU.C1"], [1500, 1501, 1502, np.nan, 1504, 1505], equal_nan=True)
    assert np.isnan(outputs["RCOU.C2"]).all()


@given(st.data())
def test_every_format_character_comes_out_as_in_the_library(tmp_path_factory, data):
    codes = data.draw(st.sampled_from(["bBMhHiIqQgfd", "cCeELnNZbd"]))
    ranges = {"b": 8, "h": 16, "c": 16, "i": 32, "e": 32, "L": 32, "q": 64}

    def value(code):
        if code in "nNZ":
            return data.draw(st.binary(max_size=4))
        if code in "gfd":
            width = {"g": 16, "f": 32, "d": 64}[code]
            return data.draw(st.floats(width=width, allow_nan=False))
        if code in ranges:
            return data.draw(st.integers(-(1 << ranges[code] - 1), (1 << ranges[code] - 1) - 1))
        return data.draw(
            st.integers(0, {"B": 255, "M": 127, "H": 65535, "C": 65535, "Q": (1 << 64) - 1}.get(code, (1 << 32) - 1))
        )

    fields = "TimeUS," + ",".join(f"A{k}" for k in range(len(codes)))
    content = definition(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    content += definition(20, "ALL", "Q" + codes, fields)
    content += message(20, "Q" + codes, 7, *map(value, codes)) * 2
    path = saved(tmp_path_factory.mktemp("all"), content)
    assert check_against_library(FORMAT.read(path, Scope()), path) == 2


@pytest.mark.parametrize(
    "unit, mult, code, stated, factor",
    [
        ("v", "C", "H", "mV", 1.0),
        ("d", "B", "h", "deg", 0.01),  # no prefix of ours for centidegrees: the number becomes degrees
        ("d", "B", "c", "deg", 1.0),  # the format character has divided by 100 already
        ("P", "2", "f", "Pa", 100.0),
        ("?", "-", "f", "", 1.0),
    ],
)
def test_multipliers_of_units(tmp_path, unit, mult, code, stated, factor):
    content = (
        HEAD
        + definition(20, "X", "Q" + code, "TimeUS,A")
        + message(3, "QBNN", 900, 20, b"s" + unit.encode(), b"F" + mult.encode())
    )
    path = saved(tmp_path, content + message(20, "Q" + code, 5, 12) * 3)
    log = FORMAT.read(path, Scope())
    assert check_against_library(log, path) == 3
    group = log.groups[0]
    assert group.units.get("X.A", "") == stated
    assert group.columns["X.A"] == pytest.approx(np.full(3, 12 * factor / (100 if code == "c" else 1)), rel=1e-15)


def test_units_are_spelled_as_channels_have_them():
    for unit, factor in ardupilot.UNITS.values():
        conversion("signal", unit)
        assert factor > 0.0


@pytest.mark.parametrize(
    "status, week, epoch", [(3, 2200, 315_964_800 + 2200 * 604_800 + 5.0 - 18 - 2.0), (1, 2200, None), (3, 1100, None)]
)
def test_the_clock_is_set_by_a_fix_of_the_gps_whose_week_can_be_right(tmp_path, status, week, epoch):
    fix = message(9, "QBIH", 2_000_000, status, 5000, week)
    log = FORMAT.read(saved(tmp_path, HEAD + body(3) + fix), Scope())
    assert log.attrs.get("start_epoch_s") == epoch


def test_a_first_look_reads_a_few_rows_and_tells_of_all(tmp_path):
    path = saved(tmp_path, HEAD + body(50))
    log = FORMAT.read(path, Scope(most=4))
    for group in log.groups:
        assert group.time is not None
        assert (group.rows, group.time.size) == (50, 4)
        assert group.span == pytest.approx((group.time[0], group.time[0] + 4.9), abs=1e-9)
    whole = FORMAT.read(path, Scope())
    assert all(group.span is None for group in whole.groups)
    one = FORMAT.read(path, Scope(groups=["IMU[1]"]))
    assert [group.name for group in one.groups] == ["IMU[1]"]


def test_progress_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(ardupilot, "_STEP", 500)
    told = []
    for read, path in ((FORMAT.read, saved(tmp_path, HEAD + body(50))), (mavlink.FORMAT.read, tlog(tmp_path))):
        told.clear()
        read(path, Scope(progress=lambda fraction, words: told.append((fraction, words))))
        fractions = [fraction for fraction, _ in told]
        assert fractions == sorted(fractions)
        assert 0.0 <= fractions[0] < fractions[-1] <= 1.0
        assert {words.split()[0] for _, words in told} == {"finding", "decoding"}


def test_many_rows_are_decoded_in_pieces(tmp_path, monkeypatch):
    monkeypatch.setattr(ardupilot, "_CHUNK", 7)
    path = saved(tmp_path, HEAD + body())
    assert check_against_library(FORMAT.read(path, Scope()), path) == 80


def test_damage_in_the_middle_costs_what_it_hits(tmp_path):
    content = HEAD + body()
    cut = len(HEAD) + len(body(10)) - 100
    for damage in (b"\0" * 5000, bytes(range(256)) * 20, b"\xa3\x95\xee" * 30):
        log = FORMAT.read(saved(tmp_path, content[:cut] + damage + content[cut:]), Scope())
        rows = {group.name: group for group in log.groups}
        assert 18 <= rows["ATT"].rows <= 20
        assert np.isin(rows["ATT"].columns["ATT.Roll"], np.arange(20.0)).all()
        assert any("are no messages" in note for note in log.notes)


def test_overwritten_messages_are_left_out(tmp_path):
    content = bytearray(HEAD + body())
    start = content.index(message(6, "QccC", 1_500_000, 500, -250, 35_994))
    content[start + 11 : start + 30] = b"\x55" * 19  # the second half, and the head of the next
    log = FORMAT.read(saved(tmp_path, bytes(content)), Scope())
    found = log.column("ATT.Roll")
    assert found is not None
    assert np.array_equal(found[1], np.delete(np.arange(20.0), 5))


def test_false_beginnings_are_given_up_in_the_end(tmp_path, monkeypatch):
    path = saved(tmp_path, HEAD + body(5) + b"\xa3\x95" * 50 + body(5))
    assert FORMAT.read(path, Scope()).groups[0].rows > 5
    monkeypatch.setattr(ardupilot, "_MOST_TRIES", 20)
    log = FORMAT.read(path, Scope())
    assert log.groups[0].rows == 5
    assert "are no messages" in log.notes[0]


@pytest.mark.parametrize("lost", [1, 2, 10, 29, 30, 31, 60, 150])
def test_a_log_that_is_cut_short_gives_what_is_whole(tmp_path, lost):
    log = FORMAT.read(saved(tmp_path, (HEAD + body())[:-lost]), Scope())
    assert {group.rows for group in log.groups} <= {17, 18, 19, 20}
    assert log.notes in ((), ("The file is cut short within its last message, which is left out.",))


def test_padding_after_the_log_is_passed_over(tmp_path):
    path = saved(tmp_path, HEAD + body())
    os.truncate(path, 1 << 28)
    log = FORMAT.read(path, Scope())
    assert {group.rows for group in log.groups} == {19, 20}  # the last message may be part of the damage
    assert "are no messages" in log.notes[0]


def test_only_so_many_definitions_and_parameters_are_looked_at(tmp_path, monkeypatch):
    monkeypatch.setattr(dataflash, "_MOST_DEFINITIONS", 2)
    assert FORMAT.read(saved(tmp_path, HEAD + body()), Scope()).attrs == {"servo_functions": [33, 34]}


def test_definitions_that_change_end_the_log(tmp_path):
    other = definition(6, "ATT", "Qff", "TimeUS,Roll,Pitch") + message(6, "Qff", 5, 1.0, 2.0)
    log = FORMAT.read(saved(tmp_path, HEAD + body(5) + other), Scope())
    assert {group.rows for group in log.groups} == {5}
    assert "change their meaning" in log.notes[0]


def test_types_without_time_or_with_an_unknown_format_are_left_out(tmp_path):
    odd = definition(30, "ODD", "Qf", "TimeUS,A,B") + message(30, "Qf", 5, 1.0)
    old = definition(31, "OLD", "f", "A") + message(31, "f", 1.0)
    log = FORMAT.read(saved(tmp_path, HEAD + odd + old + body(2)), Scope())
    assert log.notes == ("Left out ODD, OLD: no time, a second definition, or a format that is not known.",)


BAD = {
    "empty": (b"", "is empty"),
    "text": (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", "no dataflash log of ArduPilot"),
    "zeros": (b"\0" * 5000, "no dataflash log of ArduPilot"),
    "part of a definition": (HEAD[:50], "no dataflash log of ArduPilot"),
    "definitions alone": (HEAD, "no messages with a time"),
    "text alone": (HEAD + message(5, "QZ", 5, b"ArduSub"), "no messages with a time"),
}


@pytest.mark.parametrize("content, words", BAD.values(), ids=BAD)
def test_what_is_no_dataflash_log_is_refused_in_a_sentence(tmp_path, content, words, capfd):
    path = saved(tmp_path, content)
    check_refused(FORMAT, path, words, capfd)


@given(st.integers(0, len(HEAD) + 300), st.binary(max_size=40))
def test_any_cut_and_any_bytes_after_it_are_read_or_refused(tmp_path_factory, cut, rest):
    path = saved(tmp_path_factory.mktemp("cut"), (HEAD + body())[:cut] + rest)
    found = outcome(FORMAT, path)
    assert str(path) in found if isinstance(found, str) else found.groups


@given(st.lists(st.tuples(st.integers(0, len(HEAD) + 300), st.integers(0, 255)), max_size=20))
def test_any_changed_bytes_are_read_or_refused(tmp_path_factory, changes):
    content = bytearray(HEAD + message(9, "QBIH", 2_000_000, 3, 5000, 2200) + body(5))
    for at, byte in changes:
        content[at] = byte
    path = saved(tmp_path_factory.mktemp("changed"), bytes(content))
    found = outcome(FORMAT, path)
    assert str(path) in found if isinstance(found, str) else found.groups


@pytest.mark.parametrize("codes, fields", [("Qnnn", "TimeUS,Status,GMS,GWk"), ("Qaff", "TimeUS,Status,GMS,GWk")])
def test_a_definition_with_text_where_numbers_belong_is_refused(tmp_path, codes, fields):
    start = HEAD.index(definition(9, "GPS", "QBIH", "TimeUS,Status,GMS,GWk"))
    head = HEAD[:start] + definition(9, "GPS", codes, fields) + HEAD[start + 89 :]
    length = struct.calcsize(layout(codes))
    path = saved(tmp_path, head + b"\xa3\x95\x09" + b"\1" * length + body(5))
    with pytest.raises(ValueError, match=r"is damaged \(.*\): copy it") as refused:
        FORMAT.read(path, Scope())
    assert str(path) in str(refused.value)


def test_each_format_is_told_from_the_other_and_from_text(tmp_path):
    dataflash, telemetry = (HEAD + body(3))[:4096], packed(frames(3))[:4096]
    for head in (b"", b"time_s,depth_m\n0,1\n", b"\0" * 4096, b"\xa3\x95", telemetry, b"\xfd" * 100):
        assert not FORMAT.recognises(tmp_path / "a.bin", head)
    for head in (b"", b"time_s,depth_m\n0,1\n", b"\0" * 4096, dataflash, b"\xfd" * 100):
        assert not mavlink.FORMAT.recognises(tmp_path / "a.tlog", head)


def test_the_measured_dataflash_log(shared_data):
    path = shared_data / "ardusub" / "small.BIN"
    with path.open("rb") as file:
        assert FORMAT.recognises(path, file.read(4096))
    log = FORMAT.read(path, Scope())
    assert check_against_library(log, path) == 6273
    assert log.notes == ()
    assert log.attrs["servo_functions"][:7] == [33, 34, 35, 36, 37, 38, 0]
    channels = check_mapping(log, "ardusub")
    assert {"roll_rad", "heading_rad", "depth_m", "depth_cmd_m", "r_radps", "t1_us", "temperature_C"} <= channels
    # body to north-east-down, w first: the heading of the quaternion is that of the angles of the same message
    w, x, y, z = (log.column(f"AHR2.Q{k}")[1] for k in (1, 2, 3, 4))
    heading = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))) % 360
    assert heading == pytest.approx(log.column("AHR2.Yaw")[1], abs=0.0101)  # cut to 0.01 degrees
