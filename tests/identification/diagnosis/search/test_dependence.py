"""Tests of whether random accelerations depend on a signal, and whether a clock's rate varies."""

from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym import load_vehicle
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import dependence as module
from identification.diagnosis.search.candidates import Regression
from identification.diagnosis.search.dependence import Dependence, clock_varies, dependence, laws_of, signals_of
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.heading_control import closed_loop
from identification.fit.prediction_errors import PredictionErrors
from scripts.blind.logs import Conditions
from scripts.blind.outside import glider_outside, slipped_clock
from scripts.blind.own_cruise import cruised

PLANT = load_vehicle("slocum")
CALM = Conditions(1.0, 1.0, 600.0)


def fitted(record):
    bench = Workbench(PLANT, record, parts_of(PLANT, record), 0.1)
    return bench, bench.fit(PLANT, PLANT.family.coefficients)


def drawn(cause, size, seed):
    return glider_outside(PLANT, cause, size, CALM, np.random.default_rng(seed), np.random.default_rng(seed))


@pytest.fixture(scope="module")
def clean():
    return fitted(drawn("", 1.0, 5))


@pytest.fixture(scope="module")
def lopsided():
    return fitted(drawn("side", 3.0, 5))


def test_an_actuator_that_is_stronger_to_one_side_shows_and_noise_does_not(clean, lopsided):
    found = dependence(*lopsided)
    assert found is not None
    assert (found.pushed, found.signal) in {("r_radps", "rudder_rad"), ("r_radps", "r_radps")}
    assert dependence(*clean) is None


@pytest.mark.slow
def test_the_level_is_shared_by_all_that_is_tried(clean, monkeypatch):
    """With `LEFT` at 2 something always shows; at its usual value, hardly anything does by chance."""
    with monkeypatch.context() as patched:
        patched.setattr(module, "LEFT", 2.0)
        assert dependence(*clean) is not None
    rng, false = np.random.default_rng(11), 0
    for _ in range(12):
        false += dependence(*fitted(closed_loop(PLANT, rng=rng, duration=600.0))) is not None
    assert false == 0  # 12 at 0.5 % each


def test_a_layer_between_two_depths_is_a_law():
    depth = np.abs(np.linspace(-80.0, 80.0, 400))
    layer = ((depth > 20.0) & (depth <= 50.0)).astype(float)
    present, _ = laws_of("depth_m", depth, np.arange(400) == 0, 8)
    assert any(np.array_equal(law, layer) for law in present)


def test_only_what_pushes_a_vehicle_with_many_states_is_asked_for(lopsided, monkeypatch):
    bench, state = lopsided
    monkeypatch.setattr(module, "FEW_STATES", 0)
    monkeypatch.setattr(bench.problem, "pushes", lambda point: np.array([False] * len(bench.problem.pushed)))
    assert dependence(bench, state) is None


def test_errors_that_are_merely_larger_at_times_show_nothing():
    """Evidence that assumes errors of one size would pass any bar: one row in twenty has ten times the deviation."""
    rng, rows, count, false = np.random.default_rng(0), 600, 300, 0
    larger = np.arange(rows) % 20 < 1
    bar = 10.8  # 0.1 % of chi-square
    for _ in range(count):
        regression = Regressed(rng.standard_normal(rows) * np.where(larger, 10.0, 1.0))
        (evidence,) = module._evidence(regression, larger.astype(float)[None] - larger.mean())[0]
        false += evidence > bar
    assert false <= 3


class Regressed:
    def __init__(self, errors):
        self.left, self.point = errors / errors.std(), None

    def beside(self, signatures):
        return signatures


