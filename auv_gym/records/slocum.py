"""Records from the binary logs of Slocum gliders, read by dbdreader (the extra `slocum`) in a process of its own."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:  # the reading process runs this file by itself, and needs neither
    from auv_gym.records.record import Record

LOGS: Final = {
    "ammonite": "ammonite-2008-028-01-000.mbd",  # Mediterranean, one dive to 608 m and back
    "amadeus": "amadeus-2014-204-05-000.dbd",  # German Bight, to 40 m
    "sebastian": "sebastian-2014-204-05-000.dbd",  # German Bight, to 40 m
}
_TIME: Final = "m_present_time"
# sensor -> channel; SI and radians as logged.  Commands are logged when they change, and stand until then.
_MEASURED: Final = {
    "m_heading": "heading_rad",
    "m_pitch": "pitch_rad",
    "m_roll": "roll_rad",
    "m_depth": "depth_m",
    "m_fin": "rudder_rad",
}
_COMMANDED: Final = {"c_heading": "heading_cmd_rad", "c_fin": "rudder_cmd_rad"}
_LONGEST = 60.0  # s; a sensor that is logged less often than this is taken as missing in between
_TIME_LIMIT = 120.0  # s; the largest log that dbdreader ships takes 0.5 s
_SPEED_WINDOW = 30.0  # s
_STEEP = np.radians(8.0)  # below this pitch, depth rate over sin(pitch) is mostly noise
_SPEED_RANGE = (0.05, 1.0)  # m/s; a Slocum without thruster glides at 0.2 to 0.5 m/s


def read_slocum(path: str | Path, cache_dir: str | Path | None = None, *, max_gap_s: float | None = None) -> Record:
    """The record of a Slocum flight log: heading, pitch, roll, depth, rudder, commanded heading and rudder, speed.

    Time base: the cycles with a heading, from 0; the attribute `start_epoch_s` has the first.  rudder_rad is m_fin, or
    c_fin where the fin is not measured.  u_mps is derived, see `glide_speed`; positions are few and are left out, as is
    a sensor that covers less than half of the cycles.  Gaps cut the record as in Record.split_gaps.
    cache_dir: where the .cac file with the sensor list lies, if it is neither beside the log nor where dbdreader looks.
    Raises ValueError without dbdreader or that file, and on a log that is damaged or cut short.
    """
    from auv_gym.records.record import Record

    path = Path(path)
    if not path.is_file():
        raise ValueError(f"There is no file {path}: give the path of a Slocum log (.dbd, .mbd, .sbd, ...).")
    sensors = _read_apart(path, cache_dir)
    if "m_heading" not in sensors or sensors["m_heading"][0].size < 3:
        raise ValueError(
            f"{path} has fewer than 3 samples of m_heading: give a flight log (.dbd, .mbd, .sbd), not one of the "
            "science computer (.ebd, .nbd, .tbd)."
        )
    epoch, values = _aligned(sensors)
    attrs: dict[str, Any] = {"source": path.name, "start_epoch_s": float(epoch[0])}
    time = epoch - epoch[0]
    if "depth_m" in values and "pitch_rad" in values:
        speed = glide_speed(time, values["depth_m"], values["pitch_rad"])
        if speed is not None:
            values["u_mps"] = speed
            attrs["derived"] = "u_mps: depth rate over sine of pitch, both averaged over 30 s"
    return Record.from_arrays(time, values, attrs=attrs).split_gaps(max_gap_s)


def bundled_slocum_log(name: str) -> Path:
    """The path of a log that dbdreader ships: ammonite, amadeus or sebastian; raises on another name."""
    if name not in LOGS:
        from auv_gym.param import did_you_mean

        raise ValueError(
            f"dbdreader ships no log {name!r}. {did_you_mean(name, LOGS)}There are slocum:{', slocum:'.join(LOGS)}."
        )
    path = _dbdreader_folder() / "data" / LOGS[name]
    if not path.is_file():
        raise ValueError(f"This dbdreader lacks {LOGS[name]}: install another version, `pip install -U dbdreader`.")
    return path


def glide_speed(time: np.ndarray, depth: np.ndarray, pitch: np.ndarray) -> np.ndarray | None:
    """Forward speed through the water, m/s, from the depth rate and the pitch of a glider; None if it never glides.

    u = -(rate of change of depth) / sin(pitch), each averaged over 30 s around a sample.  Not defined below 8 degrees
    of pitch and at inflexions, where it is interpolated in time, and clipped to 0.05 to 1 m/s.  The angle of attack
    is neglected: a glide path is some 3 degrees steeper than the pitch, so that u comes out some 10 % high, alike
    going up and down; rising or sinking water adds to it.
    """
    time, depth, pitch = (np.asarray(a, dtype=float) for a in (time, depth, pitch))
    known = np.isfinite(depth) & np.isfinite(pitch)
    if known.sum() < 3:
        return None
    t, z, angle = time[known], depth[known], pitch[known]
    before, after = (np.clip(time + half, t[0], t[-1]) for half in (-_SPEED_WINDOW / 2, _SPEED_WINDOW / 2))
    travelled = np.concatenate([[0.0], np.cumsum(np.diff(t) * 0.5 * (angle[1:] + angle[:-1]))])
    mean_pitch = (np.interp(after, t, travelled) - np.interp(before, t, travelled)) / (after - before)
    depth_rate = (np.interp(after, t, z) - np.interp(before, t, z)) / (after - before)
    steep = np.abs(mean_pitch) > _STEEP
    speed = np.full(time.size, np.nan)
    speed[steep] = -depth_rate[steep] / np.sin(mean_pitch[steep])
    good = np.flatnonzero(speed > 0.0)
    if good.size < 3:
        return None
    return np.clip(np.interp(time, time[good], speed[good]), *_SPEED_RANGE)


def _aligned(sensors: dict[str, tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times, s since 1970, and channels on one time base.

    The first cycle holds values of before the log was opened (in ammonite, 25 s before the second), and goes.  Where
    the clock was set back, the cycles until it catches up go.
    """
    times, heading = sensors["m_heading"]
    rising = np.concatenate([[False], times[1:] > np.maximum.accumulate(times)[:-1]])
    base = times[rising & np.isfinite(heading)]
    values: dict[str, np.ndarray] = {}
    for sensor, channel in (_MEASURED | _COMMANDED).items():
        if sensor not in sensors:
            continue
        t, v = sensors[sensor]
        fresh = (t >= base[0]) & np.isfinite(v)
        t, first = np.unique(t[fresh], return_index=True)
        v = v[fresh][first]
        if t.size == 0:
            continue
        previous = np.searchsorted(t, base, side="right") - 1
        following = np.minimum(np.searchsorted(t, base), t.size - 1)
        if sensor in _COMMANDED:
            values[channel] = np.where(previous >= 0, v[np.maximum(previous, 0)], np.nan)
            continue
        between = v[np.maximum(previous, 0)] if sensor == "m_fin" else np.interp(base, t, v)
        inside = (base >= t[0]) & (base <= t[-1]) & (t[following] - t[np.maximum(previous, 0)] <= _LONGEST)
        if inside.mean() >= 0.5:
            values[channel] = np.where(inside, between, np.nan)
    if "rudder_rad" not in values and "rudder_cmd_rad" in values:
        values["rudder_rad"] = values["rudder_cmd_rad"]
    return base, values


