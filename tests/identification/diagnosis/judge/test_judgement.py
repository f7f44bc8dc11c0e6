"""The verdict that follows from what was found and from what is left."""

from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.judge.judgement import disagrees, explained_share, verdict_of
from identification.fit.validation import whiteness

NAMED, TIED, WRONG = ["an effect"], [("an effect", "another")], True


@pytest.mark.parametrize(
    "effects, tied, explained, left, refit_is_all, wrong, verdict",
    [
        (NAMED, [], 0.9, False, False, False, "named"),
        (NAMED, TIED, 0.9, False, False, False, "tied"),
        (NAMED, [], 0.51, True, False, WRONG, "named"),
        (NAMED, TIED, 0.49, False, False, False, "unexplained"),
        ([], [], 0.0, False, True, False, "none"),
        ([], [], 0.9, False, True, WRONG, "coefficients"),
        ([], [], 0.9, True, True, WRONG, "unexplained"),
        ([], [], 0.0, True, True, False, "unexplained"),
    ],
)
def test_the_verdict(effects, tied, explained, left, refit_is_all, wrong, verdict):
    assert verdict_of(effects, tied, explained, left, refit_is_all, wrong) == verdict


def stage(residual):
    window = np.repeat(np.arange(len(residual) // 50), 50)
    runs = SimpleNamespace(
        residual=residual[:, None], scored=np.ones(len(residual), dtype=bool), channels=("a",), window=window
    )
    return SimpleNamespace(held=runs, fitted=runs, plant=None)


def test_white_noise_agrees_and_slow_noise_beyond_a_twentieth_of_it_does_not():
    rng, bench = np.random.default_rng(0), SimpleNamespace(steady=True)
    white, slow = rng.standard_normal(20_000), np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(20_000) / 50.0)
    assert not disagrees(stage(white), bench, (), 100.0)
    assert disagrees(stage(white + np.sqrt(0.1) * slow), bench, (), 100.0)
    little = stage(white + np.sqrt(0.02) * slow)
    assert whiteness(little.fitted.residual[:, 0], little.fitted.window).p_value < 1e-4
    assert not disagrees(little, bench, (), 100.0)


def test_the_share_explained_is_of_what_exceeds_the_noise():
    rng, bench = np.random.default_rng(1), SimpleNamespace(steady=True, held=SimpleNamespace(windows=range(20)))
    white, slow = rng.standard_normal(1000), 2.0 * np.sin(2.0 * np.pi * np.arange(1000) / 50.0)
    before, half, after = (stage(white + size * slow) for size in (1.0, np.sqrt(0.5), 0.0))
    assert explained_share(before, after, bench) > 0.9
    assert explained_share(before, half, bench) == pytest.approx(0.5, abs=0.05)  # of 1000 samples, at twice the noise
    assert explained_share(after, after, bench) == 0.0
