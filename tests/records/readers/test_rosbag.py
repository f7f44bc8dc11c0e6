"""ROS bags: the same numbers as rosbags decodes, which clock holds, what is left out, and bags that are damaged."""

import shutil
import sqlite3
import struct
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Reader, Writer
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from auv_gym.channels import conversion
from auv_gym.records.log import Scope
from auv_gym.records.readers import ros_bytes, ros_messages, ros_types
from auv_gym.records.readers.ros_messages import Topics
from auv_gym.records.readers.ros_types import Topic
from auv_gym.records.readers.rosbag import ROS1, ROS2
from auv_gym.records.reading import read_record
from tests.records.readers.outcomes import check_refused, groups, outcome
from tests.records.readers.ros_logs import START, Maker, expected, numbers_of, sample, write_ros1, write_ros2

ALL = Scope()
KINDS = ("none", "bz2", "lz4", "ros2")
READ = {"mavros/imu/data", "rovio/thrusters", "rovio/water_pressure/data", "battery"}


def written(tmp_path, kind, sent=None, **settings):
    """A bag of one of the kinds, and how to read it."""
    if kind == "ros2":
        return write_ros2(tmp_path / "bag", sample(False) if sent is None else sent), ROS2
    return write_ros1(tmp_path / "log.bag", sample(True) if sent is None else sent, kind, **settings), ROS1


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_are_those_of_rosbags(tmp_path, kind):
    path, form = written(tmp_path, kind)
    head = b"" if path.is_dir() else path.read_bytes()[:4096]
    assert form.recognises(path, head)
    sent = sample(kind != "ros2")
    log = form.read(path, ALL)
    assert log.format == form.name
    assert {group.name for group in log.groups} == READ
    for group in log.groups:
        received, columns = expected(sent, group.name)
        assert group.rows == len(received) == 20
        for name, column in group.columns.items():
            theirs = next(
                values
                for key, values in columns.items()
                if name in (key, key.replace(f"{group.name}.data", group.name))
            )
            assert np.array_equal(column, theirs, equal_nan=True), name


@pytest.mark.parametrize("kind", ["none", "ros2"])
def test_names_units_types_and_frames(tmp_path, kind):
    found = groups(
        ROS1.read(*(written(tmp_path, kind)[0], ALL)) if kind == "none" else ROS2.read(written(tmp_path, kind)[0], ALL)
    )
    imu = found["mavros/imu/data"]
    assert imu.type == "sensor_msgs/msg/Imu"
    assert imu.frame == "base_link"
    assert list(imu.columns) == [
        *(f"mavros/imu/data.orientation.{axis}" for axis in "xyzw"),
        *(f"mavros/imu/data.angular_velocity.{axis}" for axis in "xyz"),
        *(f"mavros/imu/data.linear_acceleration.{axis}" for axis in "xyz"),
    ]
    assert imu.units == {
        **{f"mavros/imu/data.angular_velocity.{axis}": "rad/s" for axis in "xyz"},
        **{f"mavros/imu/data.linear_acceleration.{axis}": "m/s2" for axis in "xyz"},
    }
    assert conversion("p", imu.units["mavros/imu/data.angular_velocity.x"]).channel.name == "p_radps"
    assert list(found["rovio/thrusters"].columns) == [f"rovio/thrusters[{k}]" for k in range(3)]
    assert list(found["rovio/water_pressure/data"].columns) == ["rovio/water_pressure/data"]
    battery = found["battery"]
    assert {"battery.on", "battery.trim[2]", "battery.levels[2]", "battery.cells[2].voltage"} <= battery.columns.keys()
    assert battery.units == {"battery.read": "s"}
    assert not any("covariance" in name or "spectrum" in name or "header" in name for name in battery.columns)


