"""Settings and fixtures that all tests share."""

import gc
import os
import re
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run; no deadline, because the first call of a compiled function compiles it.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("repeatable")

# A compiler makes so many objects that at the default of 700 looking for garbage is a tenth of its time.
gc.set_threshold(50_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark tests of studies slow, and of the preset `bluerov2`: its programs, whose like its sisters have, are idle."""
    for item in items:
        of_sister = hasattr(item, "callspec") and "bluerov2" in re.findall(r"\w+", item.callspec.id)
        if of_sister or "studies" in item.path.parts:
            item.add_marker(pytest.mark.slow)


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
