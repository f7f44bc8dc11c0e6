"""Binary logs of Slocum gliders (.dbd, .mbd, .sbd; science computer: .ebd, .nbd, .tbd; .?cd if compressed).

A log has cycles of a few seconds; in each, the sensors that were updated have a value.  dbdreader (the extra `slocum`)
reads it in a separate process, which runs this file.  Angles are in rad; pitch is positive nose up, roll with the port
wing up, the fin turns to starboard; m_heading and c_heading are magnetic.
Sources: Slocum Glider Operators Manual, Teledyne Webb Research, "Dinkum Binary Data Format"; masterdata (signs, units).
"""

from __future__ import annotations

import importlib.util
import json
import mmap
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from auv_gym.param import did_you_mean
from auv_gym.records.log import Format, Group, Log, Scope, missing_extra

LOGS: Final = {
    "ammonite": "ammonite-2008-028-01-000.mbd",  # Mediterranean, one dive to 608 m and back
    "amadeus": "amadeus-2014-204-05-000.dbd",  # German Bight, to 40 m
    "sebastian": "sebastian-2014-204-05-000.dbd",  # German Bight, to 40 m
}
CLOCKS: Final = ("m_present_time", "sci_m_present_time")  # s since 1970, of the flight and the science computer
_NEAR: Final = 60.0  # s; a sensor that is logged less often counts as missing in between
_TIME_LIMIT: Final = 120.0  # s; the largest log that dbdreader ships takes 0.5 s
_LARGEST: Final = 1 << 30  # bytes of a decompressed log
_STATES: Final = (np.arange(256)[:, None] >> np.array([6, 4, 2, 0])) & 3  # of four sensors, by their state byte
_FOLLOWS: Final = (_STATES == 2).astype(np.int64)
_UPDATED: Final = ((_STATES == 1) | (_STATES == 2)).astype(np.int64)
_FIRST_LOOK: Final = 4  # times the requested samples, since not every sensor is updated in every cycle
_LEFT_OUT: Final = 2  # cycles: dbdreader omits the first, and `current_cycles` the next
_ENDINGS: Final = tuple(f".{computer}{packing}" for packing in ("bd", "cd") for computer in "demnst")
# Sensor lists spell units freely.  Positions (lat, lon) are degrees and minutes in one number, ddmm.mmm; nodim, enum,
# bool and the like are not units.
_UNITS: Final = {
    "%": "pct", "abstime": "s", "amp": "A", "bar": "bar", "c": "degC", "cc": "cm3", "celsius": "degC", "days": None,
    "deg": "deg", "degc": "degC", "hours": "h", "hz": "Hz", "joules": "J", "km": "km", "m": "m", "m/s": "m/s",
    "min": "min", "mins": "min", "mm/s": "mm/s", "ms": "ms", "msec": "ms", "msecs": "ms", "mv": "mV", "rad": "rad",
    "rad/s": "rad/s", "rad/sec": "rad/s", "rpm": "rpm", "s": "s", "sec": "s", "secs": "s", "timestamp": "s",
    "volts": "V", "watt": "W",
}  # fmt: skip


def bundled_slocum_log(name: str) -> Path:
    """The path of a log that dbdreader ships: ammonite, amadeus or sebastian; raises ValueError for other names."""
    if name not in LOGS:
        raise ValueError(
            f"dbdreader ships no log {name!r}. {did_you_mean(name, LOGS)}There are slocum:{', slocum:'.join(LOGS)}."
        )
    path = _dbdreader_folder() / "data" / LOGS[name]
    if not path.is_file():
        raise ValueError(f"This dbdreader does not ship {LOGS[name]}: install a newer one, `pip install -U dbdreader`.")
    return path


def unit_of_sensor(unit: str) -> str | None:
    """The unit of a sensor in the spelling of `auv_gym.channels`; None if it is not a unit known there."""
    return _UNITS.get(unit.strip().lower())


def current_cycles(time: np.ndarray) -> np.ndarray:
    """The cycles that count: not the first, whose values are from before the log was opened (by up to minutes).

    If the clock was set back, the cycles until it catches up do not count either.
    """
    if time.size == 0:
        return np.zeros(0, dtype=bool)
    latest = np.fmax.accumulate(time)
    return np.concatenate([[False], time[1:] > latest[:-1]])


def _recognises(path: Path, head: bytes) -> bool:
    # a compressed log's first block begins with its length and an LZ4 token
    plain = head.startswith(b"dbd_label")
    packed = path.suffix.lower() in _ENDINGS and path.suffix[2:].lower() == "cd" and b"dbd_label" in head[:16]
    return (plain or packed) and b"DBD_ASC" not in head[:64]


