"""MCAP files: the same numbers as rosbags decodes, JSON, unfinished and damaged files."""

import json
import struct
import sys
import time

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from auv_gym.records.log import Scope
from auv_gym.records.readers import mcap as reader
from auv_gym.records.readers.mcap import FORMAT
from tests.records.readers.outcomes import check_refused, groups, outcome
from tests.records.readers.ros_logs import START, expected, sample, write_mcap, write_ros2

ALL = Scope()
READ = {"mavros/imu/data", "rovio/thrusters", "rovio/water_pressure/data", "battery"}
WAYS = {
    "ros2, zstd": {},
    "ros2, lz4": {"compression": CompressionType.LZ4},
    "ros2, not compressed": {"compression": CompressionType.NONE},
    "ros2, without chunks": {"use_chunking": False},
    "ros1": {"ros1": True},
}


def same(group, columns, rows=None):
    """Whether a group holds the first rows of the columns that rosbags decodes."""
    return all(
        np.array_equal(
            column,
            columns[name.replace(group.name, f"{group.name}.data") if name not in columns else name][:rows],
            True,
        )
        for name, column in group.columns.items()
    )


def decoded(sent):
    """The columns of each topic, as rosbags decodes them."""
    return {name: expected(sent, name)[1] for name in READ}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_numbers_are_those_of_rosbags(tmp_path, way):
    sent = sample(way.get("ros1", False), 40)
    path = write_mcap(tmp_path / "log.mcap", sent, **way)
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    log = FORMAT.read(path, ALL)
    theirs = decoded(sent)
    assert {group.name for group in log.groups} == READ
    assert log.format == "MCAP"
    for group in log.groups:
        assert group.rows == group.time.size == 40
        assert same(group, theirs[group.name])
    imu = groups(log)["mavros/imu/data"]
    assert imu.type == "sensor_msgs/msg/Imu"
    assert imu.frame == "base_link"
    assert imu.units["mavros/imu/data.angular_velocity.z"] == "rad/s"
    assert imu.time == pytest.approx((START + 50_000_000 * np.arange(40)) * 1e-9 - 0.004, abs=1e-6)
    assert "camera/image is left out: it holds images (sensor_msgs/msg/Image)." in log.notes
    assert not any("cut short" in note for note in log.notes)


def test_a_file_that_ros_2_wrote(tmp_path):
    sent = sample(False)
    theirs = decoded(sent)
    (path,) = write_ros2(tmp_path / "bag", sent, mcap=True).glob("*.mcap")
    log = FORMAT.read(path, ALL)
    assert {group.name for group in log.groups} == READ
    assert all(same(group, theirs[group.name]) for group in log.groups)


JSON = [
    {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 50_000_000 * k}, "frame_id": "imu_frd"},
        "rate": [0.1 * k, 2.0],
        "on": True,
        "name": "imu",
        "at": {"sec": 3, "nsec": 500_000_000},
        "deep": {"x": k, "y": None},
        "many": list(range(100)),
        "orientation_covariance": [0.0] * 9,
    }
    for k in range(10)
]


def write_json(path, messages, topic="/imu", encoding="json"):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("acme.Imu", "jsonschema", b"{}")
        channel = writer.register_channel(topic, encoding, schema)
        for k, message in enumerate(messages):
            raw = message if isinstance(message, bytes) else json.dumps(message).encode()
            writer.add_message(channel, START + 50_000_000 * k, raw, START)
        writer.finish()
    return path


def test_messages_in_json(tmp_path):
    messages = [*JSON[:4], b"{not json", *JSON[5:]]
    log = FORMAT.read(write_json(tmp_path / "log.mcap", messages), ALL)
    (imu,) = log.groups
    assert imu.frame == "imu_frd"
    assert imu.type == "acme.Imu"
    assert list(imu.columns) == ["imu.rate[0]", "imu.rate[1]", "imu.on", "imu.at", "imu.deep.x"]
    k = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9])
    assert np.array_equal(imu.columns["imu.rate[0]"], 0.1 * k)
    assert np.array_equal(imu.columns["imu.deep.x"], k)
    assert set(imu.columns["imu.at"]) == {3.5}
    assert imu.time == pytest.approx(1_700_000_000 + 0.05 * k, abs=1e-6)  # doubles near 1.7e9 are 0.24 us apart
    assert "imu: 1 messages are not what its definition says, and are left out." in log.notes
    assert "imu: arrays of more than 64 numbers are left out (imu.many)." in log.notes


def test_a_topic_in_another_encoding_is_left_out_with_a_line(tmp_path):
    path = write_json(tmp_path / "log.mcap", JSON, encoding="protobuf")
    with pytest.raises(ValueError, match="messages are in 'protobuf', and only ros1, cdr, json are read"):
        FORMAT.read(path, ALL)


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_a_first_look_has_rows_and_span_of_all_but_few_samples(tmp_path, way):
    sent = sample(way.get("ros1", False), 400)
    log = FORMAT.read(write_mcap(tmp_path / "log.mcap", sent, **way), Scope(most=7))
    assert {group.name for group in log.groups} == READ
    for group in log.groups:
        received, columns = expected(sent, group.name)
        assert 7 == group.time.size < group.rows == 400
        if way.get("use_chunking", True):  # without chunks, there is no index to take the span from
            assert group.span == pytest.approx((received[0], received[-1]), abs=1e-6)
        assert same(group, columns, 7)


