"""Tests of rising and sinking water around a glider: waves of minutes are recognised, and longer motion is no noise."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import dependence
from identification.diagnosis.search.dependence import clock_varies
from identification.diagnosis.search.further_noises import with_further_noises
from identification.diagnosis.search.gusts import slow
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.glider_dives import yo_mission
from identification.fit.coloured import coloured_channels
from identification.fit.further_noises import further_noises

GLIDER = load_vehicle("slocum_flight")
PERIODS, PARTS = np.array([820.0, 1130.0, 640.0, 1500.0]), np.array([1.0, 0.7, 0.4, 0.5])  # s


@pytest.fixture(scope="module")
def still() -> Record:
    return yo_mission(GLIDER, (250.0, 300.0, 280.0), rng=np.random.default_rng(1), noise=0.02, dt=10.0)


def steps_of(record: Record) -> np.ndarray:
    """Time from each sample to the next, s; dives follow each other immediately."""
    return np.maximum(np.diff(record.time, append=record.time[-1]), 10.0)


def carried(record: Record, speed: np.ndarray) -> Record:
    """The record in water that sinks with given speeds, (n,), m/s."""
    return record.with_channels({"depth_m": record["depth_m"] + np.cumsum(speed * steps_of(record))})


def waves(record: Record, rng: np.random.Generator) -> np.ndarray:
    phases = 2.0 * np.pi * np.cumsum(steps_of(record))[:, None] / PERIODS + rng.uniform(0.0, 2.0 * np.pi, 4)
    return 0.005 * np.sin(phases) @ (PARTS / np.linalg.norm(PARTS))


def drifts(record: Record, lasting: float, size: float, rng: np.random.Generator) -> np.ndarray:
    """Random drifts with given standard deviation, m/s, and correlation time, s."""
    found, kept = np.zeros(len(record)), np.exp(-steps_of(record) / lasting)
    found[0] = size * rng.standard_normal()
    for k, share in enumerate(kept[:-1]):
        found[k + 1] = share * found[k] + size * np.sqrt(1.0 - share**2) * rng.standard_normal()
    return found


def fitted(record: Record) -> tuple[Workbench, State]:
    bench = Workbench(GLIDER, record, parts_of(GLIDER, record), 0.1)
    return bench, bench.fit(bench.plant, GLIDER.coefficients)


@pytest.mark.parametrize("seed", [0, 1])
def test_internal_waves_are_told_by_their_period_and_leave_white_errors(still, seed):
    bench, state = fitted(carried(still, waves(still, np.random.default_rng(seed))))
    (found,) = further_noises(bench.problem, state.plant, state.paths, state.point)
    ((period, pushes),) = found.problem.noise_at(found.point).swell.items()
    assert 600.0 < period < 1500.0
    assert pushes["depth_m"][0] == pytest.approx(0.0035, rel=0.6)
    assert coloured_channels(found.problem, found.point) == ()
    assert slow(found.problem, found.point) == ()
    assert further_noises(bench.problem, state.plant, state.paths, state.point, waves_alone=True) == []


@pytest.mark.parametrize("seed", [0, 1])
def test_random_drifts_are_no_waves_and_not_slow(still, seed):
    bench, state = fitted(carried(still, drifts(still, 60.0, 0.005, np.random.default_rng(seed))))
    assert further_noises(bench.problem, state.plant, state.paths, state.point) == []
    assert slow(bench.problem, state.point) == ()


@pytest.mark.parametrize("seed", [0, 1])
def test_drifts_that_last_longer_than_noise_may_are_no_noise(still, seed):
    bench, state = fitted(carried(still, drifts(still, 3000.0, 0.01, np.random.default_rng(seed))))
    assert slow(bench.problem, state.point) == ("depth_m",)


def test_a_clock_is_not_blamed_for_internal_waves(still, monkeypatch):
    bench, state = fitted(carried(still, waves(still, np.random.default_rng(0))))
    monkeypatch.setattr(dependence, "_chance", lambda regression, signatures: 0.0)
    assert clock_varies(bench, state)
    noisier, (beside,) = with_further_noises(bench, [state])
    assert not clock_varies(noisier, beside)
