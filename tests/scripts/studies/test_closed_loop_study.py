"""The study of feedback: a truth that is known, verdicts on small samples, and at full length what is biased by it."""

import numpy as np
import pytest

from auv_gym.model import predict
from scripts.studies.closed_loop import (
    EXCITATION,
    NOISE,
    PITCH,
    PLANE,
    STUDY,
    Errors,
    errors_by_method,
    quantities,
    simulated,
    truth,
)


def test_the_true_predictor_leaves_the_noise_alone():
    closed, opened = simulated(3, 2000, "closed"), simulated(3, 2000, "open")
    for record in (closed, opened):
        left = (record[PITCH] - predict(truth(), record)[PITCH])[50:]
        assert left.std() == pytest.approx(NOISE, rel=0.06)
        assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.08
    assert np.ptp(opened[PLANE]) == pytest.approx(2.0 * EXCITATION)
    assert (closed[PLANE] - opened[PLANE]).std() > 0.4 * EXCITATION  # what the disturbance feeds back


def test_n4sid_is_biased_in_closed_loop_and_others_are_not(tmp_path):
    methods = ["armax", "n4sid", "pbsid"]
    given = ["--seeds", "8", "--samples", "2000", "--loop", "closed", "--methods", *methods, "--out", str(tmp_path)]
    assert STUDY.main(given) == 0
    assert (tmp_path / "closed_loop_heu_torpedo.png").read_bytes()[:4] == b"\x89PNG"
    found = STUDY.find(range(8), ["closed"], out=tmp_path, samples=[2000], methods=methods)  # all of it is kept
    of = errors_by_method(found)["closed", 2000]
    assert [name for name in methods if of[name].biased] == ["n4sid"]
    assert np.abs(of["n4sid"].bias).max() > 5.0 * np.abs(of["armax"].bias).max()
    rows = {row[0]: row for row in STUDY.sheets(found)[0].rows}
    assert [rows[name][-1] for name in methods] == ["none seen", "yes", "none seen"]
    surest = max(range(len(of["n4sid"].t)), key=lambda i: abs(of["n4sid"].t[i]))
    assert f"{of['n4sid'].t[surest]:.1f}" in rows["n4sid"]


def test_a_vehicle_that_is_unstable_is_refused_and_so_is_one_seed(capsys):
    assert STUDY.main(["--seeds", "1", "--samples", "300", "--loop", "closed", "--methods", "arx"]) == 1
    assert "Scatter needs --seeds of at least 2, got 1 in closed loop" in capsys.readouterr().err
    with pytest.raises(ValueError, match="remus100' is unstable by itself"):
        STUDY.find(range(2), ["open"], samples=[500], vehicle="remus100")
    with pytest.raises(ValueError, match=r"tuned for 0.1 s, do not hold its pitch at samples of 0.5 s"):
        STUDY.find(range(2), ["closed"], samples=[500], vehicle="remus100")


def _errors(rng, bias, seeds=20):
    values = 0.01 * rng.standard_normal((seeds, len(quantities(truth())))) + bias
    return Errors(values, np.zeros((seeds, 1)))


def test_a_bias_is_told_from_scatter_and_from_what_does_not_matter():
    rng = np.random.default_rng(0)
    assert not _errors(rng, 0.0).biased
    small = _errors(rng, 0.008, 2000)
    assert np.abs(small.t).max() > 20.0
    assert not small.biased
    sure = _errors(rng, 0.03)
    assert sure.biased
    assert sure.bias == pytest.approx(np.full(sure.bias.size, 0.03), abs=0.01)
    assert np.all(sure.least < np.abs(sure.bias))
    assert np.all(sure.rms > np.abs(sure.bias))


@pytest.mark.slow
def test_feedback_biases_subspaces_and_fixed_noise_models_alone():
    found = errors_by_method(STUDY.find(range(50), jobs=2))
    closed, opened = found["closed", 8000], found["open", 8000]
    assert {name for name, errors in closed.items() if errors.biased} == {"arx", "output_error", "n4sid"}
    assert not any(opened[name].biased for name in ("n4sid", "armax", "pbsid"))
    shorter = found["closed", 2000]["n4sid"]
    assert np.abs(closed["n4sid"].t).max() > 1.5 * np.abs(shorter.t).max()
    assert closed["n4sid"].error.max() < shorter.error.max()
