"""The forces of every kind of part: plain and compiled alike, levers, power, symmetry, and numbers by hand."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent))

from part_forces import DENSITY, GRAVITY, KINDS, PLACE, WATER, every_kind, motions, part_forces

from auv_gym.vehicles.body.kinds import part_kinds
from auv_gym.vehicles.body.parts.fin import Fin, lift_and_drag
from auv_gym.vehicles.body.parts.thruster import CURVES, read_curve
from tests.plain_python import run_plain

ROWS = motions(11)
U = ROWS[:, :3]
OMEGA = ROWS[:, 3:6]
DOWN = ROWS[:, 16:19]
ZERO = np.zeros((len(ROWS), 4))
STILL = np.zeros(len(ROWS))


@cache
def compiled_forces() -> dict[str, np.ndarray]:
    return every_kind()


def test_every_kind_and_form_is_tried():
    forms = {(name, choice) for name, kind in part_kinds().items() for choice in (kind.variants or {"": None})}
    slots = {(n, c): (part_kinds()[n].variants[c] if c else part_kinds()[n]).slot or n for n, c in forms}
    assert {slots[form] for form in KINDS} == {slot for slot in slots.values() if slot != "thruster_us"}


@pytest.mark.slow
def test_plain_python_gives_what_compiled_code_gives(tmp_path):
    run_plain(Path(__file__).with_name("part_forces.py"), tmp_path / "plain.npz")
    plain = np.load(tmp_path / "plain.npz")
    assert set(plain) == set(compiled_forces())
    for name, forces in compiled_forces().items():
        scale = np.abs(forces).max()
        assert scale > 0.0, name
        np.testing.assert_allclose(plain[name], forces, rtol=0.0, atol=1e-14 * scale, err_msg=name)


def forces_of(kind: str, choice: str = "", actuators: np.ndarray = ZERO, inputs: float = 16.0, **values) -> np.ndarray:
    given = KINDS[kind, choice][0] | values
    return part_forces(kind, choice, given, {}, ROWS, actuators, np.full(len(ROWS), inputs))


@pytest.mark.parametrize(
    "form", [f for f in KINDS if f[0] in ("fin", "thruster", "buoyancy_engine", "tether", "hull_volume")]
)
def test_moments_are_those_of_the_forces_where_the_part_is(form):
    """Where the flow does not turn, that is: moving a part then changes the moment by the lever alone."""
    rows = ROWS.copy()
    rows[:, 3:6] = 0.0
    actuators, inputs = np.full((len(rows), 4), 3e-4 if "engine" in form[0] else 0.2), np.full(len(rows), 15.0)
    at_origin = dict.fromkeys(PLACE, 0.0)
    here, there = (
        part_forces(*form, KINDS[form][0] | place, {}, rows, actuators, inputs) for place in (PLACE, at_origin)
    )
    np.testing.assert_allclose(here[:, :3], there[:, :3], atol=1e-12)
    lever = np.cross(list(PLACE.values()), here[:, :3])
    np.testing.assert_allclose(here[:, 3:] - there[:, 3:], lever, atol=1e-10)


def power(forces: np.ndarray) -> np.ndarray:
    return (forces[:, :3] * U + forces[:, 3:] * OMEGA).sum(axis=1)


@pytest.mark.parametrize("axis", ["yaw", "pitch"])
def test_a_fixed_fin_takes_energy_and_its_lift_none(axis):
    drag = forces_of("fin", axis, actuators=np.full((len(ROWS), 4), 0.25))
    assert (power(drag) < 0.0).all()
    lift = forces_of("fin", axis, actuators=np.full((len(ROWS), 4), 0.25), drag=0.0, induced=0.0, plate=0.0)
    assert np.abs(lift).max() > 1.0
    np.testing.assert_allclose(power(lift), 0.0, atol=1e-12)


def test_wings_lose_the_power_of_their_drag_alone():
    """Lift and side force lie across the flow. Source: definition of the flow axes."""
    rates = dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate", "roll", "pitch", "pitch_0", "yaw"), 0.0)
    forces = forces_of("wings", **rates)
    speed, alpha = np.linalg.norm(U, axis=1), np.arctan2(U[:, 2], U[:, 0])
    stalled = np.clip(alpha, -1.5708, 1.5708)
    np.testing.assert_allclose(power(forces), -WATER * (7.0 + 380.0 * stalled**2) * speed**3, rtol=1e-12)
    across = np.cross(U, [0.0, 1.0, 0.0])  # lift acts along it, or against it
    np.testing.assert_allclose((forces[:, :3] * U).sum(axis=1), power(forces), rtol=1e-12)
    assert ((forces[:, :3] * across).sum(axis=1) != 0.0).all()


def test_wings_are_the_same_to_either_side():
    mirrored = ROWS.copy()
    mirrored[:, [1, 3, 5]] *= -1.0
    there = part_forces("wings", "", KINDS["wings", ""][0], {}, mirrored, ZERO, STILL)
    np.testing.assert_allclose(there, forces_of("wings") * [1, -1, 1, -1, 1, -1], atol=1e-12)


def test_a_level_wing_at_an_angle_of_attack_by_hand():
    rows = ROWS[:1].copy()
    alpha, speed = 0.1, 0.5
    rows[0, :6] = speed * np.cos(alpha), 0.0, speed * np.sin(alpha), 0.0, 0.0, 0.0
    x, y, z, k, m, n = part_forces("wings", "", KINDS["wings", ""][0], {}, rows, ZERO, STILL[:1])[0]
    drag, lift = WATER * speed**2 * (7.0 + 380.0 * alpha**2), WATER * speed**2 * (-0.4 + 440.0 * alpha)
    assert x == pytest.approx(-drag * np.cos(alpha) + lift * np.sin(alpha))
    assert z == pytest.approx(-drag * np.sin(alpha) - lift * np.cos(alpha))
    assert m == pytest.approx(WATER * speed**2 * (-0.3 - 65.0 * alpha))
    assert (y, k, n) == (0.0, 0.0, 0.0)


def test_lift_and_drag_of_a_fin_have_no_jump_and_end_across_the_flow():
    fin = Fin(area=1.0, lift_slope=4.0, drag=0.02, induced=0.1, plate=1.2, stall=0.2)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 4001)
    plain = getattr(lift_and_drag, "py_func", lift_and_drag)
    both = np.array([plain(a, fin) for a in angles])
    assert np.abs(np.diff(both, axis=0)).max() < 0.02
    assert both[:, 0].max() >= 0.8
    np.testing.assert_allclose(both[[0, -1], 0], 0.0, atol=1e-12)
    assert both[-1, 1] == pytest.approx(0.02 + 1.2 * (1.0 - np.sin(0.2) ** 2))
    np.testing.assert_allclose(both[:, 0], -both[::-1, 0], atol=1e-12)
    np.testing.assert_allclose(both[:, 1], both[::-1, 1], atol=1e-12)


def test_a_rudder_behind_the_centre_turns_to_port_and_a_plane_turns_down():
    rows = ROWS[:1].copy()
    rows[0, :6] = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    angle, place = np.full((1, 4), 0.1), {"x": -1.0, "y": 0.0, "z": 0.0}
    push = 0.5 * WATER * DENSITY * 0.02 * 4.0 * 0.1
    numbers = {"area": 0.02, "lift_slope": 4.0, **place}
    np.testing.assert_allclose(
        part_forces("fin", "yaw", numbers, {}, rows, angle, STILL[:1])[0], [0, push, 0, 0, 0, -push], atol=1e-12
    )
    np.testing.assert_allclose(
        part_forces("fin", "pitch", numbers, {}, rows, angle, STILL[:1])[0], [0, 0, -push, 0, -push, 0], atol=1e-12
    )


def test_a_thruster_pushes_along_its_direction_by_its_curve_its_supply_and_what_is_left_of_it():
    curve = {f"curve.{key}": value for key, value in read_curve("t200").items()}
    actuators = np.linspace(-1.0, 1.0, len(ROWS))[:, None] * np.ones((1, 4))
    forces = forces_of("thruster", "share", actuators, inputs=12.0, torque_arm=0.0, dead_zone=0.1, **curve)
    table = np.array(CURVES["t200"])
    wanted = np.interp(actuators[:, 0], table[:, 0], table[:, 1]) * (12.0 / 16.0) ** 1.2
    wanted[np.abs(actuators[:, 0]) <= 0.1] = 0.0
    np.testing.assert_allclose(forces[:, :3], wanted[:, None] * [0.6, 0.0, -0.8], atol=0.35)  # between its points
    exact = forces_of("thruster", "share", np.full((len(ROWS), 4), 0.5), inputs=16.0, **curve)
    np.testing.assert_allclose(exact[:, :3], 19.2 * np.broadcast_to([0.6, 0.0, -0.8], (len(ROWS), 3)), rtol=1e-12)
    torque = np.cross(list(PLACE.values()), exact[0, :3]) + 0.02 * exact[0, :3]
    np.testing.assert_allclose(exact[0, 3:], torque, rtol=1e-12)


def test_a_thruster_sits_points_and_pushes_otherwise_by_its_effects():
    curve = {f"curve.{key}": value for key, value in read_curve("t200").items()}
    values = KINDS["thruster", "share"][0] | curve | {"torque_arm": 0.0}

    def pushed(share: float, rows: np.ndarray = ROWS, supply: float = 16.0, **effects: float) -> np.ndarray:
        actuators, inputs = np.full((len(ROWS), 4), share), np.full(len(ROWS), supply)
        return part_forces("thruster", "share", values, effects, rows, actuators, inputs)

    ahead, astern = pushed(0.5), pushed(-0.5)
    np.testing.assert_allclose(pushed(0.5, astern=0.2), ahead, rtol=1e-12)
    np.testing.assert_allclose(pushed(-0.5, astern=0.2, lost=0.1), 0.7 * astern, rtol=1e-12)
    moved = np.array(list(PLACE.values())) + [0.01, 0.02, 0.03]
    shifted = pushed(0.5, shift_x=0.01, shift_y=0.02, shift_z=0.03)
    np.testing.assert_allclose(shifted[:, 3:], np.cross(moved, ahead[:, :3]), rtol=1e-12)
    turned = pushed(0.5, turn_x=0.3, turn_y=-0.2, turn_z=0.5)
    np.testing.assert_allclose(turned[:, :3], Rotation.from_rotvec([0.3, -0.2, 0.5]).apply(ahead[:, :3]), rtol=1e-12)
    slowed = pushed(-0.5, inflow=4.0) - astern
    along = (U + np.cross(OMEGA, list(PLACE.values()))) @ [0.6, 0.0, -0.8]
    np.testing.assert_allclose(power(slowed), -4.0 * 0.5 * along**2, rtol=1e-10)  # it takes energy, whatever it does
    sagging = ROWS.copy()
    sagging[:, 19] = 1.5
    np.testing.assert_allclose(pushed(0.5, sagging), pushed(0.5, supply=14.5), rtol=1e-12)


def test_volume_lifts_by_the_water_it_displaces_and_does_the_work_of_its_depth():
    engine = forces_of("buoyancy_engine", actuators=np.full((len(ROWS), 4), 5e-4), **dict.fromkeys(PLACE, 0.0))
    lift = WATER * DENSITY * GRAVITY * 3e-4
    np.testing.assert_allclose(engine[:, :3], -lift * DOWN, rtol=1e-12)
    sinking = (U * DOWN).sum(axis=1)
    np.testing.assert_allclose(power(engine), -lift * sinking, rtol=1e-9, atol=1e-12)


def test_a_hull_is_squeezed_by_depth_and_grows_with_warmth():
    given = dict.fromkeys(PLACE, 0.0)
    squeezed = forces_of("hull_volume", inputs=10.0, **given)
    pressure = WATER * DENSITY * GRAVITY * ROWS[:, 9]
    change = 0.06 * np.expm1(-4e-10 * pressure)
    weight = -WATER * DENSITY * GRAVITY * change[:, None] * DOWN
    np.testing.assert_allclose(squeezed[:, :3], weight, rtol=1e-6, atol=1e-12)
    warm = forces_of("hull_volume", inputs=15.0, compressibility=0.0, **given)
    np.testing.assert_allclose(warm[:, :3], -WATER * DENSITY * GRAVITY * 0.06 * np.expm1(7e-5 * 5.0) * DOWN, rtol=1e-9)


def test_a_tether_pulls_steadily_over_ground_and_drags_against_the_flow():
    still = forces_of("tether", drag=0.0)
    ground = np.einsum("nij,nj->ni", ROWS[:, 10:19].reshape(-1, 3, 3), still[:, :3])
    np.testing.assert_allclose(ground, np.broadcast_to([4.0, -2.0, 1.0], ground.shape), rtol=1e-12)
    drag = forces_of("tether", north=0.0, east=0.0, down=0.0, **dict.fromkeys(PLACE, 0.0))
    np.testing.assert_allclose(power(drag), -3.0 * WATER * np.linalg.norm(U, axis=1) ** 3, rtol=1e-12)


def test_a_moving_mass_weighs_where_it_is():
    forces = forces_of("moving_mass", "both", actuators=np.full((len(ROWS), 4), 0.05))
    weight = 12.0 * GRAVITY * DOWN
    place = np.array([-0.7 + 0.05, 0.3 - 0.02 * np.sin(0.05), 0.15 + 0.02 * np.cos(0.05)])
    np.testing.assert_allclose(forces, np.hstack([weight, np.cross(place, weight)]), rtol=1e-12, atol=1e-12)
