from dataclasses import replace
from math import pi, radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from matplotlib.colors import to_rgb

from auv_gym.rendering import Renderer, Scene, Target, draw, film_strip
from auv_gym.rendering.sheet import Sheet

STOP = radians(20.0)
ROUTE = np.array([[0.0, 60.0, 10.0], [120.0, 150.0, 30.0], [200.0, 20.0, 60.0]])
COMMANDS = {
    "rudder_rad": (0.1, STOP),
    "stern_plane_rad": (-STOP, STOP),
    "speed_cmd_mps": (1.4, (0.0, 3.0)),
    "propeller_rpm": (1480.0, 1525.0),
}


def dive(steps: int = 300) -> np.ndarray:
    """North, east, depth, m, of a slow spiral down at 1.5 m/s, a point each 0.1 s."""
    course = 0.004 * np.arange(steps)
    return np.column_stack(
        [np.cumsum(0.15 * np.cos(course)), np.cumsum(0.15 * np.sin(course)), 0.02 * np.arange(steps)]
    )


def scene(**changes: Any) -> Scene:
    """A dive towards waypoints in a current, with the fields that are named changed."""
    fields: dict[str, Any] = {
        "trail": dive(),
        "attitude": (0.05, -0.2, 1.2),
        "speed": 1.49,
        "commands": COMMANDS,
        "target": Target(speed=1.5, waypoints=ROUTE, active=1, radius=10.0),
        "current": (0.1, 0.25),
        "title": "remus100",
        "caption": "t = 30 s  reward −0.12",
        **changes,
    }
    fields.setdefault("time", 0.1 * np.arange(len(fields["trail"])))
    return Scene(**fields)


@pytest.mark.parametrize("size", [(960, 600), (1280, 720), (481, 300), (600, 800)])
def test_a_picture_has_the_size_asked_for_and_a_white_rim(size):
    picture = draw(scene(), size)
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8
    for rim in (picture[:3], picture[-3:], picture[:, :3], picture[:, -3:]):
        assert (rim == 255).all()


def test_a_scene_gives_the_same_picture_whatever_was_drawn_before():
    renderer = Renderer()
    first = renderer.draw(scene())
    other = renderer.draw(scene(attitude=(1.0, 1.0, -2.0), trail=dive(50), current=None, target=Target(heading=1.0)))
    assert (other != first).any()
    assert (renderer.draw(scene()) == first).all()
    assert (draw(scene()) == first).all()
    first[:] = 0  # a picture is its owner's
    assert (renderer.draw(scene()) == draw(scene())).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"attitude": (0.15, -0.2, 1.2)},
        {"attitude": (0.05, -0.1, 1.2)},
        {"attitude": (0.05, -0.2, 1.3)},
        {"speed": 1.2},
        {"trail": dive(250)},
        {"commands": {**COMMANDS, "rudder_rad": (0.15, STOP)}},
        {"target": Target(speed=1.5, waypoints=ROUTE, active=2, radius=10.0)},
        {"target": Target(speed=1.3, waypoints=ROUTE, active=1, radius=10.0)},
        {"current": (0.25, 0.1)},
        {"title": "npsauv"},
        {"caption": "t = 31 s"},
        {"model_trail": dive(250) + 5.0},
    ],
)
def test_whatever_a_scene_says_shows(changes):
    assert (draw(scene(**changes)) != draw(scene())).any()


def test_a_heading_shows_on_the_plan_and_on_the_dial_only():
    changed = (draw(scene(attitude=(0.05, -0.2, 2.0))) != draw(scene())).any(axis=2)
    rows, columns = np.nonzero(changed)
    plan = columns < 590
    assert 0 < rows[plan].max() < 380  # above the depth strip
    assert rows[~plan].max() < 290  # above the speed
    assert columns[~plan].min() > 770  # right of the horizon


def test_a_full_turn_more_or_less_is_the_same_picture():
    once = draw(scene(attitude=(0.05, -0.2, 1.2), target=Target(heading=0.5)))
    more = draw(scene(attitude=(0.05 + 2 * pi, -0.2, 1.2 - 2 * pi), target=Target(heading=0.5 + 4 * pi)))
    assert np.abs(once.astype(int) - more).max() <= 8  # where an edge falls within its pixel is rounded


