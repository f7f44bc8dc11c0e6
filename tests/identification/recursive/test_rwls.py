"""RWLS: the batch solution sample by sample; exact without noise, biased with it, and saying what it needs."""

import numpy as np
import pytest
from dives_by_equation import THETA, TRUTH, dive_log
from scipy.linalg import lstsq

from auv_gym.records.record import Record
from identification.recursive.diving_model import PARAMETERS, regressors
from identification.recursive.rwls import Rwls
from identification.recursive.samples import Samples


def rows_of(record: Record) -> tuple[np.ndarray, np.ndarray]:
    samples = Samples.of([record], "test", 6)
    rows = np.zeros((len(record), 6))
    regressors(samples.depth, samples.piston, samples.interval, rows)
    return rows[2:], record["depth_m"][2:]


def test_data_without_noise_give_the_exact_parameters():
    fit = Rwls().fit(dive_log(3000, 0.0, np.random.default_rng(0)))
    assert fit.theta == pytest.approx(THETA, abs=1e-6)
    assert fit.model.parameters == pytest.approx(TRUTH.parameters, abs=1e-6)
    assert fit.noise < 1e-9


def test_the_recursion_ends_at_the_batch_solution():
    record = dive_log(800, 0.02, np.random.default_rng(1))
    rows, target = rows_of(record)
    weights = np.random.default_rng(2).uniform(0.5, 2.0, len(record))
    root = np.sqrt(weights[2:])
    fit = Rwls().fit(record, weights=[weights])
    # P starts at 1e12 and ends at some 1e2 in the least certain direction, so rounding leaves that six digits
    assert fit.theta == pytest.approx(lstsq(rows * root[:, None], target * root)[0], rel=1e-4, abs=1e-6)
    assert fit.history is not None
    assert np.array_equal(fit.history[-1], fit.theta)


def test_forgetting_weighs_the_past_less():
    record = dive_log(800, 0.02, np.random.default_rng(1))
    rows, target = rows_of(record)
    root = np.sqrt(0.99 ** np.arange(target.size)[::-1])
    expected = lstsq(rows * root[:, None], target * root)[0]
    assert Rwls(forgetting=0.99).fit(record).theta == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_sample_by_sample_is_the_fit_and_changes_no_memory():
    record = dive_log(200, 0.02, np.random.default_rng(3))
    estimator = Rwls()
    memory = estimator.start()
    first = estimator.update(memory, record["depth_m"][0], record["piston_m"][0], 0.0)
    kept = first.vector.copy()
    memory = first
    for k in range(1, len(record)):
        h = record.time[k] - record.time[k - 1]
        memory = estimator.update(memory, record["depth_m"][k], record["piston_m"][k - 1], h)
    assert np.array_equal(memory.theta, estimator.fit(record).theta)
    assert np.array_equal(first.vector, kept)
    assert memory.skipped == 0


def test_a_gap_joins_no_samples():
    one, two = dive_log(400, 0.02, np.random.default_rng(4)), dive_log(300, 0.02, np.random.default_rng(5))
    rows, targets = zip(rows_of(one), rows_of(two))
    expected = lstsq(np.concatenate(rows), np.concatenate(targets))[0]
    assert Rwls().fit(one, two).theta == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_known_parameters_keep_their_values():
    fit = Rwls(known=("unity", "piston_rate")).fit(dive_log(500, 0.02, np.random.default_rng(6)))
    assert fit.theta[0] == 1.0
    assert fit.theta[3] == 0.0
    assert fit["piston_rate"].ci95 == (0.0, 0.0)
    assert "known" in fit["piston_rate"].problem
    assert fit["damping"].identifiable


def test_depth_noise_biases_the_damping_and_more_samples_do_not_help():
    damping = [Rwls().fit(dive_log(n, 0.02, np.random.default_rng(7))).theta[1] for n in (1000, 10000)]
    assert min(damping) > 10.0 * TRUTH.damping


def test_intervals_are_of_the_size_of_the_scatter_about_the_biased_mean():
    clean, rng = dive_log(600, 0.0, np.random.default_rng(0)), np.random.default_rng(1)
    fits = []
    for _ in range(60):
        noisy = clean["depth_m"] + 0.02 * rng.standard_normal(len(clean))
        fits.append(Rwls(known=("unity",)).fit(clean.with_channels({"depth_m": noisy})))
    for name in ("damping", "piston"):
        scatter = np.std([fit[name].value for fit in fits])
        # the noise in the regressor moves with that of the error, which the formula leaves out: it is too wide here
        assert 0.7 < np.median([fit[name].error for fit in fits]) / scatter < 2.0


def test_units_and_names():
    fit = Rwls().fit(dive_log(300, 0.02, np.random.default_rng(8)))
    assert {e.path: e.unit for e in fit.estimates} == PARAMETERS
    with pytest.raises(KeyError, match="damping"):
        fit["mass"]


LOG = dive_log(200, 0.02, np.random.default_rng(9))


@pytest.mark.parametrize(
    "record, words",
    [
        (LOG.without("piston_m"), "add piston_m"),
        (LOG.without("depth_m"), "add depth_m"),
        (LOG.between(0.0, 10.0), "at least 24 samples"),
        (LOG.with_channels({"piston_m": np.full(200, 0.55)}), "nothing excites"),
        (LOG.with_channels({"piston_m": np.where(LOG.time > 60.0, 0.55, 0.5)}), "at least 3 positions, got 2"),
        (LOG.with_channels({"depth_m": np.full(200, 3.0)}), "float that moves"),
    ],
)
def test_records_that_cannot_do_are_refused(record, words):
    with pytest.raises(ValueError, match=words):
        Rwls().fit(record)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"forgetting": 0.0}, "0 < forgetting <= 1"),
        ({"spread": -1.0}, "spread > 0"),
        ({"initial": (1.0, 0.0)}, "6 finite initial values"),
        ({"known": ("dampng",)}, "Did you mean 'damping'"),
        ({"known": tuple(PARAMETERS)}, "leave at least one"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Rwls(**settings)


def test_updates_and_weights_that_cannot_be_are_refused():
    memory = Rwls().start()
    with pytest.raises(ValueError, match="leave a missing sample out"):
        Rwls().update(memory, np.nan, 0.55, 0.7)
    with pytest.raises(ValueError, match="h >= 0 s"):
        Rwls().update(memory, 3.0, 0.55, -0.7)
    with pytest.raises(ValueError, match="one positive weight per sample"):
        Rwls().fit(LOG, weights=[np.ones(3)])
    with pytest.raises(ValueError, match="at least one record"):
        Rwls().fit()
