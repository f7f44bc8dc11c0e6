"""One log, its time written in all the ways that people write it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from auv_gym.records.first_look import look_at, mapping_text
from auv_gym.records.reading import read_record

BEGIN = datetime(2024, 3, 10, 23, 59, 40, tzinfo=UTC)
TIME = 0.5 * np.arange(120)  # over midnight
HEADING = np.linspace(10.0, 40.0, TIME.size)


def moments(form: str) -> list[str]:
    return [(BEGIN + timedelta(seconds=float(t))).strftime(form) for t in TIME]


def counted(scale: float, since: float = 0.0) -> list[str]:
    return [f"{since + t / scale:.10f}" for t in TIME]


def write(path, header: str, times: list[str]):
    rows = [f"{t},{h}" for t, h in zip(times, HEADING, strict=True)]
    path.write_text("\n".join([f"{header},heading_deg", *rows]) + "\n")
    return path


WAYS: dict[str, tuple[str, Callable[[], list[str]]]] = {
    "ISO 8601": ("time", lambda: moments("%Y-%m-%dT%H:%M:%S.%fZ")),
    "with slashes": ("Date Time", lambda: moments("%Y/%m/%d %H:%M:%S.%f")),
    "as MATLAB writes it": ("timestamp", lambda: moments("%d-%b-%Y %H:%M:%S.%f")),
    "of day": ("time", lambda: moments("%H:%M:%S.%f")),
    "two columns": ("date,time", lambda: moments("%Y-%m-%d,%H:%M:%S.%f")),
    "two columns, the other way round": ("Time,Date", lambda: moments("%H:%M:%S.%f,%Y-%m-%d")),
    "milliseconds": ("timestamp_ms", lambda: counted(1e-3, 1.7e12)),
    "microseconds": ("epoch_us", lambda: counted(1e-6, 1.7e15)),
    "minutes": ("elapsed_min", lambda: counted(60.0)),
    "MATLAB's days": ("datenum", lambda: counted(86400.0, 739321.9)),
    "days of a spreadsheet": ("time", lambda: counted(86400.0, 45361.9)),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_time_in_any_way_is_the_same_time(tmp_path, way):
    header, times = WAYS[way]
    record = read_record(write(tmp_path / "log.csv", header, times()))
    since = record.time - record.time[0]
    assert since == pytest.approx(TIME, abs=2e-4)  # ten digits of a day
    assert np.degrees(record["heading_rad"]) == pytest.approx(HEADING)


@pytest.mark.parametrize(
    "name",
    [
        "UTC", "Time (UTC)", "UTC time", "Date/Time", "datetime UTC", "Timestamp [UTC]", "Date", "DateTime", "GPS Time",
        "Local time", "time_stamp", "Time Stamp", "ISO_time", "date and time", "Log.Time",
    ],
)  # fmt: skip
def test_stamps_in_a_column_whose_name_speaks_of_time_are_its_time(tmp_path, name):
    record = read_record(write(tmp_path / "log.csv", name, moments("%Y-%m-%dT%H:%M:%S.%fZ")))
    assert record.time == pytest.approx(TIME)


def test_the_time_of_day_beside_a_date_both_in_utc(tmp_path):
    log = write(tmp_path / "log.csv", "Date (UTC),Time (UTC)", moments("%Y-%m-%d,%H:%M:%S.%f"))
    assert read_record(log).attrs["start_epoch_s"] == pytest.approx(BEGIN.timestamp())


def test_a_symbol_or_stamps_of_something_else_are_no_clock_beside_one(tmp_path):
    times = [f"{300 - 0.1 * k},{k // 2},{t}" for k, t in enumerate(moments("%Y-%m-%dT%H:%M:%S.%f"))]
    log = write(tmp_path / "log.csv", "t,seconds,UTC", times)
    assert read_record(log).time == pytest.approx(TIME)
    with pytest.raises(ValueError, match="There is no column time_s"):  # falls, as a temperature may
        read_record(write(tmp_path / "log.csv", "t", [f"{300 - 0.1 * k}" for k in range(TIME.size)]))
    with pytest.raises(ValueError, match="There is no column time_s"):
        read_record(write(tmp_path / "log.csv", "calibrated", moments("%Y-%m-%dT%H:%M:%S.%f")))


@pytest.mark.parametrize("unit, size", [("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("milliseconds", 1e-3)])
def test_the_unit_that_the_header_states_of_the_time_counts(tmp_path, unit, size):
    assert read_record(write(tmp_path / "log.csv", f"Time [{unit}]", counted(size))).time == pytest.approx(TIME)


@pytest.mark.parametrize("way", ["ISO 8601", "with slashes", "as MATLAB writes it", "two columns"])
def test_dates_keep_the_moment_at_which_a_log_begins(tmp_path, way):
    header, times = WAYS[way]
    record = read_record(write(tmp_path / "log.csv", header, times()))
    assert record.attrs["start_epoch_s"] == pytest.approx(BEGIN.timestamp())


@pytest.mark.parametrize(
    "since, whose, begins", [(739321.5, "MATLAB", "2024-03-10T12:00"), (45361.5, "spreadsheets", "2024-03-10T12:00")]
)
def test_days_are_counted_from_where_they_say(tmp_path, since, whose, begins):
    record = read_record(write(tmp_path / "log.csv", "time", counted(86400.0, since)))
    assert f"time: taken as the time, in days as counted by {whose}." in record.notes
    start = datetime.fromtimestamp(record.attrs["start_epoch_s"], UTC)
    assert start.isoformat().startswith(begins)


def test_a_datenum_counts_days_however_far_apart_its_rows_are(tmp_path):
    apart = [f"{739321.5 + k / 96:.10f}" for k in range(TIME.size)]
    record = read_record(write(tmp_path / "log.csv", "datenum", apart))
    assert record.time - record.time[0] == pytest.approx(900.0 * np.arange(TIME.size), abs=1e-3)


def test_seconds_since_boot_are_no_days(tmp_path):
    record = read_record(write(tmp_path / "log.csv", "time", counted(1.0, 45361.5)))
    assert record.time - record.time[0] == pytest.approx(TIME)


@pytest.mark.parametrize("name", ["time", "Date"])
def test_a_date_that_may_be_two_is_refused(tmp_path, name):
    words = r"'03/10/2024 23:59:40', and which number is the day and which the month is not known\. Write them with the"
    with pytest.raises(ValueError, match=words):
        read_record(write(tmp_path / "log.csv", name, moments("%m/%d/%Y %H:%M:%S")))


def test_a_log_that_runs_backwards_is_turned_round(tmp_path):
    path = write(tmp_path / "log.csv", "time_s", counted(1.0))
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *reversed(rows)]) + "\n")
    record = read_record(path)
    assert record.time == pytest.approx(TIME)
    assert np.degrees(record["heading_rad"]) == pytest.approx(HEADING)
    assert "The rows run backwards in time and were reversed." in record.notes


def test_rows_with_dates_in_no_order_are_sorted(tmp_path):
    path = write(tmp_path / "log.csv", "time", moments("%Y-%m-%dT%H:%M:%S.%f"))
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *np.random.default_rng(0).permutation(rows)]) + "\n")
    record = read_record(path)
    assert record.time == pytest.approx(TIME)
    assert np.degrees(record["heading_rad"]) == pytest.approx(HEADING)
    assert "The rows were in no order and were sorted by their dates." in record.notes


def test_times_of_which_some_state_a_zone_are_refused(tmp_path):
    times = [t + ("+02:00" if k % 2 else "") for k, t in enumerate(moments("%Y-%m-%dT%H:%M:%S"))]
    with pytest.raises(ValueError, match=r"with a zone, such as '2024.*\+02:00', and without one, such as '2024"):
        read_record(write(tmp_path / "log.csv", "time", times))


def test_the_dates_beside_times_of_day_are_not_said_to_be_left_out(tmp_path):
    path = write(tmp_path / "log.csv", "date,time", moments("%Y-%m-%d,%H:%M:%S.%f"))
    assert not any("date" in note for note in read_record(path).notes)
    found = look_at(path)
    assert "date" not in {signal.column for signal in found.signals}
    assert "date" not in mapping_text(found)
