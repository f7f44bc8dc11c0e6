import pytest

from controllers.composed.loops import Cascade, Joint, Mirrored
from controllers.controller import Controller
from controllers.pid import Pid


def depth_by_pitch(**settings):
    outer = Pid(-0.1, integral=-0.01, measured="depth_m", command="pitch_rad", limit=0.3, **settings)
    return Cascade(outer, Pid(-2.0, measured="pitch_rad", command="stern_plane_rad", limit=0.35))


def reading(depth=10.0, pitch=0.0, heading=0.0, dt=1.0):
    return {"depth_m": depth, "pitch_rad": pitch, "heading_rad": heading, "dt_s": dt}


def test_the_outer_command_is_the_inner_target_and_is_reported():
    cascade = depth_by_pitch()
    command, _ = cascade.act(cascade.start(), reading(pitch=-0.05), {"depth_m": 11.0, "u_mps": 2.0})
    assert command == {"pitch_cmd_rad": pytest.approx(-0.1), "stern_plane_rad": pytest.approx(-2.0 * -0.05)}
    assert (cascade.targets, cascade.commands) == (("depth_m",), ("stern_plane_rad",))
    assert isinstance(cascade, Controller)


def test_a_pitch_target_of_the_caller_gives_way_to_the_outer_loop():
    cascade = depth_by_pitch()
    command, _ = cascade.act(cascade.start(), reading(), {"depth_m": 10.0, "pitch_rad": 0.3})
    assert command["stern_plane_rad"] == 0.0


def test_the_outer_loop_does_not_wind_up_while_the_plane_is_at_its_stop():
    cascade = depth_by_pitch(integral_range=2.0)
    state = cascade.start()
    for _ in range(1000):  # a vehicle that does not answer: the plane stands at its stop all the time
        command, state = cascade.act(state, reading(depth=0.0, pitch=0.2), {"depth_m": 20.0})
        assert command["stern_plane_rad"] == 0.35
    assert state.outer.integral == 0.0
    command, _ = cascade.act(state, reading(depth=20.0, pitch=0.0), {"depth_m": 20.0})
    assert command["stern_plane_rad"] == 0.0


def test_the_memory_passed_in_is_not_changed():
    cascade = Mirrored(Joint((depth_by_pitch(), Pid(1.0, integral=0.1))), -0.5)
    target = {"depth_m": 11.0, "heading_rad": 0.2}
    _, state = cascade.act(cascade.start(), reading(), target)
    one, two = cascade.act(state, reading(10.5), target), cascade.act(state, reading(10.5), target)
    assert one == two
    assert cascade.start() == Joint(cascade.controller.controllers).start()


def test_joint_leaves_alone_what_has_no_target():
    joint = Joint((depth_by_pitch(), Pid(1.0, integral=0.1)))
    assert joint.targets == ("depth_m", "heading_rad")
    assert joint.commands == ("stern_plane_rad", "rudder_rad")
    command, state = joint.act(joint.start(), reading(), {"heading_rad": 0.2})
    assert command == {"rudder_rad": pytest.approx(0.2)}
    assert state[0] == joint.start()[0]
    both, _ = joint.act(state, reading(), {"heading_rad": 0.2, "depth_m": 10.0})
    assert set(both) == {"pitch_cmd_rad", "stern_plane_rad", "rudder_rad"}


def test_joint_needs_controllers_with_commands_of_their_own():
    with pytest.raises(ValueError, match="rudder_rad twice"):
        Joint((Pid(1.0), Pid(2.0)))
    with pytest.raises(ValueError, match="at least one"):
        Joint(())


def test_bow_planes_mirror_the_stern_planes():
    mirrored = Mirrored(depth_by_pitch(), -0.5)
    command, _ = mirrored.act(mirrored.start(), reading(), {"depth_m": 11.0})
    assert command["bow_plane_rad"] == -0.5 * command["stern_plane_rad"] != 0.0
    assert mirrored.commands == ("stern_plane_rad", "bow_plane_rad")
    with pytest.raises(ValueError, match=r"share within \[-1, 1\], got -2"):
        Mirrored(depth_by_pitch(), -2.0)
