"""Tables in text as other programs write them."""

import numpy as np
import pytest

from auv_gym.records.reading import read_record

ROWS = [(0.0, 10.0, 1.0), (1.0, 11.0, 1.5), (2.0, 12.5, 2.0), (3.0, 13.0, 2.5)]
HEADER = ("time_s", "heading_deg", "depth_m")


def text(mark: str, before: str = "") -> str:
    lines = [mark.join(HEADER), *(mark.join(map(str, row)) for row in ROWS)]
    return before + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "content",
    [text(","), text("   "), text(" \t"), text(",", "% logged by X\n% in 2024\n"), text(" ", "# by X\n"), text("\t")],
    ids=["comma", "blanks", "blanks and tabs", "comments as in MATLAB", "comments", "tab"],
)
def test_a_table_is_read_however_its_columns_are_divided(tmp_path, content):
    path = tmp_path / "log.txt"
    path.write_text(content)
    record = read_record(path)
    assert record.time.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert np.degrees(record["heading_rad"]) == pytest.approx([10.0, 11.0, 12.5, 13.0])
    assert record["depth_m"].tolist() == [1.0, 1.5, 2.0, 2.5]


@pytest.mark.parametrize("mark", ["-999", "-999.0", "-9999", "-99999.00"])
def test_a_number_that_stands_for_none_is_missing(tmp_path, mark):
    path = tmp_path / "log.csv"
    path.write_text(text(",").replace("11.0,1.5", f"11.0,{mark}"))
    record = read_record(path)
    assert record["depth_m"].tolist() == [1.0, 1.5, 2.0, 2.5]  # filled in from its neighbours
    assert f"depth_m: {float(mark):g} stands for a missing value in 1 of 4 rows." in record.notes


def test_two_numbers_that_stand_for_none_are_both_missing(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text(",").replace("11.0,1.5", "11.0,-999").replace("12.5,2.0", "12.5,-9999"))
    assert read_record(path)["depth_m"].tolist() == pytest.approx([1.0, 1.5, 2.0, 2.5])


def test_a_number_among_others_like_it_is_one(tmp_path):
    path = tmp_path / "log.csv"
    rpm = [-800.0, -999.0, -900.0, -700.0]
    lines = ["time_s,heading_deg,propeller_rpm", *(f"{k},10,{n}" for k, n in enumerate(rpm))]
    path.write_text("\n".join(lines) + "\n")
    assert read_record(path)["propeller_rpm"].tolist() == rpm


def test_of_text_without_numbers_it_is_asked_whether_it_is_a_log(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("Mission notes\nWe launched at 9.\nRecovered at 17:00, battery low, fin looks bent.\n")
    with pytest.raises(ValueError, match=r"the header has 1\. Is this file a log, a table of numbers below a header\?"):
        read_record(path)
    path.write_text(text(",").replace("11.0,1.5", "11.0"))
    with pytest.raises(ValueError, match=r"Row 2 below the header has 2 cells, the header has 3\. Correct the line\.$"):
        read_record(path)


@pytest.mark.parametrize(
    "title, mark",
    [
        ("Vehicle: Foo", ","),
        ("Vehicle: Foo", ";"),
        ("Vehicle: Foo\nOperator: Bar, Baz\n", ","),
        ("Vehicle,Foo", ","),
    ],
)
def test_a_title_above_the_header_is_said_to_be_one(tmp_path, title, mark):
    rows = [mark.join(row) for row in (("time_s", "depth_m", "u_mps"), *(3 * (str(k),) for k in range(20)))]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([title, *rows]) + "\n")
    first = title.partition("\n")[0]
    with pytest.raises(
        ValueError, match=f"The first line, '{first}', was taken as the header, but .* begin them with #"
    ):
        read_record(path)


@pytest.mark.parametrize("form", ["utf-16", "utf-16-le", "utf-16-be"])
def test_a_table_in_utf_16_is_read_as_one_in_utf_8(tmp_path, form):
    text = "time_s,depth_m\n" + "".join(f"{k},{k}\n" for k in range(20))
    mark = "" if form == "utf-16" else "\ufeff"
    path = tmp_path / "log.csv"
    path.write_bytes((mark + text).encode(form))
    assert read_record(path)["depth_m"].tolist() == list(range(20))
    path.write_bytes((mark + text).encode(form)[:-1])
    with pytest.raises(ValueError, match="begins as UTF-16 but is not"):
        read_record(path)


def test_an_infinite_value_is_missing_and_this_is_said(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,depth_m\n" + "".join(f"{k},{'inf' if k == 5 else k}\n" for k in range(20)))
    record = read_record(path)
    assert record["depth_m"][5] == 5.0  # filled in
    assert "depth_m: 1 of 20 cells is infinite and counts as missing." in record.notes
