"""Tests of simulated dives of a glider, and of diagnoses of dives by an independent simulator."""

from math import cos, exp, radians, sin, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq

from auv_gym.param import positions, replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.flying import steered
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record, concat
from identification.diagnosis import diagnose
from identification.experiments.glider_dives import open_sea, sea_density, yo_mission
from identification.experiments.missions import run_mission
from identification.fit.shooting import Shooting

GRAVITY, DBAR = 9.81, 1e4


@pytest.fixture(scope="module")
def glider() -> Plant:
    return load_vehicle("seaglider")


def climb_rate(force, pitch, density, hull, growth, lift):
    """Vertical velocity, m/s up, of a steady glide: bisection on the path angle; see `tests/physics/test_polar.py`."""
    side, drag_0, lift_1 = np.sign(force), hull.drag_0 * (1.0 + growth), hull.lift_1 * (1.0 + lift)

    def along(path):  # what drag leaves of the buoyancy along the path
        attack = path - side * pitch
        q = abs(force) * cos(path) / (hull.area * lift_1 * attack)
        return abs(force) * sin(path) - hull.area * q * (drag_0 * q**hull.drag_power + hull.drag_2 * attack**2)

    # beyond the best glide there would be a slower balance
    path = brentq(along, max(side * pitch, 0.0) + 1e-6, 1.5707)
    q = abs(force) * cos(path) / (hull.area * lift_1 * (path - side * pitch))
    return side * sqrt(2.0 * q / density) * sin(path)


def dives(hull, seed=0, depths=(150.0, 250.0, 150.0, 250.0), noise=0.03, **effects) -> Record:
    """Dives and climbs of a glider with these effects, by the midpoint rule in steps of 2 s, a sample every 10 s."""
    of = dict.fromkeys(
        ("offset", "compressibility", "expansion", "air", "leak", "growth", "lift", "bias", "current", "deeper"), 0.0
    )
    of |= {"gain": 1.0, "salinity": 0.0, "sinking": 0.0} | effects
    rng, records, begun = np.random.default_rng(seed), [], 0.0
    for deepest in depths:
        sinking = of["sinking"] * rng.choice([-1.0, 1.0])
        depth, rate, t, rows = 15.0, 0.12, 0.0, []
        wanted, pitches = rng.uniform(1e-4, 2e-4, 2), rng.uniform(radians(17.0), radians(28.0), 2)
        neutral = hull.mass / sea_density(deepest) - hull.volume * exp(-hull.compressibility * DBAR * deepest)
        engine, pitch, up = neutral - wanted[0], -pitches[0], False
        while depth > 14.0 and t < 1.5e4:
            up = up or depth > deepest
            wander = 0.02 * sin(0.02 * t + seed), 0.02 * sin(0.02 * (t + 1.0) + seed)
            if t % 10.0 == 0.0:
                read = depth + noise * rng.standard_normal()
                water = open_sea(depth), sea_density(depth)
                rows.append((t, read, engine, pitch + wander[0] + of["bias"], *water, begun + t))
            pumped = min(5e-6, neutral + wanted[1] - engine) if up else 0.0
            turned = ((pitches[1] if up else -pitches[0]) - pitch) * 0.1
            bow, oil, here = pitch + 0.5 * turned + wander[1], engine + 0.5 * pumped, depth + rate  # amid the step
            pressure = hull.density * GRAVITY * here
            warmed = (hull.expansion + of["expansion"]) * (open_sea(here) - hull.temperature)
            volume = hull.volume * exp(warmed - (hull.compressibility + of["compressibility"]) * pressure)
            volume += hull.engine_neutral + of["gain"] * (oil - hull.engine_neutral)
            volume += of["offset"] - of["leak"] * (begun + t + 1.0) + of["air"] / (1.0 + pressure / 101325.0)
            density = sea_density(here) + 0.78 * of["salinity"]
            force = GRAVITY * (density * volume - hull.mass)
            water = of["current"] + of["deeper"] * here + sinking
            rate = -climb_rate(force, bow, density, hull, of["growth"], of["lift"]) + water
            depth, engine, pitch, t = depth + 2.0 * rate, engine + pumped, pitch + turned, t + 2.0
        names = ("depth_m", "buoyancy_volume_m3", "pitch_rad", "temperature_C", "density_kgpm3", "elapsed_s")
        table = np.array(rows)
        records.append(Record.from_arrays(table[:, 0], dict(zip(names, table.T[1:], strict=True))))
        begun += t + 600.0
    return concat(records)