def test_the_command_bar_reaches_from_zero_towards_the_command():
    def green(value):
        picture = draw(scene(commands={"rudder_rad": (value, STOP)}))
        return np.nonzero((picture == np.round(np.multiply(to_rgb("#00785a"), 255))).all(axis=2).any(axis=0))[0]

    zero = 777  # the middle of the bar
    assert green(0.0).size == 0
    assert abs(green(0.5 * STOP).min() - zero) <= 2
    assert abs(green(-0.5 * STOP).max() - zero) <= 2
    assert abs(green(STOP).size - 2 * green(0.5 * STOP).size) <= 3
    assert green(5.0 * STOP).max() == green(STOP).max()


@pytest.mark.parametrize(
    "changes",
    [
        {"trail": np.zeros((0, 3)), "target": Target()},
        {"trail": np.zeros((0, 3))},
        {"trail": np.zeros((0, 3)), "model_trail": np.zeros((0, 3))},
        {"trail": np.zeros((1, 3))},
        {"trail": np.tile([1e6, -1e6, 50.0], (30, 1))},
        {"trail": np.zeros((20, 3)), "time": np.full(20, 3.0)},
        {"trail": dive(2) - [0.0, 0.0, 3.0]},
        {"target": Target(), "current": None, "commands": {}, "title": "", "caption": ""},
        {"target": Target(heading=-9.0, depth=0.0, speed=-0.5), "speed": -0.2},
        {"target": Target(depth=6000.0, waypoints=[[5e4, -3e4, 10.0]])},
        {"trail": dive() + [0.0, 0.0, 900.0], "target": Target(depth=1.0)},
        {"target": Target(waypoints=np.array([]))},
        {"target": Target(waypoints=ROUTE, active=3)},
        {"target": Target(waypoints=np.tile(ROUTE, (9, 1)) * np.arange(27)[:, None], active=20)},
        {"current": (0.0, 0.0)},
        {"attitude": (pi, pi / 2, 0.0)},
        {"trail": 40.0 * dive(20_000), "time": np.arange(20_000.0), "model_trail": dive(15_000)},
        {"title": "x" * 300, "caption": "y" * 300, "labels": ("z" * 90, "w" * 90), "model_trail": dive(3)},
        {"commands": dict.fromkeys(("rudder_rad", "piston_m", "propeller_V", "u_mps", "q_radps"), (0.1, 1.0))},
    ],
)
def test_what_is_missing_or_far_away_is_no_obstacle(changes):
    picture = draw(scene(**changes))
    assert picture.shape == (600, 960, 3)
    assert (picture != 255).any(axis=2).mean() > 0.05
    assert (picture[:, :3] == 255).all()
    assert (picture[:, -3:] == 255).all()


