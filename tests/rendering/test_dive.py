from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from auv_gym.rendering import Dive, draw
from auv_gym.rendering.dive import _steps
from auv_gym.rendering.sheet import COMMAND, TARGET, VEHICLE

TIME = 0.7 * np.arange(200)


def dive(**changes: Any) -> Dive:
    """A float on its way from 5 to 20 m, with the fields that are named changed."""
    fields: dict[str, Any] = {
        "time": TIME,
        "depth": 5.0 + 0.1 * TIME,
        "rate": np.full(TIME.size, 0.1),
        "target": np.where(TIME < 70.0, 12.0, 20.0),
        "command": np.where(TIME < 70.0, 0.54, 0.52),
        "position": np.linspace(0.55, 0.53, TIME.size),
        "engine": "piston_m",
        "limits": (0.5, 0.6),
        "title": "qiandao_float",
        "caption": "140 s",
        **changes,
    }
    return Dive(**fields)


def pixels(picture, colour):
    """Rows and columns of the pixels of a colour."""
    return np.nonzero((picture == np.round(np.multiply(to_rgb(colour), 255.0))).all(axis=2))


@pytest.mark.parametrize("size", [(960, 600), (1280, 720), (481, 300)])
def test_a_picture_has_the_size_asked_for_and_a_white_rim(size):
    picture = draw(dive(), size)
    assert picture.shape == (size[1], size[0], 3)
    for rim in (picture[:3], picture[-3:], picture[:, :3], picture[:, -3:]):
        assert (rim == 255).all()
    assert (draw(dive(), size) == picture).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"depth": 5.0 + 0.11 * TIME},
        {"rate": np.linspace(0.0, 0.1, TIME.size)},
        {"target": np.full(TIME.size, 12.0)},
        {"command": np.full(TIME.size, 0.54)},
        {"position": np.full(TIME.size, 0.55)},
        {"limits": (0.4, 0.6)},
        {"engine": "oil_volume_m3"},
        {"title": "another"},
        {"caption": "141 s"},
    ],
)
def test_whatever_a_dive_says_shows(changes):
    assert (draw(dive(**changes)) != draw(dive())).any()


def test_the_float_is_in_the_column_at_the_height_of_its_mark_in_the_strip():
    for depth in (4.0, 9.0, 16.0):
        picture = draw(dive(depth=np.full(TIME.size, depth)))
        rows, columns = pixels(picture, VEHICLE)
        strip = rows[(columns > 100) & (columns < 600) & (rows < 400)]
        body = rows[(columns > 780) & (columns < 815)]
        assert abs(np.median(strip) - 0.5 * (body.min() + body.max())) <= 2.0
        goal, columns = pixels(picture, TARGET)
        assert (columns[goal < 400] > 690).any()  # the target crosses the column too


def test_depth_is_down_and_a_deeper_float_is_lower():
    shallow, deep = (pixels(draw(dive(depth=np.full(TIME.size, d))), VEHICLE)[0] for d in (4.0, 16.0))
    assert np.median(deep) > np.median(shallow) + 50.0


def test_the_piston_shows_below_the_float_as_far_as_it_is_out():
    def rod(position):
        rows, columns = pixels(draw(dive(position=np.full(TIME.size, position))), COMMAND)
        return int((columns[rows < 400] > 690).sum())

    assert rod(0.6) > rod(0.55) > rod(0.5)


def test_a_line_that_stays_at_each_value_until_the_next_one_comes():
    times, values = _steps(np.array([0.0, 1.0, 2.0, 3.0]), np.array([5.0, 5.0, 7.0, 7.0]))
    assert times.tolist() == [0.0, 2.0, 2.0, 3.0]
    assert values.tolist() == [5.0, 5.0, 7.0, 7.0]


def test_one_moment_and_a_float_in_the_air_can_be_drawn():
    one = {name: np.array([value]) for name, value in (("time", 0.0), ("depth", -0.5), ("rate", 0.0), ("target", 0.0))}
    picture = draw(dive(**one, command=np.array([0.55]), position=np.array([0.55])))
    assert picture.shape == (600, 960, 3)
    assert pixels(picture, VEHICLE)[0].size > 100


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"depth": np.zeros(3)}, "depth needs as many numbers as its time"),
        ({"time": np.zeros(0)}, "time needs as many numbers"),
        ({"rate": np.full(TIME.size, np.nan)}, "rate needs finite numbers"),
        ({"time": TIME[::-1]}, "do not fall"),
        ({"engine": "piston"}, "piston"),
        ({"limits": (0.6, 0.5)}, "limits need to differ"),
    ],
)
def test_what_cannot_be_drawn_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dive(**changes)
