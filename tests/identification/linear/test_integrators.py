"""Tests of subspace methods on integrating outputs: a pole at exactly 1 by default, and no spurious drift."""

from dataclasses import replace

import numpy as np
import pytest

from identification.compare.comparison import compare_open
from identification.estimator import notes_of
from identification.identified import identify
from identification.linear.poles import pole_intervals
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from identification.linear.subspaces.refinement import candidate, local_directions, realisation_normal_equations
from tests.identification.linear.subspaces.test_long_predictor import (
    CHANNELS,
    SLOW,
    SUM,
    TWO,
    WALK,
    both,
    driven,
)
from tests.identification.linear.subspaces.test_refinement import between_scaled

METHODS = pytest.mark.parametrize("method", [N4sid, Pbsid])
DRIFT = 0.03  # rad a sample, a fifth of what an input does


@pytest.mark.slow
@METHODS
@pytest.mark.parametrize("model", [SUM, WALK], ids=["white", "walking"])
@pytest.mark.parametrize("refine", [False, True])
def test_an_integrating_output_gets_its_pole_and_no_drift(method, model, refine):
    fit = method(*CHANNELS, refine=refine).fit(driven(model, 300, 0, 0.1))
    assert 1.0 in fit.model.poles()
    assert fit.model.input_offset == pytest.approx(0.0, abs=1e-9)
    at_rest = fit.model.initial(np.array([2.0]))
    np.testing.assert_allclose(fit.model.step(at_rest, np.zeros(1)), at_rest, atol=1e-9)
    assert fit.parameters == fit.order * 3 - 2
    assert len(fit.estimates) == fit.order  # poles, and no gain
    said = "; ".join(notes_of(fit))
    for words in ("order 2", f"horizon of {fit.horizon} samples", "heading_rad integrates", "no drift at zero input"):
        assert words in said


@METHODS
def test_a_drift_is_fitted_where_it_shows(method):
    record = driven(SUM, 300, 0, 0.1, drift=DRIFT)
    fit = method(*CHANNELS).fit(record)
    assert 1.0 in fit.model.poles()
    # an input of 1 moves it by 0.2 + 0.6 * 0.3 / (1 - 0.7)
    assert fit.model.input_offset[0] == pytest.approx(-DRIFT / 0.8, rel=0.05)
    assert "a drift at zero input: the record shows one" in fit.notes


@pytest.mark.slow
def test_a_drift_is_seen_as_often_as_it_is_there():
    def share(model, drift):
        return np.mean([fit_of(model, seed, drift).centre.rest is None for seed in range(10)])

    def fit_of(model, seed, drift):
        return N4sid(*CHANNELS, order=2, horizon=10).fit(driven(model, 200, seed, 0.1, drift))

    for model in (SUM, WALK):
        assert share(model, 0.0) == 0.0
        assert share(model, 0.3 * DRIFT) == 1.0


@METHODS
@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_a_slow_output_keeps_its_pole(method, noise):
    for seed in range(3):
        fit = method(*CHANNELS).fit(driven(SLOW, 500, seed, noise))
        assert fit.model.is_stable()
        assert fit.centre.integrators == 0
        assert fit.model.poles()[0].real == pytest.approx(0.98, abs=0.02)
        assert "no output integrates" in "; ".join(fit.notes)


def test_the_integrating_one_of_two_outputs_is_named():
    fit = N4sid(*TWO).fit(driven(both(SLOW, SUM), 500, 0, 0.1))
    assert fit.integrating == ("depth_m",)
    assert "one pole fixed at 1: depth_m integrates, by a unit-root test" in fit.notes
    fit = N4sid(*TWO).fit(driven(both(WALK, SUM), 500, 0, 0.1))
    assert fit.integrating == TWO[1]
    assert sum(abs(fit.model.poles() - 1.0) < 1e-12) == 2
    assert "2 poles fixed at 1: heading_rad and depth_m integrate, by a unit-root test" in fit.notes


@METHODS
def test_settings_given_by_hand_are_kept(method):
    record = driven(SUM, 300, 0, 0.1)
    free = method(*CHANNELS, order=2, horizon=8, integrators=0, offset=True).fit(record)
    assert (free.notes, free.horizon, free.order) == ((), 8, 2)
    assert 0.0 < abs(free.model.poles()[0] - 1.0) < 0.02
    drifting = method(*CHANNELS, integrators=1, offset=True).fit(record)
    assert drifting.centre.integrators == 1
    assert drifting.model.input_offset[0] != pytest.approx(0.0, abs=1e-9)
    forced = method(*CHANNELS, integrators=1).fit(driven(SLOW, 300, 0, 0.1))
    assert 1.0 in forced.model.poles()
    about_zero = method(*CHANNELS, offset=False).fit(record)
    assert 1.0 in about_zero.model.poles()
    assert not about_zero.model.input_offset.any()
    assert method(*CHANNELS, stable=True).fit(record).model.is_stable()


