"""One-step errors over joined windows: white for the right vehicle, and not for a slow cause that short runs hide."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.judge.judgement import disagrees
from identification.diagnosis.search.joined import joined_errors, joined_windows
from identification.diagnosis.search.workbench import noise_limited_length
from identification.experiments.missions import run_mission
from identification.fit.validation import fitted_runs
from identification.fit.windows import free_run_windows

DRAG = "hull.surge.u_u"


@pytest.fixture(scope="module")
def remus():
    plant = load_vehicle("remus100")
    record = run_mission(plant, np.random.default_rng(4), duration=75.0)
    return plant, record, free_run_windows(plant, record, noise_limited_length(plant, record, 25.0))


def test_neighbouring_windows_are_joined_up_to_a_length_and_not_over_gaps():
    time = np.r_[np.arange(60.0), 100.0 + np.arange(30.0)]
    record = Record.from_arrays(
        time, {"heading_rad": np.zeros(90)}, segment=np.r_[np.zeros(60), np.ones(30)].astype(int)
    )
    windows = [slice(a, a + 10) for a in range(0, 90, 10)]
    assert joined_windows(record, windows, 25.0) == [slice(30, 50), slice(50, 60)]
    assert joined_windows(record, [windows[3], windows[5]], 25.0) == [windows[3], windows[5]]
    assert joined_windows(record, windows[6:], 25.0) == []


def test_errors_of_the_right_vehicle_are_white_though_its_free_runs_diverge(remus):
    plant, record, windows = remus
    joined = joined_errors(plant, record, windows, (), 25.0)
    assert joined is not None
    # about 480 readings of a unit variance, over a variance from as many: each has a deviation of 0.07
    size = np.nanmean(joined.errors**2, axis=0)
    assert size == pytest.approx(np.ones(size.size), abs=0.3)
    assert not _left(plant, record, windows, ())


def test_two_percent_of_drag_show_in_joined_windows_alone(remus):
    plant, record, windows = remus
    wrong = replace_at(plant, DRAG, 1.02 * value_at(plant, DRAG))
    assert not _left(wrong, record, windows, (), steady=True)
    assert _left(wrong, record, windows, ())
    assert not _left(wrong, record, windows, (DRAG,))  # at its best for the joined windows nothing is left


def _left(plant, record, windows, paths, steady=False) -> bool:
    train, held = (SimpleNamespace(windows=windows[k::2], record=record) for k in (0, 1))
    after: Any = SimpleNamespace(plant=plant, fitted=fitted_runs(plant, record, windows))
    bench: Any = SimpleNamespace(steady=steady, train=train, held=held)
    return disagrees(after, bench, paths, 25.0)
