"""The search before a fit: ranges as text, no look at the data that judge, and its table."""

import numpy as np
import pytest

from auv_gym.records.record import Record
from identification.identified import split
from identification.linear.polynomials.orders import search_orders
from identification.order_search import parse_ranges, remarks, search_apart
from identification.pages.linear_tables import order_table

INPUTS, OUTPUTS = ["stern_plane_rad"], ["q_radps", "w_mps"]


def record(n=900, seed=0):
    """Two outputs of first and second order, with a white error in each equation."""
    rng = np.random.default_rng(seed)
    u, e = np.repeat(rng.choice([-0.2, 0.2], n // 2), 2), 0.01 * rng.standard_normal((n, 2))
    q, w = np.zeros(n), np.zeros(n)
    for k in range(2, n):
        q[k] = 0.8 * q[k - 1] + 0.5 * u[k - 1] + e[k, 0]
        w[k] = 1.5 * w[k - 1] - 0.7 * w[k - 2] + 0.3 * u[k - 2] + e[k, 1]
    return Record.from_arrays(0.5 * np.arange(n), {"stern_plane_rad": u, "q_radps": q, "w_mps": w})


def test_ranges_have_both_ends_and_commas():
    found = parse_ranges(["n_a=1:3", "n_b = 2", "delay=1,4:5", "n-c=0:1"])
    assert found == {"n_a": (1, 2, 3), "n_b": (2,), "delay": (1, 4, 5), "n_c": (0, 1)}


@pytest.mark.parametrize(
    "text, words",
    [
        ("n_a=4:2", "empty, from 4 to 2"),
        ("n_a=", "such as n_a=1:4"),
        ("n_a", "such as n_a=1:4"),
        ("n_a=1:x", "such as n_a=1:4"),
        ("n_a=-1:2", "such as n_a=1:4"),
        ("n_a=1:9999", "more than 50"),
        ("na=1:4", "Did you mean 'n_a'"),
    ],
)
def test_ranges_that_are_none_are_refused(text, words):
    with pytest.raises(ValueError, match=words):
        parse_ranges([text])


def test_a_key_comes_once():
    with pytest.raises(ValueError, match="n_a came twice"):
        parse_ranges(["n_a=1:2", "n_a=3"])


def test_what_judges_the_model_takes_no_part_in_the_search():
    given, ranges = record(), {"n_a": (1, 2), "n_b": (1,)}
    train = split([given])[0]
    found = search_apart("arx", [given], [], INPUTS, OUTPUTS, ranges)
    alone = search_orders("arx", train, INPUTS, OUTPUTS, **ranges)
    assert [cell.loss for cell in found.cells] == [cell.loss for cell in alone.cells]
    assert found.rows["q_radps"] == 600 - 2
    # with other records to judge by, the search has all of these
    assert search_apart("arx", [given], [record(seed=1)], INPUTS, OUTPUTS, ranges).rows["q_radps"] == 900 - 2
    # and orders that free runs choose are judged within what is fitted
    apart = search_apart("arx", [given], [], INPUTS, OUTPUTS, ranges, criterion="held_out")
    assert apart.rows["q_radps"] == 400 - 2
    assert "held_out" in apart.criteria


def test_the_table_says_what_each_criterion_takes_and_which_was_asked_for():
    ranges = {"n_a": range(1, 4), "n_b": (1, 2), "delay": (1, 2)}
    search = search_apart("arx", [record()], [], INPUTS, OUTPUTS, ranges, criterion="bic", settings={"offset": False})
    assert search.base.offset is False
    shown = order_table(search)
    assert shown.heads == ("output", "criterion", "n_a", "n_b", "delay", "n", "RMS error")
    assert [row[0] for row in shown.rows] == ["q_radps"] * 4 + ["w_mps"] * 4
    assert [row[1] for row in shown.rows[:4]] == ["BIC, chosen", "MDL", "AIC", "parsimony"]
    assert shown.rows[0][2:6] == ["1", "1", "1", "2"]
    assert shown.rows[4][2:6] == ["2", "1", "2", "3"]
    assert shown.rows[0][6].endswith("deg/s")
    assert shown.rows[4][6].endswith("m/s")


@pytest.mark.slow
def test_the_table_has_what_the_method_and_the_criterion_add():
    ranges = {"n_a": (1,), "n_b": (1,), "n_c": (0, 1)}
    search = search_apart("armax", [record(300)], [], INPUTS, OUTPUTS[:1], ranges, criterion="held_out")
    shown = order_table(search)
    assert "n_c" in shown.heads
    assert shown.heads[-1] == "held-out"
    assert shown.rows[0][1] == "held-out, chosen"
    assert shown.rows[0][-1].endswith("%")


def test_a_search_needs_channels_and_a_known_criterion():
    with pytest.raises(ValueError, match="needs outputs"):
        search_apart("arx", [record(90)], [], INPUTS, None, {})
    with pytest.raises(ValueError, match="No criterion 'mdll'"):
        search_apart("arx", [record(90)], [], INPUTS, OUTPUTS, {}, criterion="mdll")
    with pytest.raises(ValueError, match="sets n_a itself"):
        search_apart("arx", [record(90)], [], INPUTS, OUTPUTS, {"n_b": (1, 2)}, settings={"n_a": 2})


def test_orders_at_the_end_of_what_was_tried_are_told_and_those_that_failed():
    search = search_apart("arx", [record(120)], [], INPUTS, OUTPUTS, {"n_a": (1, 2, 19), "n_b": (1,), "delay": (1, 2)})
    told = remarks(search)
    assert told[0].startswith("2 of 6 orders of q_radps could not be fitted, the first: Arx needs at least 4 samples")
    assert told[2] == "delay of w_mps is the largest that was tried, 2: try larger ones."
    assert order_table(search).caption.endswith(" ".join(told))
    assert remarks(search_apart("arx", [record()], [], INPUTS, OUTPUTS[:1], {"n_a": (1, 2), "n_b": (1, 2)})) == ()
