"""Tests of the files of a diagnosis."""

from identification.diagnosis.result_files import _with_log


def test_each_log_that_a_vehicle_was_fitted_to_is_listed_once():
    assert _with_log("", "a.csv") == "a.csv"
    assert _with_log("a.csv", "b.csv") == "a.csv; b.csv"
    assert _with_log("a.csv; b.csv", "b.csv") == "a.csv; b.csv"
    assert _with_log("a.csv; b.csv", "a.csv") == "a.csv; b.csv"
