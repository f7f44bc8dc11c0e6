"""Tests of which logs a comparison or a search in time can use."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from identification.changes.forms import sized
from identification.changes.missions import compare_missions
from identification.changes.onset import find_onsets
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK


def log_of(plant, seed: int):
    return run_mission(plant, np.random.default_rng(seed), duration=600.0)


def test_a_rudder_that_has_failed_is_what_changed_and_no_slip_of_units():
    dead = log_of(replace_at(QUICK, "effects.rudder.lost_travel", 1.0), 2)
    found = compare_missions(log_of(QUICK, 1), dead, QUICK)
    assert [c.path for c in found.changed] == ["hull.n_delta"]
    assert found.changed[0].after.value == pytest.approx(0.0, abs=1e-5)
    told = "The log after may be mislabelled: rudder_rad looks like degrees, not rad."
    assert found.notes == (f"{told} An effect may be the reason instead.",)


def test_a_size_at_its_bound_has_the_interval_of_its_profile():
    """A rudder without travel: beyond the travel that the log has used nothing changes, and the slope is zero."""
    lost, dead = "effects.rudder.lost_travel", log_of(replace_at(QUICK, "effects.rudder.lost_travel", 1.0), 2)
    bench = Workbench(QUICK, dead, parts_of(QUICK, dead), 0.1)
    state = bench.fit(replace_at(QUICK, lost, 1.0), (lost,))
    found = sized(bench, state, {lost: 1.0})
    assert found.value == 1.0
    assert 0.1 < found.ci95[0] < 0.95
    assert found.ci95[1] == 1.0


def test_a_log_that_is_surely_mislabelled_is_refused_unless_trusted():
    log = log_of(QUICK, 1)
    turned = log.with_channels({"rudder_rad": -log["rudder_rad"]})
    with pytest.raises(
        ValueError, match=r"looks mislabelled: the rudder acts with the opposite sign\. Correct the log"
    ):
        find_onsets(turned, QUICK)
    assert find_onsets(turned, QUICK, trust=True).notes == ()