def _dbdreader_folder() -> Path:
    spec = importlib.util.find_spec("dbdreader")
    if spec is None or not spec.submodule_search_locations:
        raise ValueError(
            "Slocum logs need the package dbdreader, which is not installed: `pip install auv-gym[slocum]`."
        )
    return Path(next(iter(spec.submodule_search_locations)))


def _read_apart(path: Path, cache_dir: str | Path | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times and values of each sensor, read in another process.

    dbdreader sets the locale, makes a folder in the user's home and, in its C part, trusts the file: a fault, an
    endless loop or a write stays in that process, its home is a temporary folder.
    """
    places = [path.parent, path.parent / "cache", path.parent / "cac", _dbdreader_folder() / "data" / "cac"]
    places += [Path.home() / ".local/share/dbdreader", Path.home() / ".dbdreader"]
    if cache_dir is not None:
        if not Path(cache_dir).is_dir():
            raise ValueError(f"There is no folder {cache_dir}: give the one that holds the .cac files.")
        places.insert(0, Path(cache_dir))
    with tempfile.TemporaryDirectory(prefix="auv-gym-") as private:
        request = Path(private, "request.json")
        request.write_text(json.dumps({"log": str(path.resolve()), "caches": [str(place) for place in places]}))
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
        with np.load(Path(private, "sensors.npz"), allow_pickle=False) as arrays:
            return {name: (arrays[name][0], arrays[name][1]) for name in arrays.files}


def _main(private: Path) -> None:
    """Reads the log named in a request; leaves sensors.npz, or problem.txt with the words that follow the path."""
    request = json.loads((private / "request.json").read_text())
    try:
        sensors = _sensors(Path(request["log"]), [Path(place) for place in request["caches"]], private)
    except ValueError as error:
        (private / "problem.txt").write_text(str(error))
        return
    arrays: dict[str, Any] = {name: np.array(pair) for name, pair in sensors.items()}
    np.savez(private / "sensors.npz", **arrays)


def _sensors(log: Path, caches: list[Path], private: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    import dbdreader
    import dbdreader.decompress

    data = log.read_bytes()
    if dbdreader.decompress.is_compressed(str(log)):
        try:
            with dbdreader.decompress.Decompressor(str(log)) as packed:
                data = packed.decompress()
        except Exception as error:  # what lz4 raises has no common base in its stubs
            raise ValueError(f"cannot be decompressed ({error}): it is damaged or cut short, copy it again.") from error
    header = _header(data)
    if header.get("sensor_list_factored") == "1":
        _fetch_cache(header.get("sensor_list_crc", "").lower() + ".cac", caches, private)
    try:
        reader = dbdreader.DBD(str(log), cacheDir=str(private))
    except Exception as error:  # a damaged sensor list shows as an IndexError, a wrong one as a DbdError
        raise ValueError(f"has a damaged header or sensor list ({error!r}): copy it again.") from error
    _check_cycles(data, reader.fp_binary_start, reader.n_state_bytes, reader.byteSizes)
    names = [name for name in (*_MEASURED, *_COMMANDED) if reader.has_parameter(name)]
    if not reader.has_parameter("m_present_time") or not names:
        return {}
    return dict(zip(names, reader.get(*names) if len(names) > 1 else [reader.get(*names)], strict=True))


def _header(data: bytes) -> dict[str, str]:
    """The fields of a log's text header; raises unless it is there as a whole."""
    if not data.startswith(b"dbd_label"):
        raise ValueError("is no Slocum log: it does not begin with dbd_label. Check its ending.")
    count = data.find(b"num_ascii_tags:")
    digits = data[count + 15 : count + 40].split()
    tags = int(digits[0]) if count >= 0 and digits and digits[0].isdigit() else 0
    lines = data.split(b"\n", tags)
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
        "from the glider to one of these folders, or pass its folder as cache_dir. For the logs that dbdreader ships, "
        "it is in dbdreader/data/cac of dbdreader's source archive, which pip does not install: "
        "`pip download --no-deps --no-binary dbdreader dbdreader`."
    )


