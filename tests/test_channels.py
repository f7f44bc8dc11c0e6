import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.channels import CHANNELS, channel, conversion, depth_from_pressure, known_suffixes, wrap

finite = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    "column, target, value, expected",
    [
        ("heading_deg", "heading_rad", 180.0, np.pi),
        ("r_degps", "r_radps", 90.0, np.pi / 2),
        ("u_kn", "u_mps", 1.0, 0.514444),  # international knot, 1852 m per hour
        ("depth_km", "depth_m", 0.6, 600.0),
        ("piston_mm", "piston_m", 25.0, 0.025),
        ("piston_cm", "piston_m", 2.5, 0.025),
        ("depth_ft", "depth_m", 10.0, 3.048),  # international foot
        ("oil_volume_cm3", "oil_volume_m3", 250.0, 2.5e-4),
        ("oil_volume_mL", "oil_volume_m3", 250.0, 2.5e-4),
        ("time_ms", "time_s", 1500.0, 1.5),
        ("time_min", "time_s", 2.0, 120.0),
        ("time_h", "time_s", 0.5, 1800.0),
        ("propeller_rpm", "propeller_rpm", 900.0, 900.0),
        ("propeller_V", "propeller_V", 12.0, 12.0),
        ("bow_thruster_N", "bow_thruster_N", -3.0, -3.0),
        ("pressure_bar", "pressure_dbar", 2.0, 20.0),
        ("temperature_degC", "temperature_C", 13.5, 13.5),
        ("wing_flap_deg", "wing_flap_rad", 180.0, np.pi),
    ],
)
def test_a_column_comes_in_under_its_si_name(column, target, value, expected):
    found, convert = conversion(column)
    assert found.name == target
    assert convert(np.array([value]))[0] == pytest.approx(expected, rel=1e-6)


@given(value=finite)
def test_units_of_the_same_quantity_agree(value):
    for one, other, ratio in [
        ("x_mm", "x_cm", 10.0),
        ("x_ms", "x_min", 6e4),
        ("x_cm3", "x_L", 1e3),
        ("x_mmps", "x_mps", 1e3),
    ]:
        there = conversion(one).convert(np.array([value * ratio]))
        assert there == pytest.approx(conversion(other).convert(np.array([value])), rel=1e-12)


@given(turns=st.integers(-50, 50), angle=st.floats(-3.14, 3.14))
def test_wrap_takes_whole_turns_off(turns, angle):
    # 50 turns are 314 rad, whose last digit is 6e-14
    assert wrap(angle + 2 * np.pi * turns) == pytest.approx(angle, abs=1e-12)


@given(degrees=st.floats(-720, 720))
def test_degrees_agree_with_numpy(degrees):
    assert conversion("roll_deg").convert(np.array([degrees]))[0] == pytest.approx(np.radians(degrees), rel=1e-15)


def test_pressure_in_a_depth_column_becomes_depth_and_elsewhere_stays():
    found, convert = conversion("depth_dbar")
    assert found.name == "depth_m"
    # UNESCO 44 (Fofonoff & Millard 1983), p. 28: 9712.653 m at 10000 dbar and 30 degrees; latitude is worth 0.3 %.
    assert convert(np.array([10000.0]))[0] == pytest.approx(9712.653, rel=3e-3)
    assert conversion("pressure_dbar").channel.name == "pressure_dbar"


@given(pressure=st.floats(0, 11000), step=st.floats(0.01, 100))
def test_depth_rises_with_pressure(pressure, step):
    assert depth_from_pressure(pressure + step) > depth_from_pressure(pressure)


@pytest.mark.parametrize("name", ["segment", "dive_id", "run", "stage", "dvl_good"])
def test_columns_that_are_no_quantity_need_no_unit(name):
    assert channel(name).unit == ""
    assert conversion(name).channel.held


@pytest.mark.parametrize(
    "column, texts",
    [
        ("heading_degs", ["'heading_degs'", "'_degs'", "Did you mean", "'deg'", "degps"]),
        ("heading", ["'heading'", "does not say its unit", "heading_rad"]),
        ("depth_fathom", ["'_fathom'", "map it"]),
        ("u_ms", ["'u_ms'", "u_mps", "milliseconds"]),
        ("depth_rad", ["depth_m"]),
    ],
)
def test_a_unit_that_is_unknown_or_does_not_fit_is_refused(column, texts):
    with pytest.raises(ValueError) as caught:
        conversion(column)
    assert all(text in str(caught.value) for text in texts)


def test_every_suffix_is_listed_in_the_error():
    with pytest.raises(ValueError) as caught:
        conversion("x_furlong")
    assert all(suffix in str(caught.value) for suffix in known_suffixes())


def test_a_stated_unit_wins_if_it_measures_the_same():
    assert conversion("heading_rad", "degrees").convert(np.array([180.0]))[0] == pytest.approx(np.pi)
    assert conversion("heading", "degree").channel.name == "heading_rad"
    assert conversion("depth_m", "m").convert(np.array([3.0]))[0] == 3.0
    with pytest.raises(ValueError, match="another quantity"):
        conversion("depth_m", "seconds")
    with pytest.raises(ValueError, match="unknown unit 'furlong'"):
        conversion("depth_m", "furlong")


def test_channels_are_in_si_and_say_which_are_angles():
    assert all(conversion(name).channel is known for name, known in CHANNELS.items())
    assert {name for name, known in CHANNELS.items() if known.angle} == {
        "roll_rad", "pitch_rad", "heading_rad", "heading_cmd_rad", "pitch_cmd_rad", "course_rad",
        "heading_magnetic_rad",
    }  # fmt: skip
    assert channel("heading_true_rad").angle
    assert channel("t1_us").held
    assert channel("fin_cmd_rad").held
    assert not channel("fin_rad").held
    with pytest.raises(ValueError, match="'heading_rad'"):
        channel("heading_deg")