@pytest.mark.parametrize("unknown", [range(20), range(5, 20)], ids=["never", "from the sixth on"])
def test_what_an_imu_does_not_know_is_left_out(tmp_path, unknown):
    sent = sample(True)
    imus = [message for topic, _, _, message in sent if topic == "/mavros/imu/data"]
    for k in unknown:
        imus[k].orientation_covariance[0] = -1.0
    log = ROS1.read(write_ros1(tmp_path / "log.bag", sent), ALL)
    columns = groups(log)["mavros/imu/data"].columns
    assert any(note.startswith("mavros/imu/data.orientation is left out where its covariance") for note in log.notes)
    assert np.isfinite(columns["mavros/imu/data.angular_velocity.x"]).all()
    if len(unknown) == 20:
        assert not any("orientation" in name for name in columns)
    else:
        assert np.array_equal(np.isfinite(columns["mavros/imu/data.orientation.w"]), np.arange(20) < 5)


def test_units_are_understood_where_there_is_a_channel_for_them():
    understood = {unit for fields in ros_types.UNITS.values() for unit in fields.values()} - {"T"}
    for unit in understood:
        assert conversion("x", unit).channel.name.startswith("x_")


def test_what_is_left_out_has_a_line_each(tmp_path):
    log = ROS1.read(write_ros1(tmp_path / "log.bag", sample(True)), ALL)
    assert "status is left out: it holds no numbers (std_msgs/msg/String)." in log.notes
    assert "camera/image is left out: it holds images (sensor_msgs/msg/Image)." in log.notes
    assert "battery: arrays of more than 64 numbers are left out (battery.spectrum)." in log.notes
    assert "Covariances are left out in mavros/imu/data, battery." in log.notes


CLOCKS = {
    "stamps that agree": ({}, -0.004, "Time is the stamp of each message in"),
    "since another start": ({"offset": 1.6e9}, 0.0, "Time is the stamp of each message plus 1.6e+09 s"),
}


@pytest.mark.parametrize("settings, late, words", CLOCKS.values(), ids=CLOCKS)
def test_time_is_the_stamp_on_the_recorders_clock(tmp_path, settings, late, words):
    sent = sample(True, **settings)
    log = ROS1.read(write_ros1(tmp_path / "log.bag", sent), ALL)
    received, _ = expected(sent, "mavros/imu/data")
    # stamps near 1.7e9 s are kept to 0.24 us
    assert groups(log)["mavros/imu/data"].time == pytest.approx(received + late, abs=1e-6)
    assert any(note.startswith(words) and "mavros/imu/data" in note for note in log.notes)
    plain, _ = expected(sent, "rovio/thrusters")
    assert np.array_equal(groups(log)["rovio/thrusters"].time, plain)
    assert any("time of reception in rovio/thrusters" in note and "no stamp" in note for note in log.notes)


def imus(stamps):
    make = Maker(True)
    return [
        ("/imu", "sensor_msgs/msg/Imu", START + 10_000_000 * k, make.imu(stamp, k)) for k, stamp in enumerate(stamps)
    ]


UNUSABLE = {
    "not set": (np.where(np.arange(200) == 70, 0.0, START * 1e-9 + 0.01 * np.arange(200)), "not all stamps are set"),
    "of a slower clock": (START * 1e-9 + 0.005 * np.arange(200), "wander by 0.975 s against"),
}


