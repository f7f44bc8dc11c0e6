"""Small ROS logs for tests, written by rosbags and mcap, and their columns as rosbags itself decodes them."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000_000_000_000  # ns
CUSTOM = """
std_msgs/Header header
string name
bool on
int16[3] trim
float32[] levels
acme_msgs/Cell[] cells
float64[100] spectrum
time read
float64[9] covariance
================================================================================
MSG: acme_msgs/Cell
uint8 id
string label
float64 voltage
================================================================================
MSG: std_msgs/Header
{seq}time stamp
string frame_id
"""

Sent = tuple[str, str, int, Any]  # topic, type, ns of reception, message


@cache
def store(ros1: bool) -> Any:
    """The standard types, and one that no release of ROS knows."""
    found = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    text = CUSTOM.format(seq="uint32 seq\n" if ros1 else "")
    found.register(get_types_from_msg(text, "acme_msgs/msg/Pack"))
    return found


class Maker:
    """Messages of one generation of ROS."""

    def __init__(self, ros1: bool) -> None:
        self.ros1 = ros1
        self.store = store(ros1)
        self._seq = 0

    def make(self, kind: str, **values: Any) -> Any:
        return self.store.types[kind](**values)

    def header(self, seconds: float, frame: str = "base_link") -> Any:
        whole = int(seconds // 1)
        stamp = self.make("builtin_interfaces/msg/Time", sec=whole, nanosec=round((seconds - whole) * 1e9))
        seq = {"seq": self._seq} if self.ros1 else {}
        self._seq += 1
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **seq)

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def imu(self, seconds: float, k: int, frame: str = "base_link") -> Any:
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(seconds, frame),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=0.1 * k, y=0.2, z=0.3, w=0.9),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(0.01 * k, -0.02 * k, 0.5),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(0.0, 0.1, 9.8 + k),
            linear_acceleration_covariance=np.zeros(9),
        )

    def pulses(self, values: Sequence[int]) -> Any:
        layout = self.make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        return self.make("std_msgs/msg/UInt16MultiArray", layout=layout, data=np.array(values, dtype=np.uint16))

    def number(self, value: float) -> Any:
        return self.make("std_msgs/msg/Float32", data=value)

    def text(self, words: str) -> Any:
        return self.make("std_msgs/msg/String", data=words)

    def image(self, seconds: float) -> Any:
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(seconds),
            height=2,
            width=3,
            encoding="mono8",
            is_bigendian=0,
            step=3,
            data=np.arange(6, dtype=np.uint8),
        )

    def pack(self, seconds: float, k: int) -> Any:
        cells = [
            self.make("acme_msgs/msg/Cell", id=c, label="cell" * (c + 1), voltage=3.7 + 0.01 * k)
            for c in range(2 + k % 2)
        ]
        return self.make(
            "acme_msgs/msg/Pack",
            header=self.header(seconds, "battery_" + "x" * (k % 3)),
            name="pack" * (1 + k % 2),
            on=bool(k % 2),
            trim=np.array([k, -k, 7], dtype=np.int16),
            levels=np.arange(k % 4, dtype=np.float32),
            cells=cells,
            spectrum=np.zeros(100),
            read=self.make("builtin_interfaces/msg/Time", sec=12, nanosec=500_000_000),
            covariance=np.zeros(9),
        )


def sample(ros1: bool, n: int = 20, late: float = 0.004, offset: float = 0.0) -> list[Sent]:
    """Messages of some topics, n of each, in the order of reception; stamps are late and offset s before it."""
    make = Maker(ros1)
    sent: list[Sent] = []
    for k in range(n):
        at = START + 50_000_000 * k
        stamp = at * 1e-9 - late - offset
        sent += [
            ("/mavros/imu/data", "sensor_msgs/msg/Imu", at, make.imu(stamp, k)),
            ("/rovio/thrusters", "std_msgs/msg/UInt16MultiArray", at + 1000, make.pulses([1500 + k, 1500 - k, 1700])),
            ("rovio/water_pressure/data", "std_msgs/msg/Float32", at + 2000, make.number(1000.0 + k)),
            ("/status", "std_msgs/msg/String", at + 3000, make.text("fine" * k)),
            ("/camera/image", "sensor_msgs/msg/Image", at + 4000, make.image(stamp)),
            ("/battery", "acme_msgs/msg/Pack", at + 5000, make.pack(stamp, k)),
        ]
    return sent


def write_ros1(path: Path, sent: Sequence[Sent], compression: str = "none", chunk: int = 20_000) -> Path:
    types = store(True)
    writer = Writer1(path)
    writer.chunk_threshold = chunk
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        connections = {
            (topic, kind): writer.add_connection(topic, kind, typestore=types)
            for topic, kind in dict.fromkeys((topic, kind) for topic, kind, _, _ in sent)
        }
        for topic, kind, at, message in sent:
            writer.write(connections[topic, kind], at, types.serialize_ros1(message, kind))
    return path


def write_ros2(path: Path, sent: Sequence[Sent], mcap: bool = False, compression: str = "") -> Path:
    types = store(False)
    made = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3)
    if compression:
        made.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with made as writer:
        connections = {
            (topic, kind): writer.add_connection(topic, kind, typestore=types)
            for topic, kind in dict.fromkeys((topic, kind) for topic, kind, _, _ in sent)
        }
        for topic, kind, at, message in sent:
            writer.write(connections[topic, kind], at, types.serialize_cdr(message, kind))
    return path


def write_mcap(
    path: Path,
    sent: Sequence[Sent],
    ros1: bool = False,
    compression: CompressionType = CompressionType.ZSTD,
    finish: bool = True,
    **options: Any,
) -> Path:
    types = store(ros1)
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=4000, **options)
        writer.start(profile="ros1" if ros1 else "ros2", library="test")
        channels = {}
        for topic, kind, at, message in sent:
            if (topic, kind) not in channels:
                text, _ = types.generate_msgdef(kind, ros_version=1 if ros1 else 2)
                name = kind.replace("/msg/", "/") if ros1 else kind
                schema = writer.register_schema(name, "ros1msg" if ros1 else "ros2msg", text.encode())
                channels[topic, kind] = writer.register_channel(topic, "ros1" if ros1 else "cdr", schema)
            raw = types.serialize_ros1(message, kind) if ros1 else types.serialize_cdr(message, kind)
            writer.add_message(channels[topic, kind], at, bytes(raw), at)
        if finish:
            writer.finish()
        else:  # as a recorder that lost its power
            file.flush()
    return path


def numbers_of(value: Any, path: str) -> Iterator[tuple[str, float]]:
    """The numbers in a message of rosbags by the names that the readers give them, covariances too."""
    if isinstance(value, bool | int | float | np.number | np.bool_):
        yield path, float(value)
    elif isinstance(value, np.ndarray | list):
        for k, part in enumerate(value):
            yield from numbers_of(part, f"{path}[{k}]")
    elif is_dataclass(value):
        if type(value).__name__ == "builtin_interfaces__msg__Time":
            yield path, value.sec + 1e-9 * value.nanosec
            return
        for part in fields(value):
            if part.name not in ("header", "layout"):
                yield from numbers_of(getattr(value, part.name), f"{path}.{part.name}")


def expected(sent: Sequence[Sent], topic: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times of reception, and the columns of a topic, NaN where a message has no such number."""
    rows = [dict(numbers_of(message, topic)) for name, _, _, message in sent if name.strip("/") == topic]
    names = dict.fromkeys(name for row in rows for name in row)
    times = np.array([at for name, _, at, _ in sent if name.strip("/") == topic]) * 1e-9
    return times, {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
