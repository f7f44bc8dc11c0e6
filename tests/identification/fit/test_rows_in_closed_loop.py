"""Tests of averaging in closed loop: commands that react within a row mislead fits, and rows are then shorter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import searching, workbench
from identification.diagnosis.search.dependence import Dependence
from identification.diagnosis.search.known import Known
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.workbench import Workbench
from identification.fit import greybox, strides
from identification.fit.greybox import GreyBox
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.strides import in_suited_rows

DT, ROWS, STRIDE = 0.1, 3000, 10  # s
PUSH, LASTING, QUICK = 2e-3, 2.0, 10.0  # rad/s^2, s; s, of the loop
GLIDER = replace(load_vehicle("slocum"), dt=DT, window=60.0)
PATHS = ("hull.n_r", "hull.n_delta")


def log_of(seed: int, gain: float, rudder: np.ndarray | None = None) -> Record:
    """A glider under random yaw accelerations, with a rudder that reacts to each gyro reading, or is replayed."""
    rng, x = np.random.default_rng(seed), GLIDER.initial(np.full(len(GLIDER.outputs), np.nan))
    at, moved = GLIDER.family.states.index("r_radps"), GLIDER.inputs.index("rudder_rad")
    seen = [GLIDER.outputs.index(name) for name in ("heading_rad", "r_radps")]
    inputs, readings = np.zeros((ROWS, len(GLIDER.inputs))), np.empty((ROWS, 2))
    inputs[:, GLIDER.inputs.index("u_mps")] = 0.5
    wanted = np.repeat(rng.uniform(-0.2, 0.2, ROWS // 50), 50)
    decay, pushed = np.exp(-DT / LASTING), PUSH * rng.standard_normal()
    for k in range(ROWS):
        readings[k] = GLIDER.output(x)[seen] + np.array([0.01, 0.001]) * rng.standard_normal(2)
        steered = np.clip(wanted[k] - gain * readings[k, 1], -0.4, 0.4)
        inputs[k, moved] = steered if rudder is None else rudder[k]
        x[at] += 0.5 * DT * pushed
        x = GLIDER.step(x, inputs[k])
        x[at] += 0.5 * DT * pushed
        pushed = decay * pushed + PUSH * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    channels = {"rudder_rad": inputs[:, moved], "u_mps": inputs[:, GLIDER.inputs.index("u_mps")]}
    read = dict(zip(("heading_rad", "r_radps"), readings.T, strict=True))
    return Record.from_arrays(DT * np.arange(ROWS), channels | read)


def problem_of(record: Record, stride: int = STRIDE) -> PredictionErrors:
    return PredictionErrors(GLIDER, record, [slice(0, ROWS)], stride=stride)


@pytest.fixture(scope="module")
def steered() -> Record:
    return log_of(1, QUICK)


def test_rows_are_shorter_where_commands_answer_within_them(steered):
    problem = problem_of(steered)
    point = problem.solve(GLIDER, PATHS)
    shorter = in_suited_rows(problem, point, PATHS)
    assert shorter.stride < STRIDE
    assert in_suited_rows(shorter, shorter.solve(GLIDER, PATHS), PATHS) is shorter
    assert in_suited_rows(problem, point, ()) is problem  # without fitted parameters, nothing can be misled


def test_the_same_commands_mislead_nothing_where_they_answer_nothing(steered):
    problem = problem_of(log_of(50, 0.0, rudder=steered["rudder_rad"]))
    assert in_suited_rows(problem, problem.solve(GLIDER, PATHS), PATHS) is problem


def test_a_long_record_keeps_rows_that_a_fit_can_get_through(steered, monkeypatch):
    problem = problem_of(steered)
    point = problem.solve(GLIDER, PATHS)
    monkeypatch.setattr(strides, "MOST_ROWS", ROWS // STRIDE)
    assert in_suited_rows(problem, point, PATHS) is problem


@pytest.mark.parametrize(
    "rows, stride, shortest", [(3000, 3, True), (2000, 5, False), (1000, 5, False), (9000, 1, False)]
)
def test_rows_of_a_long_record_are_known_to_be_the_shortest(rows, stride, shortest):
    """The records have 9000, 10,000, 5000 and 9000 samples; only the first is in its shortest rows, at most 3000."""
    problem = SimpleNamespace(rows=np.arange(rows), stride=stride)
    assert strides.cannot_be_shorter(problem) is shortest  # type: ignore[arg-type]


def test_a_problem_in_other_rows_is_the_one_made_so(steered):
    problem = problem_of(steered).with_noises([0], [1], 12.0)
    other, made = problem.in_rows_of(2), problem_of(steered, 2).with_noises([0], [1], 12.0)
    assert other.stride == 2
    assert other.pushed == made.pushed
    logs = made.first_noise()
    assert other.objective(other.point(GLIDER.vector, logs), ()) == pytest.approx(
        made.objective(made.point(GLIDER.vector, logs), ()), abs=0.05
    )


def test_a_grey_box_is_not_misled(monkeypatch):
    monkeypatch.setattr(greybox, "stride_for", lambda *_, **__: STRIDE)
    logs = [log_of(seed, QUICK) for seed in range(4, 8)]

    def off() -> float:
        """The mean error of the rudder effectiveness, in standard errors."""
        found = [GreyBox(GLIDER, free=PATHS).fit(log).estimates[1] for log in logs]
        return sum((one.value - value_at(GLIDER, one.path)) / one.error for one in found) / len(logs)

    assert abs(off()) < 1.0  # two standard errors of the mean
    monkeypatch.setattr(greybox, "in_suited_rows", lambda problem, *_: problem)
    assert off() < -1.4


@pytest.fixture
def known(monkeypatch) -> Known:
    monkeypatch.setattr(workbench, "stride_for", lambda *_, **__: STRIDE)
    log = log_of(5, QUICK)
    bench = Workbench(GLIDER, log, parts_of(GLIDER, log), 0.1)
    given = bench.fit(GLIDER, ())
    return Known(bench, PATHS, given, bench.fit(GLIDER, PATHS, given))


@pytest.mark.parametrize(
    "signal, left, stride",
    [("rudder_rad", Left(), 1), ("rudder_rad", Left(bursts=("r_radps",)), STRIDE), ("heading_rad", Left(), STRIDE)],
)
def test_what_seems_to_depend_on_commands_must_do_so_in_single_readings(known, monkeypatch, signal, left, stride):
    asked = []
    monkeypatch.setattr(searching, "what_is_left", lambda bench, _: asked.append(bench) or left)
    seen = Left(depends=Dependence("r_radps", signal, remembers=True))
    found = searching._in_single_readings(known, known.nominal, seen)
    assert found.bench.problem.stride == stride
    assert [bench.problem.stride for bench in asked] == ([1] if signal == "rudder_rad" else [])


def test_a_search_is_repeated_in_shorter_rows(known):
    suited = known.suited_to(known.nominal)
    assert suited.bench.problem.stride < STRIDE
    assert len(suited.bench.block_of_row) == len(suited.bench.problem.rows)
    assert suited.nominal.plant != known.nominal.plant
    assert suited.suited_to(suited.nominal) is suited