@pytest.mark.parametrize("stamps, words", UNUSABLE.values(), ids=UNUSABLE)
def test_time_is_that_of_reception_where_stamps_are_of_no_use(tmp_path, stamps, words):
    log = ROS1.read(write_ros1(tmp_path / "log.bag", imus(stamps)), ALL)
    (imu,) = log.groups
    assert np.array_equal(imu.time, (START + 10_000_000 * np.arange(200)) * 1e-9)
    assert any(words in note and "imu" in note for note in log.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_a_first_look_has_rows_and_span_of_all_but_few_samples(tmp_path, kind):
    sent = sample(kind != "ros2", 400)
    path, form = written(tmp_path, kind, sent)
    for group in form.read(path, Scope(most=7)).groups:
        received, _ = expected(sent, group.name)
        assert 7 <= group.time.size <= 7 if kind != "ros2" else group.time.size >= 7
        assert group.time.size < group.rows == 400
        assert group.span == pytest.approx((received[0], received[-1]), abs=1e-6)


@pytest.mark.parametrize("kind", ["none", "ros2"])
def test_only_wanted_topics_are_decoded(tmp_path, kind, monkeypatch):
    path, form = written(tmp_path, kind)
    seen = set()
    walk = ros_bytes._Walk

    def noted(raw, topic, types):
        seen.add(topic.name)
        return walk(raw, topic, types)

    monkeypatch.setattr(ros_bytes, "_Walk", noted)
    log = form.read(path, Scope(groups=("rovio/thrusters",)))
    assert [group.name for group in log.groups] == ["rovio/thrusters"]
    assert log.groups[0].rows == 20
    assert seen == {"rovio/thrusters"}


def test_progress_is_told(tmp_path, monkeypatch):
    path = write_ros1(tmp_path / "log.bag", sample(True, 300))
    clock = iter(np.arange(0.0, 1e4, 0.3))
    monkeypatch.setattr(ros_messages.time, "monotonic", lambda: float(next(clock)))
    told = []
    ROS1.read(path, Scope(progress=lambda fraction, words: told.append((fraction, words))))
    assert len(told) > 2
    assert all(0.0 <= fraction <= 1.0 and "log.bag" in words for fraction, words in told)
    assert told == sorted(told)


def test_two_publishers_of_a_topic_make_one_group(tmp_path):
    make = Maker(True)
    types = make.store
    path = tmp_path / "log.bag"
    with Writer(path) as writer:
        both = [
            writer.add_connection("/depth", "std_msgs/msg/Float32", typestore=types, callerid=f"/node{k}")
            for k in (0, 1)
        ]
        for k in range(10):
            raw = types.serialize_ros1(make.number(float(k)), "std_msgs/msg/Float32")
            writer.write(both[k % 2], START + k, raw)
    (depth,) = ROS1.read(path, ALL).groups
    assert depth.rows == 10
    assert sorted(depth.columns["depth"]) == list(range(10))


def test_a_bag_of_ros_2_without_definitions_is_read_by_those_of_ros(tmp_path):
    path = write_ros2(tmp_path / "bag", sample(False))
    (base,) = path.glob("*.db3")
    with sqlite3.connect(base) as database:
        database.execute("DELETE FROM message_definitions")
    database.close()
    log = ROS2.read(base, ALL)
    assert {group.name for group in log.groups} == READ - {"battery"}
    assert "battery is left out: its type acme_msgs/msg/Pack is defined neither in the file nor by ROS." in log.notes
    _, columns = expected(sample(False), "mavros/imu/data")
    imu = groups(log)["mavros/imu/data"].columns
    assert all(np.array_equal(column, columns[name]) for name, column in imu.items())


@pytest.mark.parametrize("mcap", [False, True])
@pytest.mark.parametrize("compression", ["FILE", "MESSAGE"])
def test_a_compressed_bag_of_ros_2(tmp_path, mcap, compression):
    sent = sample(False)
    log = ROS2.read(write_ros2(tmp_path / "bag", sent, mcap, compression), ALL)
    assert {group.name for group in log.groups} == READ
    _, columns = expected(sent, "mavros/imu/data")
    imu = groups(log)["mavros/imu/data"].columns
    assert all(np.array_equal(column, columns[name]) for name, column in imu.items())


def test_messages_that_the_metadata_promises_and_the_database_does_not_have_are_counted(tmp_path):
    path = write_ros2(tmp_path / "bag", sample(False))
    (base,) = path.glob("*.db3")
    with sqlite3.connect(base) as database:
        database.execute("DELETE FROM messages WHERE id % 6 = 1 AND id > 60")
    database.close()
    log = ROS2.read(path, ALL)
    assert "The bag says that it holds 100 messages of these topics, and 90 were found." in log.notes
    assert groups(log)["mavros/imu/data"].rows == 10


IDL = """module test_msgs { module msg {
  struct Inner { double x; };
  struct Outer { test_msgs::msg::Inner inner; float y; sequence<int16> z; };
}; };
"""


def test_definitions_in_idl(tmp_path):
    topics = Topics(ALL)
    samples = topics.samples(Topic("/a", "test_msgs/msg/Outer", "cdr", IDL, idl=True))
    samples.add(0, b"\0\1\0\0" + struct.pack("<dfI2h", 1.5, 2.5, 2, -3, 4))
    (group,) = topics.log("x", tmp_path).groups
    assert {name: column[0] for name, column in group.columns.items()} == {
        "a.inner.x": 1.5,
        "a.y": 2.5,
        "a.z[0]": -3.0,
        "a.z[1]": 4.0,
    }


def test_a_folder_of_mcap_files_is_a_bag(tmp_path):
    path = write_ros2(tmp_path / "bag", sample(False), mcap=True)
    log = ROS2.read(path, ALL)
    assert {group.name for group in log.groups} == READ
    assert log.format == "ROS 2 bag"
    assert all(group.rows == 20 for group in log.groups)


@pytest.mark.parametrize("mcap", [False, True])
def test_the_folder_of_a_bag_of_ros_2_is_read_as_a_record(tmp_path, mcap):
    path = write_ros2(tmp_path / "bag", sample(False), mcap)
    record = read_record(path)
    assert record.time.size > 10
    assert record.time[-1] == pytest.approx(0.85, abs=1e-3)
    assert record.has("p_radps")


BASES = ["bool", "uint8", "int8", "uint16", "int32", "uint64", "float32", "float64", "string"]
FIELD = st.tuples(st.sampled_from([*BASES, "test_msgs/Inner"]), st.sampled_from(["", "[2]", "[]"]))
DTYPES = {"bool": np.bool_, "float32": np.float32, "float64": np.float64}


def values_of(kind: str, rng: np.random.Generator, types) -> object:
    if kind == "string":
        return "x" * int(rng.integers(0, 5))
    if kind == "bool":
        return bool(rng.integers(2))
    if kind.startswith("float"):
        return float(np.float32(rng.normal()))
    if kind in DTYPES or "int" in kind:
        return int(rng.integers(0, 100))
    return message_of(types, kind.replace("/", "/msg/"), rng)


def message_of(types, name: str, rng: np.random.Generator) -> object:
    """A message with random numbers in the fields of its type."""
    made = {}
    for field, (node, detail) in types.fielddefs[name][1]:
        if node == Nodetype.BASE:
            made[field] = values_of(detail[0], rng, types)
        elif node == Nodetype.NAME:
            made[field] = message_of(types, detail, rng)
        else:
            (item, what), count = detail
            count = count if node == Nodetype.ARRAY else int(rng.integers(0, 4))
            if item == Nodetype.NAME:
                made[field] = [message_of(types, what, rng) for _ in range(count)]
            else:
                parts = [values_of(what[0], rng, types) for _ in range(count)]
                dtype = DTYPES.get(what[0], getattr(np, what[0], None))
                made[field] = parts if what[0] == "string" else np.array(parts, dtype=dtype)
    return types.types[name](**made)


@given(st.lists(FIELD, min_size=1, max_size=6), st.lists(FIELD, min_size=1, max_size=4), st.integers(0, 2**32 - 1))
def test_messages_of_any_type_are_decoded_as_by_rosbags(outer, inner, seed):
    inner = [("uint8" if kind == "test_msgs/Inner" else kind, array) for kind, array in inner]
    lines = ["\n".join(f"{kind}{array} f{k}" for k, (kind, array) in enumerate(part)) for part in (outer, inner)]
    text = f"{lines[0]}\n{'=' * 80}\nMSG: test_msgs/Inner\n{lines[1]}\n"
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(text, "test_msgs/msg/Outer"))
    rng = np.random.default_rng(seed)
    messages = [message_of(types, "test_msgs/msg/Outer", rng) for _ in range(7)]
    rows = [dict(numbers_of(message, "t")) for message in messages]
    names = {name for row in rows for name in row}
    for encoding, write in (
        ("ros1", types.serialize_ros1),
        ("cdr", types.serialize_cdr),
        ("cdr", lambda message, kind: types.serialize_cdr(message, kind, little_endian=False)),
    ):
        topics = Topics(ALL)
        samples = topics.samples(Topic("t", "test_msgs/msg/Outer", encoding, text))
        for k, message in enumerate(messages):
            samples.add(k, bytes(write(message, "test_msgs/msg/Outer")))
        if not names:
            continue
        (group,) = topics.log("x", Path("x")).groups
        assert set(group.columns) == names
        for name in names:
            assert np.array_equal(group.columns[name], [row.get(name, np.nan) for row in rows], equal_nan=True)


