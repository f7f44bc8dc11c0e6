"""Tests of fits, filters and free runs of a vehicle that passes the vertical, where Euler angles break down."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auv_gym.param import replace_at, value_at
from auv_gym.plant import Chart, Plant
from auv_gym.records.record import Record
from identification.fit.greybox import GreyBox, GreyBoxFit
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.shooting import Shooting
from identification.fit.validation import free_runs, joined_runs
from tests.identification.tumbler import ATTITUDE, DAMPING, NOISE, RATES, flown, tumbler

TRUE = tumbler()
PATHS = (*DAMPING, "hull.z_g")
WRONG = replace_at(TRUE, {path: 1.3 * value_at(TRUE, path) for path in DAMPING})
ALONG = Chart.along.__func__  # type: ignore[attr-defined]


def fitted(log: Record, plant: Plant = WRONG) -> GreyBoxFit:
    return GreyBox(plant, PATHS).fit(log)


@pytest.fixture(scope="module")
def logs() -> list[Record]:
    """Logs of attitude, without gyros, of a vehicle that passes the vertical repeatedly."""
    found = [flown(TRUE, seed, seconds=30.0).without(RATES) for seed in (1, 2, 3)]
    for log in found:
        assert np.mean(np.abs(log["pitch_rad"]) > 1.0) > 0.15
    return found


def forced(monkeypatch: pytest.MonkeyPatch, far: bool) -> None:
    monkeypatch.setattr(Chart, "along", classmethod(lambda cls, family, record: ALONG(cls, family, record, far)))


def test_parameters_are_recovered_through_the_vertical(logs):
    """For twelve 95 % intervals, the probability of more than three misses is 0.2 %."""
    misses = 0
    for log in logs:
        fit = fitted(log)
        misses += sum(not fit[p].ci95[0] < value_at(TRUE, p) < fit[p].ci95[1] for p in PATHS)
        for path in DAMPING:
            assert fit[path].value == pytest.approx(value_at(TRUE, path), rel=0.01)
        # four standard errors of 300 readings, and what fitted starts take
        assert fit.noise.measurement == pytest.approx(dict.fromkeys(ATTITUDE, NOISE), rel=0.2)
        assert not fit.noise.process
        assert list(fit.residual_rms.values()) == pytest.approx([NOISE] * 3, rel=0.25)
    assert misses <= 3


def test_a_compass_errs_about_the_vertical_and_an_inclinometer_about_level_axes():
    """This holds at any tilt; about body axes, the noise of each sensor would vary with the attitude."""
    true, rng, noise = flown(TRUE, 4, seconds=30.0, noise=0.0).without(RATES), np.random.default_rng(4), (0.3, 0.3, 1.5)
    attitude = Rotation.from_euler("ZYX", true.matrix(ATTITUDE[::-1]))
    heading = Rotation.from_euler("z", true.matrix(ATTITUDE[2:]))
    off = heading.apply(np.array(noise) * NOISE * rng.standard_normal((len(true), 3)))
    read = (Rotation.from_rotvec(off) * attitude).as_euler("ZYX")[:, ::-1]
    log = true.with_channels(dict(zip(ATTITUDE, read.T, strict=True)))
    problem = PredictionErrors(TRUE, log, [slice(0, len(log))], process=False)
    found = problem.noise_at(problem.solve(TRUE, ()))
    # four standard errors of 300 readings, and what fitted starts take
    wanted = dict(zip(ATTITUDE, NOISE * np.array(noise), strict=True))
    assert found.measurement == pytest.approx(wanted, rel=0.2)


@pytest.mark.slow
def test_euler_angles_would_not_do(logs, monkeypatch):
    forced(monkeypatch, False)
    fit = fitted(logs[0])
    assert max(fit.residual_rms.values()) > 20.0 * NOISE
    assert max(np.ptp(fit[path].ci95) / abs(value_at(TRUE, path)) for path in DAMPING) > 0.1


@pytest.fixture(scope="module")
def level() -> Record:
    """A log at any heading whose tilt stays within some hundredths of a radian."""
    log = flown(TRUE, 4, seconds=40.0, strength=0.005)
    assert not Chart.along(TRUE.family, log).on
    return log


@pytest.mark.slow
def test_near_level_a_chart_tells_what_euler_angles_tell(level, monkeypatch):
    """Turns about body axes differ from Euler angles by the first order of the tilt t.

    A row's readings differ by a share t of themselves.  With equal noise about all axes, the log-likelihood of a row
    changes by about t^2 for each of three channels only.  Scores change by a share t, so that estimates move by such a
    share of their standard errors.
    """
    plain = fitted(level)
    forced(monkeypatch, True)
    turned = fitted(level)
    assert turned.residual_rms != plain.residual_rms
    tilt = level["pitch_rad"] ** 2 + level["roll_rad"] ** 2
    assert turned.log_likelihood == pytest.approx(plain.log_likelihood, abs=3.0 * float(tilt.sum()))
    for path in PATHS:
        moved = abs(turned[path].value - plain[path].value)
        assert moved < 3.0 * float(np.sqrt(tilt.mean())) * plain[path].error
        assert turned[path].error == pytest.approx(plain[path].error, rel=3.0 * float(np.sqrt(tilt.mean())))


def test_slopes_by_starts_are_those_of_the_vehicle(logs):
    """The linearised filter passes from chart to chart like the vehicle, once its path has converged."""
    problem = PredictionErrors(TRUE, logs[0], [slice(0, 60)])
    point = problem.point(TRUE.vector, problem.first_noise())
    for _ in range(8):  # each leaves two thirds of the linearisation's error due to unmeasured speeds
        point = problem.point(TRUE.vector, point.logs, point)
    linear, _ = problem._starts_for_steps(point)
    vehicle, _ = problem._run_starts(point)
    for one, other in zip(linear, vehicle, strict=True):
        assert np.abs(one - other).max() < 5e-3 * np.abs(other).max()


def test_slopes_by_parameters_do_not_depend_on_their_step(logs):
    """Differences over a step and over a tenth of it agree, in the filter and in free runs: the vertical is no jump."""
    moves = [moves_of(PATHS), [(path, 0.1 * step) for path, step in moves_of(PATHS)]]
    problem = PredictionErrors(TRUE, logs[0], [slice(0, 200)])
    point = problem.point(TRUE.vector, problem.first_noise())
    filtered = [problem.columns_of(point, each) for each in moves]
    shooting = Shooting(TRUE, logs[0], logs[0].windows(5.0))
    begun = shooting.point(TRUE.vector, shooting.first_guess)
    free = [shooting._slopes(begun, PATHS, step)[0] for step in (1e-2, 1e-3)]
    for coarse, fine in (filtered, free):
        for one, other in zip(coarse, fine, strict=True):
            # the second derivative: a step is a hundredth of a scale, over which a run of 5 s is not quite linear
            assert np.abs(one - other).max() < 0.05 * np.abs(other).max()


def test_rates_are_first_guessed_from_turns(monkeypatch):
    """Without noise and gyros, they follow from the turn of the attitude over the first four samples."""
    log = flown(TRUE, 1, seconds=30.0, noise=0.0)
    told = log.without(RATES)
    rows = np.array([w.start for w in told.windows(1.0)])
    assert np.max(np.abs(log["pitch_rad"][rows])) > 1.2
    # the turn of three samples over their time
    between = np.stack([log.matrix(RATES)[rows + k] for k in range(4)])
    mean = np.trapezoid(between, dx=1.0 / 3.0, axis=0)

    def wrong() -> np.ndarray:
        states = TRUE.family.states
        return Shooting(TRUE, told, told.windows(1.0)).first_guess[:, [states.index(n) for n in RATES]] - mean

    # a least-squares slope weighs the turns of the four samples differently: 7 rad/s^2 times 0.1 s times 0.1
    by_turns = wrong()
    assert np.sqrt(np.mean(by_turns**2)) < 0.1
    forced(monkeypatch, False)
    assert np.sqrt(np.mean(wrong() ** 2)) > 10.0 * np.sqrt(np.mean(by_turns**2))


def test_noise_is_that_about_the_body_axes(logs):
    """In a chart all readings are zero, so that their noise is estimated from the turns between them."""
    problem = PredictionErrors(TRUE, logs[0], [slice(0, len(logs[0]))])
    assert np.nanmax(np.abs(problem.measured)) == 0.0
    assert problem.channels == ATTITUDE
    # 300 readings, and a vehicle whose rates change by 3 rad/s^2 within samples of 0.1 s
    assert problem.floors == pytest.approx([NOISE] * 3, rel=0.35)


def test_free_runs_tell_turns_and_show_angles(logs):
    log = logs[0]
    runs = free_runs(WRONG, log, log.windows(5.0), settle=1.0)
    angles = [runs.channels.index(name) for name in ATTITUDE]
    model, measured = runs.model[:, angles], log.matrix(ATTITUDE)[runs.rows]
    assert np.abs(model - measured).max() <= np.pi + 1e-9  # beside the log, row by row
    seen = Rotation.from_euler("ZYX", measured[:, ::-1])
    turn = Rotation.from_euler("ZYX", model[:, ::-1]).inv() * seen
    level = Rotation.from_euler("z", measured[:, 2:]).inv() * seen
    back = Rotation.from_rotvec(level.inv().apply(runs.residual[:, angles]))
    # a turn has the same vector seen from the measured or from the model's attitude
    assert (turn.inv() * back).magnitude().max() < 1e-9
    assert [runs.label(name) for name in ATTITUDE] == [
        "turn about the level axis ahead", "turn about the level axis to starboard", "turn about the vertical",
    ]  # fmt: skip
    scores = runs.scores(log)
    kept = runs.residual[runs.scored, runs.channels.index("pitch_rad")]
    assert scores["pitch_rad"].rmse == pytest.approx(float(np.sqrt(np.mean(kept**2))))
    assert all(s.r2 < 1.0 for s in scores.values())
    halves = [free_runs(WRONG, log, log.windows(5.0)[part], settle=1.0) for part in (slice(2, None), slice(0, 2))]
    joined = joined_runs(halves)
    assert joined.signals is not None
    assert np.array_equal(joined.signals, runs.signals)
    assert joined.scores(log)["roll_rad"].rmse == pytest.approx(scores["roll_rad"].rmse, rel=0.01)  # other starts
