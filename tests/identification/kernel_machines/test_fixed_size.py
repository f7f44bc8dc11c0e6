"""Fixed-size LS-SVM: the ridge regression that it says, the full machine in the limit, and what it refuses."""

import numpy as np
import pytest

from identification.kernel_machines import primal
from identification.kernel_machines.centres import _bell, _farthest, _swap, farthest, of_largest_entropy
from identification.kernel_machines.fixed_size import FixedSize, Reduced, fit_each
from identification.kernel_machines.regression import LsSvmRegression
from identification.kernel_machines.tuning import sweep
from identification.kernel_machines.tuning.sweep import sweep_each

RNG = np.random.default_rng(12)
X = RNG.normal(size=(120, 3)) * [1.0, 20.0, 0.05] + [0.0, 100.0, 1.0]
Y = np.column_stack([np.sin(X[:, 0]) + X[:, 1] / 50.0, 20.0 * (X[:, 2] - 1.0) * X[:, 0]])
Y += 0.05 * RNG.normal(size=Y.shape)
WEIGHTS = RNG.uniform(0.2, 3.0, 120)


def solved_directly(settings, x, y, weights, support):
    """Coefficients and bias by the normal equations of what is minimised."""
    scaled, centres = ((rows - x.mean(axis=0)) / x.std(axis=0) / settings.sigma for rows in (x, support))
    between, tall = (np.exp(-np.sum((rows[:, None] - centres[None]) ** 2, axis=2)) for rows in (centres, scaled))
    ones = np.column_stack([tall, np.ones(len(x))])
    left = ones.T @ (weights[:, None] * ones)
    left[:-1, :-1] += between / settings.penalty
    solution = np.linalg.solve(left, ones.T @ (weights[:, None] * y))
    return solution[:-1], solution[-1]


