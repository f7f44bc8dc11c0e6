"""Cross-flow drag against its integral and another program, weight and buoyancy, and what a fin sees of the flow."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import quad

from auv_gym.param import pack, record_type
from auv_gym.physics.hydrodynamics import angle_of_attack, cross_flow_drag, righting
from auv_gym.vehicles.body.parts.surface import Surface

speeds, sizes = st.floats(-2.0, 2.0), st.floats(0.0, 2.0)
LENGTH, DENSITY, DRAG_Y, DRAG_Z = 2.0, 1000.0, 0.12, 0.15
GOLDEN = Path(__file__).parent / "golden" / "npsauv_cross_flow.csv"


def drag(v=0.0, w=0.0, q=0.0, r=0.0, drag_y=DRAG_Y, drag_z=DRAG_Z) -> np.ndarray:
    """Sway and heave force, pitch and yaw moment."""
    return np.array(cross_flow_drag(v, w, q, r, drag_y, drag_z, DENSITY, LENGTH))


def integral(v, w, q, r) -> np.ndarray:
    def density(x, part):
        across, down = v + x * r, w - x * q
        share = (DRAG_Y * across**2 + DRAG_Z * down**2) / max(math.hypot(across, down), 1e-300)
        side, lift = share * across, share * down
        return 0.5 * DENSITY * (-side, -lift, x * lift, -x * side)[part]

    return np.array([quad(density, -LENGTH / 2, LENGTH / 2, args=(i,), limit=200, epsabs=1e-9)[0] for i in range(4)])


@given(v=speeds, w=speeds, q=speeds, r=speeds, drag_y=sizes, drag_z=sizes)
def test_cross_flow_drag_takes_energy(v, w, q, r, drag_y, drag_z):
    assert drag(v, w, q, r, drag_y, drag_z) @ [v, w, q, r] <= 0.0


@given(v=speeds, w=speeds, q=speeds, r=speeds)
def test_the_mirror_image_of_a_cross_flow(v, w, q, r):
    assert np.array_equal(drag(-v, w, q, -r), drag(v, w, q, r) * [-1, 1, 1, -1])


@given(v=speeds, w=speeds, q=speeds, r=speeds)
def test_sway_and_heave_are_treated_alike(v, w, q, r):
    one, other = drag(v, w, q, r), drag(w, v, -r, -q, drag_y=DRAG_Z, drag_z=DRAG_Y)
    assert other == pytest.approx(one[[1, 0, 3, 2]] * [1, 1, -1, -1], abs=1e-11)


@given(v=speeds, w=speeds)
def test_the_drag_of_a_sideways_flow_is_against_it(v, w):
    sway, heave, _, _ = drag(v, w)
    assert sway * w == pytest.approx(heave * v, abs=1e-9)  # of some 1e3 N m/s, in rounding
    assert max(sway * v, heave * w) <= 0.0


@given(v=speeds, w=speeds, q=speeds, r=speeds)
def test_a_flow_along_one_axis_meets_that_axis_alone(v, w, q, r):
    sideways, upright = drag(v=v, r=r), drag(w=w, q=q)
    assert np.array_equal(sideways[[1, 2]], [0.0, 0.0])
    assert np.array_equal(upright[[0, 3]], [0.0, 0.0])
    x = np.linspace(-0.5, 0.5, 11) * LENGTH
    across, down = v + x * r, w - x * q
    side, lift = DRAG_Y * across * np.abs(across), DRAG_Z * down * np.abs(down)
    scale = 0.5 * DENSITY * LENGTH / 10.0
    assert sideways[[0, 3]] == pytest.approx(-scale * np.array([side.sum(), x @ side]), abs=1e-10)
    assert upright[[1, 2]] == pytest.approx(scale * np.array([-lift.sum(), x @ lift]), abs=1e-10)


@pytest.mark.parametrize(
    "nu", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.3, 0.2), (0.2, -0.1, 0.5, 1.0), (1e-200, 0.0, 0.0, 0.0)]
)
def test_a_strip_without_flow_has_no_drag(nu):
    # in the second case the middle strip stands still, in the third that at -0.2 m; the last one's square is zero
    found = drag(*nu)
    assert np.isfinite(found).all()
    assert np.any(found) == (max(map(abs, nu)) > 1e-100)


def test_cross_flow_drag_agrees_with_another_program():
    with GOLDEN.open(encoding="utf-8", newline="") as file:
        cases = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    assert len(cases) == 24
    for case in cases:
        flow = [case[name] for name in "vwqr"]
        sides = case["drag_y"] * case["height"], case["drag_z"] * case["breadth"]
        found = cross_flow_drag(*flow, *sides, 1025.0, 5.3)
        expected = [case[name] for name in ("sway", "heave", "pitch", "yaw")]
        # both round, in sums of eleven strips that cancel in part
        assert found == pytest.approx(expected, rel=0.0, abs=1e-13 * np.abs(expected).max())


@given(v=speeds, w=speeds, q=speeds, r=speeds)
def test_cross_flow_drag_is_the_sum_over_eleven_stations(v, w, q, r):
    x = np.linspace(-0.5, 0.5, 11) * LENGTH
    flow = np.array([v + x * r, w - x * q])
    share = [DRAG_Y, DRAG_Z] @ flow**2 / np.maximum(np.hypot(*flow), 1e-300)
    force = -0.5 * DENSITY * LENGTH / 10.0 * share * flow
    expected = [force[0].sum(), force[1].sum(), -(x * force[1]).sum(), (x * force[0]).sum()]
    assert drag(v, w, q, r) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(
    "nu, ratio",
    [
        ((1.0, 0.0, 0.0, 0.0), 1.1),  # eleven strips of a tenth of the length
        ((0.0, 1.0, 0.0, 0.0), 1.1),
        ((0.0, 0.0, 0.5, 0.0), 1.44),  # 2 sum of (i/10)^3 to i = 5, a tenth each, over 1/32
        ((0.0, 0.0, 0.0, 0.5), 1.44),
    ],
)
def test_the_published_strips_overrate_the_integral_by_their_full_weight_at_the_ends(nu, ratio):
    exact = integral(*nu)
    part = np.abs(exact) > 1e-6
    assert drag(*nu)[part] == pytest.approx(ratio * exact[part], rel=1e-9)


gravity = st.floats(0.0, 500.0)
places = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(weight=gravity, buoyancy=gravity, g=places, b=places, roll=st.floats(-3.0, 3.0), pitch=st.floats(-3.0, 3.0))
def test_weight_and_buoyancy_act_at_their_centres(weight, buoyancy, g, b, roll, pitch):
    down = np.array([-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)])
    expected = np.r_[(weight - buoyancy) * down, weight * np.cross(g, down) - buoyancy * np.cross(b, down)]
    assert np.array(righting(weight, buoyancy, *g, *b, *down)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("angle", [-0.3, 0.1, 0.5])
def test_a_low_centre_of_gravity_rights_the_vehicle(angle):
    weight, low = 300.0, 0.02
    heeled = righting(weight, weight, 0.0, 0.0, low, 0.0, 0.0, 0.0, 0.0, math.sin(angle), math.cos(angle))
    assert heeled[3] == pytest.approx(-weight * low * math.sin(angle), rel=1e-14)
    nose_up = righting(weight, weight, 0.0, 0.0, low, 0.0, 0.0, 0.0, -math.sin(angle), 0.0, math.cos(angle))
    assert nose_up[4] == pytest.approx(-weight * low * math.sin(angle), rel=1e-14)


def fin(**values):
    return pack(Surface(**values)).view(record_type(Surface))[0]


@given(angle=st.floats(-1.5, 1.5), u=speeds, cross=speeds, turn=speeds)
def test_a_fin_whose_flow_the_hull_holds_stands_at_its_own_angle(angle, u, cross, turn):
    assert angle_of_attack(angle, u, cross, turn, fin(lift=5.0, station=-0.7)) == angle


@given(angle=st.floats(-1.5, 1.5), cross=speeds, inflow=st.sampled_from([0.0, 1.0]))
def test_the_angle_of_attack_ends_at_stall(angle, cross, inflow):
    found = angle_of_attack(angle, 1.0, cross, 0.0, fin(lift=5.0, inflow=inflow, stall=0.3))
    free = angle - inflow * math.atan2(cross, 1.0)
    assert found == pytest.approx(math.copysign(min(abs(free), 0.3), free), abs=1e-15)


@given(u=speeds, cross=speeds, turn=speeds, lift=st.sampled_from([8.0, -8.0]), station=st.floats(-1.0, 1.0))
def test_an_undeflected_fin_takes_energy_ahead_and_astern(u, cross, turn, lift, station):
    angle = angle_of_attack(0.0, u, cross, turn, fin(lift=lift, inflow=1.0, station=station))
    assert u * abs(u) * lift * angle * (cross + station * turn) <= 0.0


@pytest.mark.parametrize("u", [1.5, -1.5])
def test_a_fin_along_the_flow_has_no_lift(u):
    # drifting to starboard, the flow comes from there: ahead the rudder must turn towards it, astern away
    angle = math.atan2(0.3, 1.5) * math.copysign(1.0, u)
    assert angle_of_attack(angle, u, 0.3, 0.0, fin(lift=8.0, inflow=1.0)) == pytest.approx(0.0, abs=1e-15)
