from pathlib import Path

import numpy as np

from auv_gym.records.joining import side_by_side
from auv_gym.records.log import Group, Log


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
