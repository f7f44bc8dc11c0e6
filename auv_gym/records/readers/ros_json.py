"""ROS messages in JSON as columns of numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from auv_gym.records.log import MOST_ELEMENTS, array_columns
from auv_gym.records.readers.ros_types import Block, Topic


def from_json(topic: Topic, raws: Sequence[bytes], received: np.ndarray) -> Block:
    """The columns of messages in JSON; header.stamp, or Foxglove's timestamp, is their time."""
    n = len(raws)
    good = np.zeros(n, dtype=bool)
    stamps = np.full(n, np.nan)
    rows: list[dict[str, Any]] = []
    frame = ""
    for k, raw in enumerate(raws):
        try:
            message = json.loads(raw)
            if not isinstance(message, dict):
                message = {"data": message}
            header = message.pop("header", None)
            header = header if isinstance(header, dict) else message
            stamp = header.pop("stamp", header.pop("timestamp", None))
            frame = frame or str(header.get("frame_id", ""))
            row: dict[str, Any] = {}
            alone = [name for name in message if name != "layout"] == ["data"]
            for name, value in message.items():
                _flatten(topic.name if alone and name == "data" else f"{topic.name}.{name}", value, row)
        except (ValueError, RecursionError):
            continue
        rows.append(row)
        good[k] = True
        seconds = _json_time(stamp)
        stamps[k] = np.nan if seconds is None else seconds
    columns: dict[str, np.ndarray] = {}
    long: set[str] = set()
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row.get(name, math.nan) for row in rows]
        if not any(isinstance(value, list) for value in values):
            columns[name] = np.array(values, dtype=float)
            continue
        arrays = [value if isinstance(value, list) else [] for value in values]
        found = array_columns(name, arrays)
        columns |= found
        if not found and any(arrays):
            long.add(name)
    return Block(received[good], stamps[good], columns, {}, frame, long, (), False)


def _flatten(path: str, value: Any, row: dict[str, Any]) -> None:
    """Put the numbers in a value into a row, by their paths; texts and covariances are left out."""
    if path.endswith("covariance"):
        return
    if isinstance(value, bool | int | float):
        row[path] = float(value)
    elif isinstance(value, dict):
        seconds = _json_time(value)
        if seconds is not None:
            row[path] = seconds
            return
        for name, part in value.items():
            _flatten(f"{path}.{name}", part, row)
    elif isinstance(value, list):
        if all(isinstance(part, bool | int | float) for part in value):
            row[path] = [float(part) for part in value]
        else:
            for k, part in enumerate(value[:MOST_ELEMENTS]):
                _flatten(f"{path}[{k}]", part, row)


def _json_time(value: Any) -> float | None:
    """Seconds of a value with fields for seconds and nanoseconds; None for anything else."""
    if not isinstance(value, dict) or len(value) != 2:
        return None
    for whole, parts in (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos")):
        if all(isinstance(value.get(name), int) for name in (whole, parts)):
            return value[whole] + 1e-9 * value[parts]
    return None
