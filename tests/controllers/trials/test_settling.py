from math import inf, log

import numpy as np
import pytest

from controllers.trials.settling import step_response

TIME = np.arange(0.0, 20.0, 0.001)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_first_order_response(side):
    values = 5.0 + side * 2.0 * (1.0 - np.exp(-TIME / 1.5))
    step = step_response(TIME, values, 5.0 + side * 2.0, band=0.1)
    assert step.rise_time == pytest.approx(1.5 * log(9.0), abs=2e-3)  # two samples
    assert step.settling_time == pytest.approx(1.5 * log(20.0), abs=2e-3)
    assert step.overshoot == 0.0
    assert step.steady_error == pytest.approx(0.0, abs=1e-4)


def test_overshoot_and_swing_of_an_oscillation():
    values = 1.0 - np.cos(TIME)
    step = step_response(TIME, values, 1.0, band=0.1)
    assert step.overshoot == pytest.approx(1.0, abs=1e-6)
    assert step.settling_time == inf
    assert step.swing == pytest.approx(0.5 * np.ptp(values[TIME >= 16.0]), rel=1e-3)


def test_a_target_out_of_reach_and_none_at_all():
    step = step_response(TIME, np.minimum(TIME, 3.0), 6.0, band=0.3)
    assert (step.rise_time, step.settling_time) == (inf, inf)
    assert step.steady_error == -3.0
    with pytest.raises(ValueError, match="apart from the first value"):
        step_response(TIME, np.zeros_like(TIME), 0.0, band=0.1)
