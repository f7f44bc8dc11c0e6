"""Files of SeaExplorer gliders: times, positions, what stands for no value, compressed files, and damage."""

import gzip
import os
import tomllib
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import auv_gym.records.readers.seaexplorer as seaexplorer
from auv_gym.channels import conversion
from auv_gym.records.log import Log, Scope
from auv_gym.records.readers.seaexplorer import FORMAT
from tests.records.readers.outcomes import check_refused, outcome

HEADER = (
    "Timestamp;NavState;SecurityLevel;Heading;Declination;Pitch;Roll;Depth;Temperature;Pa;Lat;Lon;DesiredH;BallastCmd;"
    "BallastPos;LinCmd;LinPos;AngCmd;AngPos;Voltage;Altitude;\n"
)
ROWS = """\
14/06/2019 03:50:41;117;2048;226.34;17;64.09;1.27;7.6;11.50;69198;5138.149;-12820.536;207;400;5.9;20;9.8;0;0.5;29;-1.0;
14/06/2019 03:50:51;115;2048;223.95;17;67.67;4.28;2.3;;69216;0.000;0.000;-9999;500;419.8;100;61.7;0;0.9;29.2;12.5;
14/06/2019 03:51:11.250;115;2048;233.47;17;-5.16;-2.93;1.1;11.6;69037;-30.0;30.0;207;500;5.0;100;10.3;0;0.9;29.3;-1.0;
"""
PAYLOAD = """\
PLD_REALTIMECLOCK;NAV_RESOURCE;NAV_LONGITUDE;NAV_LATITUDE;NAV_DEPTH;GPCTD_TEMPERATURE;GPCTD_PRESSURE;
18/07/2019 20:15:42.123;116;-12820.536;5138.149;0.5;15.25;9999.00;
18/07/2019 20:15:43.123;116;-12820.536;5138.149;0.6;9999.00;1.25;
"""


def saved(tmp_path: Path, text: str | bytes, name: str = "SEA035.10.gli.sub.036") -> Path:
    path = tmp_path / name
    content = text.encode() if isinstance(text, str) else text
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    return path


def column(log: Log, name: str) -> np.ndarray:
    found = log.column(name)
    assert found is not None
    return np.asarray(found[1])


@pytest.mark.parametrize("name", ["SEA035.10.gli.sub.036", "sea035.10.gli.raw.036.gz", "sea035.10.gli.gz"])
def test_a_file_comes_as_a_table_with_units(tmp_path, name):
    path = saved(tmp_path, HEADER + ROWS, name)
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    log = FORMAT.read(path, Scope())
    assert log.label == ("036" if "036" in name else "")
    (group,) = log.groups
    assert (group.name, group.rows, log.notes) == ("", 3, ())
    first = datetime(2019, 6, 14, 3, 50, 41, tzinfo=UTC).timestamp()
    assert np.array_equal(group.time, first + np.array([0.0, 10.0, 30.25]))
    assert np.array_equal(column(log, "Heading"), [226.34, 223.95, 233.47])
    assert np.array_equal(column(log, "Altitude"), [np.nan, 12.5, np.nan], equal_nan=True)
    assert np.array_equal(column(log, "DesiredH"), [207, np.nan, 207], equal_nan=True)
    assert np.array_equal(column(log, "Temperature"), [11.5, np.nan, 11.6], equal_nan=True)
    # degrees and minutes; 0, 0 is no fix.  Twelve digits are left of the minutes after the degrees are taken off.
    assert column(log, "Lat") == pytest.approx([51 + 38.149 / 60, np.nan, -0.5], rel=1e-12, nan_ok=True)
    assert column(log, "Lon") == pytest.approx([-(128 + 20.536 / 60), np.nan, 0.5], rel=1e-12, nan_ok=True)
    assert set(group.units) == set(group.columns) - {"NavState", "SecurityLevel"}
    for theirs, unit in group.units.items():
        conversion(f"signal_{theirs}", unit)


