"""The study of feedback: a truth that is known, verdicts on small samples, and at full length what is biased by it."""

import json

import numpy as np
import pytest

from auv_gym.model import predict
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.long_predictor import LongPredictor
from scripts.closed_loop_study import (
    EXCITATION,
    NOISE,
    OMEGA,
    ORDER,
    PITCH,
    PLANE,
    Errors,
    as_json,
    attempt,
    draw,
    main,
    methods,
    pitch_pid,
    quantities,
    response_grid,
    simulated,
    study,
    truth,
    verdicts,
)


def test_the_true_predictor_leaves_the_noise_alone():
    true = truth()
    for loop in ("closed", "open"):
        record = simulated(3, 2000, loop)
        left = (record[PITCH] - predict(true, record)[PITCH])[50:]
        assert left.std() == pytest.approx(NOISE, rel=0.06)
        assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.08


def test_feedback_moves_the_plane_with_the_disturbance():
    closed, opened = simulated(3, 2000, "closed"), simulated(3, 2000, "open")
    assert np.ptp(opened[PLANE]) == pytest.approx(2.0 * EXCITATION)
    fed_back = closed[PLANE] - opened[PLANE]
    assert fed_back.std() > 0.4 * EXCITATION
    pid = pitch_pid()
    assert np.corrcoef(fed_back[10:], -closed[PITCH][10:])[0, 1] * np.sign(pid.proportional) > 0.5


def test_n4sid_is_biased_in_closed_loop_and_others_are_not():
    found = study(range(8), [2000], loops=("closed",), chosen=("n4sid", "pbsid", "armax"))
    of = found["closed", 2000]
    assert of["n4sid"].biased
    assert not of["pbsid"].biased
    assert not of["armax"].biased
    assert np.abs(of["n4sid"].bias).max() > 5.0 * np.abs(of["armax"].bias).max()
    lines = verdicts(found)
    assert lines[0].startswith("closed loop, 2000 samples, armax: none seen")
    assert "n4sid: biased (t = " in lines[1]


def test_no_integrator_is_made_of_the_controllers():
    """The integral of the PID puts the pitch's level into the plane, so that a long predictor needs none."""
    misled = 0
    for seed in range(4):
        record = simulated(seed, 2000)
        fit = methods()["pbsid"].fit(record)
        assert fit.centre.integrators == 0
        scaled = Scaled.of(Series.of([record], (PLANE,), (PITCH,), "test"), True, "test")
        misled += LongPredictor.of(scaled, fit.horizon).integrators
    assert misled >= 2


def test_n4sid_has_no_bias_in_open_loop():
    assert not study(range(8), [1000], loops=("open",), chosen=("n4sid",))["open", 1000]["n4sid"].biased


def test_a_vehicle_that_is_unstable_is_refused():
    with pytest.raises(ValueError, match="remus100' is unstable by itself"):
        study(range(2), [500], vehicle="remus100", loops=("open",))
    with pytest.raises(ValueError, match=r"tuned for 0.1 s, do not hold its pitch at samples of 0.5 s"):
        study(range(2), [500], vehicle="remus100")


def test_errors_are_those_of_the_truth():
    by_method = attempt(0, [600, 900], chosen=("arx",))
    assert list(by_method) == [600, 900]
    assert list(by_method[600]) == ["arx"]
    values, responses = (np.asarray(part) for part in by_method[900]["arx"])
    assert values.shape == (len(quantities(truth())),) == (ORDER + 2 * len(OMEGA),)
    assert responses.shape == response_grid().shape
    assert np.abs(responses).max() < 1.0


def _errors(rng, bias, seeds=20):
    count = len(quantities(truth()))
    values = 0.01 * rng.standard_normal((seeds, count)) + bias
    return Errors(values, 0.01 * rng.standard_normal((seeds, response_grid().size)) + bias + 0j)


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


def test_figures_and_numbers_are_written(tmp_path):
    rng = np.random.default_rng(1)
    found = {("closed", 500): {name: _errors(rng, 0.03 * (name == "n4sid")) for name in ("n4sid", "armax")}}
    paths = draw(found, "heu_torpedo", tmp_path)
    assert [path.name for path in paths] == ["closed_loop_heu_torpedo.png"]
    assert paths[0].read_bytes()[:4] == b"\x89PNG"
    told = as_json(found)["loops"]["closed"]["500"]
    assert told["n4sid"]["biased"]
    assert not told["armax"]["biased"]
    assert set(told["n4sid"]["quantities"]) == set(quantities(truth()))


def test_the_program_prints_verdicts_or_json(monkeypatch, capsys):
    def made(seed, samples, loop, vehicle, chosen):
        error = _errors(np.random.default_rng(seed), 0.05, 1)
        return {n: {"n4sid": (error.values[0], error.responses[0]), "arx": "too short"} for n in samples}

    monkeypatch.setattr("scripts.closed_loop_study.attempt", made)
    given = ["--seeds", "9", "--samples", "500"]
    assert main(given) == 0
    printed = capsys.readouterr().out
    assert "closed loop, 500 samples, n4sid: biased" in printed
    assert "open loop, 500 samples, arx: refused (too short)" in printed
    assert main([*given, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["loops"]
    assert told["open"]["500"]["arx"]["refused"] == 9
    assert main(["--seeds", "1"]) == 1
    assert "at least 2" in capsys.readouterr().err


@pytest.mark.slow
def test_feedback_biases_subspaces_and_fixed_noise_models_alone():
    found = study(range(50), [2000, 8000], jobs=2)
    closed, opened = found["closed", 8000], found["open", 8000]
    assert {name for name, errors in closed.items() if errors.biased} == {"arx", "output_error", "n4sid"}
    assert not any(opened[name].biased for name in ("n4sid", "armax", "pbsid"))
    shorter = found["closed", 2000]["n4sid"]
    assert np.abs(closed["n4sid"].t).max() > 1.5 * np.abs(shorter.t).max()
    assert closed["n4sid"].error.max() < shorter.error.max()