@settings(max_examples=25)
@given(
    st.floats(0.01, 2e4),
    st.floats(-1e5, 1e5),
    st.floats(0.0, 6000.0),
    st.floats(-pi, pi),
    st.floats(0.1, 2e5),
    st.booleans(),
)
def test_no_text_covers_another_or_leaves_the_paper(spread, away, depth, angle, duration, route):
    """Numbers inside the plan (with a veil behind them) may meet; all the rest keeps clear."""
    written = []

    class Noting(Sheet):
        def text(self, at, text, colour="#000000", size=12.0, align="left", *, bold=False, veil=None):
            width = super().text(at, text, colour, size, align, bold=bold, veil=veil)
            if text and veil is None:
                left = at[0] - {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width
                written.append((left, left + width, at[1] - 0.36 * size, at[1] + 0.36 * size, text))
            return width

    n = 200
    angles = np.linspace(0.0, 3.0, n) + angle
    trail = np.column_stack(
        [away + spread * np.cos(angles), -away + spread * np.sin(angles), depth * np.linspace(0.2, 1, n)]
    )
    target = Target(heading=2.0 * angle, depth=0.7 * depth, speed=1.0, waypoints=ROUTE + trail[-1] if route else None)
    shown = scene(
        trail=trail,
        time=np.linspace(0.0, duration, n),
        attitude=(angle, 0.5 * angle, -angle),
        target=target,
        current=None,
        model_trail=trail + 1.0,
    )
    renderer = Renderer()
    renderer._sheet = Noting(960, 600, 1.0)
    renderer.draw(shown)
    assert len(written) > 30
    for index, (left, right, top, bottom, text) in enumerate(written):
        assert 0.0 <= left < right <= 960.0, text
        assert 0.0 <= top < bottom <= 600.0, text
        for other in written[:index]:
            apart = right < other[0] or other[1] < left or bottom < other[2] or other[3] < top
            assert apart, (text, other[4])


def test_a_closed_renderer_and_a_picture_too_small_are_refused():
    renderer = Renderer()
    renderer.close()
    renderer.close()
    with pytest.raises(ValueError, match="closed"):
        renderer.draw(scene())
    with pytest.raises(ValueError, match=r"at least 320 x 200 pixels, got 100 x 600"):
        Renderer((100, 600))


def test_a_film_strip_holds_its_frames_row_by_row():
    frames = [np.full((20, 30, 3), value, np.uint8) for value in (10, 20, 30)]
    strip = film_strip(frames, 2)
    assert strip.shape == (42, 62, 3)
    assert (strip[:20, :30] == 10).all()
    assert (strip[:20, 32:] == 20).all()
    assert (strip[22:, :30] == 30).all()
    assert (strip[22:, 30:] == 255).all()
    assert film_strip(frames, 9).shape == (20, 94, 3)
    with pytest.raises(ValueError, match="one shape"):
        film_strip([frames[0], frames[1][1:]], 2)
    with pytest.raises(ValueError, match="a column or more"):
        film_strip(frames, 0)
    with pytest.raises(ValueError, match="film strip needs"):
        film_strip([], 2)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"trail": np.zeros((4, 2))}, r"trail needs .*shape \(4, 2\)"),
        ({"trail": np.full((4, 3), np.nan)}, "trail needs finite"),
        ({"time": np.zeros(3)}, "time needs 300 finite"),
        ({"time": -np.arange(300.0)}, "do not fall"),
        ({"attitude": (0.0, 0.0)}, "attitude needs 3"),
        ({"speed": np.inf}, "speed needs 1 finite number,"),
        ({"current": (0.0, np.nan)}, "current needs 2"),
        ({"model_trail": dive(301)}, "at most the 300 points"),
        ({"commands": {"rudder": (0.0, 1.0)}}, "rudder"),
        ({"commands": {"rudder_rad": (0.0, 0.0)}}, "limits that differ"),
    ],
)
def test_a_scene_that_cannot_be_drawn_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        scene(**changes)


@pytest.mark.parametrize(
    "fields, message",
    [
        ({"heading": np.nan}, "heading needs a finite number"),
        ({"waypoints": [1.0, 2.0, 3.0]}, r"waypoints need .*shape \(3,\)"),
        ({"waypoints": ROUTE, "active": 4}, "from 0 to 3"),
    ],
)
def test_a_target_that_cannot_be_drawn_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        Target(**fields)


def test_the_depth_asked_for_is_the_target_s_or_else_the_waypoint_s():
    assert Target(waypoints=ROUTE, active=2).next_depth == 60.0
    assert Target(waypoints=ROUTE, active=3).next_depth is None
    assert Target(waypoints=ROUTE, depth=7.0).next_depth == 7.0
    assert Target(waypoints=ROUTE, level=True).next_depth is None
    assert replace(Target(), depth=3.0).next_depth == 3.0


def test_a_route_is_drawn_from_where_it_begins():
    route = {"waypoints": ROUTE, "active": 0, "radius": 10.0}
    without, whole = (draw(scene(target=Target(**route, start=start))) for start in (None, dive()[0]))
    assert (without != whole).any()
    with pytest.raises(ValueError, match="start needs 3 finite numbers"):
        Target(**route, start=np.array([0.0, np.nan, 1.0]))


def test_a_long_title_is_written_whole(monkeypatch):
    title = "StationKeeping   BlueROV2 Heavy, remotely operated vehicle of 0.46 m with eight thrusters"
    written, write = [], Sheet.text

    def noted(sheet, at, text, *given, **options):
        written.append(text)
        return write(sheet, at, text, *given, **options)

    monkeypatch.setattr(Sheet, "text", noted)
    draw(scene(title=title))
    assert title in written
