"""PX4 logs: the same numbers as pyulog reads, first looks, and logs that are damaged."""

import struct
import sys
import time

import numpy as np
import pytest
from pyulog import ULog

from auv_gym.records.log import Scope
from auv_gym.records.readers import ulog as reader
from auv_gym.records.readers.ulog import FORMAT
from tests.records.readers.outcomes import check_refused, groups

ALL = Scope()
HEADER = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 5_000_000)
FORMATS = (
    "vehicle_attitude:uint64_t timestamp;float[4] q;uint8_t quat_reset_counter;uint8_t[7] _padding0;",
    "esc_report:uint32_t rpm;float voltage;",
    "esc_status:uint64_t timestamp;esc_report[2] esc;char[8] name;bool armed;",
    "spectrum:uint64_t timestamp;float peak;float[100] power;",
)


def message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def definitions() -> bytes:
    name = b"char[3] sys_name"
    return (
        HEADER
        + message("B", bytes(40))
        + b"".join(message("F", text.encode()) for text in FORMATS)
        + message("I", bytes([len(name)]) + name + b"PX4")
        + message("A", struct.pack("<BH", 0, 0) + b"vehicle_attitude")
        + message("A", struct.pack("<BH", 1, 1) + b"vehicle_attitude")
        + message("A", struct.pack("<BH", 0, 2) + b"esc_status")
        + message("A", struct.pack("<BH", 0, 3) + b"spectrum")
    )


def data(k: int) -> bytes:
    at = 10_000_000 + 4000 * k
    return (
        message("D", struct.pack("<HQ4fB", 0, at, 1.0, 0.1 * k, 0.2, 0.3, k % 256))
        + message("D", struct.pack("<HQ4fB", 1, at + 100, 0.9, 0.1, -0.2 * k, 0.3, 0))
        + message("D", struct.pack("<HQIfIf8s?", 2, at + 200, 900 + k, 15.5, 910 + k, 15.4, b"esc", k % 2))
        + message("D", struct.pack("<HQf100f", 3, at + 300, 0.5 * k, *range(100)))
    )


def write(path, n=50, end=b""):
    path.write_bytes(definitions() + b"".join(data(k) for k in range(n)) + end)
    return path


def test_numbers_are_those_of_pyulog(tmp_path):
    path = write(tmp_path / "log.ulg", end=message("O", struct.pack("<H", 250)))
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    log = FORMAT.read(path, ALL)
    assert log.format == "PX4 ULog"
    assert [group.name for group in log.groups] == ["esc_status", "spectrum", "vehicle_attitude", "vehicle_attitude_1"]
    theirs = ULog(str(path))
    for group in log.groups:
        topic, _, instance = group.name.partition("_1")
        found = theirs.get_dataset(topic, int(group.name.endswith("_1")))
        assert group.type == topic
        assert group.rows == 50
        assert np.array_equal(group.time, found.data["timestamp"] * 1e-6)
        for name, column in group.columns.items():
            assert np.array_equal(column, found.data[name.removeprefix(f"{group.name}.")])
    assert log.notes == ("The autopilot could not write for 0.25 s in all, 1 times.",)
    attitude = groups(log)["vehicle_attitude"]
    assert list(attitude.columns) == [
        *(f"vehicle_attitude.q[{k}]" for k in range(4)),
        "vehicle_attitude.quat_reset_counter",
    ]
    assert attitude.columns["vehicle_attitude.q[1]"] == pytest.approx(
        0.1 * np.arange(50), rel=1e-7
    )  # stored as float32
    assert attitude.time[:2] == pytest.approx([10.0, 10.004])


def test_texts_and_long_arrays_are_left_out(tmp_path):
    found = groups(FORMAT.read(write(tmp_path / "log.ulg"), ALL))
    assert list(found["esc_status"].columns) == [
        "esc_status.esc[0].rpm",
        "esc_status.esc[0].voltage",
        "esc_status.esc[1].rpm",
        "esc_status.esc[1].voltage",
        "esc_status.armed",
    ]
    assert list(found["spectrum"].columns) == ["spectrum.peak"]


def test_a_first_look_reads_the_beginning_and_knows_rows_and_span_of_all(tmp_path, monkeypatch):
    path = write(tmp_path / "log.ulg", 2000)
    monkeypatch.setattr(reader, "_SAMPLE", 20_000)
    asked = []
    part_read = reader._Part.read
    monkeypatch.setattr(reader._Part, "read", lambda self, size: asked.append(size) or part_read(self, size))
    for group in FORMAT.read(path, Scope(most=5)).groups:
        assert group.time.size == 5
        assert group.rows == 2000
        assert group.span[0] == group.time[0]
        assert group.span[1] == pytest.approx(group.time[0] + 0.004 * 1999)
    few = len(asked)
    FORMAT.read(path, ALL)
    assert few < 0.1 * (len(asked) - few)


