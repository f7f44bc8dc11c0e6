"""The text that dbd2asc makes of Slocum logs: names, units, rows, and what is refused or cut short."""

import os

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.records.log import Scope
from auv_gym.records.readers import slocum
from auv_gym.records.readers.dbd_ascii import FORMAT

HEADER = """dbd_label: DBD_ASC(dinkum_binary_data_ascii)file
encoding_ver: 0
num_ascii_tags: 8
all_sensors: 0
filename: made-2024-001-0-0
mission_name: TEST.MI
num_label_lines: 3
num_segments: 1
"""
NAMES = "m_present_time m_heading m_depth m_battpos sci_m_present_time \ntimestamp rad m in timestamp \n8 4 4 4 8 \n"


def rows(count: int) -> str:
    """Rows 4 s apart, in turn of the flight and of the science computer."""
    flight = "{t} {h:.6g} {d} 0.5 NaN \n"
    science = "NaN NaN {d} NaN {t} \n"
    return "".join((flight, science)[k % 2].format(t=1.7e9 + 4 * k, h=0.1 * k, d=k) for k in range(count))


def put(path, text: str):
    path.write_text(text)
    return path


def test_the_rows_of_a_text(tmp_path):
    path = put(tmp_path / "made.dba", HEADER + NAMES + rows(20))
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    assert not slocum.FORMAT.recognises(path, path.read_bytes()[:4096])
    log = FORMAT.read(path, Scope())
    (group,) = log.groups
    assert (log.label, log.attrs, log.notes) == ("made-2024-001-0-0", {"mission": "TEST.MI"}, ())
    assert (group.name, group.rows, group.units) == ("", 19, {"m_heading": "rad", "m_depth": "m"})  # the first row goes
    assert group.time is not None
    assert group.time.tolist() == [1.7e9 + 4 * k for k in range(1, 20)]
    assert group.columns["m_depth"].tolist() == list(range(1, 20))
    assert np.isnan(group.columns["m_heading"]).tolist() == [k % 2 == 1 for k in range(1, 20)]
    assert set(group.columns) == {"m_heading", "m_depth", "m_battpos"}


@given(values=st.lists(st.floats(allow_infinity=False), min_size=4, max_size=12))
def test_what_is_written_is_read(values, tmp_path_factory):
    path = tmp_path_factory.mktemp("text") / "made.dba"
    text = "".join(f"{1.7e9 + k} 0 {value!r} 0 NaN \n" for k, value in enumerate(values))
    (group,) = FORMAT.read(put(path, HEADER + NAMES + text), Scope()).groups
    assert np.array_equal(group.columns["m_depth"], values[1:], equal_nan=True)


def test_a_first_look_counts_all_rows(tmp_path):
    path = put(tmp_path / "made.dba", HEADER + NAMES + rows(9001))
    (group,) = FORMAT.read(path, Scope(most=10)).groups
    assert (group.rows, len(group.columns["m_depth"])) == (9000, 10)
    assert group.span == (1.7e9 + 4, 1.7e9 + 36000)
    said = []
    FORMAT.read(path, Scope(progress=lambda share, words: said.append(share)))
    assert said[-1] == 1.0


def test_a_clock_that_was_set_back(tmp_path):
    times = [0, 1, 2, 3, 1.5, 2.5, 3.5, 4]
    text = "".join(f"{1.7e9 + t} {k} 0 0 NaN \n" for k, t in enumerate(times))
    log = FORMAT.read(put(tmp_path / "made.dba", HEADER + NAMES + text), Scope())
    assert log.groups[0].columns["m_heading"].tolist() == [1, 2, 3, 6, 7]
    assert log.notes == ("2 rows without a time later than the ones before are left out.",)


def test_a_text_that_is_cut_short_within_a_row(tmp_path):
    text = HEADER + NAMES + rows(20)
    log = FORMAT.read(put(tmp_path / "cut.dba", text[: text.rindex("19 NaN")]), Scope())
    assert log.groups[0].rows == 18
    assert log.notes == ("The text is cut short within its last row, which is left out.",)


@pytest.mark.parametrize(
    "text, message",
    [
        (HEADER[:40], "header of dbd2asc's text is cut short"),
        (HEADER.replace("tags: 8", "tags: 9999"), "header of dbd2asc's text is cut short"),
        (HEADER.replace("tags: 8", "tags: x") + NAMES + rows(5), "header of dbd2asc's text is cut short"),
        (HEADER, r"of one length, got 0, 0 and 0"),
        (HEADER + NAMES.replace("8 4 4 4 8", "8 4 4"), "got 5, 5 and 3"),
        (HEADER + NAMES.replace("m_depth", "m_heading") + rows(5), "names the sensor 'm_heading' twice"),
        (HEADER + NAMES.replace("present", "past") + rows(5), "needs the sensor m_present_time or sci_m_present_time"),
        (HEADER + NAMES, "needs 3 rows or more, got 0"),
        (
            HEADER + NAMES + rows(3) + "1 2\n" + rows(3),
            "Row 4 of dbd2asc's text needs 5 numbers, a sensor each, but has 2 cells",
        ),
        (HEADER + NAMES + rows(3) + "1 2 x 4 5\n" + rows(3), "Row 4 .* but has a cell that is no number"),
        (HEADER + NAMES + rows(5) + "x" * (1 << 20), "longer than 1048576 bytes"),
    ],
)
def test_what_is_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        FORMAT.read(put(tmp_path / "bad.dba", text), Scope())


def test_zeros_after_a_good_beginning_are_refused_at_once(tmp_path):
    path = put(tmp_path / "zeros.dba", HEADER + NAMES + rows(9))
    os.truncate(path, 1 << 30)
    with pytest.raises(ValueError, match="longer than 1048576 bytes"):
        FORMAT.read(path, Scope())