def _check_cycles(data: bytes, start: int, state_bytes: int, sizes: tuple[int, ...]) -> None:
    """Raises unless the log is a chain of whole cycles; each is its state bytes, the changed values, and a tag.

    State bytes hold 2 bits per sensor, high bits first; 2 means that a value follows.  The tag is 'd' before another
    cycle and 'X' at the end, which newer gliders leave out.
    """
    if data[start : start + 2] != b"sa" or 0x1234 not in (
        int.from_bytes(data[start + 2 : start + 4], order) for order in ("little", "big")
    ):
        raise ValueError(
            f"has no known cycle after its header (byte {start}): it is damaged or cut short, copy it again."
        )
    size = np.zeros(4 * state_bytes, dtype=np.int64)
    size[: len(sizes)] = sizes
    follows = (np.arange(256)[:, None] >> np.array([6, 4, 2, 0])) & 3 == 2
    length = (size.reshape(-1, 4) @ follows.T.astype(np.int64)).astype(np.int64)  # [state byte, its value] -> bytes
    position, cycle, bytes_of = start + 17, 0, np.arange(state_bytes)
    while True:
        state = np.frombuffer(data[position : position + state_bytes], dtype=np.uint8)
        if state.size == state_bytes:
            position += state_bytes + int(length[bytes_of, state].sum())
        if state.size < state_bytes or position > len(data):
            raise ValueError(f"is cut short in its cycle {cycle} (at byte {len(data)}): copy it again.")
        if position == len(data) or data[position : position + 1] == b"X":
            return
        if data[position : position + 1] != b"d":
            raise ValueError(f"is damaged in its cycle {cycle} (near byte {position} of {len(data)}): copy it again.")
        position, cycle = position + 1, cycle + 1


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
