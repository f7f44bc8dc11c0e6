"""What is said of samples that are dropped, and measurements that are missing for a while."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.plant.record_check import needs_of
from auv_gym.records.mending import on_dropped
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record


@pytest.mark.parametrize(
    "lost, words", [(1, "1 of 50 samples (2 %) was dropped, "), (2, "2 of 50 samples (4 %) were ")]
)
def test_one_sample_was_dropped_and_several_were(lost, words):
    missing = np.arange(50) < lost
    heading = np.where(missing, np.nan, 0.1)
    (line,) = on_dropped({"heading_rad": (("time_s",), heading, {})}, missing)
    assert line.startswith(words)


@pytest.mark.parametrize(
    "lost, ends",
    [
        ([0], "no value, at the beginning or end of the record."),
        ([48, 49], "no value, at the beginning or end of the record."),
        ([0, 20], "no value; the record is cut there."),
    ],
)
def test_a_record_is_cut_only_where_samples_inside_it_are_dropped(lost, ends):
    missing = np.isin(np.arange(50), lost)
    heading = np.where(missing, np.nan, 0.1)
    (line,) = on_dropped({"heading_rad": (("time_s",), heading, {})}, missing)
    assert line.endswith(ends)


def test_a_measurement_that_may_be_missing_cuts_nothing_and_keeps_its_readings():
    """A Doppler log without bottom for a third of the rows, and a track of one fix in 20 rows."""
    rows = np.arange(200)
    fixed, tracked = rows % 20 == 5, (rows < 60) | (rows >= 120)
    values = {
        "heading_rad": 0.01 * rows,
        "north_m": np.where(fixed, 2.0 * rows, np.nan),
        "u_dvl_mps": np.where(tracked, 1.0, np.nan),
        "east_m": np.where(rows < 7, 0.0, np.nan),  # too few readings to be of any use
    }
    log = Record.from_arrays(0.1 * rows, values, required=["heading_rad"], spare={"north_m", "u_dvl_mps", "east_m"})
    assert len(log) == 200
    assert len(log.segments) == 1
    assert log.names == ("heading_rad", "north_m", "u_dvl_mps")
    assert np.array_equal(log.readings("north_m"), fixed)
    assert np.array_equal(log.readings("u_dvl_mps"), tracked)
    assert log["north_m"][[0, 5, 15, 199]] == pytest.approx([10.0, 10.0, 30.0, 2.0 * 185])
    assert log.notes[:2] == [
        "north_m has no value in 190 of 200 samples (95 %), which are used without it.",
        "u_dvl_mps has no value in 60 of 200 samples (30 %), which are used without it.",
    ]
    assert log.notes[2].startswith("east_m: left out, since it has values at 7 of 200 samples only")
    coarse = log.resample(0.5)
    assert not coarse.readings("u_dvl_mps")[13:23].any()
    assert coarse.readings("u_dvl_mps")[:12].all()


def test_in_a_segment_without_any_reading_a_measurement_is_unknown():
    rows = np.arange(100)
    values = {"heading_rad": 0.01 * rows, "u_dvl_mps": np.where(rows < 50, 1.0 + 0.01 * rows, np.nan)}
    log = Record.from_arrays(rows, values, rows >= 50, required=["heading_rad"], spare={"u_dvl_mps"})
    assert len(log.segments) == 2
    assert np.array_equal(log.readings("u_dvl_mps"), rows < 50)
    assert log["u_dvl_mps"][50:] == pytest.approx(np.full(50, np.median(values["u_dvl_mps"][:50])))


def test_what_a_vehicle_measures_but_does_not_need_may_be_missing_except_angles_and_inputs(tmp_path):
    needs = needs_of(load_vehicle("slocum"))
    assert {"r_radps", "north_m", "east_m"} <= needs.spare
    assert not needs.spare & {"heading_rad", "rudder_rad", "u_mps"}
    text = "".join(f"{4 * k},0.1,{0.1 * np.sin(k / 9)},{k if k % 15 == 0 else ''},0.5\n" for k in range(150))
    (tmp_path / "log.csv").write_text("time_s,heading_rad,rudder_rad,north_m,u_mps\n" + text)
    log = read_record(tmp_path / "log.csv", required=needs)
    assert np.array_equal(np.flatnonzero(log.readings("north_m")), np.arange(0, 150, 15))
