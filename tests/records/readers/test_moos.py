"""Logs of MOOS: numbers by variable and their times, what is left out, and files that are none."""

import os
import tomllib
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import auv_gym.records.readers.moos as moos
from auv_gym.channels import conversion
from auv_gym.records.log import Scope
from auv_gym.records.readers.moos import FORMAT
from tests.records.readers.outcomes import check_refused, outcome

START = 1_700_000_000.25
BANNER = (
    f"{'%' * 40}\n%% LOG FILE:       ./MOOSLog.alog\n%% FILE OPENED ON  Tue Nov 14\n%% LOGSTART   {START}\n{'%' * 40}\n"
)
LINES = """\
0.500           NAV_X                uSimMarine      12.5
0.500           NAV_DEPTH            uSimMarine      -0
0.600           NODE_REPORT_LOCAL    pNodeReporter   NAME=alpha,X=12.5,Y=0,SPD=1.2,HDG=119
0.700           DEPLOY               pMarineViewer   true
1.000           NAV_X                uSimMarine:aux  13.25e0
1.250           DESIRED_THRUST       pHelmIvP        1_000
1.500           NAV_DEPTH            uSimMarine      3.5
2.000           NAV_DEPTH            uSimMarine      nan
2.500           NAV_X                uSimMarine      14
"""


def saved(tmp_path: Path, text: str | bytes, name: str = "MOOSLog.alog") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_each_variable_with_numbers_is_a_group(tmp_path):
    path = saved(tmp_path, BANNER + LINES)
    assert FORMAT.recognises(path, path.read_bytes())
    log = FORMAT.read(path, Scope())
    assert [group.name for group in log.groups] == ["NAV_DEPTH", "NAV_X"]
    depth, x = log.groups
    assert np.array_equal(x.columns["NAV_X"], [12.5, 13.25, 14.0])
    assert x.time is not None
    assert np.array_equal(x.time, START + np.array([0.5, 1.0, 2.5]))
    assert np.array_equal(depth.columns["NAV_DEPTH"], [0.0, 3.5, np.nan], equal_nan=True)
    assert x.units == {}  # MOOS states none
    assert log.notes == ("Left out 3 variables that hold text: DEPLOY, DESIRED_THRUST, NODE_REPORT_LOCAL.",)


def test_types_may_be_marked(tmp_path):
    log = FORMAT.read(saved(tmp_path, BANNER + "1.0 NAV_X sim D:12.5\n2.0 MODE helm S:3\n"), Scope())
    assert [(group.name, *group.columns[group.name]) for group in log.groups] == [("NAV_X", 12.5)]


@pytest.mark.parametrize(
    "banner, time, expected",
    [
        (BANNER, START + 3.0, START + 3.0),  # written as time since 1970
        (BANNER, 3.0, START + 3.0),
        ("", 3.0, 3.0),
        ("%% LOGSTART 24716270386.8\n", 3.0, 24716270389.8),  # of a simulation whose time runs fast
    ],
)
def test_times_count_from_the_start_of_the_log(tmp_path, banner, time, expected):
    log = FORMAT.read(saved(tmp_path, f"{banner}{time:.6f} NAV_X sim 1\n"), Scope())
    assert log.groups[0].time == pytest.approx([expected], rel=1e-15)
    assert any("LOGSTART" in note for note in log.notes) == (banner == "")


def test_texts_among_numbers_are_left_out_with_a_note(tmp_path):
    log = FORMAT.read(saved(tmp_path, BANNER + LINES + "3.0 NAV_X sim unknown\n"), Scope())
    assert log.groups[1].rows == 3
    assert "Left out the texts among the numbers of NAV_X." in log.notes


def test_a_first_look_tells_of_all_rows(tmp_path):
    text = BANNER + "".join(f"{0.1 * k:.1f} NAV_X sim {k}\n{0.1 * k:.1f} NAV_Y sim {-k}\n" for k in range(50))
    log = FORMAT.read(saved(tmp_path, text), Scope(most=3, groups=["NAV_Y"]))
    (group,) = log.groups
    assert np.array_equal(group.columns["NAV_Y"], [0, -1, -2])
    assert (group.rows, group.span) == (50, (START, START + 4.9))


def test_progress_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(moos, "_BLOCK", 64)
    told = []
    log = FORMAT.read(saved(tmp_path, BANNER + LINES), Scope(progress=lambda fraction, words: told.append(fraction)))
    assert log.groups[1].rows == 3  # lines go on over blocks
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_damaged_lines_are_left_out_and_counted(tmp_path):
    text = (BANNER + LINES).encode() + b"\0\xff garbage\nNAV_X 3\n3.5 NAV_X sim 15\n"
    log = FORMAT.read(saved(tmp_path, text), Scope())
    assert log.groups[1].rows == 4
    assert "Left out 2 lines that are not `time VARIABLE SOURCE value`." in log.notes


def test_a_file_of_other_lines_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(moos, "_MOST_BAD", 10)
    log = FORMAT.read(saved(tmp_path, BANNER + LINES + "no line\n" * 20 + LINES), Scope())
    assert log.groups[1].rows == 3
    assert "Left out the rest of the file, which is no log." in log.notes


@pytest.mark.parametrize("lost", [1, 2, 3, 10])
def test_a_log_that_is_cut_short_gives_its_whole_lines(tmp_path, lost):
    log = FORMAT.read(saved(tmp_path, (BANNER + LINES)[:-lost]), Scope())
    assert np.array_equal(log.groups[1].columns["NAV_X"], [12.5, 13.25])
    assert log.notes[0] == "The file ends within a line, which is left out: it may be cut short."


def test_zeros_after_the_log_do_not_fill_the_memory(tmp_path):
    path = saved(tmp_path, BANNER + LINES)
    os.truncate(path, 1 << 27)
    held = []

    def told(fraction: float, words: str) -> None:
        held.append(tracemalloc.get_traced_memory()[1])

    tracemalloc.start()
    try:
        log = FORMAT.read(path, Scope(progress=told))
    finally:
        tracemalloc.stop()
    assert log.groups[1].rows == 3
    assert held[-1] < 8 * moos._BLOCK  # the blocks before and after, joined and split


@pytest.mark.parametrize(
    "content", ["", "hello\n", "\0" * 5000, BANNER, BANNER + "1.0 DEPLOY viewer true\n", "%% LOGSTART\n1.0 NAV_X\n"]
)
def test_a_file_without_numbers_is_refused_in_a_sentence(tmp_path, content, capfd):
    path = saved(tmp_path, content)
    check_refused(FORMAT, path, "is no MOOS log with numbers", capfd)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content):
    path = saved(tmp_path_factory.mktemp("any"), BANNER.encode() + content)
    found = outcome(FORMAT, path)
    assert str(path) in found if isinstance(found, str) else found.groups or found.notes


def test_it_is_known_by_its_banner(tmp_path):
    path = tmp_path / "MOOSLog.alog"
    assert FORMAT.recognises(path, BANNER.encode())
    for head in (b"", b"time_s,depth_m\n", b"%PDF-1.4\n", b"LOGSTART 3\n", b"\0" * 4096):
        assert not FORMAT.recognises(path, head)


def test_the_mapping_names_channels():
    path = Path(moos.__file__).parents[1] / "mappings" / "moos.toml"
    names = tomllib.loads(path.read_text(encoding="utf-8"))["names"]
    channels = {theirs: conversion(ours.removeprefix("-")).channel.name for theirs, ours in names.items()}
    assert channels["NAV_X"] == "east_m"
    assert channels["NAV_SPEED"] == "speed_ground_mps"
    assert names["NAV_YAW"] == "-heading_rad"
