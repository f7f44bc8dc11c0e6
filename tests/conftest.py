"""Settings and fixtures that all tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run; no deadline, because the first call of a compiled function compiles it.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured records that are not part of the repository; the test is skipped where it is absent."""
    named = os.environ.get("AUV_GYM_DATA")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no measured records at {folder}: name their folder in AUV_GYM_DATA")
    return folder