@pytest.mark.parametrize("kind", ["none", "bz2", "lz4"])
def test_a_bag_that_is_cut_short_anywhere_gives_what_is_there_or_a_reason(tmp_path, kind):
    sent = sample(True, 60)
    content = written(tmp_path, kind, sent, chunk=5000)[0].read_bytes()
    received, columns = expected(sent, "rovio/thrusters")
    cut = tmp_path / "cut.bag"
    rows = []
    for size in np.linspace(0, len(content) - 1, 30).astype(int):
        cut.write_bytes(content[:size])
        log = outcome(ROS1, cut)
        if isinstance(log, str):
            assert "needs" in log or "is empty" in log
            assert not rows
            continue
        assert any("cut short" in note for note in log.notes)
        thrusters = groups(log)["rovio/thrusters"]
        assert np.array_equal(thrusters.time, received[: thrusters.rows])
        assert np.array_equal(
            thrusters.columns["rovio/thrusters[1]"], columns["rovio/thrusters.data[1]"][: thrusters.rows]
        )
        rows.append(thrusters.rows)
    assert rows == sorted(rows)
    assert rows[-1] == 60
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.bag", "log.bag"]


def test_an_open_bag_whose_last_chunk_has_no_length_yet_is_read(tmp_path):
    """The recorder of ROS 1 writes the length of a chunk when it closes it."""
    sent = sample(True, 60)
    content = bytearray(write_ros1(tmp_path / "log.bag", sent, chunk=10**6).read_bytes())
    (size,) = struct.unpack_from("<I", content, 13)
    at = 13 + 4 + size
    at += 4 + struct.unpack_from("<I", content, at)[0]
    (header,) = struct.unpack_from("<I", content, at)
    length = at + 4 + header
    (whole,) = struct.unpack_from("<I", content, length)
    struct.pack_into("<I", content, length, 0)
    path = tmp_path / "open.bag.active"
    path.write_bytes(content[: length + 4 + whole - 30])
    log = ROS1.read(path, ALL)
    assert {group.name for group in log.groups} == READ
    assert any("was not closed by its recorder" in note for note in log.notes)
    assert min(group.rows for group in log.groups) >= 59


