"""What several tests of the search share: a glider's log with a rudder offset."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK

OFFSET = "effects.rudder.offset"


@pytest.fixture(scope="session")
def offset_log():
    """A bench with a glider's log that has a rudder offset of 0.05 rad, the refitted vehicle, and all candidates."""
    record = run_mission(replace_at(QUICK, OFFSET, 0.05), np.random.default_rng(1), duration=1200.0)
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    return bench, bench.fit(QUICK, QUICK.family.coefficients), candidates_of(QUICK, record)
