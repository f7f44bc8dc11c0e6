"""Order search: what cells say, what each criterion takes, and which questions are refused."""

import json
from dataclasses import replace
from math import log

import numpy as np
import pytest

from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.orders import CRITERIA, Cell, Orders, OrderSearch, search_orders
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of

COLOURED = Polynomial.from_coefficients(
    a={"q_radps": [-1.5, 0.7]},
    b={"q_radps": {"stern_plane_rad": [0.5, 0.2]}},
    c={"q_radps": [-0.8]},
    dt=0.5,
)


def coloured(n, rng, noise=0.02):
    """A record of COLOURED from rest, its error white with this standard deviation."""
    e, u = noise * rng.standard_normal(n), np.repeat(rng.choice([-0.1, 0.1], n // 2 + 1), 2)[:n]
    y = np.zeros(n)
    for k in range(n):
        y[k] = e[k] - 0.8 * (e[k - 1] if k else 0.0)
        y[k] += 1.5 * y[k - 1] + 0.5 * u[k - 1] if k else 0.0
        y[k] += -0.7 * y[k - 2] + 0.2 * u[k - 2] if k > 1 else 0.0
    return Record.from_arrays(0.5 * np.arange(n), {"stern_plane_rad": u, "q_radps": y})


@pytest.fixture(scope="module")
def arx_search():
    return search_orders(
        "arx",
        [record_of(TRUTH, 1200, np.random.default_rng(1), 0.01, segments=2)],
        INPUTS,
        OUTPUTS,
        n_a=range(1, 6),
        n_b=range(1, 4),
        delay=range(1, 4),
    )


def made(*cells):
    """A search of one output with these cells: n_a, n_b, delay and the loss of 1000 rows."""
    rows = 1000
    filled = [
        Cell(
            "q_radps", a, (b,), 0, (late,), a + b, loss, loss * (1 + 2 * (a + b) / rows),
            loss * (1 + 2 * (a + b) * log(rows) / rows), rows * log(loss) + (a + b) * log(rows), float("nan"),
        )
        for a, b, late, loss in cells
    ]  # fmt: skip
    return OrderSearch("arx", Arx(("stern_plane_rad",), ("q_radps",)), tuple(filled), {"q_radps": rows}, 0.5)


def test_cells_hold_the_criteria_as_they_are_printed(arx_search):
    assert len(arx_search.cells) == 2 * 5 * 3 * 3
    for cell in arx_search.cells:
        n, rows = cell.n_a + sum(cell.n_b), arx_search.rows[cell.output]
        assert cell.parameters == n
        assert cell.aic == pytest.approx(cell.loss * (1.0 + 2.0 * n / rows), rel=1e-12)
        assert cell.mdl == pytest.approx(cell.loss * (1.0 + 2.0 * n * log(rows) / rows), rel=1e-12)
        assert cell.bic == pytest.approx(rows * log(cell.loss) + n * log(rows), rel=1e-12)
        assert np.isnan(cell.held_out)
        assert cell.problem == ""


def test_all_cells_share_their_rows_and_one_factorisation_gives_their_losses(arx_search):
    record = record_of(TRUTH, 1200, np.random.default_rng(1), 0.01, segments=2)
    assert arx_search.rows == dict.fromkeys(OUTPUTS, 1200 - 2 * 5)
    for cell in arx_search.cells[::7]:
        fit = Arx(INPUTS, (cell.output,), cell.n_a, (cell.n_b,), (cell.delay,), skip=5).fit(record)
        assert fit.samples == arx_search.rows[cell.output]
        assert fit.parameters == cell.parameters
        assert cell.loss == pytest.approx(fit.loss[0], rel=1e-9)


@pytest.mark.parametrize("criterion", ["mdl", "bic"])
def test_a_consistent_criterion_finds_the_orders_of_each_output(arx_search, criterion):
    chosen = arx_search.choice(criterion)
    assert chosen == Orders((3, 2), ((2, 2), (2, 2)), ((1, 1), (1, 1)))
    estimator = arx_search.estimator(criterion)
    assert estimator == Arx(INPUTS, OUTPUTS, (3, 2), ((2, 2), (2, 2)), ((1, 1), (1, 1)))


def test_with_an_integrator_the_pole_at_one_is_no_parameter():
    record = record_of(TRUTH, 600, np.random.default_rng(2), 0.01)
    grid = {"n_a": [2, 3], "n_b": [2]}
    search = search_orders("arx", [record], INPUTS, OUTPUTS, integrating=("depth_m",), **grid)
    assert [(cell.n_a, cell.parameters) for cell in search.of("depth_m")] == [(2, 5), (3, 6)]
    assert [(cell.n_a, cell.parameters) for cell in search.of("pitch_rad")] == [(2, 6), (3, 7)]
    estimator = search.estimator("mdl")
    assert estimator.integrating == ("depth_m",)
    fit = replace(estimator, outputs=("depth_m",), n_a=3, n_b=2, delay=1, skip=3).fit(record)
    assert search.of("depth_m")[1].loss == pytest.approx(fit.loss[0], rel=1e-9)
    with pytest.raises(ValueError, match="n_a as whole numbers from 1"):
        search_orders("arx", [record], INPUTS, OUTPUTS, integrating=("depth_m",), n_a=[0, 1])


def test_parsimony_takes_the_fewest_parameters_that_lose_little():
    # the pitch curves of paper 1, in parts of 1e-4 %: 2 with (4, 4) and nearly with more, 3 with fewer, much with none
    search = made((2, 1, 1, 40.0), (4, 1, 1, 3.0), (4, 4, 1, 2.0), (5, 5, 1, 1.995))
    assert search.best("q_radps", "mdl").n_b == (4,)
    assert search.best("q_radps", "parsimony").n_b == (1,)
    assert replace(search, tolerance=0.4).best("q_radps", "parsimony").n_b == (4,)
    assert replace(search, tolerance=0.0).best("q_radps", "parsimony").n_b == (4,)


def test_a_tie_goes_to_the_smaller_delay_and_then_to_the_smaller_n_a():
    best = made((3, 2, 2, 1.0), (2, 3, 2, 1.0), (3, 2, 1, 1.1), (2, 3, 1, 1.2)).best("q_radps", "parsimony")
    assert (best.n_a, best.delay) == (2, (1,))
    best = made((3, 2, 2, 1.0), (2, 3, 2, 1.0)).best("q_radps", "aic")
    assert best.n_a == 2


def test_without_noise_rounding_is_not_fitted():
    record = record_of(TRUTH, 400, np.random.default_rng(3))
    search = search_orders("arx", [record], INPUTS, ["pitch_rad"], n_a=range(1, 4), n_b=range(1, 4))
    for criterion in search.criteria:
        assert search.choice(criterion).n_a == (2,)


@pytest.mark.parametrize("method", ["els", "armax"])
def test_coefficients_of_the_noise_count_and_are_found(method):
    record = coloured(3000, np.random.default_rng(4))
    search = search_orders(
        method, [record], COLOURED.inputs, COLOURED.outputs, n_a=[1, 2, 3], n_b=[2, 3], n_c=[0, 1, 2]
    )
    assert all(cell.parameters == cell.n_a + sum(cell.n_b) + cell.n_c for cell in search.cells)
    assert search.choice("mdl") == Orders((2,), ((2,),), ((1,),), (1,))
    assert search.estimator("mdl").n_c == (1,)
    fit = replace(search.estimator("mdl"), skip=3).fit(record)
    best = search.best("q_radps", "mdl")
    assert (fit.samples, fit.parameters) == (search.rows["q_radps"], best.parameters)
    # cells end their iteration as soon as losses can be compared
    assert best.loss == pytest.approx(fit.loss[0], rel=1e-5)


def test_output_error_models_are_searched_without_n_c():
    rng = np.random.default_rng(5)
    record = coloured(800, rng, 0.0)
    record = record.with_channels({"q_radps": record["q_radps"] + 0.01 * rng.standard_normal(len(record))})
    search = search_orders("output_error", [record], COLOURED.inputs, COLOURED.outputs, n_a=[1, 2, 3], n_b=[1, 2])
    assert search.choice("mdl") == Orders((2,), ((2,),), ((1,),))
    with pytest.raises(ValueError, match="output_error has no n_c"):
        search_orders("output_error", [record], COLOURED.inputs, COLOURED.outputs, n_c=[1])


def test_held_out_takes_the_best_free_run_over_other_records():
    rng = np.random.default_rng(6)
    train, other = coloured(600, rng), coloured(600, rng)
    search = search_orders(
        "armax", [train], COLOURED.inputs, COLOURED.outputs, n_a=[1, 2], n_b=[1, 2], n_c=[1], validate=[other]
    )
    assert search.criteria == tuple(CRITERIA)
    best = search.best("q_radps", "held_out")
    assert best.n_a == 2
    assert best.held_out == max(cell.held_out for cell in search.cells)
    assert 50.0 < best.held_out < 100.0


def test_a_criterion_that_needs_other_records_says_so(arx_search):
    assert "held_out" not in arx_search.criteria
    with pytest.raises(ValueError, match="records in `validate`"):
        arx_search.choice("held_out")
    with pytest.raises(ValueError, match="Did you mean 'mdl'"):
        arx_search.choice("mdll")


def test_orders_that_cannot_be_fitted_are_kept_with_the_reason():
    record = coloured(60, np.random.default_rng(7))
    search = search_orders("arx", [record], COLOURED.inputs, COLOURED.outputs, n_a=[1, 2, 20], n_b=[1, 2])
    failed = [cell for cell in search.cells if cell.problem]
    assert {cell.n_a for cell in failed} == {20}
    assert all("samples per coefficient" in cell.problem and np.isnan(cell.loss) for cell in failed)
    assert search.choice("aic").n_a[0] <= 2
    short = search_orders("arx", [record], COLOURED.inputs, COLOURED.outputs, n_a=[20], n_b=[1])
    with pytest.raises(ValueError, match="No order could be fitted to q_radps"):
        short.choice("mdl")


def test_an_input_may_have_a_range_of_its_own():
    record = record_of(TRUTH, 600, np.random.default_rng(8), 0.01)
    search = search_orders(
        "arx",
        [record],
        INPUTS,
        ["pitch_rad"],
        n_a=[2],
        n_b={INPUTS[0]: [0, 2], INPUTS[1]: [2]},
        delay={n: [1] for n in INPUTS},
    )
    assert [cell.n_b for cell in search.cells] == [(0, 2), (2, 2)]
    assert search.choice("mdl").n_b == ((2, 2),)
    with pytest.raises(ValueError, match="n_b by input for bow_plane_rad, stern_plane_rad"):
        search_orders("arx", [record], INPUTS, OUTPUTS, n_b={"rudder_rad": [1]})


def test_a_search_is_json(arx_search):
    told = json.loads(json.dumps(arx_search.as_dict(), allow_nan=False))
    assert told["choices"]["mdl"] == {"n_a": [3, 2], "n_b": [[2, 2], [2, 2]], "delay": [[1, 1], [1, 1]]}
    assert len(told["cells"]) == len(arx_search.cells)
    assert told["cells"][0]["held_out"] is None


def test_progress_goes_from_cell_to_cell():
    seen = []
    record = coloured(100, np.random.default_rng(9))
    search_orders(
        "arx", [record], COLOURED.inputs, COLOURED.outputs, n_a=[1, 2], n_b=[1], progress=lambda f, t: seen.append(f)
    )
    assert seen == [0.0, 0.5, 1.0]


@pytest.mark.parametrize(
    "given, words",
    [
        ({"n_a": []}, "n_a as whole numbers from 0"),
        ({"n_a": [-1]}, "n_a as whole numbers from 0"),
        ({"n_b": [0]}, "n_b of at least 1"),
        ({"n_b": [1.5]}, "n_b as whole numbers"),
        ({"delay": [0]}, "delay as whole numbers from 1"),
        ({"n_c": [1]}, "arx has no n_c"),
        ({"tolerance": -0.1}, "tolerance from 0"),
        ({"structure": "full"}, "diagonal models"),
        ({"skip": 3}, "sets skip itself"),
        ({"n_aa": 3}, "no setting 'n_aa'"),
    ],
)
def test_wrong_questions_are_refused(given, words):
    record = coloured(100, np.random.default_rng(10))
    with pytest.raises(ValueError, match=words):
        search_orders("arx", [record], COLOURED.inputs, COLOURED.outputs, **given)


def test_methods_without_orders_are_refused():
    record = coloured(100, np.random.default_rng(11))
    with pytest.raises(ValueError, match="No order search for 'n4sid'"):
        search_orders("n4sid", [record], COLOURED.inputs, COLOURED.outputs)
    with pytest.raises(ValueError, match="at least one record"):
        search_orders("arx", [], COLOURED.inputs, COLOURED.outputs)
