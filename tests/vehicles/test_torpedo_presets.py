"""The presets in six degrees of freedom: printed tables, another program's numbers, steady speeds, and their limits."""

import itertools
import math
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.physics.frames import euler_angles_of, rotation_of
from auv_gym.physics.propulsion import INFLOWS, VOLTAGES
from auv_gym.physics.rigid_body import coriolis_forces
from auv_gym.plant import Plant, load_vehicle
from auv_gym.vehicles.body.derived import fill_added_mass
from auv_gym.vehicles.body.dynamics import enter
from auv_gym.vehicles.body.parts.propeller import thrust_and_torque

PRESETS = ("npsauv", "heu_torpedo", "remus100", "vt690")
FOLDER = Path(__file__).parents[2] / "auv_gym" / "vehicles" / "presets"
FIN_LIMIT, RPM_LIMIT = math.radians(20.0), 1500.0

# State derivatives of NPS AUV II without cross-flow drag, from npsauv.m of the MSS toolbox (MIT licence, revision of
# April 2024) run in GNU Octave.  Per case: u v w p q r x y z phi theta psi; rudder, stern plane, delta_b, port and
# starboard bow plane, rpm; the derivative of the twelve states.
MSS_CASES = """
1.1476655296663247 -0.3491508260754981 0.15093447303985374 -0.1710254853329829 0.01435280172267568
-0.053724433234965785 -44.20010752252932 0.7435733189420257 -46.250434155801514 -0.06635431633761413
-0.43014457642538106 -2.5716259809776343
-0.06586943357691079 0.2852322871333028 -0.3282947208742114 -0.24151956544180775 0.11120646537018711
1526.7925194398078
0.0718595362783489 0.02484780823085315 -0.08134627492418946 0.4175083573701083 0.02121934992264539 0.05515862269390886
-0.9998088261024681 -0.2388901746350917 0.6365041069747523 -0.14599454858840444 0.010758983700896388
-0.06002590863738483

1.9586700760787934 -0.2947824729179135 0.23982859142074187 0.1902940376411082 -0.002420488460268855
-0.04697580910700601 -2.098983592937398 18.369656270235147 26.697010581752266 0.11697401577824973 0.14276297538198623
-2.654822855475079
-0.3076796669138512 -0.2147276120817258 0.2122470969277561 -0.17067824515426142 0.059133236728052804
217.45689865491522
0.00764134197896363 0.17443651210721398 -0.04045934973816733 -0.2579353264339947 0.10542024616149702
0.0892379939379645 -1.8892244221560022 -0.6369541820059768 -0.07696349318592835 0.18354723316669827
0.0030784787893893308 -0.047419697854408145

1.1781390661444409 -0.22768533725313167 0.4576896053087891 0.046791392694668636 -0.09513101057279744
0.08665429857247275 -18.35163688344652 -22.436967270518938 -49.622838406583625 0.2556523725060236 0.4164596036498125
0.8418214365882676
0.3868087198494467 -0.4151643446528599 -0.2322455004599366 -0.021651631548822645 0.39861369763143595
1535.4748121418008
0.2026998429901992 0.0670056110907375 -0.07123618848727342 0.07325732898938181 0.15338702829555273
-0.03208412919870694 1.0721194897586677 0.6960223740916086 -0.12427671232768234 0.07323470878404105
-0.11395196021711203 0.06536877207175557

1.136133707406888 0.4031682273927055 -0.3858318317430539 0.19144870791869653 -0.17725882938205975 0.1580150389301913
16.828001234850564 -28.884145200295386 -2.254464600024908 -0.21376684964307324 -0.2422068584348943 -1.8747653321870665
-0.1184380854570306 0.4284966068753632 0.43466170761689715 0.37095208039145455 -0.35119092037491734 605.2000744781672
-0.13982997162624844 -0.31016927565565294 0.07049374377348448 0.18933055385152744 0.047688218447619814
0.056142800721333604 -0.06550698753601497 -1.2516944357157198 -0.1765800024169187 0.14400819477408414
-0.1397024886187129 0.19779601129236804

1.0241352372889776 0.06896083484237447 0.028148499015063 0.18278422099082092 0.19687301426711468 -0.18635536755605067
6.0628435780402885 27.091276716628688 37.238270192775104 0.27429843266496046 0.13310181775517738 0.8458630767634884
-0.11963320916584744 -0.19060430009400733 0.2577112134096461 0.3253411656309701 0.3827888490255711 1153.867324447951
-0.04881030707476788 0.05403962568165354 -0.04708477129235824 -0.7462169002713552 -0.1091448929320125
-0.04806310332266859 0.6331277937609365 0.8033382786022917 -0.09054129386983756 0.16590544775268562
0.23999139753040377 -0.12718619760413621
"""
# The inverse mass matrix that this revision prints and multiplies by, with density 1000 and mass 5454.54.
MSS_INVERSE_MASS = np.array(
    [
        [1.662e-4, 1.846e-10, 1.303e-7, 3.726e-9, -1.132e-6, 7.320e-10],
        [1.846e-10, 1.052e-4, 3.843e-10, 9.638e-6, -3.340e-9, 2.368e-6],
        [1.303e-7, 3.843e-10, 4.315e-5, 7.757e-9, -2.357e-6, 1.524e-9],
        [3.726e-9, 9.638e-6, 7.757e-9, 2.431e-4, -6.742e-8, -7.740e-7],
        [-1.132e-6, -3.340e-9, -2.357e-6, -6.742e-8, 2.049e-5, -1.324e-8],
        [7.320e-10, 2.368e-6, 1.524e-9, -7.740e-7, -1.324e-8, 4.838e-5],
    ]
)
# The largest acceleration of each column over the 200 cases from which those above were taken.
MSS_LARGEST = np.array([0.361, 0.453, 0.259, 1.257, 0.465, 0.302])
CASES = np.array(MSS_CASES.split(), dtype=float).reshape(-1, 30)


