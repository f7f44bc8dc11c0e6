"""Tests of free runs over parts by vehicles fitted without them, including one that diverges."""

import numpy as np
import pytest

from auv_gym.model import Diverged
from auv_gym.param import replace_at
from identification.diagnosis.judge.scoring import first_that_flies
from identification.experiments.missions import run_mission
from identification.fit.validation import free_runs, joined_runs
from tests.identification.gliders import QUICK

WILD = replace_at(QUICK, "effects.discovered.yaw.r_r", 1e6)


@pytest.fixture(scope="module")
def log():
    record = run_mission(QUICK, np.random.default_rng(3), duration=500.0)
    return record, record.windows(100.0)


def test_a_vehicle_that_flies_is_scored_in_place_of_one_that_does_not(log):
    record, windows = log
    (found, flown), own = (
        first_that_flies((WILD, QUICK), record, windows, 20.0),
        free_runs(QUICK, record, windows, 20.0),
    )
    assert flown is QUICK
    assert np.array_equal(found.model, own.model)
    turned = replace_at(QUICK, "effects.rudder.offset", 0.05)
    first, _ = first_that_flies((turned, QUICK), record, windows, 20.0)
    assert np.array_equal(first.model, free_runs(turned, record, windows, 20.0).model)


@pytest.mark.filterwarnings("ignore:overflow")
def test_nothing_is_scored_where_no_vehicle_flies(log):
    with pytest.raises(Diverged):
        first_that_flies((WILD, WILD), *log, 20.0)


def test_runs_over_parts_are_joined_in_the_order_of_the_record(log):
    record, windows = log
    whole = free_runs(QUICK, record, windows, 20.0)
    joined = joined_runs([free_runs(QUICK, record, own, 20.0) for own in (windows[1::2], windows[0::2])])
    for name in ("rows", "window", "scored", "readings"):
        assert np.array_equal(getattr(joined, name), getattr(whole, name)), name
    for name in ("model", "residual"):  # the initial states of all windows share one estimate of the noise
        assert getattr(joined, name) == pytest.approx(getattr(whole, name), abs=5e-3), name