def test_only_wanted_topics_are_read(tmp_path):
    path = write(tmp_path / "log.ulg")
    log = FORMAT.read(path, Scope(groups=["vehicle_attitude_1"]))
    assert [group.name for group in log.groups] == ["vehicle_attitude_1"]
    assert log.groups[0].columns["vehicle_attitude_1.q[2]"] == pytest.approx(-0.2 * np.arange(50), rel=1e-7)


def test_progress_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "_TOLD", 100)
    told = []
    FORMAT.read(write(tmp_path / "log.ulg", 500), Scope(progress=lambda fraction, words: told.append(fraction)))
    assert len(told) > 10
    assert told == sorted(told)
    assert 0.0 < told[0] < 0.25 < told[-1] <= 1.0


def test_a_log_that_is_cut_short_anywhere_gives_what_is_there_or_a_reason(tmp_path, capfd):
    content = write(tmp_path / "log.ulg").read_bytes()
    cut = tmp_path / "cut.ulg"
    rows = []
    for size in np.linspace(0, len(content) - 1, 60).astype(int):
        cut.write_bytes(content[:size])
        try:
            log = FORMAT.read(cut, ALL)
        except ValueError as refused:
            rows.append(-1)
            words = str(refused)
        else:
            rows.append(log.groups[0].rows)
            assert np.array_equal(log.groups[0].columns.popitem()[1][:1], [0.0])
            words = log.notes[0] if log.notes else "cut at the end of a message"
        assert any(part in words for part in ("needs", "is empty", "cut short", "cut at"))
    assert rows == sorted(rows)
    assert rows[0] == -1
    assert rows[-1] == 50
    assert capfd.readouterr() == ("", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.ulg", "log.ulg"]


def test_a_log_is_read_up_to_garbage_in_its_middle(tmp_path, capfd):
    path = write(tmp_path / "log.ulg", 200)
    content = bytearray(path.read_bytes())
    at = content.index(data(120))
    content[at : at + 5000] = b"\xff" * 5000
    path.write_bytes(content)
    log = FORMAT.read(path, ALL)
    assert all(group.rows == 120 for group in log.groups)
    assert log.notes == (f"The log is cut short or damaged at byte {at} of {len(content)}, and read up to there.",)
    assert capfd.readouterr() == ("", "")


def test_messages_of_an_unknown_kind_are_skipped(tmp_path):
    path = tmp_path / "log.ulg"
    path.write_bytes(definitions() + data(0) + message("Z", b"new in some later version") + data(1))
    log = FORMAT.read(path, ALL)
    assert all(group.rows == 2 for group in log.groups)
    assert log.notes == ()


REFUSED = {
    "empty": b"",
    "another magic": b"ULog\x02" + bytes(100),
    "magic only": HEADER[:7],
    "header only": HEADER,
    "zeros": HEADER + bytes(10_000_000),
    "no data": definitions(),
    "noise": HEADER + bytes(np.random.default_rng(0).integers(0, 256, 100_000, dtype=np.uint8)),
    "type within itself": HEADER
    + message("B", bytes(40))
    + message("F", b"loop:uint64_t timestamp;loop next;")
    + message("A", struct.pack("<BH", 0, 0) + b"loop")
    + message("D", struct.pack("<HQ", 0, 1)),
    "unknown flags": HEADER + message("B", b"\xff" * 40) + definitions()[16 + 43 :] + data(0),
}


@pytest.mark.parametrize("content", REFUSED.values(), ids=REFUSED)
def test_what_is_no_log_of_px4_is_refused_in_a_sentence(tmp_path, content, capfd):
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    check_refused(FORMAT, path, r"(needs|is empty|is no PX4 log).*[Cc]opy it", capfd)


def test_a_gigabyte_of_zeros_is_cut_off_at_once(tmp_path):
    path = write(tmp_path / "log.ulg")
    with path.open("r+b") as file:
        file.truncate(1 << 30)
    started = time.monotonic()
    log = FORMAT.read(path, ALL)
    assert time.monotonic() - started < 10.0  # what a reader may take for any bad file
    assert all(group.rows == 50 for group in log.groups)


def test_without_pyulog_the_sentence_says_what_to_install(tmp_path, monkeypatch):
    path = write(tmp_path / "log.ulg", 2)
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(ValueError, match=r"PX4 logs are read by the package pyulog.*pip install '\.\[px4\]'"):
        FORMAT.read(path, ALL)