def rates(plant: Plant, state: np.ndarray, commands: Sequence[float]) -> np.ndarray:
    """The derivative of the integrated state at [u v w p q r | x y z | phi theta psi], actuators at the commands."""
    z, dz = np.zeros(14), np.zeros(14)
    enter(np.append(state, 0.0), z)
    view = plant.family.view(plant.derived)
    plant.family.hooks.derivative(z, np.array(commands), np.array(commands), view, dz, np.zeros(plant.family.scratch))
    return dz


def mass_matrix(plant: Plant) -> np.ndarray:
    return np.linalg.inv(np.array(plant.family.view(plant.derived).computed.inverse_mass))


def told(plant: Plant, rudder: float = 0.0, plane: float = 0.0, drive: float = 0.0, bow: float = 0.0) -> np.ndarray:
    """The inputs: rudder, stern plane, bow planes where there are any, propulsion."""
    return np.array([rudder, plane, *([bow] if "bow_plane_rad" in plant.inputs else []), drive])


def afloat(speed: float, **known: float) -> np.ndarray:
    """A state in straight motion, but for what is given by name."""
    names = ("u", "v", "w", "p", "q", "r", "north", "east", "depth", "roll", "pitch", "heading")
    return np.array([known.get(name, speed if name == "u" else 0.0) for name in names])


def run(plant: Plant, command, seconds: float, speed: float) -> np.ndarray:
    """The states over time, shape (samples, 12); command: the inputs, or a function of the state."""
    y = np.full(len(plant.outputs), np.nan)
    y[plant.outputs.index("u_mps")] = speed
    x = plant.initial(y)
    states = np.empty((round(seconds / plant.dt), 12))
    for row in range(len(states)):
        x = plant.step(x, np.asarray(command(x) if callable(command) else command, dtype=float))
        states[row] = x[:12]
    return states


def steady_speed(plant: Plant, command: float, start: float) -> float:
    return run(plant, told(plant, drive=command), 300.0, start)[-1, 0]


