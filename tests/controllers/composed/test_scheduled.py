from dataclasses import dataclass
from math import nan

import pytest

from controllers.composed.scheduled import Scheduled
from controllers.controller import Controller


@dataclass(frozen=True)
class Listening:
    """Commands 0.1 rad and 900 rpm whatever it reads, and remembers that."""

    targets = ("depth_m",)
    commands = ("stern_plane_rad", "propeller_rpm")

    def start(self):
        return {}

    def act(self, state, reading, target):
        return {"stern_plane_rad": 0.1, "propeller_rpm": 900.0, "infeasible_flag": 0.0}, dict(reading)


FINS = Scheduled(Listening(), 2.0, {"stern_plane_rad": 0.3})


def act(state, **reading):
    return FINS.act(state, {"dt_s": 0.1, **reading}, {"depth_m": 3.0})


def test_it_is_a_controller_with_the_channels_of_the_one_inside():
    assert isinstance(FINS, Controller)
    assert (FINS.targets, FINS.commands) == (("depth_m",), ("stern_plane_rad", "propeller_rpm"))


@pytest.mark.parametrize(
    "speed, plane", [(2.0, 0.1), (1.6, 0.1 / 0.64), (2.5, 0.064), (1.01, 0.3), (0.0, 0.3), (9.0, 0.1 / 2.25)]
)
def test_a_fin_turns_with_the_inverse_square_of_the_speed_within_its_limit(speed, plane):
    command, _ = act(FINS.start(), u_mps=speed)
    assert command == {"stern_plane_rad": pytest.approx(plane), "propeller_rpm": 900.0, "infeasible_flag": 0.0}


def test_what_it_made_of_a_command_is_what_the_controller_reads():
    _, state = act(FINS.start(), u_mps=1.6)
    assert "stern_plane_rad" not in state.inner
    _, after = act(state, u_mps=1.6)
    assert after.inner["stern_plane_rad"] == pytest.approx(0.1)
    _, after = act(state, u_mps=2.0)  # the plane still stands where it was, and does more
    assert after.inner["stern_plane_rad"] == pytest.approx(0.1 / 0.64)
    _, slow = act(FINS.start(), u_mps=1.01)
    _, after = act(slow, u_mps=1.01)
    assert after.inner["stern_plane_rad"] == pytest.approx(0.3 * 0.505**2)
    _, after = act(state, u_mps=1.6, stern_plane_rad=0.05)  # a plane that tells where it stands
    assert after.inner["stern_plane_rad"] == pytest.approx(0.05 * 0.64)


def test_without_a_speed_the_last_one_counts():
    assert act(FINS.start())[0]["stern_plane_rad"] == 0.1
    _, state = act(FINS.start(), u_mps=1.6)
    for reading in ({}, {"u_mps": nan}):
        assert act(state, **reading)[0]["stern_plane_rad"] == pytest.approx(0.1 / 0.64)


@pytest.mark.parametrize("speed, limit", [(0.0, 0.3), (2.0, 0.0)])
def test_what_has_no_speed_or_limit_is_refused(speed, limit):
    with pytest.raises(ValueError, match="speed and limits above 0"):
        Scheduled(Listening(), speed, {"stern_plane_rad": limit})
