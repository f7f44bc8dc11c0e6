"""The study of orders: what it counts and prints, and at full length that MDL finds the truth."""

import json

import pytest

from scripts.order_study import CRITERIA, RIGHT, Pick, as_json, attempt, main, study


def test_choices_are_counted_by_criterion():
    rows = [dict.fromkeys(CRITERIA, Pick(orders, 98.0 + k)) for k, orders in enumerate([RIGHT, (5, 4, 2), RIGHT])]
    told = as_json(rows, 500)
    assert (told["seeds"], told["samples"], told["right"]) == (3, 500, [4, 4, 2])
    assert told["criteria"]["mdl"] == {
        "right": 2,
        "median_fit_percent": 99.0,
        "picked": [{"orders": [4, 4, 2], "seeds": 2}, {"orders": [5, 4, 2], "seeds": 1}],
    }


def test_mdl_and_bic_find_the_orders_of_a_record():
    picks = attempt(0, 1500)
    assert picks["mdl"].orders == picks["bic"].orders == RIGHT
    assert sum(picks["aic"].orders) >= sum(RIGHT)
    assert sum(picks["parsimony"].orders) <= sum(RIGHT)
    assert picks["mdl"].fit > 97.0


def test_the_program_prints_a_table_or_json(monkeypatch, capsys):
    row = dict.fromkeys(CRITERIA, Pick(RIGHT, 99.5))
    monkeypatch.setattr("scripts.order_study.attempt", lambda seed, samples: row)
    assert main(["--seeds", "2", "--jobs", "1"]) == 0
    printed = capsys.readouterr().out
    assert "ARMAX(4, 4, 2), 10000 samples, 2 seeds" in printed
    assert printed.count("2 of 2") == len(CRITERIA)
    assert main(["--seeds", "2", "--jobs", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["criteria"]["aic"]["right"] == 2


def test_nothing_to_do_is_refused(capsys):
    assert main(["--seeds", "0"]) == 1
    assert "at least 1, got 0" in capsys.readouterr().err


@pytest.mark.slow
def test_mdl_finds_the_orders_in_nine_records_of_ten():
    picks = study(range(50), 10_000, 2)
    assert sum(pick["mdl"].orders == RIGHT for pick in picks) >= 45
