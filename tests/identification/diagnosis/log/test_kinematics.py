"""Tests of sensors compared with each other: simulated errors are found, and nothing is found in clean logs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auv_gym.param import replace_at, spec_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import linear_yaw_coefficients
from identification.diagnosis import diagnose
from identification.diagnosis.log.kinematics import kinematic_findings
from identification.experiments.missions import run_mission
from tests.identification.tumbler import flown, tumbler

PROBES = 4.0
SLOW = pytest.mark.slow
EXACT = (  # linear in the effect to first order
    *("gyros.bias_r", "depth.scale", "dvl_ground.scale", "current.north", "clock.rate"),
    *(
        pytest.param(name, marks=SLOW)
        for name in (
            *("gyros.bias_p", "gyros.bias_q", "gyros.scale", "inclinometer.pitch_bias", "dvl_ground.bias_u"),
            *("dvl_ground.misalignment", "dvl_water.bias_v", "dvl_water.scale", "compass.deviation_cos"),
            "current.shear_north",
        )
    ),
)


@pytest.fixture(scope="module")
def torpedo():
    return load_vehicle("vt690")


def log_with(plant, path=None, seed=2):
    changed = plant
    if path is not None:
        spec = spec_at(plant, path)
        changed = replace_at(plant, path, spec.neutral + PROBES * spec.probe)
    return run_mission(changed, np.random.default_rng(seed), duration=200.0)


@pytest.fixture(scope="module")
def clean(torpedo):
    return log_with(torpedo)


@pytest.mark.parametrize("name", EXACT)
def test_a_sensor_effect_is_found_with_its_size(torpedo, name):
    path = f"effects.{name}"
    found = kinematic_findings(log_with(torpedo, path), torpedo).mismatches
    truth = PROBES * spec_at(torpedo, path).probe
    assert found[0].path == path or path in found[0].tied
    if found[0].path == path:
        assert found[0].value == pytest.approx(truth, rel=0.15)  # second order in the effect, noise in the signals
        assert found[0].text.endswith(")") or found[0].tied
    assert all(other.evidence < 0.2 * found[0].evidence for other in found[1:])


@pytest.mark.parametrize(
    "name", ["compass.lag", pytest.param("gyros.lag", marks=SLOW), pytest.param("depth.lag", marks=SLOW)]
)
def test_a_lag_is_found(torpedo, name):
    path = f"effects.{name}"
    found = kinematic_findings(log_with(torpedo, path), torpedo).mismatches
    truth = PROBES * spec_at(torpedo, path).probe
    assert found[0].path == path
    assert 0.6 * truth < found[0].value < 1.2 * truth  # a lag as long as the motion looks shorter


def test_clean_logs_are_silent_and_clear_the_sensors(torpedo, clean):
    result = kinematic_findings(clean, torpedo)
    assert result.mismatches == ()
    cleared = {c.path for c in result.clears}
    assert {f"effects.{n}" for n in ("gyros.bias_r", "gyros.scale", "compass.lag", "dvl_ground.scale")} <= cleared
    for c in result.clears:
        assert c.ci95[0] < c.value < c.ci95[1]


def test_no_other_sensor_has_an_error_that_is_too_small_to_tell():
    """At a nearly constant speed, a DVL's scale looks like a bias, which has a smaller probe beside this speed."""
    vehicle = load_vehicle("npsauv")
    rows = run_mission(
        replace_at(vehicle, "effects.dvl_ground.scale", -0.0045), np.random.default_rng(3), duration=290.0
    )
    assert kinematic_findings(rows, vehicle).mismatches == ()


def test_a_cleared_sensor_is_not_the_one_with_the_effect(torpedo):
    path = "effects.gyros.bias_r"
    assert path not in {c.path for c in kinematic_findings(log_with(torpedo, path), torpedo).clears}


def test_forces_do_not_show(torpedo):
    strong = replace_at(torpedo, {"effects.rudder.gain": 1.6, "effects.load.moment_z": 0.6})
    assert kinematic_findings(log_with(strong), torpedo).mismatches == ()


