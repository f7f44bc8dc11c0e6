"""Small logs of ArduPilot vehicles for tests, dataflash and telemetry, and what the mappings find in a log."""

import io
import struct
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np

from auv_gym.channels import conversion
from auv_gym.records.log import Log

MAPPINGS = files("auv_gym.records") / "mappings"
LAYOUTS = {
    "a": "64s", "n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "b", "g": "e"
}  # fmt: skip
UNITS = {"s": "s", "d": "deg", "h": "degheading", "E": "rad/s", "#": "instance", "?": "UNKNOWN", "-": "", "v": "V",
         "P": "Pa", "Y": "us"}  # fmt: skip
MULTS = {"-": 0, "0": 1, "F": 1e-6, "B": 1e-2, "C": 1e-3, "2": 100}


def layout(codes: str) -> str:
    return "<" + "".join(LAYOUTS.get(code, code) for code in codes)


def message(byte: int, codes: str, *values) -> bytes:
    return b"\xa3\x95" + bytes([byte]) + struct.pack(layout(codes), *values)


def definition(byte: int, name: str, codes: str, fields: str) -> bytes:
    length = 3 + struct.calcsize(layout(codes))
    return message(0x80, "BBnNZ", byte, length, name.encode(), codes.encode(), fields.encode())


HEAD = (
    definition(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    + definition(1, "UNIT", "QbZ", "TimeUS,Id,Label")
    + definition(2, "MULT", "Qbd", "TimeUS,Id,Mult")
    + definition(3, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    + definition(4, "PARM", "QNf", "TimeUS,Name,Value")
    + definition(5, "MSG", "QZ", "TimeUS,Message")
    + definition(6, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw")
    + definition(7, "IMU", "QBf", "TimeUS,I,GyrX")
    + definition(8, "RCOU", "QHH", "TimeUS,C1,C2")
    + definition(9, "GPS", "QBIH", "TimeUS,Status,GMS,GWk")
    + b"".join(message(1, "QbZ", 900, ord(unit), label.encode()) for unit, label in UNITS.items())
    # singles made doubles, as some versions log them
    + b"".join(message(2, "Qbd", 900, ord(mult), np.float32(factor)) for mult, factor in MULTS.items())
    + message(3, "QBNN", 900, 6, b"sddh", b"FBBB")
    + message(3, "QBNN", 900, 7, b"s#E", b"F--")
    + message(3, "QBNN", 900, 8, b"sYY", b"F--")
)  # fmt: skip


def body(rows: int = 20) -> bytes:
    out = [message(5, "QZ", 5, b"ArduSub V4.1.0")]
    out += [message(4, "QNf", 5, f"SERVO{n}_FUNCTION".encode(), f) for n, f in ((1, 33), (2, 34), (4, 59))]
    for k in range(rows):
        t = 1_000_000 + 100_000 * k
        out += [
            message(6, "QccC", t, 100 * k, -50 * k, 35_999 - k),
            *(message(7, "QBf", t + 10 + i, i, 0.1 * k + i) for i in range(2)),
            message(8, "QHH", t + 20, 0 if k == 3 else 1500 + k, 0),
        ]
    return b"".join(out)


def saved(tmp_path: Path, content: bytes, name: str = "00000012.BIN") -> Path:
    path = tmp_path / name
    path.write_bytes(content)
    return path


def sender(system: int, component: int):
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega.MAVLink(io.BytesIO(), srcSystem=system, srcComponent=component)


def frames(rows: int = 30) -> list[tuple[object, object, bool]]:
    """Messages, who sends each, and whether in version 1 of the protocol."""
    from pymavlink.dialects.v20 import ardupilotmega as mav

    vehicle, camera, station = sender(1, 1), sender(1, 100), sender(255, 190)
    out: list = [
        (mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), station, False),
        (mav.MAVLink_heartbeat_message(12, 3, 81, 19, 4, 3), vehicle, False),
        (mav.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3), camera, False),
        (mav.MAVLink_statustext_message(6, b"ArduSub V4.5"), vehicle, False),
        (mav.MAVLink_param_value_message(b"SERVO2_FUNCTION", 34.0, 9, 1000, 5), vehicle, False),
    ]
    for k in range(rows):
        out += [
            (mav.MAVLink_attitude_message(1000 + 50 * k, 0.1 * k, -0.2, 3.0, 0.0, 0.0, 0.0), vehicle, k % 3 == 0),
            (mav.MAVLink_servo_output_raw_message(k, 0, *[1500 + k] * 4, *[0] * 4, *[1100] * 8), vehicle, False),
            (mav.MAVLink_scaled_pressure2_message(k, 1013.25 + k, 0.0, 1250 - k), vehicle, k % 2 == 0),
            (mav.MAVLink_named_value_float_message(k, b"PilotGain" if k % 2 else b"Lights1", 0.5 * k), vehicle, False),
            (mav.MAVLink_battery_status_message(k % 2, 0, 0, 2000, [4100] * 10, 500, 10, 20, 80), vehicle, False),
        ]
    return out


def packed(content, signed: bool = False, start_s: float = 1_700_000_000.0) -> bytes:
    out = []
    for k, (found, mav, first_version) in enumerate(content):
        mav.signing.sign_outgoing, mav.signing.secret_key = signed and not first_version, b"k" * 32
        stamp = round(1e6 * start_s) + 10_000 * k
        out.append(struct.pack(">Q", stamp) + found.pack(mav, force_mavlink1=first_version))
    return b"".join(out)


def tlog(tmp_path: Path, content: bytes | None = None) -> Path:
    return saved(tmp_path, packed(frames()) if content is None else content, "dive.tlog")


def targets(name: str) -> dict[str, str]:
    return tomllib.loads((MAPPINGS / f"{name}.toml").read_text(encoding="utf-8"))["names"]


def check_mapping(log: Log, name: str) -> set[str]:
    """The channels that a mapping finds in a log, with units that fit."""
    found = set()
    for theirs, ours in targets(name).items():
        ours = ours.removeprefix("-")
        column = log.column(theirs)
        if ours.startswith("quaternion_"):
            assert ours[-1] in "wxyz"
        elif column is None:
            conversion(ours)
        else:
            found.add(conversion(ours, column[0].units.get(theirs)).channel.name)
    return found
