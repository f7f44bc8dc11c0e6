from pathlib import Path

import numpy as np
import pytest

from auv_gym.records.joining import check_apart, labels_of, one_after_the_other, side_by_side
from auv_gym.records.log import Group, Log
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record


def log(label, start, *names, format="Slocum log"):
    time = start + np.arange(10.0)
    return Log(
        format, f"{label}.bin", tuple(Group(n, {n: time}, time) for n in names), {"of": names[0]}, (label,), label
    )


def joined(*logs):
    return [one for _, one in side_by_side([(Path(str(k)), one) for k, one in enumerate(logs)])]


def test_what_was_logged_side_by_side_is_one_log():
    flight, science = log("a", 0.0, "m_heading", "m_depth"), log("a", 5.0, "sci_temp", "sci_cond", "m_depth")
    (both,) = joined(flight, science)
    assert both.names == ["m_heading", "m_depth", "sci_temp", "sci_cond"]
    assert both.column("m_depth")[0].time[0] == 0.0  # of the first file
    assert both.attrs == {"of": "m_heading"}
    assert both.notes == ("a",)


def test_dives_of_one_number_and_stretches_apart_stay_apart():
    one = log("dive 2", 0.0, "pitch", "roll")
    assert len(joined(one, log("dive 2", 0.0, "pitch", "roll"))) == 2  # another vehicle
    assert len(joined(one, log("dive 2", 100.0, "sci_temp"))) == 2  # another time
    assert len(joined(one, log("dive 3", 0.0, "sci_temp"))) == 2
    assert len(joined(one, log("dive 2", 0.0, "sci_temp", format="another"))) == 2
    assert len(joined(log("", 0.0, "a"), log("", 0.0, "b"))) == 2  # files without a label


def dive(start, **attrs):
    return Record.from_arrays(start + np.arange(3.0), {"depth_m": np.arange(3.0)}).with_notes([], **attrs)


def test_files_without_a_date_are_joined_in_the_order_in_which_they_are_given():
    both = one_after_the_other([dive(5.0), dive(0.0)])
    assert len(both.segments) == 2
    assert both.time.tolist() == [5.0, 6.0, 7.0, 0.0, 1.0, 2.0]
    assert "start_epoch_s" not in both.attrs


def test_files_with_dates_are_joined_in_their_order_and_on_one_clock():
    both = one_after_the_other([dive(0.0, start_epoch_s=150.0), dive(0.0, start_epoch_s=100.0)])
    assert both.time.tolist() == [0.0, 1.0, 2.0, 50.0, 51.0, 52.0]
    assert both.attrs["start_epoch_s"] == 100.0


def test_where_some_files_have_no_date_the_clock_is_that_of_the_first():
    assert one_after_the_other([dive(0.0, start_epoch_s=150.0), dive(5.0)]).attrs["start_epoch_s"] == 150.0
    assert "start_epoch_s" not in one_after_the_other([dive(5.0), dive(0.0, start_epoch_s=150.0)]).attrs


def mission(seed, begin=None, vehicle=None, n=100):
    values = {"depth_m": np.random.default_rng(seed).uniform(0.0, 50.0, n)}
    attrs = {"start_epoch_s": begin, "platform_id": vehicle}
    return Record.from_arrays(np.arange(n) * 1.0, values, attrs={k: v for k, v in attrs.items() if v is not None})


def test_what_was_given_twice_is_refused():
    with pytest.raises(ValueError, match=r"^a.csv was given twice, which would count as twice the evidence: give each"):
        check_apart([("a.csv", mission(1)), ("b.csv", mission(2)), ("a.csv", mission(1))])
    copy = mission(1).with_channels({"pitch_rad": np.zeros(100)}).later(7.0)
    with pytest.raises(ValueError, match=r"^a.csv and copy.csv hold the same samples"):
        check_apart([("a.csv", mission(1)), ("copy.csv", copy)])
    with pytest.raises(ValueError, match=r"^all.csv and a.csv hold the same samples"):
        check_apart([("all.csv", one_after_the_other([mission(1), mission(2), mission(3)])), ("a.csv", mission(1))])
    check_apart([("a.csv", mission(1)), ("b.csv", mission(2)), ("c.csv", mission(3))])


def test_logs_that_overlap_in_time_are_refused():
    with pytest.raises(ValueError, match=r"^a.csv and b.csv overlap in time by 50 s"):
        check_apart([("a.csv", mission(1, 1.4e9)), ("b.csv", mission(2, 1.4e9 + 49.0))])
    check_apart([("a.csv", mission(1, 1.4e9)), ("b.csv", mission(2, 1.4e9 + 95.0))])  # clocks are not that exact
    check_apart([("a.csv", mission(1, 1.4e9)), ("b.csv", mission(2))])
    turns = one_after_the_other([mission(1, 1.4e9), mission(2, 1.4e9 + 400.0)])
    check_apart([("a.csv", turns), ("b.csv", mission(3, 1.4e9 + 200.0))])


def test_logs_of_two_vehicles_are_refused():
    with pytest.raises(ValueError, match=r"a.nc is of SG561 and b.nc is of SG171: give the logs of one of them"):
        check_apart([("a.nc", mission(1, vehicle="SG561")), ("b.nc", mission(2, vehicle="SG171"))])
    check_apart([("a.nc", mission(1, vehicle="SG561")), ("b.nc", mission(2, vehicle="SG561")), ("c", mission(3))])
    both = one_after_the_other([mission(1, 1.4e9, "SG561"), mission(2, 1.5e9, "SG561")])
    with pytest.raises(ValueError, match=r"a.nc, b.nc is of SG561 and c.nc is of SG171"):
        check_apart([("a.nc, b.nc", both), ("c.nc", mission(3, vehicle="SG171"))])


def test_logs_of_one_name_from_two_folders_are_told_apart_by_these(tmp_path):
    files = []
    for folder in ("monday", "tuesday"):
        (tmp_path / folder).mkdir()
        files.append(tmp_path / folder / "log.csv")
        files[-1].write_text("time_s,heading_deg,rudder_rad\n" + "".join(f"{t},{t},{len(folder)}\n" for t in range(9)))
    assert read_record(files, required=("rudder_rad",)).labels == ["monday/log.csv", "tuesday/log.csv"]
    assert labels_of([(files[0], ""), (tmp_path / "b.csv", ""), (files[1], "dive 3")]) == ["log.csv", "b.csv", "dive 3"]