def modes(plant: Plant, speed: float, command: float) -> np.ndarray:
    """Eigenvalues of [u v w p q r roll pitch] in straight and level motion."""

    def change(small: np.ndarray) -> np.ndarray:
        state = afloat(speed)
        state[:6] += small[:6]
        state[9:11] += small[6:]
        return np.append(rates(plant, state, told(plant, drive=command))[:6], small[3:5])

    h = 1e-6
    return np.linalg.eigvals(np.array([change(h * e) - change(-h * e) for e in np.eye(8)]).T / (2.0 * h))


@pytest.fixture(scope="module")
def nps_1994(tmp_path_factory) -> Plant:
    """NPS AUV II with the constants of the revision that the cases come from, without cross-flow drag."""
    text = (FOLDER / "npsauv.toml").read_text(encoding="utf-8")
    # the weight stays 53400 N whatever the mass, as that revision has it
    changes = {"density": 1000.0, "mass": 5454.54, "gravity": 53400.0 / 5454.54, "drag_y": 0.0, "drag_z": 0.0}
    for key, value in changes.items():
        text, count = re.subn(rf"(?m)^{key} = {{ value = [0-9.]+", f"{key} = {{ value = {value!r}", text)
        assert count == 1
    path = tmp_path_factory.mktemp("vehicles") / "nps_1994.toml"
    path.write_text(text, encoding="utf-8")
    plant = load_vehicle(path)
    return replace_at(plant, "parts.propeller.t_nn", plant.parts.propeller.t_nn * 1000.0 / 1025.0)


@pytest.mark.parametrize("name", PRESETS)
def test_every_number_has_a_unit_and_a_source(name):
    def leaves(table):
        for key, entry in table.items():
            if "value" in entry:
                yield key, entry
            elif not isinstance(entry, str):  # as the kind of a part is
                yield from leaves(entry)

    content = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    found = [*leaves(content["hull"]), *leaves(content["parts"])]
    assert len(found) > 70
    assert [key for key, entry in found if not entry.get("unit") or not entry.get("source")] == []


@pytest.mark.parametrize("name", PRESETS)
def test_mass_matrix_is_positive_definite(name):
    matrix = mass_matrix(load_vehicle(name))
    assert np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0] > 0.0


def test_prime_coefficients_become_dimensional_by_density_and_length():
    plant = load_vehicle("npsauv")
    for path, value in (
        ("hull.sway.uv", -0.1 * 0.5 * 1025.0 * 5.3**2),
        ("hull.added_mass.y_vdot", -0.055 * 0.5 * 1025.0 * 5.3**3),
        ("hull.pitch.uq", -0.068 * 0.5 * 1025.0 * 5.3**4),
        ("hull.added_mass.m_qdot", -0.017 * 0.5 * 1025.0 * 5.3**5),
    ):
        assert value_at(plant, path) == pytest.approx(value, rel=1e-14)


def test_nps_inverse_mass_matrix_has_the_printed_digits(nps_1994):
    inverse = np.array(nps_1994.family.view(nps_1994.derived).computed.inverse_mass)
    # half a unit of the fourth digit
    tolerance = 0.5e-3 * 10.0 ** np.floor(np.log10(np.abs(MSS_INVERSE_MASS)))
    assert np.all(np.abs(inverse - MSS_INVERSE_MASS) <= tolerance)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"u={case[0]:.2f}")
def test_nps_state_derivative_agrees_with_the_mss_toolbox(nps_1994, case):
    state, inputs, expected = case[:12], case[12:18].copy(), case[18:]
    rudder, stern, centre_bow, port_bow, starboard_bow = np.clip(inputs[:5], -FIN_LIMIT, FIN_LIMIT)
    bow = 0.5 * (port_bow + starboard_bow)
    found = rates(nps_1994, state, (rudder, stern, bow, min(inputs[5], RPM_LIMIT)))
    forces = mass_matrix(nps_1994) @ found[:6]
    # X_dbdb2 delta_b^2 belongs to a third bow plane angle, which the preset has no input for
    forces[0] += -0.004 * 0.5 * 1000.0 * 5.3**2 * state[0] ** 2 * centre_bow**2
    # the same arithmetic in another order
    np.testing.assert_allclose(MSS_INVERSE_MASS @ forces, expected[:6], rtol=0.0, atol=1e-14)
    # the printed inverse has four digits
    inverse = np.linalg.inv(mass_matrix(nps_1994))
    assert np.all(np.abs(inverse @ forces - expected[:6]) < 3e-4 * MSS_LARGEST)
    np.testing.assert_allclose(found[6:9], expected[6:9], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"u={case[0]:.2f}")