@pytest.mark.parametrize("ahead, answers", [(2, True), (0, False), (-1, False)])
def test_commands_that_answer_pushes_are_told_from_those_that_push(ahead, answers):
    """A controller sees more than the log holds: its next command follows the push more closely than its last one."""
    rng, rows = np.random.default_rng(0), 2000
    command = np.convolve(rng.standard_normal(rows), np.ones(6) / 6.0, mode="same")
    problem = SimpleNamespace(
        plant=SimpleNamespace(inputs=("rudder_rad",)),
        stretch_of_row=np.repeat([0, 1], rows // 2),
        offsets=np.array([0, rows // 2]),
        pushed_by=lambda point, axis, laws: laws,
        slopes_by=lambda point, terms: terms,
        flattened=lambda slopes: slopes,
    )
    regression = Regressed(np.roll(command, -ahead) + rng.standard_normal(rows))
    evidence = float(module._evidence(regression, command[None])[0][0])

    def tried(signal):
        return module._Tried(Dependence("r_radps", signal, False), 0, command, evidence, command)

    assert module._answers(problem, regression, tried("rudder_rad")) is answers
    # the filter's own states contain no later push
    assert not module._answers(problem, regression, tried("heading_rad"))


def test_half_of_the_level_is_that_of_pushes_that_follow_what_they_push():
    def tried(signal, law):
        return module._Tried(Dependence("r_radps", signal, True), 0, law, 1.0, law)

    laws = np.eye(30)
    found = [*(tried("r_radps", law) for law in laws[:2]), *(tried("depth_m", law) for law in laws[2:])]
    shares = module._shared(found, 0.02)
    assert np.unique(shares[:2]).size == np.unique(shares[2:]).size == 1
    assert shares[0] == pytest.approx(0.005, rel=0.3)
    assert shares[-1] == pytest.approx(0.01 / 28, rel=0.5)


def test_a_law_that_answers_is_not_said(lopsided, monkeypatch):
    monkeypatch.setattr(module, "_answers", lambda *args: True)
    assert dependence(*lopsided) is None


def test_a_clock_whose_rate_varies_shows(clean):
    bench, state = clean
    assert not clock_varies(bench, state)
    record = slipped_clock(drawn("", 1.0, 5), 2.0, 90.0, np.random.default_rng(3))
    assert clock_varies(*fitted(record))


def test_slopes_by_a_law_are_those_of_an_effect_that_follows_it(clean):
    """The example is a yaw moment in the second half, as an acceleration and as the effect itself."""
    bench, state = clean
    problem, point = bench.problem, state.point
    later = (np.arange(len(problem.rows)) > len(problem.rows) // 2).astype(float)
    (pushed,) = problem.slopes_by(point, problem.pushed_by(point, problem.pushed.index("r_radps"), later[None]))
    (effect,) = problem.slopes_by(point, problem.partly(point, "effects.yaw.moment", later[None]))
    cosine = np.sum(pushed * effect) / np.sqrt(np.sum(pushed**2) * np.sum(effect**2))
    assert cosine > 0.999
    (whole,) = problem.slopes_by(point, problem.partly(point, "effects.yaw.moment", np.ones((1, len(problem.rows)))))
    known = problem.columns_of(point, [("effects.yaw.moment", 1e-4)])[0]
    np.testing.assert_allclose(whole, known, atol=1e-3 * np.abs(known).max())


def test_laws_of_a_signal():
    depth = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0])
    begins = np.zeros(13, dtype=bool)
    begins[0] = True
    switched = module._switched(depth, 0.5, 2.5, begins)
    assert switched.tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0]
    direction = module._direction(depth, begins)
    assert direction.tolist() == [0, 1, 1, 1, 1, -1, -1, -1, -1, 1, 1, -1, -1]
    begins[9] = True  # no memory across stretches
    assert module._direction(np.where(np.arange(13) == 9, 0.0, depth), begins)[9] == 0.0
    present, past = laws_of("depth_m", depth, begins, 4)
    assert {len(law) for law in (*present, *past)} == {13}
    assert past
    speed = depth - 2.0
    _, past = laws_of("u_mps", speed, begins, 4)  # a drag that depends on the past speed, in both directions
    assert np.array_equal(past[-1], speed * past[-2] / np.std(speed))
    assert np.unique(past[-2]).tolist() == [0.0, 1.0]
    around, nothing = laws_of("heading_rad", np.linspace(0.0, 20.0, 50), np.zeros(50, dtype=bool), 8)
    assert (len(around), nothing) == (6, [])


def test_signals_are_states_commands_and_the_time(clean):
    bench, state = clean
    names = set(signals_of(bench.problem, state.point))
    assert {"heading_rad", "r_radps", "rudder_rad", "time_s"} <= names


def test_a_push_that_follows_the_waves_of_other_velocities_follows_no_law():
    """Waves push all velocities together; the part of a law that these waves do not contain still counts."""
    plant = load_vehicle("vt690")
    record = cruised(plant, np.random.default_rng(1), duration=40.0)
    problem = PredictionErrors(plant, record, [slice(0, len(record))], stride=4)
    problem = problem.with_noises(problem.velocities, [], 6.0)
    logs, first = problem.first_noise(), len(problem.channels)
    logs[first : first + len(problem.pushed)] = np.log(0.5 * problem.unit)
    point = problem.point(plant.vector, logs)
    regression = Regression(problem, point, (), 0.0)
    axis = problem.pushed.index("v_mps")
    waves = module._by_other_waves(regression, axis)
    assert 0 < len(waves) <= 2 * (len(problem.velocities) - 1)

    def left_of(law: np.ndarray, *beside: np.ndarray) -> tuple[float, float]:
        """The evidence for a law, and the norm of the rest of its signature."""
        signature = problem.flattened(problem.slopes_by(point, problem.pushed_by(point, axis, law[None])))
        evidence, rest = module._evidence(regression, signature, *beside)
        return float(evidence[0]), float(np.linalg.norm(rest))

    states = point.path[:, -len(problem.pushed) :].T
    of_roll = problem.swells & np.array([name == "p_radps" for name in problem.pushed])
    in_phase, out_of_phase = states[of_roll]
    for law in (in_phase, out_of_phase, 0.6 * in_phase - 0.8 * out_of_phase):
        assert left_of(law)[1] > 0.1
        assert left_of(law, waves)[1] < 0.03
        assert left_of(law, waves)[0] < 0.01 * left_of(law)[0]
    steps = np.arange(len(problem.rows)) // 20 % 2 - 0.5
    assert left_of(steps, waves)[1] > 0.5 * left_of(steps)[1]


def test_waves_of_one_velocity_are_no_other_s(clean):
    bench, state = clean
    problem = bench.problem.with_noises(bench.problem.velocities, [], 14.0)
    logs, first = problem.first_noise(), len(problem.channels)
    logs[first : first + len(problem.pushed)] = np.log(0.5 * problem.unit)
    point = problem.point(state.point.vector, logs)
    assert problem.swelling(point).any()
    assert module._by_other_waves(Regression(problem, point, (), 0.0), 0).size == 0
