"""The study of orders: what it counts and prints, and at full length that MDL finds the truth."""

import pytest

from scripts.studies.orders import CRITERIA, RIGHT, STUDY, SYSTEM


def test_mdl_and_bic_find_the_orders_of_a_record(capsys):
    found = STUDY.find(range(1), samples=1500)
    (picks,) = found.of(SYSTEM)
    assert picks["mdl"]["orders"] == picks["bic"]["orders"] == list(RIGHT)
    assert sum(picks["aic"]["orders"]) >= sum(RIGHT) >= sum(picks["parsimony"]["orders"])
    assert picks["mdl"]["fit"] > 97.0
    (sheet,) = STUDY.sheets(found)
    assert sheet.title == "Orders (n_a, n_b, n_c) chosen on ARMAX(4, 4, 2), 1500 samples, 1 seeds"
    assert [row[0] for row in sheet.rows] == list(CRITERIA)
    assert sheet.rows[0] == ["mdl", "1 of 1", "10 (10 to 10)", f"{picks['mdl']['fit']:.2f}", "(4, 4, 2) 1"]


@pytest.mark.slow
def test_mdl_finds_the_orders_in_nine_records_of_ten():
    picks = STUDY.find(range(50), jobs=2).of(SYSTEM)
    assert sum(pick["mdl"]["orders"] == list(RIGHT) for pick in picks) >= 45
