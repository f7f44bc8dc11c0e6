"""Tests of states with one unknown value in each dive: recovered with correct intervals."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.checking import Asked, check_log
from identification.fit.greybox import GreyBox
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.shooting import Shooting, unknown_states
from identification.fit.windows import free_run_windows, stretches_of

DRAG, OFFSET = "hull.drag_quadratic", "effects.volume.offset"
TRUTH = {DRAG: 280.0, "effects.volume.compressibility": 1e-7}
VOLUMES = np.array([-3e-5, -1e-5, -2.2e-5, -4e-5])
ROWS = 60


def dives(seed: int = 0, noise: float = 0.3, volumes=VOLUMES, truth=TRUTH) -> Record:
    """Measured depths of dives with these unknown volumes; the valve and the pump act once in each.  noise: m."""
    k, count = np.arange(ROWS), len(volumes)
    valved, pumped = 2e-5 * (k >= 18), 8e-5 * (k >= 38)
    channels = {"oil_volume_m3": pumped - valved, "pumped_volume_m3": pumped, "valved_volume_m3": valved}
    record = Record.from_arrays(
        np.tile(100.0 * k, count),
        {name: np.tile(values, count) for name, values in channels.items()},
        segment=np.repeat(np.arange(count), ROWS),
    )
    starts = np.array([[100.0 + 20.0 * i, 0.03, volume] for i, volume in enumerate(volumes)])
    depth = replace_at(load_vehicle("mermaid"), truth).run(record, record.segments, starts)[:, 0]
    return record.with_channels({"depth_m": depth + noise * np.random.default_rng(seed).standard_normal(depth.size)})


def shooting(record: Record) -> Shooting:
    plant = load_vehicle("mermaid")
    return Shooting(plant, record, free_run_windows(plant, record, plant.window))


def by_dive(plant, record: Record) -> np.ndarray:
    """The volumes at the starts of free runs over the windows, (dives, windows in each)."""
    return shooting(record).solve(plant, ()).starts[:, 2].reshape(len(VOLUMES), -1)


def test_a_vehicle_says_whether_its_dives_have_volumes_of_their_own():
    mermaid = load_vehicle("mermaid")
    assert unknown_states(mermaid) == {"volume_m3": OFFSET}
    assert unknown_states(replace_at(mermaid, "hull.trim_known", 1.0)) == {}
    assert unknown_states(load_vehicle("qiandao_float")) == {}
    assert unknown_states(load_vehicle("slocum")) == {}


def test_exact_dives_give_each_its_volume_and_the_drag():
    log = dives(noise=0.0)
    fit = GreyBox(load_vehicle("mermaid"), list(TRUTH)).fit(log)
    for path, value in TRUTH.items():
        assert value_at(fit.model, path) == pytest.approx(value, rel=1e-5)
    # the same volume in the three windows of a dive, and another one in each dive
    volumes = by_dive(replace_at(load_vehicle("mermaid"), TRUTH), log)
    assert volumes == pytest.approx(np.tile(VOLUMES[:, None], 3), abs=1e-10)
    assert np.array_equal(np.ptp(volumes, axis=1), np.zeros(4))


def test_the_first_guess_of_the_volumes_needs_no_right_drag():
    """It uses a few samples of each dive, in which a quarter more drag matters little; it is coarse but in order."""
    problem = shooting(dives(noise=0.0))
    guess = problem.first_guess[:, 2].reshape(4, 3)
    assert np.array_equal(np.ptp(guess, axis=1), np.zeros(4))
    assert np.argsort(guess[:, 0]).tolist() == np.argsort(VOLUMES).tolist()
    assert guess[:, 0] == pytest.approx(VOLUMES, abs=2e-5)


@pytest.mark.slow
def test_intervals_hold_the_truth_where_each_dive_has_an_unknown_volume():
    hits, values, errors = np.zeros(2), [], []
    for seed in range(20):
        fit = GreyBox(load_vehicle("mermaid"), list(TRUTH)).fit(dives(seed))
        hits += [fit[path].ci95[0] <= value <= fit[path].ci95[1] for path, value in TRUTH.items()]
        values.append([fit[path].value for path in TRUTH])
        errors.append([fit[path].error for path in TRUTH])
    # at 95 % fewer than 16 hits of 20 have a probability of 0.3 %
    assert np.all(hits >= 16), hits
    # a standard deviation from 20 draws has an error of 16 %
    assert np.std(values, axis=0) / np.mean(errors, axis=0) == pytest.approx([1.0, 1.0], abs=0.4)


def test_an_offset_of_all_dives_cannot_be_told_from_their_volumes():
    fit = GreyBox(load_vehicle("mermaid"), [DRAG, OFFSET]).fit(dives(truth={}))
    assert not fit[OFFSET].identifiable
    assert "initial states" in fit[OFFSET].problem
    assert fit[DRAG].identifiable
    alone = GreyBox(load_vehicle("mermaid"), [DRAG]).fit(dives(truth={}))
    assert fit[DRAG].error == pytest.approx(alone[DRAG].error, rel=0.01)


def test_with_a_known_trim_the_offset_is_what_all_dives_share():
    plant = replace_at(load_vehicle("mermaid"), "hull.trim_known", 1.0)
    fit = GreyBox(plant, [DRAG, OFFSET]).fit(dives(volumes=np.full(3, -2e-5), truth={DRAG: 280.0}))
    for path, value in {DRAG: 280.0, OFFSET: -2e-5}.items():
        assert fit[path].value == pytest.approx(value, abs=4.0 * fit[path].error)
        assert fit[path].error < 0.01 * abs(value)


def test_what_a_volume_does_in_one_dive_is_taken_out_of_the_sensitivities():
    """Nothing is left of a constant volume offset, but much of one that grows within a dive."""
    problem = shooting(dives(noise=0.0))
    paths = [OFFSET, "effects.volume.leak", DRAG]
    point = problem.solve(problem.plant, [DRAG])
    linear = problem.linearise(point, paths, problem.sigma(point))
    left = np.sqrt((linear.columns**2).sum(axis=(1, 2))) / linear.raw
    assert left[0] < 1e-9
    assert np.all(left[1:] > 0.05)


def filtered() -> PredictionErrors:
    plant, record = load_vehicle("mermaid"), dives()
    return PredictionErrors(plant, record, stretches_of(plant, record))


def test_dives_with_volumes_of_their_own_are_linearised_by_their_starts_alone():
    """This is needed to choose the length of windows in a log that may need shorter ones."""
    log = check_log(dives(), load_vehicle("mermaid"), Asked())
    assert len(log.every_window) >= 4


def test_each_dive_of_a_log_may_count_its_time_from_zero():
    """The filter is first linearised about the path of the readings."""
    problem = filtered()
    assert np.diff(problem.record.time).min() < 0.0
    np.testing.assert_allclose(problem.first_path[:, 0], problem.measured[:, 0], atol=1e-9)


def test_steps_take_what_goes_on_between_stretches_by_the_vehicle_itself():
    """From a wrong drag, the effect of a volume follows the vehicle's path and not the filter's."""
    problem = filtered()
    assert problem.carried.any()
    wrong = problem.point(replace_at(problem.plant, DRAG, 230.0).vector, problem.first_noise())
    far = problem.with_gains(wrong, replace_at(problem.plant, DRAG, 330.0).vector)
    columns, owners = problem._starts_for_steps(far)
    volumes = [(c, stretches) for c, (stretches, state) in zip(columns, owners, strict=True) if state == 2]
    assert len(volumes) == len(VOLUMES)
    for column, stretches in volumes:
        moved, size = far.starts.copy(), 1e-9
        moved[stretches, 2] += size
        change = far.errors - problem.with_gains(far, far.vector, moved).errors
        np.testing.assert_allclose(column, change.ravel() / size, atol=1e-4 * np.abs(column).max())


def test_nothing_is_left_of_what_starts_imitate():
    """An offset of all volumes acts like the volumes of the dives; one-sided slopes would leave 3e-5 of it."""
    problem = filtered()
    slopes, left = problem.own_slopes(problem.point(problem.plant.vector, problem.first_noise()), [OFFSET])
    assert np.linalg.norm(left) < 1e-7 * np.linalg.norm(slopes)
