"""Tests of refinement by prediction errors: correct slopes, decreasing losses, and intervals with correct coverage."""

import numpy as np
import pytest

from auv_gym.models.linear import StateSpace
from auv_gym.records.record import Record
from identification.linear.fit import LinearFit, has_errors
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces import refinement
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from identification.linear.subspaces.realisation import Realisation
from identification.linear.subspaces.refinement import (
    candidate,
    local_directions,
    realisation_normal_equations,
    refined,
)

CHANNELS = (("rudder_rad", "stern_plane_rad"), ("r_radps", "q_radps"))
TRUTH = StateSpace(
    a=np.array([[0.9, 0.2, 0.0], [-0.2, 0.85, 0.05], [0.0, 0.0, 0.6]]),
    b=np.array([[0.5, 0.0], [0.1, 0.4], [0.0, 1.0]]),
    c=np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -0.5]]),
    k=np.array([[0.3, 0.1], [-0.1, 0.3], [0.1, 0.1]]),
    inputs=CHANNELS[0],
    outputs=CHANNELS[1],
    dt=1.0,
    input_offset=np.array([0.2, -0.1]),
    output_offset=np.array([0.5, 1.0]),
)
NOISE = np.array([[0.2, 0.0], [0.1, 0.2]])  # its square root


def record_of(n, rng, segments=1):
    labels = np.repeat(np.arange(segments), n // segments)
    u = np.repeat(rng.choice([-1.0, 1.0], (labels.size // 2 + 1, 2)), 2, axis=0)[: labels.size] + TRUTH.input_offset
    y = np.empty((labels.size, 2))
    for s in range(segments):
        x = rng.standard_normal(3)
        for t in np.flatnonzero(labels == s):
            e = NOISE @ rng.standard_normal(2)
            y[t] = TRUTH.output(x) + e
            x = TRUTH.step(x, u[t]) + TRUTH.k @ e
    columns = dict(zip((*CHANNELS[0], *CHANNELS[1]), np.hstack([u, y]).T))
    return Record.from_arrays(np.arange(labels.size, dtype=float), columns, labels)


def problem(n=60, segments=2, offset=True):
    series = Series.of([record_of(n, np.random.default_rng(0), segments)], *CHANNELS, "refine")
    scaled = Scaled.of(series, offset, "refine")
    return series, scaled, between_scaled(TRUTH, scaled)


def between_scaled(model, scaled):
    """A model between scaled signals."""
    return Realisation(
        model.a,
        model.b * scaled.input_spread,
        model.c / scaled.output_spread[:, None],
        model.k * scaled.output_spread,
        model.b @ (scaled.input_middle - model.input_offset),
        (model.output_offset - scaled.output_middle) / scaled.output_spread,
    )


@pytest.mark.parametrize("offset", [True, False])
def test_slopes_are_those_of_finite_differences(offset):
    _, scaled, found = problem(offset=offset)
    starts = np.random.default_rng(1).standard_normal((2, 3))
    here, weight = candidate(found, starts, scaled), np.array([[2.0, 0.3], [0.3, 1.0]])
    directions = local_directions(found, offset)
    assert directions.shape[1] == 3 * (2 + 4) + (2 if offset else 0)
    slopes = realisation_normal_equations(here, scaled, directions, weight)

    def errors(change, start_change):
        moved = found.at(found.vector + directions @ change)
        return candidate(moved, starts + start_change.reshape(2, 3), scaled).errors

    size, step = directions.shape[1], 1e-6
    moves = step * np.eye(size + 6)
    columns = np.array([(errors(d[:size], d[size:]) - errors(-d[:size], -d[size:])) / (2.0 * step) for d in moves])
    full = np.einsum("jto,op,ktp->jk", columns, weight, columns)
    pull = np.einsum("jto,op,tp->j", columns, weight, here.errors)
    own, mixed = full[size:, size:], full[size:, :size]
    reduced = full[:size, :size] - mixed.T @ np.linalg.solve(own, mixed)
    scale = np.abs(reduced).max()
    # differences over 1e-6 keep nine digits, and their squares as many
    np.testing.assert_allclose(slopes.matrix, reduced, atol=1e-7 * scale)
    gradient = pull[:size] - mixed.T @ np.linalg.solve(own, pull[size:])
    np.testing.assert_allclose(slopes.gradient, gradient, atol=1e-6 * np.abs(pull).max())


def test_local_directions_cross_those_of_another_choice_of_states():
    _, _, found = problem()
    directions = local_directions(found, True)
    turn = np.eye(3) + 1e-6 * np.random.default_rng(0).standard_normal((3, 3))
    back = np.linalg.inv(turn)
    parts = (turn @ found.a @ back, turn @ found.b, found.c @ back, turn @ found.k, turn @ found.drift, found.level)
    change = np.concatenate([part.ravel() for part in parts]) - found.vector
    assert np.abs(directions.T @ change).max() < 1e-5 * np.abs(change).max()
    np.testing.assert_allclose(directions.T @ directions, np.eye(directions.shape[1]), atol=1e-12)


def test_compiled_and_plain_slopes_agree(monkeypatch):
    _, scaled, found = problem()
    directions = local_directions(found, True)

    def slopes():
        return realisation_normal_equations(candidate(found, np.ones((2, 3)), scaled), scaled, directions)

    as_is = slopes()
    for name in ("_states", "_slopes"):
        function = getattr(refinement, name)
        monkeypatch.setattr(refinement, name, getattr(function, "py_func", function))
    plain = slopes()
    np.testing.assert_allclose(as_is.matrix, plain.matrix, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(as_is.gradient, plain.gradient, rtol=1e-12, atol=1e-9)


def test_the_loss_falls_to_the_same_place_from_two_starts():
    record = record_of(1200, np.random.default_rng(1), segments=3)
    rough = [method(*CHANNELS, order=3).fit(record) for method in (N4sid, Pbsid)]
    fine = [method(*CHANNELS, order=3, refine=True).fit(record) for method in (N4sid, Pbsid)]
    determinants = [np.linalg.det(fit.noise) for fit in (*rough, *fine)]
    assert max(determinants[2:]) < 1.02 * min(determinants[:2])  # over more rows, the first of each segment too
    assert determinants[2] == pytest.approx(determinants[3], rel=1e-6)
    np.testing.assert_allclose(np.sort(fine[0].model.poles()), np.sort(fine[1].model.poles()), atol=1e-4)
    assert fine[0].singular_values.size
    assert fine[0].iterations > 0
    assert fine[0].samples == 2 * 1200
    assert isinstance(fine[0], LinearFit)
    assert has_errors(fine[0])


def test_refining_a_given_model_needs_no_subspace_fit():
    record = record_of(600, np.random.default_rng(2))
    rough = N4sid(*CHANNELS, order=3).fit(record)
    series = Series.of([record], *CHANNELS, "refine")
    scaled = Scaled.of(series, True, "refine")
    fit = refined(series, scaled, between_scaled(rough.model, scaled))
    same = N4sid(*CHANNELS, order=3, refine=True).fit(record)
    np.testing.assert_allclose(fit.loss, same.loss, rtol=1e-5)
    np.testing.assert_allclose(fit.at(fit.vector).a, fit.model.a)
    np.testing.assert_allclose(fit.at(fit.vector).input_offset, fit.model.input_offset, atol=1e-9)


def test_states_chosen_otherwise_change_no_interval():
    series, scaled, found = problem(400, 1)
    turn = np.array([[1.0, 0.4, 0.0], [-0.3, 2.0, 0.1], [0.0, 0.2, 0.5]])
    back = np.linalg.inv(turn)
    other = type(found)(
        turn @ found.a @ back, turn @ found.b, found.c @ back, turn @ found.k, turn @ found.drift, found.level
    )
    one, two = refined(series, scaled, found), refined(series, scaled, other)
    for estimate, same in zip(one.estimates, two.estimates, strict=True):
        assert estimate.path == same.path
        assert estimate.value == pytest.approx(same.value, abs=0.02 * estimate.error)  # where each descent ended
        assert estimate.error == pytest.approx(same.error, rel=0.02)


def inside(seeds, samples):
    """How often poles and gains lie within their intervals, by name."""
    true = {
        f"gain[{o}, {i}]": TRUTH.dc_gain()[r, c] for r, o in enumerate(CHANNELS[1]) for c, i in enumerate(CHANNELS[0])
    }
    pair, single = TRUTH.poles()[np.argmax(TRUTH.poles().imag)], TRUTH.poles()[-1].real
    true |= {"pole 1 (real)": pair.real, "pole 1 (imaginary)": pair.imag, "pole 2": single}
    hits = []
    for seed in seeds:
        fit = Pbsid(*CHANNELS, order=3, refine=True).fit(record_of(samples, np.random.default_rng(seed)))
        hits.append([e.ci95[0] <= true[e.path] <= e.ci95[1] for e in fit.estimates])
        assert len(fit.estimates) == len(true)
    return dict(zip((e.path for e in fit.estimates), np.mean(hits, axis=0)))


def test_intervals_hold_the_truth():
    share = inside(range(16), 400)
    assert 0.85 < np.mean(list(share.values())) < 1.0  # 112 trials, those of a fit together


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    for name, share in inside(range(500), 1000).items():
        assert 0.92 < share < 0.98, name  # three standard deviations of 500 trials at 0.95


def test_too_few_samples_are_refused():
    series, scaled, found = problem(20, 2)
    with pytest.raises(ValueError, match="record longer, or lower order"):
        refined(series, scaled, found)