EFFECTS = {
    "volume.offset": ("offset", 2e-5),
    "volume.compressibility": ("compressibility", 1.5e-10),
    "volume.expansion": ("expansion", 1e-4),
    "volume.air": ("air", 6e-5),
    "volume.leak": ("leak", 4e-9),
    "engine.gain": ("gain", 1.1),
    "polar.growth": ("growth", 0.3),
    "polar.lift": ("lift", 0.5),
    "inclinometer.pitch_bias": ("bias", 0.03),
    "water.current": ("current", 0.015),
    "water.current_with_depth": ("deeper", 8e-5),
    "water.salinity": ("salinity", 0.25),
}


@pytest.mark.parametrize("path", EFFECTS)
def test_each_effect_is_recovered_from_dives_of_an_independent_simulator(glider, path):
    name, size = EFFECTS[path]
    plant, record = glider, described(glider, dives(glider.hull, **{name: size}))
    assert len(record) > 600
    neutral = 1.0 if name == "gain" else 0.0
    start = replace_at(plant, f"effects.{path}", neutral + 0.5 * (size - neutral))
    found = Shooting(plant, record, record.windows(900.0)).solve(start, (f"effects.{path}",))
    value = found.vector[positions(plant)[f"effects.{path}"]]
    # noise, steps of 2 s and the interpolation between samples leave some parts in a hundred
    assert value - neutral == pytest.approx(size - neutral, rel=0.05)


def test_a_mission_dives_and_climbs_with_what_its_log_would_have(glider):
    record = yo_mission(glider, (60.0, 90.0), rng=np.random.default_rng(0))
    assert len(record.segments) == 2
    for part, deepest in zip(record.segments, (60.0, 90.0), strict=True):
        depth, pitch = record["depth_m"][part], record["pitch_rad"][part]
        assert deepest <= depth.max() < deepest + 15.0
        assert depth[-1] < 15.0
        assert pitch.min() < -0.2
        assert pitch.max() > 0.2
    assert np.ptp(record["buoyancy_volume_m3"]) > 2e-4
    assert record["elapsed_s"][record.segments[1].start] > record["elapsed_s"][record.segments[0].stop - 1]
    assert not yo_mission(glider, (60.0,), rng=np.random.default_rng(0), measured=False).has("density_kgpm3")
    again = run_mission(glider, np.random.default_rng(0), target_depths=(60.0, 90.0))
    assert np.array_equal(again["depth_m"], record["depth_m"])


@pytest.mark.parametrize(
    "settings, message", [({"depths": (20.0,)}, "from 32 to 1000 m"), ({"dt": 0.5}, "dt of at least")]
)
def test_a_mission_that_cannot_be_flown_is_refused(glider, settings, message):
    with pytest.raises(ValueError, match=message):
        yo_mission(glider, **{"depths": (60.0,), **settings}, rng=np.random.default_rng(0))


@pytest.mark.slow
def test_a_volume_bias_and_growth_are_named_in_dives_of_an_independent_simulator(glider):
    found = diagnose(dives(glider.hull, offset=2e-5, seed=3), glider)
    assert [e.path for e in found.effects] == ["effects.volume.offset"]
    assert found.effects[0].value == pytest.approx(2e-5, rel=0.1)
    assert found.after.scores["depth_m"].rmse < 0.3 * found.before.scores["depth_m"].rmse
    found = diagnose(dives(glider.hull, growth=0.5, seed=4), glider)
    assert [e.path for e in found.effects] == ["effects.polar.growth"]


@pytest.mark.slow
def test_nothing_is_named_in_dives_of_the_vehicle_as_given(glider):
    found = diagnose(dives(glider.hull, seed=5), glider)
    assert found.verdict == "none"


@pytest.mark.slow
def test_what_no_effect_explains_is_said_to_be_left(glider):
    """Water that sinks in some dives and rises in others; no library of terms is searched, and none is missed."""
    found = diagnose(dives(glider.hull, sinking=0.02, seed=6), glider)
    assert found.unexplained
    assert found.failures == ()


def test_a_mission_of_a_steered_glider_has_the_attitude_that_its_masses_gave(glider):
    plant = steered(glider, dt=None)
    rng = np.random.default_rng(4)
    record = yo_mission(plant, (60.0, 80.0), rng=rng, truth=lambda one: replace_at(one, "effects.steering.roll", 0.05))
    s = plant.parameters.steering
    assert record["pitch_rad"] == pytest.approx(s.pitch + s.pitch_mass * record["battery_position_m"], abs=0.03)
    rolled = record["roll_rad"] - s.roll - s.roll_mass * record["battery_roll_rad"]
    assert rolled.mean() == pytest.approx(0.05, abs=0.001)  # 0.3 deg of noise in some hundred samples
    assert np.ptp(record["battery_roll_rad"]) > s.roll_limit * 0.9
    assert np.abs(np.diff(record["heading_rad"])).max() > 0.01
