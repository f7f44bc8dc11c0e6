"""Penalty and width by leave-one-out error: the loss, its gradient, and the minima that both searches find."""

import numpy as np
import pytest

from identification.kernel_machines.regression import LsSvmRegression, Training, fit_each
from identification.kernel_machines.tuning import tuning
from identification.kernel_machines.tuning.tuning import _Search, anneal, descend, descend_each

RNG = np.random.default_rng(8)
X = RNG.uniform(-1.0, 1.0, (90, 2))
TRUE = np.column_stack([np.sin(3.0 * X[:, 0]) * X[:, 1], X[:, 0] * np.abs(X[:, 0])])
Y = TRUE + 0.05 * RNG.normal(size=TRUE.shape)
WEIGHTS = RNG.uniform(0.3, 2.0, 90)


def search_of(settings, y, weights=None):
    return _Search.of(settings, Training.of(X, y, weights, settings), 99, lambda fraction, text: None)


@pytest.mark.parametrize("kernel", ["rbf", "linear"])
def test_gradient_is_that_of_the_loss(kernel):
    search = search_of(LsSvmRegression(kernel=kernel), Y, WEIGHTS)
    for at in ([2.0, 0.3], [6.0, 1.0]):
        at = np.array(at[: len(search.bounds)])
        _, slope = search(at, gradient=True)
        for k in range(len(at)):
            move = np.zeros(len(at))
            move[k] = 1e-4
            central = (search(at + move)[0] - search(at - move)[0]) / 2e-4
            assert slope[k] == pytest.approx(central, rel=1e-5, abs=1e-8)


def test_loss_is_that_of_the_machine_at_the_settings_found():
    tuned = descend(LsSvmRegression(), X, Y, weights=WEIGHTS)
    left_out = tuned.settings.fit(X, Y, WEIGHTS).leave_one_out
    errors = np.average(left_out**2, axis=0, weights=WEIGHTS)
    centre = np.average(Y, axis=0, weights=WEIGHTS)
    np.testing.assert_allclose(tuned.errors, errors, rtol=1e-10)
    assert tuned.loss == pytest.approx(
        np.mean(np.log(errors / np.average((Y - centre) ** 2, axis=0, weights=WEIGHTS))), rel=1e-6
    )


def test_both_searches_come_to_the_least_of_a_grid():
    steps = []
    by_gradient = descend(LsSvmRegression(), X, Y[:, 0])
    by_annealing = anneal(
        LsSvmRegression(), X, Y[:, 0], np.random.default_rng(3), evaluations=200, progress=lambda f, t: steps.append(f)
    )
    search = search_of(LsSvmRegression(), Y[:, 0])
    grid = [
        search(np.array([c, s]))[0]
        for c in np.linspace(*search.bounds[0], 25)
        for s in np.linspace(*search.bounds[1], 25)
    ]
    assert by_gradient.loss < min(grid) + 1e-6
    assert by_annealing.loss < min(grid) + 0.02  # annealing comes near a minimum, and goes down to it by chance only
    assert by_gradient.evaluations <= 60 < by_annealing.evaluations <= 205
    assert steps == sorted(steps)
    assert steps[-1] == 1.0


def test_tuned_machine_smooths_the_noise_away():
    tuned = descend(LsSvmRegression(), X, Y)
    inside = 0.8 * RNG.uniform(-1.0, 1.0, (200, 2))
    truth = np.column_stack([np.sin(3.0 * inside[:, 0]) * inside[:, 1], inside[:, 0] * np.abs(inside[:, 0])])
    error = tuned.settings.fit(X, Y)(inside) - truth
    assert np.sqrt(np.mean(error**2)) < 0.03  # the noise is 0.05
    np.testing.assert_allclose(np.sqrt(tuned.errors), 0.05, rtol=0.35)


def test_same_seed_same_settings_inside_the_bounds():
    first, second = (anneal(LsSvmRegression(), X, TRUE, np.random.default_rng(5), evaluations=60) for _ in range(2))
    assert first == second
    low, high = search_of(LsSvmRegression(), TRUE).bounds[0]
    assert low <= np.log(first.settings.penalty) <= high
    assert first.settings.fit(X, TRUE)(X).shape == TRUE.shape


def test_linear_kernel_has_its_penalty_tuned_alone():
    straight = X @ np.array([1.0, -2.0]) + 0.1 * RNG.normal(size=90)
    tuned = descend(LsSvmRegression(sigma=7.0, kernel="linear"), X, straight)
    assert tuned.settings.sigma == 7.0
    assert tuned.errors[0] == pytest.approx(0.01, rel=0.4)