def test_nps_attitude_rates_agree_with_the_mss_toolbox(nps_1994, case):
    found = rates(nps_1994, case[:12], (0.0, 0.0, 0.0, 0.0))
    z = np.zeros(14)
    enter(np.append(case[:12], 0.0), z)

    def angles(step: float) -> np.ndarray:
        quaternion = z[9:13] + step * found[9:13]
        r11, r12, r13, r21, r22, r23, r31, _, _ = rotation_of(*(quaternion / np.linalg.norm(quaternion)))
        return np.array(euler_angles_of(r11, r12, r13, r21, r22, r23, r31))

    h = 1e-5
    # a central difference: h^2 and rounding over h
    np.testing.assert_allclose((angles(h) - angles(-h)) / (2.0 * h), case[27:30], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("rpm", [800.0, 1300.0, 1500.0])
def test_nps_runs_at_the_published_speed_per_shaft_speed(rpm):
    speed = 0.012 * rpm * 2.0 * math.pi / 60.0
    plant = load_vehicle("npsauv")
    np.testing.assert_allclose(rates(plant, afloat(speed), told(plant, drive=rpm))[:6], 0.0, rtol=0.0, atol=1e-12)
    # the slowest case settles with a time constant of half a minute at speed 1 m/s
    assert steady_speed(plant, rpm, 0.8 * speed) == pytest.approx(speed, rel=1e-3)


def hold_course(plant: Plant, depth: float, propulsion: float):
    """Rudder and stern plane that hold heading zero and a depth, as a function of the state."""
    up = math.copysign(1.0, plant.parts.stern_plane.moment)  # which way the stern plane pitches
    integral = 0.0

    def command(x: np.ndarray) -> np.ndarray:
        nonlocal integral
        integral += plant.dt * (x[8] - depth)
        pitch = np.clip(0.1 * (x[8] - depth) + 0.01 * integral, -0.4, 0.4)
        return told(plant, 2.0 * x[11] + 2.0 * x[5], up * (2.0 * (pitch - x[10]) - 2.0 * x[4]), propulsion)

    return command


def test_remus_makes_its_speed_on_a_held_course():
    plant = load_vehicle("remus100")
    straight = math.sqrt(3.86 / 1.62)  # X_prop against X_u|u|
    assert rates(plant, afloat(straight), told(plant, drive=1500.0))[0] == pytest.approx(0.0, abs=1e-3)
    last = run(plant, hold_course(plant, 5.0, 1500.0), 300.0, 1.5)[-1]
    # 7 N of buoyancy and the heel cost a little of 1.54 m/s
    assert 1.45 < last[0] < straight
    assert last[8] == pytest.approx(5.0, abs=0.05)
    # K_prop against the metacentric moment W z_G
    assert last[9] == pytest.approx(-math.asin(0.543 / (299.0 * 0.0196)), abs=0.005)
    assert last[10] < -0.03  # nose down against the buoyancy


def test_remus_does_not_hold_its_course_by_itself():
    found = modes(load_vehicle("remus100"), 1.5, 1500.0)
    # sway and yaw alone: Y_uv N_ur - N_uv (Y_ur - m) < 0
    assert -28.6 * -2.0 + 24.0 * (5.22 - 30.48) < 0.0
    assert np.real(found).max() == pytest.approx(1.01, abs=0.02)


@pytest.mark.parametrize("name, command", [("npsauv", 1300.0), ("heu_torpedo", 4.5), ("vt690", 1.5)])
def test_the_others_hold_their_course(name, command):
    assert np.real(modes(load_vehicle(name), 1.5, command)).max() < 0.0


def test_heu_needs_14_newton_at_full_speed():
    plant = load_vehicle("heu_torpedo")
    resistance = -plant.hull.surge.u_u * 1.5**2
    assert resistance == pytest.approx(14.15, abs=0.05)
    p = plant.family.view(plant.derived)
    own = p.parts.propeller[0], p.effects.parts.propeller[0], p.derived.propeller[0]
    thrust, torque = thrust_and_torque(4.5, 1.5, p.computed.density, *own)
    assert thrust == pytest.approx(resistance, rel=0.01)
    assert torque == 0.0


@pytest.mark.parametrize("voltage, speed", [(3.5, 1.17), (4.0, 1.32), (4.5, 1.50), (5.0, 1.69)])
def test_heu_speed_per_voltage(voltage, speed):
    assert steady_speed(load_vehicle("heu_torpedo"), voltage, 1.0) == pytest.approx(speed, abs=0.01)


def test_heu_thrust_table_rises_with_voltage_and_falls_with_inflow():
    plant = load_vehicle("heu_torpedo")
    table = np.array(plant.family.view(plant.derived).parts.propeller[0].table, dtype=float)
    grid = table.reshape(len(VOLTAGES), len(INFLOWS))
    assert np.all(np.diff(grid, axis=0) > 0.0)
    assert np.all(np.diff(grid, axis=1) < 0.0)
    assert grid.max() == pytest.approx(35.0, abs=0.1)


@pytest.mark.parametrize("name, tolerance", [("remus100", 0.06), ("heu_torpedo", 1e-3)])
def test_listed_cross_terms_are_those_of_an_ideal_fluid(name, tolerance):
    # Without forward speed, what the polynomials list is the Coriolis force of the added mass; remus100 prints
    # 4.86 where its own added inertias make 4.81. In roll, forces cancel on a body of revolution.
    plant = load_vehicle(name)
    hull = plant.hull
    added = np.zeros((6, 6))
    fill_added_mass(plant.family.view(plant.derived).hull.added_mass, added)
    rng = np.random.default_rng(1)
    for v, w, p, q, r in rng.uniform(-1.0, 1.0, (20, 5)):
        values = {
            "vr": v * r,
            "wq": w * q,
            "qq": q * q,
            "rr": r * r,
            "wp": w * p,
            "vp": v * p,
            "pq": p * q,
            "pr": p * r,
        }
        found = [
            sum(getattr(group, term) * value for term, value in values.items())
            for group in (hull.surge, hull.sway, hull.heave, hull.pitch, hull.yaw)
        ]
        expected = np.array(coriolis_forces(added, 0.0, v, w, p, q, r))[[0, 1, 2, 4, 5]]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("speed", [0.8, 1.5, 2.2])
def test_vt690_flies_level_at_the_commanded_speed(speed):
    plant = load_vehicle("vt690")
    np.testing.assert_allclose(rates(plant, afloat(speed), told(plant, drive=speed))[:6], 0.0, rtol=0.0, atol=1e-12)
    assert steady_speed(plant, speed, 0.5) == pytest.approx(speed, rel=1e-4)


def test_vt690_needs_buoyancy_to_fly_as_in_its_log():
    # In a log at 1.5 m/s it is level at -0.042 rad of pitch with 0.129 rad of stern plane; a neutral model needs none
    plant = load_vehicle("vt690")
    pitch, speed = -0.042, 1.5
    state = afloat(speed, w=speed * math.tan(pitch), pitch=pitch)

    def balance(buoyancy: float, plane: float) -> np.ndarray:
        trimmed = replace_at(plant, "effects.load.net_buoyancy", buoyancy)
        return (mass_matrix(plant) @ rates(trimmed, state, told(plant, plane=plane, drive=speed))[:6])[[2, 4]]

    at_rest = balance(0.0, 0.0)
    slopes = np.column_stack([balance(1.0, 0.0) - at_rest, (balance(0.0, 0.1) - at_rest) / 0.1])
    buoyancy, plane = np.linalg.solve(slopes, -at_rest)
    assert buoyancy == pytest.approx(5.9, abs=0.1)  # N, 1.3 % of the weight, where the source has none
    assert plane == pytest.approx(0.147, abs=0.002)
    assert plane == pytest.approx(0.129, rel=0.15)


@pytest.mark.parametrize("name", PRESETS)
def test_sign_conventions_of_the_fins(name):
    plant = load_vehicle(name)
    propulsion = plant.parts.propeller.design
    straight = run(plant, told(plant, drive=propulsion), 4.0, 1.5)[-1]
    rudder = run(plant, told(plant, rudder=0.1, drive=propulsion), 4.0, 1.5)[-1] - straight
    plane = run(plant, told(plant, plane=0.1, drive=propulsion), 4.0, 1.5)[-1] - straight
    assert rudder[11] < -0.01  # bow to port
    nose_up = 1.0 if name == "vt690" else -1.0
    assert nose_up * plane[10] > 0.01
    if name == "npsauv":
        bow = run(plant, told(plant, bow=0.1, drive=propulsion), 4.0, 1.5)[-1] - straight
        assert bow[10] > 0.0


@pytest.mark.parametrize("name", PRESETS)
def test_full_deflection_stays_finite(name):
    plant = load_vehicle(name)
    # ahead only: the polynomials are of captive tests in forward motion, where their terms u p and u q damp
    limits = np.array([getattr(plant.parts, part.name).limit for part in plant.family.body.parts])
    top = max(steady_speed(plant, plant.parts.propeller.limit, 1.0), 2.2)
    for signs in itertools.product((-1.0, 1.0), (-1.0, 1.0), *[(-1.0, 0.0, 1.0)] * (len(limits) - 3)):
        states = run(plant, limits * np.array([*signs, 1.0]), 60.0, 0.0)
        assert np.all(np.isfinite(states))
        assert np.abs(states[:, :3]).max() < top
        assert np.abs(states[:, 3:6]).max() < 2.0


def test_the_vehicle_in_the_guide_loads_and_drives(tmp_path):
    guide = (Path(__file__).parents[2] / "docs" / "vehicles.md").read_text(encoding="utf-8")
    blocks = [block.partition("```")[0] for block in guide.split("```toml\n")[1:]]
    text = next(block for block in blocks if block.startswith("family"))  # the others are parts of a file
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    plant = load_vehicle(path)
    assert plant.hull.yaw.uv == pytest.approx(0.009 * 0.5 * 1000.0 * 2.0**3)
    # thrust against drag; 1.4 N of buoyancy trim it a little
    assert steady_speed(plant, 1000.0, 1.0) == pytest.approx(math.sqrt(5e-4 / 3.0) * 1000.0 * math.pi / 30.0, rel=0.02)
    path.write_text(text.replace('value = -2.0, unit = "kg"', 'value = -2.0, unit = "kg m"'), encoding="utf-8")
    with pytest.raises(ValueError, match=r"hull\.added_mass\.x_udot is in kg"):
        load_vehicle(path)


def test_a_speed_over_ground_stands_in_for_a_missing_one_through_the_water():
    plant = load_vehicle("vt690")
    given = {"u_dvl_mps": 1.4, "v_dvl_mps": -0.1, "heading_rad": 1.0}
    x = plant.initial(np.array([given.get(name, np.nan) for name in plant.outputs]))
    assert dict(zip(plant.outputs, plant.output(x), strict=True))["u_mps"] == pytest.approx(1.4)
    both = {**given, "u_mps": 1.6}
    x = plant.initial(np.array([both.get(name, np.nan) for name in plant.outputs]))
    assert plant.output(x)[plant.outputs.index("u_mps")] == pytest.approx(1.6)
