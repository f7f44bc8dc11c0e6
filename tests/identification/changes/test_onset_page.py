"""Tests of the page and the picture of the times at which effects act."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from identification.changes.forms import Sized
from identification.changes.onset import Timed, Timeline
from identification.changes.page import timeline_figure, timeline_page, write_timeline
from identification.changes.spans import BETWEEN, OUTSIDE
from identification.changes.timed_forms import FROM, GROWING, UNTIL

OFFSET = Timed(
    "effects.rudder.offset", "rudder offset", "rad", FROM, Sized(0.03, (0.028, 0.032)), 90.0,
    Sized(400.0, (380.0, 410.0)), tied=("from effects.yaw.moment",),
)  # fmt: skip
LEAK = Timed("effects.volume.leak", "leak", "m^3/s", GROWING, Sized(2e-9, (1e-9, 3e-9)), 30.0)
LATER = Sized(600.0, (590.0, 620.0))


def timeline(*found):
    return Timeline(found, 1234, load_vehicle("slocum"), (100.0, 900.0), ("Two rows were dropped.",))


def drawn_line(timed):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    axes = timeline_figure(timeline(timed)).axes[0]
    times, sizes = axes.lines[0].get_data()
    return list(zip(np.asarray(times).tolist(), np.round(sizes, 6).tolist(), strict=True)), axes


@pytest.mark.parametrize(
    "form, second, line",
    [
        (FROM, None, [(100, 0), (400, 0), (400, 1), (900, 1)]),
        (UNTIL, None, [(100, 1), (400, 1), (400, 0), (900, 0)]),
        (BETWEEN, LATER, [(100, 0), (400, 0), (400, 1), (600, 1), (600, 0), (900, 0)]),
        (OUTSIDE, LATER, [(100, 1), (400, 1), (400, 0), (600, 0), (600, 1), (900, 1)]),
        (GROWING, None, [(100, 0), (900, 1)]),
        ("", None, [(100, 1), (900, 1)]),
    ],
)
def test_the_picture_has_the_size_at_each_time(form, second, line):
    time = OFFSET.time if form not in (GROWING, "") else None
    size = np.rad2deg(0.03)
    drawn, axes = drawn_line(replace(OFFSET, form=form, time=time, second=second))
    assert drawn == [(t, pytest.approx(share * size, abs=1e-6)) for t, share in line]
    assert axes.get_title(loc="left") == "rudder offset, deg"
    assert axes.get_xlabel() == "time, s"


def test_the_page_says_what_acts_when_and_stands_without_anything_found():
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    text = timeline_page(timeline(OFFSET, LEAK))
    assert text.count("<svg") == 1
    for words in ("from 400 s on", "380 to 410 s", "growing from zero to this size", "yaw moment", "1234 candidates"):
        assert words in text
    assert "0.002 mL/s" in text
    assert re.search(r'<th scope="col" class="n">evidence</th><th scope="col">alternatives</th>', text)
    assert re.search(r"<td>[^<]*yaw moment", text)  # may wrap, as no number does
    assert "Two rows were dropped." in text
    nothing = timeline_page(timeline())
    assert "no known effect is missing at any time" in nothing
    assert "<svg" not in nothing


def test_the_files_are_written_whole(tmp_path):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    written = write_timeline(timeline(OFFSET), tmp_path / "out")
    assert [path.name for path in written.values()] == ["onset.json", "onset.html"]
    assert json.loads(written["onset.json"].read_text())["span"] == [100.0, 900.0]