def test_free_runs_over_other_inputs_stay_with_the_output():
    """With a pole nearly at 1, an output far from where the record was drifts off: a heading from another start."""
    test = driven(SUM, 600, 100, 0.0)
    test = test.with_channels({"heading_rad": test["heading_rad"] + 20.0})
    for seed in range(4):
        record = driven(SUM, 300, seed, 0.3)
        fits = {"auto": N4sid(*CHANNELS), "free": N4sid(*CHANNELS, integrators=0, offset=True)}
        run = compare_open({name: method.fit(record).model for name, method in fits.items()}, test)
        scores = {name: run.scores[name]["heading_rad"].fit_percent for name in fits}
        assert scores["auto"] > 95.0
        assert scores["free"] < scores["auto"]


def test_a_record_too_short_to_refine_shows_no_drift():
    """Order 2 with an integrator has 8 free numbers and 2 of its start, for which 20 samples are too few."""
    settings = {"order": 2, "horizon": 3, "integrators": 1}
    fits = [Pbsid(*CHANNELS, **settings).fit(driven(SUM, n, 0, 0.1, drift=DRIFT)) for n in (70, 18)]
    assert [fit.centre.rest is None for fit in fits] == [True, False]


def scaled_of(fit, scaled):
    """The model of a fit between scaled signals."""
    found = between_scaled(fit.model, scaled)
    return replace(found, integrators=fit.centre.integrators, rest=fit.centre.rest)


@pytest.mark.parametrize("resting", [True, False])
def test_a_refinement_keeps_what_is_fixed_and_moves_the_rest(resting):
    record = driven(WALK, 200, 0, 0.3, drift=0.0 if resting else DRIFT)
    settings = {"order": 2, "integrators": 1, "offset": "auto"}
    fit = N4sid(*CHANNELS, refine=True, **settings).fit(record)
    assert (fit.centre.rest is not None) == resting
    np.testing.assert_array_equal(fit.model.a[0], [1.0, 0.0])
    directions = local_directions(fit.centre, True)
    # n (m + 2 p), a level, less the pole and, where it rests, the drift
    assert directions.shape[1] == 2 * 3 + 1 - 1 - resting
    assert not directions[:2].any()
    # other coordinates of the states, those that keep the sum a sum, are not among them
    turn = np.array([[1.0 + 1e-6, 0.0], [2e-6, 1.0 - 1e-6]])
    back = np.linalg.inv(turn)
    a, b, c, k, drift, level = fit.centre.parts
    parts = (turn @ a @ back, turn @ b, c @ back, turn @ k, turn @ drift, level)
    change = np.concatenate([part.ravel() for part in parts]) - fit.centre.vector
    assert np.abs(directions.T @ change).max() < 1e-5 * np.abs(change).max()
    assert fit.noise[0, 0] <= 1.01 * N4sid(*CHANNELS, **settings).fit(record).noise[0, 0]
    fixed, other = pole_intervals(fit)
    assert fixed.fixed
    assert fixed.value == 1.0
    assert other.real.ci95[0] < 0.7 < other.real.ci95[1]


def test_slopes_beside_an_integrator_are_those_of_finite_differences():
    record = driven(WALK, 60, 0, 0.3)
    scaled = Scaled.of(Series.of([record], *CHANNELS, "test"), True, "test")
    found = scaled_of(N4sid(*CHANNELS, order=2, horizon=5, integrators=1).fit(record), scaled)
    directions, start, step = local_directions(found, True), np.ones((1, 2)), 1e-6
    slopes = realisation_normal_equations(candidate(found, start, scaled), scaled, directions, np.eye(1))

    def errors(change, start_change):
        return candidate(found.at(found.vector + directions @ change), start + start_change, scaled).errors

    count = directions.shape[1]
    moves = step * np.eye(count + 2)
    columns = np.array([(errors(d[:count], d[count:]) - errors(-d[:count], -d[count:])) / (2 * step) for d in moves])
    full = columns[:, :, 0] @ columns[:, :, 0].T
    reduced = full[:count, :count] - full[count:, :count].T @ np.linalg.solve(
        full[count:, count:], full[count:, :count]
    )
    # differences over 1e-6 keep nine digits, and their squares as many
    np.testing.assert_allclose(slopes.matrix, reduced, atol=1e-7 * np.abs(reduced).max())


def test_identify_says_what_was_chosen():
    done = identify(N4sid(*CHANNELS), [driven(SUM, 450, 0, 0.2)])
    assert done.fit.centre.integrators == 1
    assert any("heading_rad integrates" in note for note in notes_of(done.fit))
    assert done.open_loop.scores["model"]["heading_rad"].fit_percent > 95.0


@pytest.mark.slow
def test_intervals_beside_an_integrator_hold_the_truth_as_often_as_they_say():
    hits = []
    for seed in range(300):
        fit = Pbsid(*CHANNELS, order=2, refine=True).fit(driven(WALK, 600, seed, 0.3))
        pole = pole_intervals(fit)[-1].real.ci95
        hits.append(fit.centre.integrators == 1 and pole[0] <= 0.7 <= pole[1])
    assert 0.91 < np.mean(hits) < 0.985  # three standard deviations of 300 trials at 0.95
