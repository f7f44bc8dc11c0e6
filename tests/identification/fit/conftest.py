"""A log that tests of fits share."""

import pytest

from auv_gym.records.record import Record
from tests.identification.fit.glider_logs import glider_log


@pytest.fixture(scope="session")
def pushed() -> Record:
    return glider_log(0)