def test_a_payload_file(tmp_path):
    path = saved(tmp_path, PAYLOAD, "sea035.12.pld1.raw.36.gz")
    assert FORMAT.recognises(path, path.read_bytes())
    log = FORMAT.read(path, Scope())
    assert log.label == "36"
    assert np.array_equal(column(log, "GPCTD_TEMPERATURE"), [15.25, np.nan], equal_nan=True)
    assert np.array_equal(column(log, "GPCTD_PRESSURE"), [np.nan, 1.25], equal_nan=True)
    assert log.groups[0].units["GPCTD_PRESSURE"] == "dbar"
    assert log.groups[0].time == pytest.approx(
        [datetime(2019, 7, 18, 20, 15, second, 123_000, tzinfo=UTC).timestamp() for second in (42, 43)], abs=1e-6
    )


def test_a_first_look_tells_of_all_rows(tmp_path):
    path = saved(tmp_path, HEADER + ROWS)
    log = FORMAT.read(path, Scope(most=2))
    (group,) = log.groups
    assert group.time is not None
    assert (group.rows, group.time.size) == (3, 2)
    assert group.span == (group.time[0], group.time[0] + 30.25)
    assert FORMAT.read(path, Scope(groups=["other"])).groups == ()


def test_progress_is_told(tmp_path):
    told = []
    FORMAT.read(saved(tmp_path, HEADER + ROWS * 15_000), Scope(progress=lambda fraction, words: told.append(fraction)))
    assert len(told) == 2
    assert 0.0 < told[0] < told[1] <= 1.0


DAMAGE = {
    "a line cut short": (ROWS + ROWS[:50], 3, 1),
    "garbage": (ROWS.replace("14/06/2019 03:50:51", "\0\xff\x01"), 2, 1),
    "no such day": (ROWS.replace("14/06/2019 03:50:51", "34/06/2019 03:50:51"), 2, 1),
    "no number": (ROWS.replace("67.67", "6x.67"), 2, 1),
    "the header again": (ROWS + HEADER + ROWS, 6, 1),
    "empty lines": (ROWS + "\n\n", 3, 0),
    "of windows": (ROWS.replace("\n", "\r\n"), 3, 0),
}


@pytest.mark.parametrize("text, rows, bad", DAMAGE.values(), ids=DAMAGE)
def test_damaged_lines_are_left_out_and_counted(tmp_path, text, rows, bad):
    log = FORMAT.read(saved(tmp_path, HEADER + text), Scope())
    assert log.groups[0].rows == rows
    assert log.notes == ((f"Left out {bad} lines that are damaged or cut short.",) if bad else ())


@pytest.mark.parametrize("kept", [0.5, 0.9, 0.99])
def test_a_compressed_file_that_is_cut_short_says_so(tmp_path, kept):
    rng = np.random.default_rng(0)
    rows = "".join(ROWS.splitlines()[0].replace("226.34", f"{x:.2f}") + "\n" for x in rng.uniform(0, 360, 500))
    packed = gzip.compress((HEADER + rows).encode())
    path = tmp_path / "sea035.10.gli.sub.36.gz"
    path.write_bytes(packed[: int(kept * len(packed))])
    log = FORMAT.read(path, Scope())
    assert 100 < log.groups[0].rows <= 500
    assert any(note.startswith("The compressed file is cut short or damaged") for note in log.notes)


def test_a_damaged_compressed_file_says_so(tmp_path):
    packed = bytearray(gzip.compress((HEADER + ROWS).encode()))
    packed[-8] ^= 1  # its checksum
    path = tmp_path / "sea035.10.gli.sub.36.gz"
    path.write_bytes(packed)
    log = FORMAT.read(path, Scope())
    assert log.notes[0].startswith("The compressed file is cut short or damaged")


@pytest.mark.parametrize("name", ["SEA035.10.gli.sub.36", "sea035.10.gli.sub.36.gz"])
def test_zeros_after_the_rows_are_given_up(tmp_path, name, monkeypatch):
    if name.endswith(".gz"):
        path = saved(tmp_path, (HEADER + ROWS).encode() + b"\0" * (1 << 24), name)
    else:
        path = saved(tmp_path, HEADER + ROWS, name)
        os.truncate(path, 1 << 26)
    log = FORMAT.read(path, Scope())
    assert log.groups[0].rows == 3
    assert "lines that are damaged" in log.notes[0]
    monkeypatch.setattr(seaexplorer, "_MOST_BAD", 5)
    assert FORMAT.read(path, Scope()).notes[0] == "Left out the rest of the file: it is no text."


