"""Settings and fixtures that all tests share."""

import gc
import os
import re
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

from auv_gym.plant import load_vehicle, plant
from auv_gym.plant.rollout import bind_family
from tests.presets import SELDOM, UNCOMPILED

# The same examples in every run; no deadline, because the first call of a compiled function compiles it.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("repeatable")

# A compiler makes so many objects that at the default of 700 looking for garbage is a tenth of its time.
gc.set_threshold(50_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark tests of studies slow, and those that are repeated for a preset of `SELDOM`."""
    for item in items:
        seldom = hasattr(item, "callspec") and SELDOM & {*re.findall(r"\w+", item.callspec.id)}
        if seldom or "studies" in item.path.parts:
            item.add_marker(pytest.mark.slow)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Let no daily test have programs of `UNCOMPILED`."""
    daily = item.get_closest_marker("slow") is None

    def bound(family):
        if daily and family.program in uncompiled():
            pytest.fail(f"this test needs the programs of {family.program}: mark it slow, or take another vehicle")
        return bind_family(family)

    plant.bind_family = bound


@cache
def uncompiled():
    """What the programs of `UNCOMPILED` are called."""
    return {load_vehicle(name).family.program for name in UNCOMPILED}


def pytest_collection_finish():
    """Leave what modules and tests consist of out of every later search for garbage."""
    gc.freeze()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured records that are not part of the repository; the test is skipped where it is absent."""
    named = os.environ.get("AUV_GYM_DATA")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no measured records at {folder}: name their folder in AUV_GYM_DATA")
    return folder