def _read(path: Path, scope: Scope) -> Log:
    """The log of a flight or science computer: one group for each sensor with values, named after it."""
    scope.progress(0.0, f"reading {path.name}")
    answer, numbers = _read_apart(path, scope)
    groups, begin = [], 0
    for name, read, rows, unit in answer["sensors"]:
        time, values = numbers[:, begin : begin + read]
        begin += read
        units = {name: unit} if unit else {}
        span = None
        if scope.most is not None and rows > scope.most and read:
            span = (float(time[0]), float(time[-1]) if read == rows else answer["end"])
        groups.append(
            Group(name, {name: values[: scope.most]}, time[: scope.most], units, rows=rows, span=span, near=_NEAR)
        )
    return Log("Slocum log", path.name, tuple(groups), answer["attrs"], tuple(answer["notes"]), answer["label"])


def _dbdreader_folder() -> Path:
    spec = importlib.util.find_spec("dbdreader")
    if spec is None or not spec.submodule_search_locations:
        raise missing_extra("Slocum logs", "dbdreader", "slocum")
    return Path(next(iter(spec.submodule_search_locations)))


def _read_apart(path: Path, scope: Scope) -> tuple[dict[str, Any], np.ndarray]:
    """Names, row counts and units of the sensors, and their times and values side by side, read in another process.

    dbdreader sets the locale, makes a folder in the user's home and, in its C part, trusts the file.  In the separate
    process, a crash, an endless loop or a write does no harm; its home is a temporary folder.
    """
    places = [path.parent, path.parent / "cache", path.parent / "cac", _dbdreader_folder() / "data" / "cac"]
    places += [Path.home() / ".local/share/dbdreader", Path.home() / ".dbdreader"]
    if scope.beside is not None:
        if not scope.beside.is_dir():
            raise ValueError(f"There is no folder {scope.beside}: give the one that holds the .cac files.")
        places.insert(0, scope.beside)
    with tempfile.TemporaryDirectory(prefix="auv-gym-") as private:
        wanted = None if scope.groups is None else sorted(scope.groups)
        asked = {
            "log": str(path.resolve()),
            "caches": [str(place) for place in places],
            "sensors": wanted,
            "most": scope.most,
        }
        Path(private, "request.json").write_text(json.dumps(asked))
        environment = os.environ | {
            "HOME": private,
            "USERPROFILE": private,
            "PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry),
        }
        command = [sys.executable, "-P", __file__, private]
        try:
            run = subprocess.run(command, env=environment, capture_output=True, timeout=_TIME_LIMIT, check=False)
        except subprocess.TimeoutExpired as error:
            raise ValueError(
                f"{path} could not be read within {_TIME_LIMIT:g} s; it may be damaged: copy it again."
            ) from error
        problem = Path(private, "problem.txt")
        if problem.is_file():
            raise ValueError(f"{path} {problem.read_text()}")
        if run.returncode != 0:
            last = run.stderr.decode(errors="replace").strip().rpartition("\n")[2]
            raise ValueError(
                f"{path} could not be read by dbdreader (exit status {run.returncode}; {last or 'no message'}): the "
                "log may be damaged, copy it again."
            )
        answer = json.loads(Path(private, "answer.json").read_text())
        return answer, np.load(Path(private, "numbers.npy"), allow_pickle=False)


def _main(private: Path) -> None:
    """Read the log named in a request; leaves an answer with its numbers, or an error text to follow the path."""
    request = json.loads((private / "request.json").read_text())
    try:
        caches = [Path(place) for place in request["caches"]]
        answer, numbers = _answer(Path(request["log"]), caches, request["sensors"], request["most"], private)
    except ValueError as error:
        (private / "problem.txt").write_text(str(error))
        return
    np.save(private / "numbers.npy", numbers)
    (private / "answer.json").write_text(json.dumps(answer))


