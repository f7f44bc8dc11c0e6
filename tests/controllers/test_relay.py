import copy
from math import pi, radians

import numpy as np
import pytest

from controllers.composed.loops import Joint
from controllers.pid import Pid
from controllers.relay import Relay, zigzag
from scripts.studies.manoeuvres import trials as manoeuvres

DEPTH = Pid(0.1, measured="depth_m", command="stern_plane_rad")


def replay(controller, values, channel="heading_rad", **targets):
    """The commands over readings of one channel."""
    state, commands = controller.start(), []
    for value in values:
        reading = {"depth_m": 10.0, channel: float(value), "dt_s": 0.1}
        command, state = controller.act(state, reading, {"depth_m": 12.0, **targets})
        commands.append(command)
    return {name: np.array([command[name] for command in commands]) for name in commands[0]}


@pytest.mark.parametrize("angle", [10, 20])
def test_a_zigzag_is_that_of_the_manoeuvres(angle):
    """The rudder of a run that another program steers, from its headings alone."""
    trial = manoeuvres.approach("heu_torpedo")
    run = manoeuvres.zigzag(trial, radians(angle))
    found = replay(zigzag(DEPTH, radians(angle), to_starboard=-1), run["heading_rad"])
    np.testing.assert_allclose(found["rudder_rad"], run["rudder_rad"], atol=1e-15)
    assert manoeuvres.executes(run).size == 5


def test_the_rest_is_left_to_the_controller():
    found = replay(zigzag(DEPTH, 0.2), [0.0, 0.1])
    np.testing.assert_allclose(found["stern_plane_rad"], 0.2)
    assert zigzag(DEPTH, 0.2).commands == ("stern_plane_rad", "rudder_rad")


def test_a_zigzag_swings_about_its_first_heading_over_south_too():
    turned = np.concatenate([np.arange(0.0, 0.3, 0.05), np.arange(0.25, -0.3, -0.05)])
    north, south = (
        replay(zigzag(DEPTH, 0.19), (start + turned + pi) % (2.0 * pi) - pi)["rudder_rad"] for start in (0.0, pi)
    )
    np.testing.assert_array_equal(north, south)
    assert list(np.flatnonzero(np.diff(north))) == [3, 14]  # where 0.2 and -0.2 come next


def test_a_relay_follows_its_target():
    relay = Relay(DEPTH, "bow_plane_rad", "pitch_rad", 0.1, 0.02, neutral=0.01, follow=True)
    values = [0.0, 0.3, 0.53, 0.5, 0.49, 0.47, 0.5, 0.53]
    found = replay(relay, values, "pitch_rad", pitch_rad=0.5)["bow_plane_rad"]
    np.testing.assert_allclose(found, 0.01 + 0.1 * np.array([1, 1, -1, -1, -1, 1, 1, -1]))


def test_a_relay_that_starts_beyond_its_band_pushes_back():
    relay = Relay(DEPTH, "rudder_rad", "heading_rad", 0.1, 0.02, follow=True)
    assert replay(relay, [0.5], heading_rad=0.0)["rudder_rad"][0] == -0.1


def test_nothing_changes_without_a_reading():
    values = [np.nan, 0.0, 0.1, np.nan, 0.25, np.nan]
    np.testing.assert_allclose(replay(zigzag(DEPTH, 0.2), values)["rudder_rad"], [0, 0.2, 0.2, 0.2, -0.2, -0.2])


def test_it_is_pure():
    relay = zigzag(DEPTH, 0.2)
    _, state = relay.act(relay.start(), {"heading_rad": 0.0, "depth_m": 1.0, "dt_s": 0.1}, {"depth_m": 1.0})
    kept = copy.deepcopy(state)
    reading = {"heading_rad": 0.3, "depth_m": 1.0, "dt_s": 0.1}
    assert relay.act(state, reading, {"depth_m": 1.0}) == relay.act(state, reading, {"depth_m": 1.0})
    assert state == kept


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="amplitude other than 0"):
        Relay(DEPTH, "rudder_rad", "heading_rad", 0.0, 0.1)
    with pytest.raises(ValueError, match="band >= 0, in the unit of heading_rad"):
        Relay(DEPTH, "rudder_rad", "heading_rad", 0.1, -0.1)
    with pytest.raises(ValueError, match="to_starboard 1 or -1"):
        zigzag(DEPTH, 0.2, to_starboard=0)
    with pytest.raises(ValueError, match="pitch_rad, which is not read"):
        replay(Relay(DEPTH, "rudder_rad", "pitch_rad", 0.1, 0.1), [0.0])
    with pytest.raises(ValueError, match="heading_rad, which is not told"):
        replay(Relay(Joint((DEPTH,)), "rudder_rad", "heading_rad", 0.1, 0.1, follow=True), [0.0])
