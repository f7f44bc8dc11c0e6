"""Damaged, cut, wrongly named and useless files of every format end in a sentence or a note, soon, without traces."""

import re
import struct
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from scipy.io import savemat

from auv_gym.records.first_look import FirstLook, look_at
from auv_gym.records.formats import formats
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from tests.records.readers import (
    ardupilot_logs,
    ros_logs,
    test_dbd_ascii as dbd_ascii,
    test_moos as moos,
    test_netcdf as netcdf,
    test_seaexplorer as seaexplorer,
    test_seaglider as seaglider,
    test_slocum_logs as slocum,
    test_ulog as ulog,
)

SECONDS = 10.0  # that a gigabyte may take; it takes less than one
GIGABYTE = 1 << 30
TABLE = "time_s,heading_deg,depth_m\n" + "".join(f"{k},{10 * k % 360},{0.5 * k}\n" for k in range(60))
DEPTHS = 0.5 * np.arange(60)


def content_of(write: Callable[[Path], object]) -> bytes:
    """What is written to a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "made")
        write(path)
        return next(path.glob("*.db3")).read_bytes() if path.is_dir() else path.read_bytes()


MAKERS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "csv": (".csv", TABLE.encode),
    "dbd_ascii": (".dba", (dbd_ascii.HEADER + dbd_ascii.NAMES + dbd_ascii.rows(60)).encode),
    "netcdf": (".nc", lambda: content_of(netcdf.write)),
    "classic netcdf": (".nc", lambda: content_of(lambda path: netcdf.write(path, engine="scipy"))),
    "mat": (".mat", lambda: mat(DEPTHS)),
    "slocum": (".dbd", lambda: slocum.log_of(slocum.rows_at(1.7e9 + 4.0 * np.arange(60)))),
    "seaglider": (".nc", lambda: content_of(lambda path: seaglider.write(path, seaglider.dive()))),
    "seaexplorer": (
        ".gli.sub",
        lambda: yo_of(30),
    ),
    "ros1": (".bag", lambda: content_of(lambda path: ros_logs.write_ros1(path, ros_logs.sample(True, 60)))),
    "ros1 lz4": (".bag", lambda: content_of(lambda path: ros_logs.write_ros1(path, ros_logs.sample(True, 60), "lz4"))),
    "ros2": (".db3", lambda: content_of(lambda path: ros_logs.write_ros2(path, ros_logs.sample(False, 60)))),
    "mcap": (".mcap", lambda: content_of(lambda path: ros_logs.write_mcap(path, ros_logs.sample(False, 60)))),
    "dataflash": (".bin", lambda: ardupilot_logs.HEAD + ardupilot_logs.body(60)),
    "mavlink": (".tlog", lambda: ardupilot_logs.packed(ardupilot_logs.frames(60))),
    "ulog": (".ulg", lambda: ulog.definitions() + b"".join(map(ulog.data, range(60)))),
    "moos": (
        ".alog",
        lambda: alog_of(60),
    ),
}
# A Slocum log is read in a process of its own, half a second each time; test_slocum_logs.py damages some every day.
MOSTLY_DAILY = [pytest.param(name, marks=pytest.mark.slow) if name == "slocum" else name for name in MAKERS]
TEXT = {"csv", "dbd_ascii", "seaexplorer", "moos"}
ENDINGS = sorted({ending for form in formats() for ending in form.endings})


def yo_of(minutes: int) -> bytes:
    rows = seaexplorer.ROWS.replace("03:51:11", "03:50:59")
    return "".join([seaexplorer.HEADER, *(rows.replace("03:50", f"03:{k:02d}") for k in range(minutes))]).encode()


def alog_of(seconds: int) -> bytes:
    lines = (f"{k}.5 NAV_DEPTH sim {k}\n{k}.6 NAV_HEADING sim {k}\n" for k in range(seconds))
    return "".join([moos.BANNER, *lines]).encode()


def mat(depths: np.ndarray) -> bytes:
    signals = {"time_s": np.arange(60.0), "heading_deg": 6.0 * np.arange(60), "depth_m": depths}
    return content_of(lambda path: savemat(path, signals, appendmat=False))


@cache
def made(name: str) -> bytes:
    """The content of a sound log of a format."""
    return MAKERS[name][1]()


@pytest.fixture
def put(tmp_path) -> Callable[..., Path]:
    """Writes a file into a folder of its own."""

    def write(content: bytes, ending: str, size: int | None = None) -> Path:
        path = tmp_path / "logs" / f"log{ending}"
        path.parent.mkdir(exist_ok=True)
        with path.open("wb") as file:
            file.write(content)
            file.truncate(size)
        return path

    return write


@pytest.fixture
def tried(tmp_path, monkeypatch, capfd):
    """Tries a file by `read_record` and `look_at`: what each comes to, a sentence or a result; checks for traces."""
    private = tmp_path / "temporary"
    private.mkdir()
    monkeypatch.setenv("TMPDIR", str(private))
    monkeypatch.setattr(tempfile, "tempdir", str(private))

    def outcomes(path: Path, mapping=None, required=()) -> tuple[Record | str, FirstLook | str]:
        before = sorted(path.parent.rglob("*"))
        found: list = []
        for act in (lambda: read_record(path, mapping, required), lambda: look_at(path, mapping)):
            try:
                found.append(act())
            except ValueError as error:
                sentence = str(error)
                assert str(path) in sentence
                assert re.search(r"[.:?`]\s|[.`]$", sentence), sentence
                assert not re.search(r" object at 0x|Traceback|<class |\bself\b", sentence), sentence
                found.append(sentence)
        assert sorted(path.parent.rglob("*")) == before
        assert [*private.iterdir()] == []
        assert capfd.readouterr() == ("", "")
        return found[0], found[1]

    return outcomes


def notes_of(outcome: Record | FirstLook) -> tuple[str, ...]:
    return tuple(outcome.notes) + ((outcome.problem,) if isinstance(outcome, FirstLook) and outcome.problem else ())


WHAT_TO_DO = re.compile(
    r"\b([Cc]opy|[Cc]onvert|[Ee]xport|[Gg]ive|[Cc]heck|[Ss]ave|[Cc]orrect|[Nn]ame|[Mm]ap|[Rr]ecord|[Cc]hoose|[Mm]end|"
    r"let the basestation|[Ll]og it|put a header)\b"
)


def says(outcome: Record | FirstLook | str, words: str) -> bool:
    """Whether a sentence, or a line of the notes, has these words."""
    lines = (outcome,) if isinstance(outcome, str) else notes_of(outcome)
    return any(re.search(words, line) for line in lines)


@pytest.mark.parametrize("name", MAKERS)
def test_sound_logs_are_read(name, put, tried):
    read, looked = tried(put(made(name), MAKERS[name][0]))
    assert isinstance(looked, FirstLook)
    assert looked.rows > 5
    assert isinstance(read, Record), read


@pytest.mark.parametrize("ending", ENDINGS)
def test_nothing_zeros_and_a_folder(ending, put, tried):
    for outcome in tried(put(b"", ending)):
        assert says(outcome, r"is empty \(0 bytes\): copy or download it again")
    path = put(b"", ending, GIGABYTE)
    start = time.monotonic()
    for outcome in tried(path):
        assert says(outcome, "begins with only zeros. Check its ending, or copy or export it again")
    assert time.monotonic() - start < SECONDS
    path.unlink()
    path.mkdir()
    for outcome in tried(path):
        assert says(outcome, "is a folder, .* give the path of one log file in it")


@pytest.mark.parametrize("ending", sorted(set(ENDINGS) - {".csv", ".txt", ".tsv", ".dat", ".asc"}))
def test_text_under_the_ending_of_another_format(ending, put, tried):
    for outcome in tried(put(b"Notes of the day:\nthe vehicle was lost, and then found.\n" * 40, ending)):
        assert says(outcome, "but its content is something else: it begins with 'Notes of the day'?.* Check its ending")


@pytest.mark.parametrize("name", MAKERS)
def test_a_log_under_the_ending_of_tables(name, put, tried):
    read, looked = tried(put(made(name), ".csv"))
    if name in TEXT:  # taken as a table, which it may be
        assert isinstance(read, Record) or WHAT_TO_DO.search(read), read
    elif name == "ros2":  # a database may hold anything
        assert says(read, "Check its ending"), read
    else:
        assert isinstance(read, Record)
        assert isinstance(looked, FirstLook)
        assert looked.format == look_at(put(made(name), MAKERS[name][0])).format


def rows_of(outcome: Record | FirstLook) -> int:
    return outcome.time.size if isinstance(outcome, Record) else outcome.rows


@pytest.mark.parametrize("name", MOSTLY_DAILY)
def test_logs_that_are_cut_short(name, put, tried):
    whole, ending = made(name), MAKERS[name][0]
    sound = tried(put(whole, ending))
    for share in (0.002, 0.03, 0.2, 0.51, 0.9, 0.999):
        for outcome, of_all in zip(tried(put(whole[: max(int(share * len(whole)), 1)], ending)), sound, strict=True):
            assert not isinstance(of_all, str)
            if isinstance(outcome, str):
                assert WHAT_TO_DO.search(outcome), outcome
            elif name not in TEXT and rows_of(outcome) < rows_of(
                of_all
            ):  # a row of text may look whole where it is cut
                assert set(notes_of(outcome)) - set(notes_of(of_all)), share


@pytest.mark.parametrize("name", MOSTLY_DAILY)
def test_garbage_in_the_middle(name, put, tried):
    whole, ending = made(name), MAKERS[name][0]
    sound = tried(put(whole, ending))
    garbage = np.random.default_rng(1).bytes(len(whole) // 10)
    for share in (0.1, 0.5, 0.8):
        at = int(share * len(whole))
        for outcome, of_all in zip(tried(put(whole[:at] + garbage + whole[at + len(garbage) :], ending)), sound):
            assert not isinstance(of_all, str)
            if isinstance(outcome, str):
                assert WHAT_TO_DO.search(outcome), outcome
            elif rows_of(outcome) < rows_of(of_all):
                assert set(notes_of(outcome)) - set(notes_of(of_all)), share


@pytest.mark.parametrize("size", [1 << 26, pytest.param(GIGABYTE, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", MOSTLY_DAILY)
def test_zeros_after_a_good_beginning(name, size, put, tried):
    for part in (made(name), made(name)[:64]):
        path = put(part, MAKERS[name][0], size)
        start = time.monotonic()
        outcomes = tried(path)
        assert time.monotonic() - start < 2 * SECONDS  # for two of them
        path.unlink()
        for outcome in outcomes:
            if isinstance(outcome, str):
                assert WHAT_TO_DO.search(outcome), outcome
            else:
                assert notes_of(outcome)


IMAGES = [sent for sent in ros_logs.sample(False, 5) if sent[1] == "sensor_msgs/msg/Image"]
WITHOUT_MESSAGES = {
    "csv": (".csv", lambda: TABLE.splitlines()[0].encode(), "at least 2 rows are needed"),
    "dbd_ascii": (".dba", (dbd_ascii.HEADER + dbd_ascii.NAMES).encode, "needs 3 rows or more, got 0"),
    "mat": (".mat", lambda: content_of(lambda path: savemat(path, {}, appendmat=False)), "there are none"),
    "netcdf": (
        ".nc",
        lambda: content_of(lambda path: netcdf.write(path, netcdf.dataset().isel(TIME=[], z=[]))),
        "time",
    ),
    "slocum": (".dbd", lambda: slocum.log_of([]), "cut short in its cycle 0"),
    "seaexplorer": (".gli.sub", seaexplorer.HEADER.encode, "no row with a time"),
    "ros1": (".bag", lambda: content_of(lambda path: ros_logs.write_ros1(path, [])), "got no messages"),
    "ros2": (".db3", lambda: content_of(lambda path: ros_logs.write_ros2(path, [])), "it has no topics"),
    "images alone": (".db3", lambda: content_of(lambda path: ros_logs.write_ros2(path, IMAGES)), "it holds images"),
    "mcap": (".mcap", lambda: content_of(lambda path: ros_logs.write_mcap(path, [])), "got no messages"),
    "dataflash": (".bin", lambda: ardupilot_logs.HEAD, "no messages with a time"),
    "mavlink": (".tlog", lambda: ardupilot_logs.packed(ardupilot_logs.frames(0)[:1]), "no message with numbers"),
    "ulog": (".ulg", ulog.definitions, "got none in"),
    "moos": (".alog", moos.BANNER.encode, "no MOOS log with numbers"),
}


@pytest.mark.parametrize("ending, make, words", WITHOUT_MESSAGES.values(), ids=WITHOUT_MESSAGES)
def test_logs_without_messages(ending, make, words, put, tried):
    for outcome in tried(put(make(), ending)):
        assert says(outcome, words), outcome
        assert isinstance(outcome, FirstLook) or WHAT_TO_DO.search(outcome)


@pytest.mark.parametrize("name", MAKERS)
def test_what_a_mapping_or_a_vehicle_needs_and_the_log_does_not_have(name, put, tried):
    path = put(made(name), MAKERS[name][0])
    for outcome in tried(path, {"rovio/reference[7]": "rudder_deg"}):
        assert says(outcome, r"rovio/reference\[7\]"), outcome
    read, _ = tried(path, None, ["sway_force_N"])
    assert says(read, "no channel sway_force_N, which is needed; it has .* Name it in a mapping"), read


def depth_log(name: str, seconds: np.ndarray, depths: np.ndarray) -> tuple[bytes, dict[str, str]]:
    """A log of depth alone at these times after its start, and the mapping that it needs."""
    make = ros_logs.Maker(name == "ros1")
    sent = [("/depth", "std_msgs/msg/Float32", int(ros_logs.START + 1e9 * t), make.number(d))
            for t, d in zip(seconds.tolist(), depths.tolist())]  # fmt: skip
    in_topic = {"depth": "depth_m"}
    if name == "ros1":
        return content_of(lambda path: ros_logs.write_ros1(path, sent)), in_topic
    if name == "mcap":
        return content_of(lambda path: ros_logs.write_mcap(path, sent)), in_topic
    if name == "netcdf":
        data = netcdf.xr.Dataset(
            {"DEPTH": ("TIME", depths, {"units": "m"})},
            {"TIME": ("TIME", seconds, {"units": "seconds since 2014-07-24 12:00:00"})},
        )
        return content_of(lambda path: netcdf.write(path, data)), {"DEPTH": "depth_m"}
    if name == "mat":
        found = {"time_s": seconds, "depth_m": depths}
        return content_of(lambda path: savemat(path, found, appendmat=False)), {"depth_m": "depth_m"}
    if name == "moos":
        lines = (f"{t} NAV_DEPTH sim {d}\n" for t, d in zip(seconds, depths))
        return "".join([moos.BANNER, *lines]).encode(), {"NAV_DEPTH": "depth_m"}
    if name == "dataflash":
        rows = (struct.pack("<Qf", int(1e6 * t), d) for t, d in zip(1.0 + seconds, depths))
        head = ardupilot_logs.HEAD + ardupilot_logs.definition(20, "BARO", "Qf", "TimeUS,Dep")
        return head + b"".join(b"\xa3\x95\x14" + row for row in rows), {"BARO.Dep": "depth_m"}
    rows = (f"{t},{d}\n" for t, d in zip(seconds, depths))
    return "".join(["time_s,depth_m\n", *rows]).encode(), {"depth_m": "depth_m"}


DEPTH_LOGS = ["csv", "mat", "netcdf", "ros1", "mcap", "dataflash", "moos"]


@pytest.mark.parametrize("name", DEPTH_LOGS)
def test_stamps_that_go_back(name, put, tried):
    back = np.concatenate([np.arange(30.0), np.arange(10.0, 40.0)])
    content, mapping = depth_log(name, back, DEPTHS)
    read, looked = tried(put(content, MAKERS[name][0]), mapping, ["depth_m"])
    for outcome in (read, looked):
        assert says(outcome, "time|clock|Time"), outcome
    if isinstance(read, Record):
        for segment in read.segments:
            assert (np.diff(read.time[segment]) > 0.0).all()


@pytest.mark.parametrize("name", DEPTH_LOGS)
def test_nothing_but_nan_in_a_channel_that_is_needed(name, put, tried):
    content, mapping = depth_log(name, np.arange(60.0), np.full(60, np.nan))
    read, looked = tried(put(content, MAKERS[name][0]), mapping, ["depth_m"])
    assert says(read, "'depth_m' has no value in any of its 60 samples .* check the log, or map another column"), read
    assert says(looked, "none of its 60 samples has a value"), looked


EVIL = "<img src=x onerror=alert(1)>{{ 7 * 7 }}__import__('os').system('touch executed')"


def test_what_a_file_says_is_text_and_nothing_else(put, tried, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = f"time_s,depth_m,{EVIL}\n" + "".join(f"{k},{k},word\n" for k in range(30))
    of_table, looked = tried(put(table.encode(), ".csv"))
    assert isinstance(of_table, Record)
    assert isinstance(looked, FirstLook)
    assert EVIL in {signal.column for signal in looked.signals}
    assert says(of_table, re.escape(EVIL))
    path = put(b"", ".mcap")
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        for topic, text in (
            (EVIL, "float32 data"),
            ("/odd", f"float32 data\n{EVIL}"),
            ("/even", f"string data={EVIL}"),
        ):
            schema = writer.register_schema("odd_msgs/msg/Odd" + str(len(text)), "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for k in range(10):
                writer.add_message(channel, k * 10**9, struct.pack("<4sf", b"\0\1\0\0", k), k * 10**9)
        writer.finish()
    read, looked = tried(path, {EVIL: "depth_m"})
    assert isinstance(read, Record), read
    assert read["depth_m"].tolist() == list(range(10))
    assert isinstance(looked, FirstLook)
    assert says(looked, "^odd is left out: the definition of its type odd_msgs/msg/Odd.* cannot be parsed")
    assert says(looked, "^even is left out")
    assert not (tmp_path / "executed").exists()


def test_the_page_of_a_diagnosis_shows_notes_as_text(monkeypatch):
    jinja2 = pytest.importorskip("jinja2")
    page = pytest.importorskip("identification.pages.page")
    source = (Path(page.__file__).parent / "templates" / "diagnosis.html").read_text(encoding="utf-8")
    found = re.search(r"<ul[^>]*>\s*{% for line in d\.record\.notes %}.*?{% endfor %}", source, re.DOTALL)
    assert found is not None
    monkeypatch.setattr(jinja2, "PackageLoader", lambda package: jinja2.DictLoader({"notes.html": found[0]}))
    shown = page.page("notes.html", {"d": {"record": {"notes": [f"{EVIL}: left out."]}}})
    assert "<img" not in shown
    assert "&lt;img src=x" in shown
    assert "{{ 7 * 7 }}" in shown