BAD = {
    "empty": ("", "first line has to begin with"),
    "text": ("time_s;depth_m\n0;1\n", "first line has to begin with"),
    "zeros": ("\0" * 50_000, "first line has to begin with"),
    "header": (HEADER, "no row with a time"),
    "part of a header": (HEADER[:40], "no row with a time"),
    "rows of another width": (HEADER + "14/06/2019 03:50:41;1;2\n", "no row with a time"),
}


@pytest.mark.parametrize("name", ["SEA035.10.gli.sub.36", "sea035.10.gli.sub.36.gz"])
@pytest.mark.parametrize("content, words", BAD.values(), ids=BAD)
def test_what_is_no_such_file_is_refused_in_a_sentence(tmp_path, content, words, name, capfd):
    path = saved(tmp_path, content, name)
    check_refused(FORMAT, path, words, capfd)


@given(st.integers(0, 700), st.binary(max_size=60))
def test_any_cut_and_any_bytes_after_it_are_read_or_refused(tmp_path_factory, cut, rest):
    path = saved(tmp_path_factory.mktemp("cut"), (HEADER + ROWS).encode()[:cut] + rest)
    found = outcome(FORMAT, path)
    assert str(path) in found if isinstance(found, str) else found.groups[0].rows > 0


def test_it_is_known_by_its_first_line(tmp_path):
    path = tmp_path / "SEA035.10.gli.sub.36"
    packed = gzip.compress(HEADER.encode())
    for head in (HEADER.encode(), b"\xef\xbb\xbf" + HEADER.encode(), packed, PAYLOAD.encode()):
        assert FORMAT.recognises(path, head)
    for head in (
        b"",
        b"Timestamp,x\n",
        b"Timestamp;Depth\n",
        b"\x1f\x8b",
        b"\x1f\x8b" + b"\0" * 50,
        gzip.compress(b"Time;x\n"),
        b"\0" * 4096,
    ):
        assert not FORMAT.recognises(path, head)


def test_the_measured_files(shared_data):
    paths = sorted((shared_data / "seaexplorer").glob("*.gli.sub.*"))
    logs = [FORMAT.read(path, Scope()) for path in paths]
    assert [log.label for log in logs] == [f"{n:03d}" for n in range(1, 49)]
    assert sum(log.groups[0].rows for log in logs) == 6666
    assert all(log.notes == () for log in logs)

    def whole(name: str) -> np.ndarray:
        return np.concatenate([column(log, name) for log in logs])

    time = np.concatenate([np.asarray(log.groups[0].time) for log in logs])
    assert (np.diff(time) > 0.0).all()
    assert np.median(np.diff(time)) == 20.0
    assert 51.4 < np.nanmin(whole("Lat")) < np.nanmax(whole("Lat")) < 51.7
    assert -128.5 < np.nanmin(whole("Lon")) < np.nanmax(whole("Lon")) < -128.0
    # what the mapping says of signs
    depth, pitch, ballast = whole("Depth"), whole("Pitch"), whole("BallastPos")
    growth = np.gradient(depth, time)
    deep = depth > 10.0
    assert np.corrcoef(pitch[deep], growth[deep])[0, 1] < -0.95
    assert ballast[deep & (pitch < -5.0)].mean() < -200.0
    assert ballast[deep & (pitch > 5.0)].mean() > 100.0
    units = logs[0].groups[0].units
    mapping = Path(seaexplorer.__file__).parents[1] / "mappings" / "seaexplorer.toml"
    names = tomllib.loads(mapping.read_text(encoding="utf-8"))["names"]
    channels = {conversion(ours, units[theirs]).channel.name for theirs, ours in names.items()}
    assert {"heading_magnetic_rad", "depth_m", "buoyancy_volume_m3", "battery_position_cmd_m"} <= channels
