"""Types of ROS messages: which hold signals, in which units, and the fields in their definitions.

Definitions are parsed by rosbags, and never run: rosbags itself would run Python code generated from them.
Sources: wiki.ros.org/msg (ROS 1), REP 103 (units and axes).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

_LONGEST_DEFINITION = 200_000  # characters; the largest standard messages have 20 000

HEADER = "std_msgs/msg/Header"
LAYOUT = "std_msgs/msg/MultiArrayLayout"
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
NO_SIGNALS = {
    "sensor_msgs/msg/Image": "images",
    "sensor_msgs/msg/CompressedImage": "images",
    "stereo_msgs/msg/DisparityImage": "images",
    "theora_image_transport/msg/Packet": "images",
    "sensor_msgs/msg/PointCloud": "point clouds",
    "sensor_msgs/msg/PointCloud2": "point clouds",
    "sensor_msgs/msg/LaserScan": "scans",
    "sensor_msgs/msg/MultiEchoLaserScan": "scans",
    "nav_msgs/msg/OccupancyGrid": "maps",
    "nav_msgs/msg/GridCells": "maps",
    "nav_msgs/msg/Path": "paths",
    "tf2_msgs/msg/TFMessage": "transforms between several frames in turn",
    "tf/msg/tfMessage": "transforms between several frames in turn",
    "visualization_msgs/msg/Marker": "drawings",
    "visualization_msgs/msg/MarkerArray": "drawings",
    "visualization_msgs/msg/InteractiveMarkerUpdate": "drawings",
    "rosgraph_msgs/msg/Log": "text",
    "rcl_interfaces/msg/Log": "text",
    "rcl_interfaces/msg/ParameterEvent": "settings",
    "dynamic_reconfigure/msg/ConfigDescription": "settings",
    "bond/msg/Status": "text",
    "foxglove.CompressedImage": "images",
    "foxglove.RawImage": "images",
    "foxglove.PointCloud": "point clouds",
    "foxglove.LaserScan": "scans",
    "foxglove.SceneUpdate": "drawings",
    "foxglove.Log": "text",
}
# The unit of a field's content, by owner and field.
_NAVIGATION = {
    "body_velocity": "m/s",
    "gbody_velocity": "m/s",
    "seafloor_velocity": "m/s",
    "position": "m",
    "altitude": "m",
    "orientation": "rad",
    "orientation_rate": "rad/s",
}
UNITS: dict[str, dict[str, str]] = {
    "geometry_msgs/msg/Point": {"x": "m", "y": "m", "z": "m"},
    "geometry_msgs/msg/Point32": {"x": "m", "y": "m", "z": "m"},
    "geometry_msgs/msg/Pose2D": {"x": "m", "y": "m", "theta": "rad"},
    "geometry_msgs/msg/Twist": {"linear": "m/s", "angular": "rad/s"},
    "geometry_msgs/msg/Accel": {"linear": "m/s2", "angular": "rad/s2"},
    "geometry_msgs/msg/Wrench": {"force": "N", "torque": "N m"},
    "geometry_msgs/msg/Transform": {"translation": "m"},
    "geometry_msgs/msg/Inertia": {"m": "kg", "com": "m"},
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s2"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/msg/Range": {"field_of_view": "rad", "min_range": "m", "max_range": "m", "range": "m"},
    "sensor_msgs/msg/BatteryState": {"voltage": "V", "current": "A", "temperature": "degC", "cell_voltage": "V"},
    "geographic_msgs/msg/GeoPoint": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "auv_msgs/msg/NavigationStatus": _NAVIGATION,
    "auv_msgs/msg/NavSts": _NAVIGATION,
    "cola2_msgs/msg/NavSts": _NAVIGATION,
}
# Their field x is unknown if the first element of x_covariance is -1, according to sensor_msgs.
MAY_BE_UNKNOWN = ("sensor_msgs/msg/Imu",)

Types = Mapping[str, Sequence[tuple[str, Any]]]  # message type -> names and descriptions of its fields, as rosbags has


@dataclass(frozen=True)
class Topic:
    """A topic as a file announces it.

    definition: of its messages, in the language of .msg or, if idl, of .idl; '' if the file has none.
    rows, span: number of messages, and times of reception of the first and the last, s; 0 and None if unknown.
    """

    name: str
    type: str
    encoding: str
    definition: str = ""
    idl: bool = False
    rows: int = 0
    span: tuple[float, float] | None = None


class Unreadable(Exception):
    """The reason why a topic is left out; it completes a sentence."""


class Block(NamedTuple):
    """Some messages of a topic as columns; messages that do not match the definition are left out."""

    received: np.ndarray
    stamps: np.ndarray
    columns: dict[str, np.ndarray]
    units: Mapping[str, str]
    frame: str
    long: Collection[str]
    unknown: Collection[str]
    covariances: bool


@lru_cache(maxsize=512)
def parsed(definition: str, kind: str, idl: bool) -> Types:
    """The fields of a type and of the types that it uses; nothing in the definition is run."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if len(definition) > _LONGEST_DEFINITION:
        raise Unreadable(f"the definition of {kind} has {len(definition)} characters")
    text = definition.replace("\r\n", "\n")
    try:
        if not idl:
            found = get_types_from_msg(text, kind)
        else:
            rule = "=" * 80 + "\n"
            parts = [part.partition("\n")[2] for part in text.split(rule)[1:]] if text.startswith(rule) else [text]
            found = {name: fields for part in parts for name, fields in get_types_from_idl(part).items()}
    except Exception as error:
        raise Unreadable(f"the definition of its type {kind} cannot be parsed") from error
    return {name: fields for name, (_, fields) in found.items()}


def shipped(ros1: bool) -> Iterator[Types]:
    """The types that releases of ROS define, the newest first."""
    from rosbags.typesys import Stores

    prefix = "ROS1_" if ros1 else "ROS2_"
    return (_store(store) for store in reversed(Stores) if store.name.startswith(prefix))


@cache
def _store(store: Any) -> Types:
    from rosbags.typesys import get_typestore

    return {name: fields for name, (_, fields) in get_typestore(store).fielddefs.items()}


def full_type(kind: str) -> str:
    """The full name sensor_msgs/msg/Imu, also for ROS 1's sensor_msgs/Imu."""
    package, slash, name = kind.partition("/")
    return f"{package}/msg/{name}" if slash and "/" not in name else kind