def test_a_first_look_reads_few_chunks(tmp_path, monkeypatch):
    path = write_mcap(tmp_path / "log.mcap", sample(False, 400))
    opened = []
    body = reader._File._body
    monkeypatch.setattr(reader._File, "_body", lambda self, *args: opened.append(args) or body(self, *args))
    FORMAT.read(path, Scope(most=7))
    few = len(opened)
    FORMAT.read(path, ALL)
    assert few < 0.1 * (len(opened) - few)


def test_only_wanted_topics_are_read(tmp_path):
    log = FORMAT.read(write_mcap(tmp_path / "log.mcap", sample(False)), Scope(groups=["battery"]))
    assert [group.name for group in log.groups] == ["battery"]
    assert not any("camera" in note for note in log.notes)


@pytest.mark.parametrize("chunked", [True, False])
def test_an_unfinished_file_is_read_as_far_as_it_goes(tmp_path, chunked):
    sent = sample(False, 100)
    theirs = decoded(sent)
    log = FORMAT.read(write_mcap(tmp_path / "log.mcap", sent, finish=False, use_chunking=chunked), ALL)
    assert {group.name for group in log.groups} == READ
    assert any("was not finished by its recorder" in note for note in log.notes)
    for group in log.groups:
        assert 80 < group.rows <= 100
        assert same(group, theirs[group.name], group.rows)


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_a_file_that_is_cut_short_anywhere_gives_what_is_there_or_a_reason(tmp_path, way):
    sent = sample(way.get("ros1", False), 40)
    content = write_mcap(tmp_path / "log.mcap", sent, **way).read_bytes()
    theirs = decoded(sent)
    cut = tmp_path / "cut.mcap"
    rows = []
    for size in np.linspace(0, len(content) - 1, 25).astype(int):
        cut.write_bytes(content[:size])
        log = outcome(FORMAT, cut)
        if isinstance(log, str):
            assert "needs" in log or "is empty" in log
            assert not rows
            continue
        assert any("cut short" in note for note in log.notes)
        assert all(same(group, theirs[group.name], group.rows) for group in log.groups)
        rows.append(min(group.rows for group in log.groups))
    assert rows == sorted(rows)
    assert rows[-1] == 40
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.mcap", "log.mcap"]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_garbage_in_the_middle_costs_the_messages_there(tmp_path, compression):
    sent = sample(False, 200)
    path = write_mcap(tmp_path / "log.mcap", sent, compression=compression)
    content = bytearray(path.read_bytes())
    at = len(content) // 2
    content[at : at + 3000] = bytes(np.random.default_rng(0).integers(0, 256, 3000, dtype=np.uint8))
    path.write_bytes(content)
    log = FORMAT.read(path, ALL)
    assert all(150 < group.rows < 200 for group in log.groups)
    assert any("chunks are damaged" in note for note in log.notes)


MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.pack("<BQQQI", 2, 20, 100, 0, 0) + MAGIC
REFUSED = {
    "empty": b"",
    "another magic": b"\x89PNG\r\n" + bytes(100),
    "magic only": MAGIC,
    "zeros": MAGIC + bytes(10_000_000),
    "zeros and a footer": MAGIC + bytes(10_000_000) + FOOTER,
    "noise": MAGIC + bytes(np.random.default_rng(0).integers(0, 256, 100_000, dtype=np.uint8)),
    "noise and a footer": MAGIC + bytes(np.random.default_rng(1).integers(0, 256, 100_000, dtype=np.uint8)) + FOOTER,
}


@pytest.mark.parametrize("content", REFUSED.values(), ids=REFUSED)
def test_what_is_no_mcap_file_is_refused_in_a_sentence(tmp_path, content, capfd):
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    check_refused(FORMAT, path, r"(needs|is empty) .*[Cc]opy it again", capfd)


def test_a_gigabyte_of_zeros_is_refused_at_once(tmp_path):
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        file.write(MAGIC + struct.pack("<BQII", 1, 8, 0, 0))
        file.truncate(1 << 30)
    started = time.monotonic()
    with pytest.raises(ValueError, match="no messages"):
        FORMAT.read(path, ALL)
    assert time.monotonic() - started < 10.0  # what a reader may take for any bad file


def test_a_chunk_that_claims_to_grow_without_bounds_is_not_unpacked(tmp_path):
    body = struct.pack("<QQQII", 0, 0, 1 << 40, 0, 4) + b"zstd" + struct.pack("<Q", 4) + b"\0\0\0\0"
    path = tmp_path / "log.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", 6, len(body)) + body)
    with pytest.raises(ValueError, match="no messages"):
        FORMAT.read(path, ALL)


@pytest.mark.parametrize("package", ["mcap", "rosbags"])
def test_without_the_packages_the_sentence_says_what_to_install(tmp_path, monkeypatch, package):
    path = write_mcap(tmp_path / "log.mcap", sample(False, 2))
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ValueError, match=r"MCAP files are read by .*pip install '\.\[ros\]'"):
        FORMAT.read(path, ALL)


def test_a_first_look_does_not_end_at_a_topic_that_is_left_out(tmp_path):
    sent = sorted(sample(False, 30), key=lambda one: one[0] != "/camera/image")  # all images come first
    path = write_mcap(tmp_path / "log.mcap", sent, finish=False)
    log = FORMAT.read(path, Scope(most=5))
    assert groups(log)["mavros/imu/data"].rows >= 5
