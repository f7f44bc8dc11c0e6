"""Tests of the verdict that follows from the found effects and from the remainder."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from auv_gym.param import replace_at
from identification.deciding import LEFT, UNSTEADY
from identification.diagnosis.judge.effects import Effect
from identification.diagnosis.judge.explained import (
    explained_share,
    many_windows,
    verdict_of,
)
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.dependence import Dependence
from identification.diagnosis.search.remainder import Left, comes_in_bursts, what_is_left
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from identification.fit import coloured
from identification.fit.coloured import is_coloured
from identification.fit.validation import FreeRuns, whiteness
from tests.identification.diagnosis.stand_ins import point_of
from tests.identification.gliders import QUICK

OFFSET = Effect("effects.rudder.offset", "rudder offset", 0.1, 0.0, "rad", (0.0, 0.2), 50.0, 40.0)
CHANGES = replace(OFFSET, path="effects.yaw.moment", steady=0.5 * UNSTEADY)
NAMED, TIED, WRONG = [OFFSET], [("an effect", "another")], True


@pytest.mark.parametrize(
    "effects, tied, explained, left, refit_is_all, wrong, verdict",
    [
        (NAMED, [], 0.9, False, False, False, "named"),
        (NAMED, TIED, 0.9, False, False, False, "tied"),
        (NAMED, [], 0.51, True, False, WRONG, "named"),
        (NAMED, [], 0.49, True, False, False, "unexplained"),
        (NAMED, TIED, 0.49, False, False, False, "tied"),
        ([OFFSET, CHANGES], TIED, 0.99, False, False, False, "unexplained"),  # a constant effect explains no change
        ([], [], 0.0, False, True, False, "none"),
        ([], [], 0.9, False, True, WRONG, "coefficients"),
        ([], [], 0.9, True, True, WRONG, "unexplained"),
        ([], [], 0.0, True, True, False, "unexplained"),
    ],
)
def test_the_verdict(effects, tied, explained, left, refit_is_all, wrong, verdict):
    assert verdict_of(effects, tied, explained, left, refit_is_all, wrong) == verdict


def white_and_slow(seed: int = 0, count: int = 20_000) -> tuple[np.ndarray, np.ndarray]:
    """White noise, and a slow signal of the same variance."""
    slow = np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(count) / 50.0)
    return np.random.default_rng(seed).standard_normal(count), slow


def test_white_errors_leave_nothing_and_slow_ones_beyond_a_trace_do():
    (white, slow), stretch = white_and_slow(), np.repeat(np.arange(400), 50)
    none = np.zeros((white.size, 0))
    assert not is_coloured(white, stretch, none, LEFT)
    assert is_coloured(white + np.sqrt(0.1) * slow, stretch, none, LEFT)
    little = white + np.sqrt(0.02) * slow
    assert whiteness(little, stretch).p_value < 1e-4  # significant, but predicts next to nothing
    assert not is_coloured(little, stretch, none, LEFT)


def test_bursts_are_told_from_steady_noise_from_wild_readings_and_from_a_trace():
    (white, slow), stretch = white_and_slow(), np.repeat(np.arange(400), 50)
    assert not comes_in_bursts(white, stretch, LEFT)
    assert comes_in_bursts(white * (1.0 + 0.5 * slow), stretch, LEFT)
    assert not comes_in_bursts(white * (1.0 + 0.1 * slow), stretch, LEFT)  # significant, but predicts next to nothing
    wild = white.copy()
    wild[100:110] *= 100.0
    assert not comes_in_bursts(wild, stretch, LEFT)


@pytest.mark.slow
def test_white_errors_are_flagged_as_seldom_as_is_said():
    """Of 2000 records of 500 readings, at most as many are flagged as chance exceeds once in 10,000 such tests."""
    rng, stretch, none, count = np.random.default_rng(3), np.repeat(np.arange(5), 100), np.zeros((500, 0)), 2000
    records = rng.standard_normal((count, 500))
    coloured = sum(is_coloured(errors, stretch, none, LEFT) for errors in records)
    bursts = sum(comes_in_bursts(errors, stretch, LEFT) for errors in records)
    assert 0 < coloured <= binom.isf(1e-4, count, LEFT)
    assert 0 < bursts <= binom.isf(1e-4, count, LEFT)


def nothing(point) -> np.ndarray:
    """An empty basis: the initial states were not fitted, and imitate nothing."""
    return np.zeros((point.errors.size, 0))


@pytest.mark.parametrize("channels, flagged", [(1, True), (2, False)])
def test_channels_share_the_probability_of_a_false_flag(channels, flagged, monkeypatch):
    near = SimpleNamespace(p_value=0.7 * LEFT, correlation=np.full(15, 0.1))
    monkeypatch.setattr(coloured, "whiteness", lambda *_, **__: near)
    names, shape = tuple("abc"[:channels]), (100, channels)
    problem = SimpleNamespace(
        channels=names,
        stretch_of_row=np.zeros(100, dtype=int),
        finite=np.ones(shape, dtype=bool),
        start_basis=nothing,
        steps_of_readings=np.zeros(channels),
    )
    bench = SimpleNamespace(problem=problem)
    errors = np.random.default_rng(4).standard_normal(shape)
    state = SimpleNamespace(point=point_of(np.zeros(100), errors=errors), paths=())
    assert bool(what_is_left(bench, state)) is flagged


def test_what_is_left_is_said_by_channel():
    (white, slow), stretch = white_and_slow(), np.repeat(np.arange(400), 50)
    seen = np.ones((20_000, 2), dtype=bool)
    names = ("depth_m", "heading_rad")
    problem = SimpleNamespace(
        channels=names, stretch_of_row=stretch, finite=seen, start_basis=nothing, steps_of_readings=np.zeros(2)
    )
    errors = np.stack([white, white + slow], axis=1)
    bench = SimpleNamespace(problem=problem)
    state = SimpleNamespace(point=point_of(np.zeros(20_000), errors=errors), paths=())
    found = what_is_left(bench, state)
    assert found == Left(("heading_rad",))
    assert found
    assert not Left()
    assert Left(depends=Dependence("r_radps", "heading_rad", False))


def test_a_filter_that_is_lost_leaves_everything():
    bench = SimpleNamespace(problem=SimpleNamespace(channels=("depth_m", "heading_rad")))
    state = SimpleNamespace(point=point_of(np.full(50, -np.inf)), paths=())
    assert what_is_left(bench, state) == Left(("depth_m", "heading_rad"))


def test_errors_that_come_in_bursts_are_left():
    (white, slow), stretch = white_and_slow(), np.repeat(np.arange(400), 50)
    seen = np.ones((20_000, 1), dtype=bool)
    problem = SimpleNamespace(
        channels=("r_radps",), stretch_of_row=stretch, finite=seen, start_basis=nothing, steps_of_readings=np.zeros(1)
    )
    bench = SimpleNamespace(problem=problem)
    errors = (white * (1.0 + 0.5 * slow))[:, None]
    state = SimpleNamespace(point=point_of(np.zeros(20_000), errors=errors), paths=())
    assert what_is_left(bench, state) == Left(bursts=("r_radps",))


def test_colour_is_that_from_reading_to_reading():
    """The depth is read every fifth row: over that many rows, its errors would look white."""
    white, slow = white_and_slow()
    errors, seen = np.zeros((100_000, 1)), np.zeros((100_000, 1), dtype=bool)
    errors[::5, 0], seen[::5] = white + np.sqrt(0.05) * slow, True
    stretch = np.repeat(np.arange(200), 500)
    problem = SimpleNamespace(
        channels=("depth_m",), stretch_of_row=stretch, finite=seen, start_basis=nothing, steps_of_readings=np.zeros(1)
    )
    bench = SimpleNamespace(problem=problem)
    state = SimpleNamespace(point=point_of(np.zeros(100_000), errors=errors), paths=())
    assert what_is_left(bench, state) == Left(("depth_m",))


def test_pushes_that_follow_the_vehicles_motion_are_left_although_the_errors_are_white():
    """Process noise absorbs an unknown moment, and the errors are white; the dependence shows that it is not random."""
    plant, term = QUICK, "effects.discovered.yaw.sin_2heading"
    left = {}
    for size in (0.0, 0.02):
        record = run_mission(replace_at(plant, term, size), np.random.default_rng(2), duration=900.0)
        bench = Workbench(plant, record, parts_of(plant, record), 0.1)
        state = bench.fit(plant, plant.family.coefficients)
        left[size] = what_is_left(bench, state)
        assert ("r_radps" in bench.problem.noise_at(state.point).process) == (size > 0.0)
    assert left == {0.0: Left(), 0.02: Left(depends=Dependence("r_radps", "heading_rad", False))}


def stage(residual, readings=None):
    window, rows = np.repeat(np.arange(len(residual) // 50), 50), np.arange(len(residual))
    scored, errors = np.ones(len(residual), dtype=bool), residual[:, None]
    held = None if readings is None else readings[:, None]
    runs = FreeRuns(("a",), rows, window, errors, errors, scored, held)
    return SimpleNamespace(unseen=runs, fitted=runs, plant=None)


def test_noise_that_is_interpolated_is_none_that_an_effect_could_remove():
    """The channel is read every fourth row: interpolated noise looks smooth, and makes the noise floor too low."""
    rows = np.arange(2000)
    white, slow = white_and_slow(1, 2000)
    noise = np.interp(rows, rows[::4], white[::4])
    before, after = noise + 2.0 * slow, noise
    assert explained_share(stage(before), stage(after), True) < 0.9
    told = rows % 4 == 0
    assert explained_share(stage(before, told), stage(after, told), True) > 0.97


def test_the_share_explained_is_of_what_exceeds_the_noise():
    white, slow = white_and_slow(1, 1000)
    before, half, after = (stage(white + size * slow) for size in (np.sqrt(2.0), 1.0, 0.0))
    assert explained_share(before, after, True) > 0.9
    assert explained_share(before, half, True) == pytest.approx(0.5, abs=0.05)  # from 1000 samples, at twice the noise
    assert explained_share(after, after, True) == 0.0


def test_few_windows_leave_the_share_to_runs_fitted_to_all():
    white, slow = white_and_slow(1, 1000)
    (before, after), other = (stage(white + size * slow) for size in (1.0, 0.0)), stage(white + 3.0 * slow)
    after = SimpleNamespace(unseen=other.unseen, fitted=after.fitted)
    assert explained_share(before, after, False) > 0.9
    assert explained_share(before, after, True) < 0.0
    eight = [slice(k, k + 1) for k in range(8)]
    assert many_windows(eight, True)
    assert not many_windows(eight, False)
    assert not many_windows(eight[:7], True)