def test_long_record_is_settled_on_a_part_of_it_and_finished_on_all(monkeypatch):
    monkeypatch.setattr(tuning, "FEW_SAMPLES", 120)
    rng = np.random.default_rng(6)
    x = rng.uniform(-1.0, 1.0, (250, 1))
    y = np.sin(4.0 * x[:, 0]) + 0.1 * rng.normal(size=250)
    tuned = descend(LsSvmRegression(), x, y)
    assert tuned.evaluations < 15
    assert tuned.errors[0] == pytest.approx(0.01, rel=0.27)  # the noise's variance, told by 250 samples to 9 %
    monkeypatch.setattr(tuning, "FEW_SAMPLES", 250)
    on_all = descend(LsSvmRegression(), x, y)
    assert on_all.evaluations > tuned.evaluations
    assert tuned.loss == pytest.approx(on_all.loss, abs=0.01)  # 1 % of the mean square, far inside its own 9 %


def test_constant_outputs_leave_the_loss_to_the_others():
    constant = np.column_stack([Y[:, 0], np.ones(90)])
    alone, beside = descend(LsSvmRegression(), X, Y[:, 0]), descend(LsSvmRegression(), X, constant)
    assert beside.settings == alone.settings
    assert beside.errors[1] == 0.0
    with pytest.raises(ValueError, match="constants alone"):
        descend(LsSvmRegression(), X, np.ones(90))


def test_each_output_has_the_settings_that_it_has_alone():
    outputs = np.column_stack([Y, np.ones(90)])
    steps = []
    each = descend_each(LsSvmRegression(), X, outputs, weights=WEIGHTS, progress=lambda f, t: steps.append(f))
    for output in (0, 1):
        assert each[output] == descend(LsSvmRegression(), X, Y[:, output], weights=WEIGHTS)
    assert each[2].settings == LsSvmRegression()
    assert (each[2].errors, each[2].evaluations) == ((0.0,), 0)
    assert each[0].settings != each[1].settings
    assert steps == sorted(steps)
    machines = fit_each([tuned.settings for tuned in each], X, outputs, WEIGHTS)
    for output, machine in enumerate(machines):
        alone = each[output].settings.fit(X, outputs[:, output], WEIGHTS)
        np.testing.assert_array_equal(machine(X), alone(X))
    assert machines[2].notes


def test_settings_for_each_output_must_be_as_many():
    with pytest.raises(ValueError, match="for each of its outputs, alike in kernel"):
        fit_each([LsSvmRegression()], X, Y)
    with pytest.raises(ValueError, match="alike in kernel"):
        fit_each([LsSvmRegression(), LsSvmRegression(kernel="linear")], X, Y)


def test_output_that_rests_in_a_part_is_tuned_on_all():
    burst = np.zeros(90)
    burst[[1, 2]] = 1.0, -1.0  # between the rows of a part of 30
    training = Training.of(X, burst, None, LsSvmRegression())
    assert training.part(30) is training
    assert len(Training.of(X, Y, None, LsSvmRegression()).part(30).samples.x) == 30


def test_finish_comes_to_the_minimum_from_a_wrong_curvature_and_at_a_bound():
    search = search_of(LsSvmRegression(), Y[:, 0])
    search.follow(np.array([3.0, 0.0]), 1e-6)
    least, at = search.best, search.at
    for curvature in (np.diag([1e-2, 1e-2]), np.diag([50.0, 50.0])):
        again = search_of(LsSvmRegression(), Y[:, 0])
        again.settle([at + [0.7, -0.3], at + [0.8, -0.3]], curvature, search)
        assert again.best == pytest.approx(least, abs=3e-3)
    again = search_of(LsSvmRegression(), Y[:, 0])
    again.bounds = [again.bounds[0], (again.bounds[1][0], at[1] - 0.2)]
    again.settle([at - [0.4, 0.3]], None, search)
    assert again.at[1] == pytest.approx(at[1] - 0.2, abs=1e-12)
    assert again(again.at, gradient=True)[1][0] == pytest.approx(0.0, abs=0.02)


def test_searches_need_something_to_spend():
    with pytest.raises(ValueError, match="at least one evaluation"):
        anneal(LsSvmRegression(), X, Y, np.random.default_rng(0), evaluations=0)
    with pytest.raises(ValueError, match="starts and evaluations from 1"):
        descend(LsSvmRegression(), X, Y, starts=0)
