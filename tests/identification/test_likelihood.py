"""Points that are likeliest where residuals are slow: what white fits leave, and what can then be compared."""

import numpy as np
import pytest
from scipy.signal import lfilter

from auv_gym.plant import load_vehicle
from identification.likelihood import colour, evidence, polished, window_costs
from identification.missions import fly
from identification.shooting import Shooting

MOMENT = "effects.yaw.moment"


@pytest.fixture(scope="module")
def disturbed():
    """A glider's mission with slow noise in its heading, and nothing else that its model lacks."""
    plant, rng = load_vehicle("slocum"), np.random.default_rng(3)
    record = fly(plant, rng, duration=2400.0)
    slow = lfilter([1.0], [1.0, -0.95], 0.01 * rng.standard_normal(len(record.time)))
    return plant, Shooting(
        plant, record.with_channels({"heading_rad": record["heading_rad"] + slow}), record.windows(120.0)
    )


def test_a_white_residual_is_left_as_it_is(disturbed):
    plant, problem = disturbed
    point = problem.solve(plant, (MOMENT,))
    assert polished(problem, point, (MOMENT,), np.zeros(len(problem.channels))) is point


def test_no_start_and_no_path_near_by_is_likelier(disturbed):
    plant, problem = disturbed
    point = problem.solve(plant, (MOMENT,))
    slow = colour(problem, point)
    assert slow[problem.channels.index("heading_rad")] > 0.6
    found = polished(problem, point, (MOMENT,), slow)

    def cost(vector, starts):
        near = problem.point(vector, starts)
        return float(problem.counts @ np.log(window_costs(problem, near, slow).sum(axis=0)))

    least, rng = cost(found.vector, found.starts), np.random.default_rng(0)
    assert least < cost(point.vector, point.starts) - 5.0
    for _ in range(20):
        vector, starts = found.vector.copy(), found.starts.copy()
        vector[problem.index[MOMENT]] += 0.1 * problem.scale(MOMENT) * rng.standard_normal()
        starts[:, problem.start_states] += 3e-3 * rng.standard_normal((len(starts), len(problem.start_states)))
        assert cost(vector, starts) > least


def test_what_is_not_there_gains_what_chance_gives_and_never_loses(disturbed):
    plant, problem = disturbed
    without, beside = problem.solve(plant, ()), problem.solve(plant, (MOMENT,))
    slow = colour(problem, beside)
    gain = evidence(problem, polished(problem, without, (), slow), polished(problem, beside, (MOMENT,), slow), slow)
    assert -1e-6 <= gain < 11.0  # a chi-squared of one degree of freedom, with probability .999