def test_sensors_that_are_not_there_are_left_out(torpedo, clean):
    bare = clean.without([n for n in clean.names if n.endswith("_mps") or n in ("north_m", "east_m")])
    result = kinematic_findings(bare, torpedo)
    assert set(result.equations) == {"roll against gyros", "pitch against gyros", "heading against gyros"}
    alone = clean.without([n for n in clean.names if n.endswith(("_mps", "_radps")) or n in ("north_m", "east_m")])
    assert kinematic_findings(alone, torpedo).equations == ()


def gliding(seed: int) -> Record:
    """A pitched and rolled `slocum` under its rudder, with a track computed by SciPy's rotations."""
    rng, dt, inner = np.random.default_rng(seed), 4.0, 40
    plant, count = load_vehicle("slocum"), 300
    damping, effect = linear_yaw_coefficients(plant.family.view(plant.vector).hull)
    rudder = 0.3 * rng.choice([-1.0, 1.0], count // 10).repeat(10)
    pitch = 0.45 * np.where(np.arange(count) % 150 < 75, -1.0, 1.0)
    roll = np.full(count, 0.1)
    psi, r, x, found = 0.3, 0.0, np.zeros(3), []
    for k in range(count):
        found.append([psi, *x])
        for _ in range(inner):
            h = dt / inner
            middle = r + 0.5 * h * (damping * r + effect * rudder[k])
            turn = middle * np.cos(roll[k]) / np.cos(pitch[k])
            x = x + h * Rotation.from_euler("ZYX", [psi + 0.5 * h * turn, pitch[k], roll[k]]).apply([0.35, 0.0, 0.0])
            psi, r = psi + h * turn, r + h * (damping * middle + effect * rudder[k])
    heading, north, east, depth = np.array(found).T
    noise = np.radians(0.5) * rng.standard_normal(count), *rng.standard_normal((3, count))
    channels = {"heading_rad": heading + noise[0], "north_m": north + noise[1], "east_m": east + noise[2]}
    channels |= {"depth_m": depth + 0.1 * noise[3] + 100.0, "pitch_rad": pitch, "roll_rad": roll, "rudder_rad": rudder}
    return Record.from_arrays(dt * np.arange(count), channels | {"u_mps": np.full(count, 0.35)})


@pytest.mark.slow
def test_a_glider_without_a_fault_and_with_a_true_track_lacks_nothing():
    plant = load_vehicle("slocum")
    for seed in range(3):
        found = diagnose(gliding(seed), plant)
        assert found.verdict == "none", (seed, found.summary())
        assert found.kinematics is not None
        assert not found.kinematics.mismatches


def test_a_gliders_current_shows_against_its_track():
    glider = load_vehicle("ganeshblue")
    drifted = run_mission(replace_at(glider, "effects.current.east", 0.08), np.random.default_rng(1))
    found = {m.path: m for m in kinematic_findings(drifted, glider).mismatches}
    assert any(path == "effects.current.east" or "effects.current.east" in m.tied for path, m in found.items())


def test_what_was_not_read_for_a_while_is_not_compared(torpedo, clean):
    """Four of ten seconds of a Doppler log are made up, and would look like its bias."""
    lost = (clean.time % 10.0) > 6.0
    values = clean["u_dvl_mps"] + 0.3 * lost
    assert kinematic_findings(clean.with_channels({"u_dvl_mps": values}), torpedo).mismatches
    told = clean.with_channels({"u_dvl_mps": values}).with_readings({"u_dvl_mps": ~lost})
    assert not kinematic_findings(told, torpedo).mismatches


@pytest.mark.parametrize("name, size", [("bias_q", 0.03), ("misalignment", 0.08), ("", 0.0)])
def test_gyros_are_judged_by_turns_where_a_vehicle_goes_through_the_vertical(name, size):
    true = tumbler()
    log = flown(replace_at(true, f"effects.gyros.{name}", size) if name else true, 5, seconds=240.0)
    found = kinematic_findings(log, true)
    axes = ("bow", "starboard", "downward")
    assert found.equations == tuple(f"turns about the {axis} axis against gyros" for axis in axes)
    assert [m.path for m in found.mismatches] == ([f"effects.gyros.{name}"] if name else [])
    for mismatch in found.mismatches:
        assert mismatch.ci95[0] < size < mismatch.ci95[1]
    assert {c.path for c in found.clears} > {"effects.gyros.bias_p", "effects.gyros.bias_r", "effects.gyros.scale"}
