"""Tests of logs that begin while an actuator moves: its unknown position must not look like an effect."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import diagnose


def yo(seed: int, late: int) -> Record:
    """A clean log of `qiandao_float` under steps of its piston, that begins `late` samples after one of them."""
    plant, rng = load_vehicle("qiandao_float"), np.random.default_rng(seed)
    x = plant.initial(np.array([25.0, np.nan]))
    u = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
    depths, commands, begin, until, diving = [], [], None, 0, False
    u[0] = 0.595
    for k in range(1300):
        depth = float(plant.output(x)[0])
        if k >= until or (depth > 50.0 and diving) or (depth < 8.0 and not diving):
            diving = depth <= 40.0 and (depth < 14.0 or not diving)
            u[0] = 0.55 + (-1.0 if diving else 1.0) * rng.uniform(0.02, 0.045)
            until = k + int(rng.uniform(90, 200))
            begin = k if begin is None and k > 100 else begin
        depths.append(depth)
        commands.append(u[0])
        x = plant.step(x, u)
    assert begin is not None
    depth, first = np.array(depths) + 0.02 * rng.standard_normal(len(depths)), begin + late
    channels = {"depth_m": depth[first:], "piston_m": np.array(commands)[first:]}
    return Record.from_arrays(plant.dt * np.arange(len(depths) - first), channels)


@pytest.mark.slow
def test_a_float_whose_piston_is_moving_when_its_log_begins_lacks_nothing():
    for seed in range(3):
        found = diagnose(yo(seed, late=3), load_vehicle("qiandao_float"))
        assert found.verdict == "none", (seed, found.summary())
