import copy

import numpy as np
import pytest

from controllers.composed.excited import Excited, command_without_excitation
from controllers.pid import Pid


class Silent:
    """A controller that commands what it is told, and does not say so beforehand."""

    def start(self):
        return 0

    def act(self, state, reading, target):
        return {"rudder_rad": target["heading_rad"]}, state + 1


def run(controller, times, target=0.0):
    """Commands at these times, s."""
    state, commands = controller.start(), []
    for dt in np.diff(times, prepend=times[0] - 0.5):
        command, state = controller.act(state, {"heading_rad": 0.0, "dt_s": dt}, {"heading_rad": target})
        commands.append(command)
    return {name: np.array([command[name] for command in commands]) for name in commands[0]}


def test_a_signal_at_an_actuator_is_added_to_the_command():
    found = run(Excited(Pid(2.0), {"rudder_rad": np.array([0.1, -0.1, 0.2])}, 1.0), np.arange(5.0), target=0.3)
    np.testing.assert_allclose(found["rudder_rad"], 0.6 + np.array([0.1, -0.1, 0.2, 0.0, 0.0]))
    np.testing.assert_allclose(found["excitation_rudder_rad"], [0.1, -0.1, 0.2, 0.0, 0.0])


def test_a_signal_at_a_set_point_is_added_to_the_target():
    found = run(Excited(Pid(2.0), {"heading_rad": np.array([0.1, -0.1])}, 1.0), np.arange(3.0), target=0.3)
    np.testing.assert_allclose(found["rudder_rad"], 2.0 * (0.3 + np.array([0.1, -0.1, 0.0])))
    np.testing.assert_allclose(found["excitation_heading_rad"], [0.1, -0.1, 0.0])


def test_a_signal_goes_by_the_clock_where_samples_are_uneven():
    signal = np.arange(10.0)
    times = np.array([0.0, 0.4, 1.0, 2.9, 3.0, 7.5, 30.0])
    found = run(Excited(Pid(1.0), {"rudder_rad": signal}, 1.0), times)
    np.testing.assert_array_equal(found["excitation_rudder_rad"], [0, 0, 1, 2, 3, 7, 0])


def test_a_sum_of_many_intervals_does_not_lose_a_sample():
    signal = np.arange(6000.0)
    found = run(Excited(Pid(1.0), {"rudder_rad": signal}, 0.1), 0.1 * np.arange(6000))
    np.testing.assert_array_equal(found["excitation_rudder_rad"], signal)


def test_an_actuator_left_alone_moves_about_its_rest():
    excited = Excited(Pid(2.0), {"bow_plane_rad": np.array([0.1, 0.2])}, 1.0, at_rest={"bow_plane_rad": 0.05})
    found = run(excited, np.arange(3.0))
    np.testing.assert_allclose(found["bow_plane_rad"], [0.15, 0.25, 0.05])
    assert excited.commands == ("rudder_rad", "bow_plane_rad")
    assert excited.targets == ("heading_rad",)


def test_it_is_pure():
    excited = Excited(Pid(2.0, integral=0.1), {"rudder_rad": np.array([0.1, -0.1, 0.2])}, 1.0)
    _, state = excited.act(excited.start(), {"heading_rad": 0.1, "dt_s": 1.0}, {"heading_rad": 0.0})
    kept = copy.deepcopy(state)
    target = {"heading_rad": 0.0}
    one = excited.act(state, {"heading_rad": 0.2, "dt_s": 1.0}, target)
    assert one == excited.act(state, {"heading_rad": 0.2, "dt_s": 1.0}, target)
    assert state == kept
    assert target == {"heading_rad": 0.0}


def test_a_command_without_its_excitation():
    assert command_without_excitation(
        {"rudder_rad": 0.5, "excitation_rudder_rad": 0.125, "excitation_depth_m": 1.0}
    ) == {
        "rudder_rad": 0.375,
        "excitation_rudder_rad": 0.0,
        "excitation_depth_m": 0.0,
    }


@pytest.mark.parametrize("controller", [Pid(1.0), Silent()])
def test_an_unknown_place_is_refused_with_those_there_are(controller):
    with pytest.raises(ValueError, match=r"excitation of bow_plane_rad: .* rudder_rad and is told heading_rad"):
        run(Excited(controller, {"bow_plane_rad": np.ones(3)}, 1.0), np.arange(3.0))


@pytest.mark.parametrize(
    "signals, dt, words",
    [
        ({"rudder_rad": np.ones((2, 2))}, 1.0, r"shape \(n,\) at rudder_rad"),
        ({"rudder_rad": np.array([0.0, np.nan])}, 1.0, "finite signal"),
        ({"rudder_rad": np.ones(3)}, 0.0, "dt > 0 s"),
        ({"rudder": np.ones(3)}, 1.0, "rudder"),
    ],
)
def test_settings_that_do_not_fit_are_refused(signals, dt, words):
    with pytest.raises(ValueError, match=words):
        Excited(Pid(1.0), signals, dt)