def _answer(
    log: Path, caches: list[Path], wanted: list[str] | None, most: int | None, private: Path
) -> tuple[dict[str, Any], np.ndarray]:
    """The result of `_read_apart`; if only the first samples of a long log are needed, its first cycles are read."""
    import dbdreader

    notes: list[str] = []
    with log.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        plain = b"dbd_label" not in mapped[1:16] and log.suffix.lower()[2:] != "cd"
        data = mapped if plain else _decompressed(mapped, notes)
        header = _header(data)
        if header.get("sensor_list_factored") == "1":
            _fetch_cache(header.get("sensor_list_crc", "").lower() + ".cac", caches, private)
        if not plain:
            log = private / "log.dbd"
            log.write_bytes(data)
        try:
            reader = dbdreader.DBD(str(log), cacheDir=str(private))
        except Exception as error:  # a damaged sensor list raises IndexError, a wrong one DbdError
            raise ValueError(f"has a damaged header or sensor list ({error!r}): copy it again.") from error
        start = reader.fp_binary_start
        clock = reader.timeVariable
        if clock not in reader.parameterNames:
            raise ValueError(f"has no sensor {clock}, which holds the time: log it too.")
        begins, end = _whole_cycles(data, start, reader.n_state_bytes, reader.byteSizes)
        if end < len(data) and data[end : end + 1] != b"X" and not notes:
            notes.append(f"The log is cut short: its {begins.size} whole cycles are read.")
        last, updates = 0.0, None
        if most is not None and begins.size > _FIRST_LOOK * (most + 2):
            last = float(reader.get(clock)[0][-1])
            updates = _updates(data, begins[_LEFT_OUT:], reader.n_state_bytes)
            end = int(begins[_FIRST_LOOK * (most + 2)]) - 1
        if end < len(data):
            whole = private / "whole.dbd"
            whole.write_bytes(data[:end])
            reader = dbdreader.DBD(str(whole), cacheDir=str(private))
    names = [name for name in reader.parameterNames if name not in CLOCKS]
    if wanted is not None:
        names = [name for name in names if name in set(wanted)]
    time = reader.get(clock)[0]
    counts = current_cycles(time)
    late = int(np.count_nonzero(~counts[1:]))
    if late:
        notes.append(f"The clock was set back; {late} cycles until it caught up are left out.")
    gone = np.setdiff1d(time[~counts], time[counts])
    # as logged: dbdreader would convert positions to degrees
    found = reader.get(*names, decimalLatLon=False, discardBadLatLon=False) if names else []
    found = [found] if len(names) == 1 else found
    sensors, parts = [], []
    for name, (t, values) in zip(names, found, strict=True):
        fresh = np.flatnonzero(np.isfinite(values) & ~np.isin(t, gone))
        fresh = fresh[np.concatenate([[True], np.diff(np.fmax.accumulate(t[fresh])) > 0.0])] if fresh.size else fresh
        rows = fresh.size if updates is None else max(fresh.size, updates[reader.parameterNames.index(name)])
        if rows:
            sensors.append((name, fresh.size, int(rows), unit_of_sensor(reader.parameterUnits[name])))
            parts.append(np.stack([t[fresh], values[fresh]]).astype(np.float64))
    if wanted is None and not sensors:
        raise ValueError(f"has no values after its first cycle, of {begins.size}: choose a longer log.")
    attrs = _attrs(reader, header)
    label = header.get("full_filename", "")
    answer = {"sensors": sensors, "attrs": attrs, "notes": notes, "label": label, "end": last}
    return answer, np.concatenate(parts, axis=1) if parts else np.zeros((2, 0))


def _attrs(reader: Any, header: dict[str, str]) -> dict[str, Any]:
    """The mission, the latitude, and the magnetic variation, deg, positive east (m_gps_mag_var is positive west)."""
    attrs: dict[str, Any] = {"mission": header["mission_name"]} if header.get("mission_name") else {}
    for name in ("m_lat", "m_gps_lat"):
        if reader.has_parameter(name):
            degrees = reader.get(name)[1]
            degrees = degrees[np.abs(degrees) <= 90.0]
            if degrees.size:
                attrs["latitude_deg"] = float(np.median(degrees))
    if reader.has_parameter("m_gps_mag_var"):
        variation = reader.get("m_gps_mag_var")[1]
        variation = variation[np.isfinite(variation)]
        if variation.size:
            attrs["magnetic_variation_deg"] = -float(np.degrees(variation[-1]))
    return attrs


def _decompressed(packed: mmap.mmap, notes: list[str]) -> bytes:
    """The log from LZ4 blocks, each preceded by its length in two bytes."""
    import lz4.block

    blocks, position, total = [], 0, 0
    while position < len(packed):
        length = int.from_bytes(packed[position : position + 2], "big")
        block = packed[position + 2 : position + 2 + length]
        if len(block) < length or position + 2 > len(packed):
            if not blocks:
                raise ValueError(
                    "cannot be decompressed: it is damaged or cut short in its first block, copy it again."
                )
            notes.append("The log is cut short: its whole blocks are read.")
            break
        try:
            blocks.append(lz4.block.decompress(block, 32 * 1024))
        except Exception as error:  # the exceptions of lz4 have no common base in its stubs
            raise ValueError(f"cannot be decompressed ({error}): it is damaged, copy it again.") from error
        position += 2 + length
        total += len(blocks[-1])
        if not length or total > _LARGEST:
            raise ValueError(f"cannot be decompressed (near byte {position}): it is damaged, copy it again.")
    return b"".join(blocks)


