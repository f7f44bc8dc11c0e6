"""What holds for the fit of every linear method: its attributes, its model as a Model, in files, in environments."""

from functools import cache

import gymnasium
import numpy as np
import pytest

from auv_gym.model import Model, predict, simulate
from auv_gym.models.files import load_model, save_model
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.models.spliced import splice
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.estimator import make_estimator
from identification.experiments.excitation import prbs
from identification.linear.fit import LinearFit, is_linear
from identification.linear.polynomials.output_error import OutputError

# of remus100 at cruise, roughly: what it is does not matter here, but an environment has to be able to step it
INPUTS, OUTPUTS, DT = ("rudder_rad", "stern_plane_rad"), ("q_radps", "r_radps"), 0.2
TRUTH = Polynomial.from_coefficients(
    a={"q_radps": [-1.5, 0.56], "r_radps": [-1.4, 0.48]},
    b={"q_radps": {"stern_plane_rad": [-0.05, -0.02]}, "r_radps": {"rudder_rad": [-0.06, -0.01]}},
    dt=DT,
    inputs=INPUTS,
)
SETTINGS = {
    "arx": {},
    "els": {"n_c": 1},
    "armax": {"n_c": 1},
    "output_error": {},
    "n4sid": {"order": 4},
    "n4sid refined": {"order": 4, "refine": True},
    "pbsid": {"order": 4},
    "pbsid refined": {"order": 4, "refine": True},
}


def record(seed, n=400, noise=0.002, start=0.0):
    """A record of the truth from a state of size `start`, with PRBS inputs and a white error in its equations."""
    rng = np.random.default_rng(seed)
    state = TRUTH.state_space
    u = np.stack([prbs(n, 3, 0.15, rng) for _ in INPUTS], axis=1)
    e, y = noise * rng.standard_normal((n, len(OUTPUTS))), np.empty((n, len(OUTPUTS)))
    x = start * rng.standard_normal(len(state.states))
    for k in range(n):
        y[k] = state.c @ x + e[k]
        x = state.step(x, u[k]) + state.k @ e[k]
    columns = dict(zip((*INPUTS, *OUTPUTS), np.concatenate([u, y], axis=1).T, strict=True))
    return Record.from_arrays(DT * np.arange(n), columns)


def estimator(method, **settings):
    return make_estimator(method.split()[0], {**SETTINGS[method], **settings}, inputs=INPUTS, outputs=OUTPUTS)


@cache
def fitted(method):
    return estimator(method).fit(record(1))


@pytest.fixture(params=SETTINGS)
def method(request):
    return request.param


@pytest.fixture
def fit(method):
    return fitted(method)


def response(model):
    """From a slow to the fastest frequency, (n, p, m)."""
    state = model.state_space if isinstance(model, Polynomial) else model
    return state.frequency_response(np.array([0.3, 1.0, 3.0, 10.0, np.pi / DT]))


def test_it_has_what_every_linear_fit_has(method, fit):
    p, n = len(OUTPUTS), fit.vector.size
    assert isinstance(fit, LinearFit)
    assert is_linear(fit)
    assert isinstance(fit.model, Model)
    assert (fit.model.inputs, fit.model.outputs, fit.model.dt) == (INPUTS, OUTPUTS, DT)
    assert fit.vector.shape == (n,)
    assert fit.covariance.shape == (n, n)
    np.testing.assert_allclose(fit.covariance, fit.covariance.T, rtol=1e-6, atol=1e-15)
    assert fit.noise.shape == (p, p)
    assert np.linalg.eigvalsh(fit.noise).min() > 0.0
    assert fit.loss.shape == (p,)
    least = 0.0018  # of an error of 0.002 in the equations, which is larger in free runs
    assert np.sqrt(fit.loss).min() > least
    assert np.sqrt(np.diag(fit.noise)).min() > least
    if not isinstance(estimator(method), OutputError):
        assert np.sqrt(fit.loss).max() < 0.0022
        assert np.sqrt(np.diag(fit.noise)).max() < 0.0022
    assert 0 < fit.parameters <= n
    assert 0 < fit.freedom < fit.samples <= 400 * p
    assert len({e.path for e in fit.estimates}) == len(fit.estimates) > 0
    for e in fit.estimates:
        assert np.isfinite(e.value)
        assert e.ci95[0] <= e.value <= e.ci95[1]
        assert fit[e.path] is e or fit[e.path] == e


def test_at_its_own_vector_it_is_its_model_and_moves_smoothly_from_there(fit):
    np.testing.assert_allclose(response(fit.at(fit.vector)), response(fit.model), rtol=1e-8)
    step = 1e-6 * (np.abs(fit.vector) + 1e-3) * np.random.default_rng(0).standard_normal(fit.vector.size)
    there, back, here = (response(fit.at(fit.vector + s * step)) for s in (1.0, -1.0, 0.0))
    change = np.abs(there - back).max()
    assert change > 0.0
    assert np.abs(there + back - 2.0 * here).max() < 1e-3 * change
    assert fit.at(fit.vector + step).dt == fit.model.dt


def test_its_model_runs_free_and_ahead(fit):
    fresh = record(2)
    free, ahead = simulate(fit.model, fresh), predict(fit.model, fresh)
    for name in OUTPUTS:
        spread = fresh[name].std()
        assert np.std(free[name] - fresh[name]) < 0.25 * spread
        assert np.std(ahead[name][10:] - fresh[name][10:]) < 0.2 * spread


def test_its_model_is_written_and_read_back(fit, tmp_path):
    save_model(fit.model, tmp_path / "model.npz")
    again = load_model(tmp_path / "model.npz")
    assert type(again) is type(fit.model)
    run, same = simulate(fit.model, record(2)), simulate(again, record(2))
    for name in OUTPUTS:
        np.testing.assert_array_equal(same[name], run[name])


def test_its_model_goes_to_python_control_and_back(fit):
    pytest.importorskip("control", reason="the extra `control` is not installed")
    again = type(fit.model).from_control(fit.model.to_control())
    assert isinstance(again, Polynomial | StateSpace)
    assert (again.inputs, again.outputs, again.dt) == (INPUTS, OUTPUTS, DT)
    np.testing.assert_allclose(response(again), response(fit.model), rtol=1e-6)


@pytest.mark.slow
def test_its_model_drives_the_channels_that_it_has_in_an_environment(fit):
    plant = load_vehicle("remus100", dt=DT)
    env = gymnasium.make("auv_gym/Heading-v0", vehicle="remus100", dt=DT, model=splice(plant, fit.model))
    env.reset(seed=0)
    readings = []
    for _ in range(20):
        _, _, cut, _, info = env.step(np.ones(env.action_space.shape, dtype=np.float32))
        assert not cut
        readings.append(info["state"]["r_radps"])
    assert np.ptp(readings) > 0.01
    with pytest.raises(ValueError, match=r"0\.2 s.*0\.1 s"):
        gymnasium.make("auv_gym/Heading-v0", vehicle="remus100", dt=0.1, model=fit.model)


def test_records_have_each_a_start_of_their_own(method):
    parts = [record(seed, noise=1e-5, start=1.0) for seed in (3, 4)]
    assert np.ptp([part["q_radps"][0] for part in parts]) > 0.1  # a jump of this size is in no equation
    both = estimator(method).fit(*parts)
    wanted = response(TRUTH)
    np.testing.assert_allclose(response(both.model), wanted, atol=1e-3 * np.abs(wanted).max())
    assert both.samples > 1.9 * fitted(method).samples
