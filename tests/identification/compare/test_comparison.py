"""Comparison of models with a record: starts, scores, and horizons."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.channels import wrap
from auv_gym.model import predict, simulate
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from controllers.pid import heading_pid
from identification.compare.closed_loop import compare_closed
from identification.compare.comparison import compare_open, fitted_starts, horizon_sweep
from identification.experiments.excitation import prbs
from identification.experiments.heading_control import closed_loop
from identification.linear.polynomials.arx import Arx
from identification.recursive.diving_model import DivingModel
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of


@pytest.fixture(scope="module")
def record() -> Record:
    """Segments that begin in mid-motion, without noise."""
    u = record_of(TRUTH, 240, np.random.default_rng(0), segments=3)
    model, rng, y = TRUTH.state_space, np.random.default_rng(1), np.empty((240, 2))
    for part in u.segments:
        x = rng.normal(size=len(model.states))
        for k in range(part.start, part.stop):
            y[k] = model.output(x)
            x = model.step(x, u.matrix(INPUTS)[k])
    return u.with_channels(dict(zip(OUTPUTS, y.T)))


class StepOnly:
    """A model without `run`, as a user may write one; not known to be linear."""

    def __init__(self, model):
        self.inputs, self.outputs, self.states, self.dt = model.inputs, model.outputs, model.states, model.dt
        self.initial, self.step, self.output, self.correct = model.initial, model.step, model.output, model.correct


def test_a_true_model_meets_a_record_that_begins_in_mid_motion(record):
    exact = compare_open({"truth": TRUTH, "same, stepped": StepOnly(TRUTH.state_space)}, record)
    assert not exact.failed
    assert len(exact.windows) == 3
    spread = {name: np.ptp(record[name]) for name in OUTPUTS}
    for name, scores in exact.scores.items():
        for channel, found in scores.items():
            assert found.rmse < 1e-6 * spread[channel], (name, channel)
    # `initial` knows the outputs alone and starts at rest
    at_rest = simulate(TRUTH, record)["pitch_rad"] - record["pitch_rad"]
    assert np.abs(at_rest).max() > 0.01 * spread["pitch_rad"]


def test_all_models_are_scored_on_the_same_samples(record):
    wrong = replace(TRUTH, b=1.1 * TRUTH.b)
    open_loop = compare_open({"truth": TRUTH, "wrong": wrong}, record, settle=100.0)
    assert open_loop.settle == 100.0
    masks = [run.scored for run in open_loop.runs.values()]
    assert np.array_equal(*masks)
    assert masks[0].sum() == 3 * (80 - 25)  # 100 s at 4 s a sample
    assert open_loop.scores["wrong"]["depth_m"].samples == 165
    assert open_loop.scores["wrong"]["depth_m"].fit_percent < 99.0 < open_loop.scores["truth"]["depth_m"].fit_percent
    cut = compare_open({"truth": TRUTH}, record, window=160.0)
    assert len(cut.windows) == 6
    shown = open_loop.shown("wrong")
    assert len(shown.segments) == 3
    run = open_loop.runs["wrong"]
    np.testing.assert_allclose(shown["depth_m"], run.model[:, run.channels.index("depth_m")])
    np.testing.assert_array_equal(open_loop.shown()["depth_m"], record["depth_m"])


def test_missing_samples_and_channels_that_were_not_measured(record):
    gone = record["depth_m"].copy()
    gone[5:40] = np.nan
    held = record.without(["depth_m"]).with_channels({"altitude_m": gone})
    model = replace(TRUTH, outputs=("altitude_m", "pitch_rad"))
    found = compare_open({"truth": model}, held).scores["truth"]
    assert found["altitude_m"].samples < found["pitch_rad"].samples
    assert found["altitude_m"].rmse < 1e-6
    only = compare_open({"truth": TRUTH}, record.without(["depth_m"])).scores["truth"]
    assert list(only) == ["pitch_rad"]


def test_headings_are_compared_from_the_turn_that_they_start_in():
    model = Polynomial.from_coefficients(
        a={"heading_rad": [-1.8, 0.8]}, b={"heading_rad": {"rudder_rad": [0.4, 0.2]}}, dt=1.0
    )
    record = record_of(model, 200, np.random.default_rng(0), segments=2, start=1.0)
    turned = record.with_channels({"heading_rad": record["heading_rad"] + 4.0 * np.pi * (record.time > 99.5)})
    assert compare_open({"truth": model}, turned).scores["truth"]["heading_rad"].rmse < 1e-6
    short = record.with_channels({"heading_rad": wrap(record["heading_rad"])}).between(0.0, 20.0)
    assert np.isfinite(fitted_starts(model, short, short.segments)).all()


def test_a_model_that_diverges_does_not_spoil_the_others(record):
    # the largest double is reached within the record
    wild = StateSpace(
        a=np.array([[1e8]]), b=np.ones((1, 2)), c=np.ones((1, 1)), inputs=INPUTS, outputs=("depth_m",), dt=4
    )
    found = compare_open({"wild": wild, "truth": TRUTH}, record)
    assert "diverged" in found.failed["wild"]
    assert list(found.scores) == ["truth"]


def test_what_cannot_be_compared_is_refused_by_name(record):
    other = replace(TRUTH, dt=2.0)
    with pytest.raises(ValueError, match=r"Model 'slow': .*2 s at a time.*record\.resample\(2\)"):
        compare_open({"truth": TRUTH, "slow": other}, record)
    with pytest.raises(ValueError, match=r"Model 'truth' needs the inputs .* lacks bow_plane_rad"):
        compare_open({"truth": TRUTH}, record.without(["bow_plane_rad"]))
    with pytest.raises(ValueError, match=r"Model 'truth' gives depth_m, pitch_rad, and the record has none"):
        compare_open({"truth": TRUTH}, record.without(OUTPUTS))
    with pytest.raises(ValueError, match="at least one model"):
        compare_open({}, record)
    with pytest.raises(ValueError, match="shorter settle"):
        compare_open({"truth": TRUTH}, record, settle=1000.0)
    with pytest.raises(ValueError, match="shorter windows"):
        compare_open({"truth": TRUTH}, record, window=1e4)


def test_a_vehicle_and_a_linear_model_share_the_vehicle_s_windows():
    plant = load_vehicle("slocum")
    log = closed_loop(plant, rng=np.random.default_rng(0), duration=400.0, track_noise=None)
    log = log.without(["u_mps", "roll_rad", "pitch_rad", "depth_m"])
    from identification.linear.polynomials.arx import Arx

    models = {"vehicle": plant, "arx": Arx(("rudder_rad",), ("heading_rad",), n_a=2, n_b=1).fit(log).model}
    found = compare_open(models, log)
    assert found.settle == plant.settle
    assert len(found.windows) == 3  # of 120 s
    assert np.array_equal(found.runs["vehicle"].rows, found.runs["arx"].rows)
    for scores in found.scores.values():
        assert scores["heading_rad"].rmse < 0.35 * np.std(log["heading_rad"])


def test_a_diving_model_starts_from_its_first_samples():
    model = DivingModel(0.1, 0.0, 0.0, 0.0, 0.05, dt=1.0)
    piston = prbs(120, 10, 0.02, np.random.default_rng(0))
    record = Record.from_arrays(np.arange(120.0), {"piston_m": piston})
    depth = model.run(record, record.segments, np.array([[30.0, 0.2, 0.0, 0.0]]))[:, 0]
    found = compare_open({"float": model}, record.with_channels({"depth_m": depth}), settle=20.0)
    assert found.scores["float"]["depth_m"].rmse < 1e-9
    assert found.scores["float"]["depth_m"].samples == 100


def test_a_horizon_sweep_is_what_predict_gives(record):
    noisy = record.with_channels({n: record[n] + 0.05 * np.random.default_rng(3).standard_normal(240) for n in OUTPUTS})
    swept = horizon_sweep(TRUTH, noisy, [1, 4, 9], settle=24.0)
    for horizon in (1, 4, 9):
        residual = predict(TRUTH, noisy, horizon)["depth_m"] - noisy["depth_m"]
        # origins from the 7th sample of a segment on, as long as the longest horizon lies in it
        rows = np.concatenate([np.arange(s.start + 6 + horizon, s.stop - 9 + horizon) for s in noisy.segments])
        assert swept["depth_m"][horizon] == pytest.approx(np.sqrt(np.mean(residual[rows] ** 2)), rel=0.05)
    whole = horizon_sweep(TRUTH, noisy.between(0.0, 319.0), [1, 4, 9], settle=24.0)
    residual = predict(TRUTH, noisy, 4)["depth_m"] - noisy["depth_m"]
    assert whole["depth_m"][4] == pytest.approx(np.sqrt(np.mean(residual[6 + 4 : 80 - 9 + 4] ** 2)), rel=1e-9)
    with pytest.raises(ValueError, match="longer than every segment"):
        horizon_sweep(TRUTH, record, [80])
    with pytest.raises(ValueError, match="at least 1 sample"):
        horizon_sweep(TRUTH, record, [0])


def test_a_fit_is_no_model():
    plant = load_vehicle("slocum")
    log = closed_loop(plant, rng=np.random.default_rng(0))
    fit = Arx(["rudder_rad"], ["heading_rad"]).fit(log)
    for compare in (
        lambda: compare_open({"a": fit}, log),
        lambda: compare_closed(lambda model: None, heading_pid(plant), {"a": fit}, seed=4),
    ):
        with pytest.raises(
            ValueError, match=r"A comparison with 'a' needs a model, .*: give the fit's model, fit.model"
        ):
            compare()
    with pytest.raises(ValueError, match="horizon_sweep needs a list of horizons of at least 1 sample, got 1"):
        horizon_sweep(plant, log, 1)
