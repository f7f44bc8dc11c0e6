"""What all tests of the command line share."""

from collections.abc import Iterator
from functools import lru_cache

import pytest
from typer.main import get_command


@pytest.fixture(autouse=True, scope="session")
def commands_built_once() -> Iterator[None]:
    """The commands of the program, built once: typer builds all of them anew at every call, in 30 ms."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.main.get_command", lru_cache(get_command))
        yield


@pytest.fixture
def wide(monkeypatch) -> None:
    """Tables as on a wide terminal, so that nothing is folded."""
    monkeypatch.setattr("auv_gym.cli.options.console.output.width", 250)
    monkeypatch.setattr("auv_gym.cli.options.console.errors.width", 250)
