import pytest

from auv_gym.records.naming import candidates, looks_like


@pytest.mark.parametrize(
    "channel, columns, first",
    [
        ("rudder_rad", ["m_depth", "c_fin", "m_fin", "m_battpos"], "m_fin"),
        ("rudder_cmd_rad", ["m_fin", "c_fin"], "c_fin"),
        ("heading_rad", ["NAV_DEPTH", "NAV_HEADING", "DESIRED_HEADING"], "NAV_HEADING"),
        ("heading_cmd_rad", ["NAV_HEADING", "DESIRED_HEADING"], "DESIRED_HEADING"),
        ("heading_rad", ["ATT.Roll", "ATT.Yaw", "ATT.DesYaw"], "ATT.Yaw"),
        ("depth_m", ["x", "y", "z"], "z"),
        ("stern_plane_rad", ["sternPlane", "thruster"], "sternPlane"),
        ("pitch_rad", ["pitchAng", "eng_rollAng"], "pitchAng"),
        ("time_s", ["Zeit", "TimeUS", "n"], "TimeUS"),
        ("heading_rad", ["hdg", "speed"], "hdg"),
        ("roll_rad", ["phi", "theta", "psi"], "phi"),
        ("t2_share", ["Thr1", "Thr12", "Thr2"], "Thr2"),
        ("t2_us", ["Motor 1", "Motor 2"], "Motor 2"),
        ("t10_share", ["esc1", "esc10"], "esc10"),
        ("t1_share", ["temp1", "Thruster_01 %"], "Thruster_01 %"),
        ("u_dvl_mps", ["DVL stbd", "DVL fwd"], "DVL fwd"),
        ("v_dvl_mps", ["dvl_x", "dvl_y"], "dvl_y"),
        ("w_dvl_mps", ["BT vx", "BT vz"], "BT vz"),
    ],
)
def test_the_likeliest_column_comes_first(channel, columns, first):
    assert candidates(channel, columns)[0] == first


def test_nothing_looks_like_it():
    assert candidates("rudder_rad", ["temperature", "altitude", "n_satellites"]) == []
    assert looks_like("rudder_rad", ["temperature"]) == ""


def test_it_is_said_in_a_sentence():
    assert looks_like("rudder_rad", ["m_fin"]) == "`m_fin` looks like `rudder_rad`. "
    assert looks_like("rudder_rad", ["m_fin", "fin_2"]) == "`m_fin` and `fin_2` look like `rudder_rad`. "