def spoiled(content: bytearray) -> None:
    at = content.find(b"BZh", len(content) // 2)
    content[at : at + 40] = bytes(40)


def boasting(content: bytearray) -> None:
    """A chunk says that it has 4 GB when it is unpacked."""
    at = content.find(b"size=", len(content) // 2)
    content[at + 5 : at + 9] = b"\xff\xff\xff\xff"


@pytest.mark.parametrize("damage", [spoiled, boasting])
def test_damage_in_a_chunk_costs_the_messages_in_it(tmp_path, damage):
    path = write_ros1(tmp_path / "log.bag", sample(True, 200), "bz2", chunk=5000)
    content = bytearray(path.read_bytes())
    damage(content)
    path.write_bytes(content)
    log = ROS1.read(path, ALL)
    thrusters = groups(log)["rovio/thrusters"]
    assert 150 < thrusters.rows < 200
    assert any("messages are lost" in note for note in log.notes)


REFUSED = {
    "empty": b"",
    "another magic": b"#ROSBAG V1.2\n" + bytes(100),
    "header only": b"#ROSBAG V2.0\n",
    "zeros": b"#ROSBAG V2.0\n" + bytes(10_000_000),
    "noise": b"#ROSBAG V2.0\n" + bytes(np.random.default_rng(0).integers(0, 256, 100_000, dtype=np.uint8)),
}


@pytest.mark.parametrize("content", REFUSED.values(), ids=REFUSED)
def test_what_is_no_bag_of_ros_1_is_refused_in_a_sentence(tmp_path, content, capfd):
    path = tmp_path / "log.bag"
    path.write_bytes(content)
    check_refused(ROS1, path, r"(needs|is empty) .*(Copy|copy|convert)", capfd)


def test_a_gigabyte_of_zeros_is_refused_at_once(tmp_path):
    path = tmp_path / "log.bag"
    with write_ros1(path, sample(True)).open("r+b") as file:
        header = file.read(13 + 4096 + 8)
        file.truncate(0)
        file.seek(0)
        file.write(header)
        file.truncate(1 << 30)
    started = time.monotonic()
    with pytest.raises(ValueError, match="no messages"):
        ROS1.read(path, ALL)
    assert time.monotonic() - started < 10.0  # what a reader may take for any bad file


def test_a_bag_without_numbers_is_refused(tmp_path):
    make = Maker(True)
    path = write_ros1(tmp_path / "log.bag", [("/a", "std_msgs/msg/String", START, make.text("hello"))])
    with pytest.raises(ValueError, match=r"at least one topic with numbers.*a: it holds no numbers"):
        ROS1.read(path, ALL)


def test_topics_without_messages_are_no_groups(tmp_path):
    types, kind = Maker(False).store, "std_msgs/msg/Float32"
    for name, count in (("some", 1), ("none", 0)):
        with Writer2(tmp_path / name, version=9) as writer:
            first, _ = (writer.add_connection(topic, kind, typestore=types) for topic in ("/depth", "/speed"))
            for k in range(count):
                writer.write(first, START + k, types.serialize_cdr(Maker(False).number(2.0), kind))
    log = ROS2.read(tmp_path / "some", ALL)
    assert [group.name for group in log.groups] == ["depth"]
    assert "There are no messages in speed." in log.notes
    with pytest.raises(ValueError, match="needs at least one topic with numbers, got no messages"):
        ROS2.read(tmp_path / "none", ALL)


DATABASES = {
    "cut": lambda content: content[: len(content) // 2],
    "zeros": lambda content: content[:100] + bytes(1_000_000),
    "noise": lambda content: content[:16] + bytes(np.random.default_rng(0).integers(0, 256, 50_000, dtype=np.uint8)),
    "nothing but magic": lambda content: content[:16],
}


@pytest.mark.parametrize("damage", DATABASES.values(), ids=DATABASES)
def test_a_damaged_database_is_refused_or_read_as_far_as_it_goes(tmp_path, damage, capfd):
    path = write_ros2(tmp_path / "bag", sample(False, 300))
    (base,) = path.glob("*.db3")
    base.write_bytes(damage(base.read_bytes()))
    for given_path in (path, base):
        log = outcome(ROS2, given_path)
        if isinstance(log, str):
            assert "cannot be read as a ROS 2 bag" in log
        else:
            assert any("damaged" in note for note in log.notes)
    assert capfd.readouterr() == ("", "")
    assert {file.name for file in path.iterdir()} == {base.name, "metadata.yaml"}


METADATA = {
    "not YAML": "rosbag2_bagfile_information: [",
    "empty": "rosbag2_bagfile_information: {}",
    "a list": "- rosbag2_bagfile_information",
}


@pytest.mark.parametrize("text", METADATA.values(), ids=METADATA)
def test_a_folder_with_bad_metadata_is_refused(tmp_path, text):
    path = write_ros2(tmp_path / "bag", sample(False, 3))
    (path / "metadata.yaml").write_text(text, encoding="utf-8")
    assert ROS2.recognises(path, b"")
    with pytest.raises(ValueError, match="cannot be read as a ROS 2 bag"):
        ROS2.read(path, ALL)


def test_a_message_that_is_not_what_its_definition_says_is_left_out():
    topics = Topics(ALL)
    samples = topics.samples(Topic("/a", "std_msgs/Float64", "ros1", "float64 data"))
    for k in range(10):
        samples.add(k, struct.pack("<d", k) if k != 4 else b"odd")
    log = topics.log("x", Path("x"))
    assert list(log.groups[0].columns["a"]) == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert "a: 1 messages are not what its definition says, and are left out." in log.notes


ODD = {
    "recursive": ("test/Loop next\nfloat64 x\n" + "=" * 80 + "\nMSG: test/Loop\ntest/Loop next\n", bytes(64)),
    "huge array": ("float64[999999999999] x", bytes(64)),
    "huge count": ("test/Empty[] x\n" + "=" * 80 + "\nMSG: test/Empty\n", b"\xff\xff\xff\x7f"),
    "very many fields": (
        "test/A[64] a\n"
        + "".join(f"{'=' * 80}\nMSG: test/{one}\ntest/{two}[64] x\n" for one, two in ("AB", "BC"))
        + f"{'=' * 80}\nMSG: test/C\nuint8 x\n",
        bytes(64**3),
    ),
    "unknown inside": ("test/Nothing x", bytes(8)),
    "no definition that parses": ("float64 x; import os", bytes(8)),
    "long definition": ("float64 x\n" * 100_000, bytes(8)),
}


@pytest.mark.parametrize("definition, raw", ODD.values(), ids=ODD)
def test_odd_definitions_leave_a_topic_out(definition, raw):
    topics = Topics(ALL)
    good = topics.samples(Topic("/good", "std_msgs/Float64", "ros1", "float64 data"))
    good.add(0, bytes(8))
    odd = topics.samples(Topic("/odd", "test/Odd", "ros1", definition))
    if odd is not None:
        odd.add(0, raw)
    log = topics.log("x", Path("x"))
    assert [group.name for group in log.groups] == ["good"]
    assert any(note.startswith("odd is left out: ") for note in log.notes)


@pytest.mark.parametrize("form, name", [(ROS1, "log.bag"), (ROS2, "bag.db3")])
def test_without_rosbags_the_sentence_says_what_to_install(tmp_path, monkeypatch, form, name):
    path = tmp_path / name
    path.write_bytes(b"#ROSBAG V2.0\n")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(ValueError, match=r"ROS bags are read by the package rosbags.*pip install '\.\[ros\]'"):
        form.read(path, ALL)


def test_other_files_and_folders_are_no_bags(tmp_path):
    (tmp_path / "a").mkdir()
    assert not ROS2.recognises(tmp_path / "a", b"")
    assert not ROS2.recognises(tmp_path / "a.sqlite", b"SQLite format 3\0")
    assert not ROS1.recognises(tmp_path / "a.bag", b"PK\x03\x04")


MEASURED = {
    "stepDepth_2016-05-25-09-33-48.bag": (6, 8760, 15.104),
    "test1_t1_lock_t2_2016-04-04-14-24-09.bag": (2, 24919, 109.658),
}


@pytest.mark.parametrize("name", MEASURED)
def test_the_measured_bags_of_a_bluerov(shared_data, name):
    path = shared_data / "bluerov2016" / name
    topics, messages, seconds = MEASURED[name]
    log = ROS1.read(path, ALL)
    assert len(log.groups) == topics
    assert sum(group.rows for group in log.groups) == messages
    assert max(g.time[-1] for g in log.groups) - min(g.time[0] for g in log.groups) == pytest.approx(seconds, abs=1e-3)
    types = get_typestore(Stores.ROS1_NOETIC)
    with Reader(path) as reader:
        (connection,) = [c for c in reader.connections if c.topic.strip("/") == "sensor_fusion/states"]
        theirs = [(at, types.deserialize_ros1(raw, connection.msgtype)) for _, at, raw in reader.messages([connection])]
    states = groups(log)["sensor_fusion/states"]
    assert np.array_equal(states.time, np.array([at for at, _ in theirs]) * 1e-9)
    table = np.array([message.data for _, message in theirs])
    for k in range(10):
        assert np.array_equal(states.columns[f"sensor_fusion/states[{k}]"], table[:, k])


def test_a_measured_bag_cut_in_the_middle(shared_data, tmp_path):
    source = shared_data / "bluerov2016" / "yaw_1_2016-04-18-13-44-26.bag"
    path = tmp_path / "cut.bag"
    shutil.copyfile(source, path)
    with path.open("r+b") as file:
        file.truncate(source.stat().st_size // 2)
    log = ROS1.read(path, ALL)
    assert len(log.groups) == 5
    assert 2000 < groups(log)["sensor_fusion/states"].rows < 6115
