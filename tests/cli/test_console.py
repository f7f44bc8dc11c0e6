"""What commands print of their progress."""

import pytest

from auv_gym.cli.options import console


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand, s."""
    now = [100.0]
    monkeypatch.setattr(console, "monotonic", lambda: now[0])
    return now


def test_where_no_bar_can_be_drawn_a_long_run_prints_a_line_now_and_then(clock, capsys, monkeypatch):
    monkeypatch.setattr(console, "errors", console.Console(stderr=True, highlight=False, width=80))
    with console.progress_bar() as show:
        show(0.1, "soon")
        for seconds, text in ((29.0, "not yet"), (31.0, "fitting [all]"), (50.0, "not again"), (95.0, "searching")):
            clock[0] = 100.0 + seconds
            show(seconds / 100.0, text)
    assert capsys.readouterr().err.splitlines() == ["0:31 min, 31 %: fitting [all]", "1:35 min, 95 %: searching"]


def test_a_short_run_prints_nothing(clock, capsys, monkeypatch):
    monkeypatch.setattr(console, "errors", console.Console(stderr=True, highlight=False, width=80))
    with console.steps_bar(2) as begin:
        begin("first")
        begin("second")
    assert capsys.readouterr().err == ""