@pytest.mark.parametrize("centres", ["farthest", "entropy"])
@pytest.mark.parametrize("block", [4096, 50], ids=["one block", "blocks"])
def test_machine_is_the_least_of_what_is_minimised(centres, block, monkeypatch):
    monkeypatch.setattr(primal, "BLOCK", block)
    settings = FixedSize(30.0, 1.2, 12, centres)
    machine = settings.fit(X, Y, WEIGHTS, np.random.default_rng(1))
    coefficients, bias = solved_directly(settings, X, Y, WEIGHTS, machine.support)
    # the direct solve squares the condition of the kernel between centres, some 1e4
    np.testing.assert_allclose(machine.coefficients, coefficients, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(machine.bias, bias, rtol=1e-8)
    assert machine.support.shape == (12, 3)
    one = settings.fit(X, Y[:, 1], WEIGHTS, np.random.default_rng(1))
    np.testing.assert_allclose(one(X), machine(X)[:, 1], rtol=1e-9)


def test_leave_one_out_is_what_leaving_out_gives():
    settings = FixedSize(20.0, 1.5, 15)
    machine = settings.fit(X, Y, WEIGHTS)
    reduced = Reduced.of(X, Y, WEIGHTS, settings, None)
    for left in (0, 40, int(reduced.chosen[3])):  # a centre, too: it stays where it is
        rows = np.flatnonzero(np.arange(120) != left)
        rest = reduced.primal(1.5, rows).solution(20.0)
        scaled = reduced.samples.scaled / 1.5
        found = primal.bells(scaled[[left]], reduced.scaled / 1.5) @ rest.coefficients + rest.bias
        np.testing.assert_allclose(machine.leave_one_out[left], Y[left] - found[0], rtol=1e-8)


def test_one_pass_gives_the_errors_of_every_penalty(monkeypatch):
    monkeypatch.setattr(primal, "BLOCK", 50)
    reduced, penalties = Reduced.of(X, Y, WEIGHTS, FixedSize(size=20), None), np.array([0.1, 10.0, 1e5])
    system = reduced.primal(1.3)
    for penalty, squares in zip(penalties, system.mean_squares(penalties)):
        errors = FixedSize(penalty, 1.3, 20).fit(X, Y, WEIGHTS).leave_one_out
        np.testing.assert_allclose(squares, np.average(errors**2, axis=0, weights=WEIGHTS), rtol=1e-10)


def test_with_all_samples_it_is_the_full_machine():
    for penalty, sigma in ((30.0, 1.2), (1e6, 3.0)):
        full = LsSvmRegression(penalty, sigma).fit(X, Y, WEIGHTS)
        machine = FixedSize(penalty, sigma, 1000).fit(X, Y, WEIGHTS)
        at = X[:20] + 0.2 * X.std(axis=0)
        np.testing.assert_allclose(machine(at), full(at), rtol=1e-6)
        # other samples' bells make up for one whose centre stays: equal where the centre that is left adds nothing
        np.testing.assert_allclose(machine.leave_one_out, full.leave_one_out, rtol=1e-4, atol=1e-6)


def test_more_centres_come_nearer_to_the_full_machine():
    full = LsSvmRegression(1e4, 1.5).fit(X, Y)
    away = [np.abs(FixedSize(1e4, 1.5, size).fit(X, Y)(X) - full(X)).max() for size in (5, 40, 110)]
    assert away[0] > 3.0 * away[1] > 9.0 * away[2]


def test_interpolating_penalty_and_wide_bells_stay_finite():
    x = RNG.uniform(-1.0, 1.0, (500, 2))
    y = x[:, 0] ** 2 - x[:, 1]
    machine = FixedSize(np.inf, 20.0, 60).fit(x, y)
    assert "centres carry nothing: at sigma 20" in machine.notes[0]
    assert np.max(np.abs(machine(x) - y)) < 1e-5  # rounding at 1e-16 times coefficients of some 1e7
    assert np.isfinite(machine.leave_one_out).all()
    assert machine.support.shape == (60, 2)


def test_repeated_samples_are_centres_once():
    twice = np.vstack([X[:30]] * 3)
    machine = FixedSize(1e3, 1.0, 50).fit(twice, np.vstack([Y[:30]] * 3))
    assert "30 centres instead of 50: no more samples differ" in machine.notes[0]
    assert len(np.unique(machine.support, axis=0)) == 30
    weighted = FixedSize(1e3, 1.0, 50).fit(X[:30], Y[:30], np.full(30, 3.0))
    np.testing.assert_allclose(machine(X), weighted(X), rtol=1e-6, atol=1e-8)
    drawn = FixedSize(1e3, 1.0, 50, "entropy").fit(twice, np.vstack([Y[:30]] * 3), rng=np.random.default_rng(0))
    np.testing.assert_allclose(drawn(X), machine(X), rtol=1e-6, atol=1e-8)


def test_farthest_centres_are_apart_and_deterministic():
    rows = farthest(X, 40)
    assert len(set(rows.tolist())) == 40
    between = np.linalg.norm(X[:, None] - X[None], axis=2)
    nearest = [between[row, rows[:k]].min() for k, row in enumerate(rows) if k]
    assert nearest == sorted(nearest, reverse=True)
    assert between[:, rows].min(axis=1).max() <= nearest[-1]
    np.testing.assert_array_equal(farthest(X, 500)[:40], rows)


def test_swaps_raise_the_entropy():
    x = np.concatenate([0.1 * RNG.normal(size=(300, 2)), RNG.uniform(-3.0, 3.0, (60, 2))])
    rows = of_largest_entropy(x, 40, np.random.default_rng(3))
    assert len(set(rows.tolist())) == 40
    np.testing.assert_array_equal(rows, of_largest_entropy(x, 40, np.random.default_rng(3)))

    def crowding(rows):
        return np.exp(-np.sum((x[rows][:, None] - x[rows][None]) ** 2, axis=2)).sum()

    drawn = [np.random.default_rng(seed).permutation(360)[:40] for seed in range(50)]
    assert crowding(rows) < 0.7 * min(crowding(one) for one in drawn)


def test_compiled_choices_equal_plain_ones():
    x = np.ascontiguousarray(X[:50])
    found, plain = np.empty(10, dtype=np.int64), np.empty(10, dtype=np.int64)
    for function, rows in ((_farthest, found), (getattr(_farthest, "py_func", _farthest), plain)):
        assert function(x, 3, np.full(50, np.inf), rows) == 10
    np.testing.assert_array_equal(found, plain)
    leaving, coming = RNG.integers(0, 10, 100), RNG.integers(10, 50, 100)
    orders = [np.arange(50), np.arange(50)]
    for function, order in zip((_swap, getattr(_swap, "py_func", _swap)), orders):
        function(x / x.std(axis=0), order, 10, leaving, coming)
    np.testing.assert_array_equal(*orders)
    assert orders[0].tolist() != list(range(50))
    assert getattr(_bell, "py_func", _bell)(x, 0, 1) == pytest.approx(_bell(x, 0, 1), rel=1e-14)


def test_sweep_finds_the_least_of_a_grid():
    settings = FixedSize(size=25)
    tuned = sweep.sweep(settings, X, Y, weights=WEIGHTS)
    reduced = Reduced.of(X, Y, WEIGHTS, settings, None)
    spread = np.average((Y - np.average(Y, axis=0, weights=WEIGHTS)) ** 2, axis=0, weights=WEIGHTS)
    losses = [
        np.log(reduced.primal(sigma).mean_squares(np.exp(np.linspace(-4.0, 20.0, 100))) / spread).mean(axis=1).min()
        for sigma in np.exp(np.linspace(-1.5, 4.0, 60))
    ]
    assert tuned.loss < min(losses) + 1e-3
    errors = tuned.settings.fit(X, Y, WEIGHTS).leave_one_out
    np.testing.assert_allclose(tuned.errors, np.average(errors**2, axis=0, weights=WEIGHTS), rtol=1e-8)
    assert tuned.loss == pytest.approx(np.mean(np.log(np.array(tuned.errors) / spread)), rel=1e-10)


def test_sweep_on_a_part_is_finished_on_all(monkeypatch):
    rng = np.random.default_rng(2)
    x = rng.uniform(-1.0, 1.0, (1500, 1))
    y = np.sin(4.0 * x[:, 0]) + 0.1 * rng.normal(size=1500)
    on_all = sweep.sweep(FixedSize(size=20), x, y)
    monkeypatch.setattr(sweep, "PART", 300)
    on_part = sweep.sweep(FixedSize(size=20), x, y)
    assert on_part != on_all
    assert on_part.loss == pytest.approx(on_all.loss, abs=0.01)
    assert on_all.errors[0] == pytest.approx(0.01, rel=0.11)  # variance of the noise, told by 1500 samples to 3.7 %


def test_each_output_by_itself_around_the_same_centres():
    outputs, steps = np.column_stack([Y[:, 0], np.ones(120), Y[:, 1]]), []
    each = sweep_each(FixedSize(size=20), X, outputs, progress=lambda fraction, text: steps.append(fraction))
    assert each[2] == sweep.sweep(FixedSize(size=20), X, Y[:, 1])
    assert each[1].errors == (0.0,)
    assert steps == sorted(steps)
    assert steps[-1] == 1.0
    machines = fit_each([tuned.settings for tuned in each], X, outputs)
    np.testing.assert_array_equal(machines[0].support, machines[2].support)
    assert machines[0].sigma != machines[2].sigma
    np.testing.assert_allclose(machines[2](X), each[2].settings.fit(X, Y[:, 1])(X), rtol=1e-12)
    with pytest.raises(ValueError, match="alike in all but C and sigma"):
        fit_each([FixedSize(), FixedSize(size=7)], X, Y)
    with pytest.raises(ValueError, match="constants alone"):
        sweep.sweep(FixedSize(size=20), X, np.ones(120))


@pytest.mark.parametrize(
    "settings, change, message",
    [
        ({"sigma": 1e-9}, None, "FixedSize needs sigma from .* the unit matrix"),
        ({"sigma": 1e9}, None, "constant: all samples look alike"),
        ({"penalty": -1.0}, None, "penalty > 0"),
        ({"sigma": np.nan}, None, "finite sigma > 0"),
        ({"size": 1}, None, "whole size of 2 or more, got 1"),
        ({"centres": "best"}, None, "'farthest' or 'entropy', got 'best'"),
        ({"centres": "entropy"}, None, "needs rng for centres of large entropy"),
        ({}, lambda x, y: (x[:2], y[:2]), "FixedSize needs at least 3 samples, got 2"),
        ({}, lambda x, y: (np.where(x == x[4, 1], np.inf, x), y), "first in row 4"),
        ({}, lambda x, y: (x * [1.0, 0.0, 1.0] + 0.1, y), "0.1 in every sample of column 1"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_words(settings, change, message):
    with pytest.raises(ValueError, match=message):
        FixedSize(**settings).fit(*(change(X, Y) if change else (X, Y)))


def test_three_samples_and_constant_outputs_will_do():
    machine = FixedSize(1e3, 1.0).fit(X[:3], np.column_stack([Y[:3, 0], np.full(3, 0.1)]))
    assert len(machine.support) == 3
    assert machine(X)[:, 1] == pytest.approx(0.1, abs=0.0)
    assert "output 1 is 0.1 in every sample" in machine.notes[-1]
