"""The study of depth-averaged currents: what a mission gives, and the table."""

import numpy as np

from scripts.studies.currents import CASES, STUDY, attempt, sheets


def test_currents_of_a_mission_are_within_a_few_of_their_standard_errors_and_the_table_counts_intervals():
    found = attempt("one dive", 3)
    assert np.shape(found["error"]) == np.shape(found["standard"]) == (CASES["one dive"][0], 2)
    assert np.all(np.abs(found["error"]) < 4.0 * np.array(found["standard"]))
    assert np.all(np.array(found["standard"]) >= found["without_flight"])
    made = STUDY.find([3], ["one dive"])
    (row,) = sheets(made)[0].rows
    assert row[0] == "one dive"
    assert row[1].endswith("of 2")