def _header(data: bytes | mmap.mmap) -> dict[str, str]:
    """The fields of a log's text header; raises unless it is complete."""
    start = data[: 1 << 16]
    if not start.startswith(b"dbd_label"):
        raise ValueError("is no Slocum log: it does not begin with dbd_label. Check its ending.")
    found = re.search(rb"num_ascii_tags:\s*(\d{1,4})\s", start)
    tags = int(found[1]) if found else 0
    lines = start.split(b"\n", tags)
    if tags == 0 or len(lines) <= tags:
        raise ValueError(f"is cut short within its header ({len(data)} bytes): copy it again.")
    fields = (line.decode("ascii", "replace").partition(":") for line in lines[:tags])
    return {name.strip(): value.strip() for name, _, value in fields}


def _fetch_cache(name: str, places: list[Path], private: Path) -> None:
    for place in places:
        for candidate in (name, name.upper(), name.replace(".cac", ".CAC")):
            if (place / candidate).is_file():
                shutil.copyfile(place / candidate, private / name)
                return
    raise ValueError(
        f"needs the sensor list {name}, which is not in {', '.join(map(str, dict.fromkeys(places)))}. Copy that file "
        "from the glider to one of these folders, or name its folder. For the logs that dbdreader ships, "
        "`make slocum-cache` in a clone of auv-gym adds it to the clone's .venv. It is in dbdreader/data/cac of "
        "dbdreader's source archive, which pip does not install: "
        "`pip download --no-deps --no-binary dbdreader dbdreader`."
    )


def _whole_cycles(
    data: bytes | mmap.mmap, start: int, state_bytes: int, sizes: tuple[int, ...]
) -> tuple[np.ndarray, int]:
    """The starts of complete cycles, and the end of the last; raises on damage, or if fewer than two are complete.

    A cycle consists of its state bytes, the changed values, and a tag.  State bytes hold 2 bits per sensor, high bits
    first; 1 means the same value as before, 2 that a value follows.  The tag is 'd' before another cycle and 'X' at the
    end; newer gliders omit the latter.
    """
    if data[start : start + 2] != b"sa" or 0x1234 not in (
        int.from_bytes(data[start + 2 : start + 4], order) for order in ("little", "big")
    ):
        raise ValueError(
            f"has no known cycle after its header (byte {start}): it is damaged or cut short, copy it again."
        )
    size = np.zeros(4 * state_bytes, dtype=np.int64)
    size[: len(sizes)] = sizes
    length = (size.reshape(-1, 4) @ _FOLLOWS.T).astype(np.int64)  # [state byte, its value] -> bytes
    position, bytes_of = start + 17, np.arange(state_bytes)
    begins, end = [], position - 1
    while True:
        begin = position
        state = np.frombuffer(data[begin : begin + state_bytes], dtype=np.uint8)
        if state.size == state_bytes:
            position += state_bytes + int(length[bytes_of, state].sum())
        if state.size < state_bytes or position > len(data):
            if len(begins) < 2:
                raise ValueError(f"is cut short in its cycle {len(begins)} (at byte {len(data)}): copy it again.")
            break
        tag = data[position : position + 1]
        if tag not in (b"d", b"X", b""):
            raise ValueError(
                f"is damaged in its cycle {len(begins)} (near byte {position} of {len(data)}): copy it again."
            )
        begins.append(begin)
        end = position
        if tag != b"d":
            break
        position += 1
    return np.array(begins), end


def _updates(data: bytes | mmap.mmap, begins: np.ndarray, state_bytes: int) -> np.ndarray:
    """The number of updates of each sensor in the cycles that begin there."""
    content = np.frombuffer(data, dtype=np.uint8)
    bytes_of = np.arange(state_bytes)
    seen = np.zeros((state_bytes, 256), dtype=np.int64)
    for some in np.array_split(begins, max(1, begins.size // 10_000)):
        states = content[some[:, None] + bytes_of]
        seen += np.bincount((states + 256 * bytes_of).ravel(), minlength=seen.size).reshape(seen.shape)
    return np.ravel(seen @ _UPDATED)


FORMAT: Final = Format("Slocum log", _ENDINGS, _recognises, _read)

if __name__ == "__main__":
    _main(Path(sys.argv[1]))
