"""Whether an effect has one size: a rudder offset throughout, and one that begins half-way."""

import numpy as np

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.deciding import UNSTEADY
from identification.diagnosis.judge.constancy import steadiness
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.heading_control import closed_loop
from scripts.blind.changing import ChangingGlider

OFFSET = "effects.rudder.offset"


def probability(begins):
    """Of one size, for an offset of 0.03 rad that begins at a time, s."""
    plant = load_vehicle("slocum")
    bent = replace_at(plant, OFFSET, 0.03)
    moving = ChangingGlider(plant, lambda t: bent if t >= begins else plant)
    record = closed_loop(moving, rng=np.random.default_rng(700), duration=600.0)
    log = check_log(record, plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    return steadiness(bench, bench.fit(bench.plant, (*plant.coefficients, OFFSET)), OFFSET)


def test_parts_contradict_each_other_where_an_effect_begins_half_way_and_only_there():
    assert probability(-100.0) > 0.01
    assert probability(300.0) < UNSTEADY
