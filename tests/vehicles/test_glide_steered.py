"""A glider that its masses steer: attitude and turn by the static relation, on the polar of the family beside it."""

from dataclasses import replace
from math import sin

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle, save_vehicle, without_effects
from auv_gym.plant.flying import battery_for, neutral_engine, nominal_flight, steered, turning_input
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from auv_gym.vehicles.glide_effects import STEERED
from auv_gym.vehicles.glide_steered import GLIDE_STEERED

NAMES = ("seaglider", "slocum_flight", "seaexplorer")
START = {"depth_m": 250.0, "heading_rad": 0.3}


@pytest.fixture(scope="module")
def glider():
    plant = replace_at(load_vehicle("seaglider"), {"hull.compressibility": 0.0, "hull.expansion": 0.0})
    return replace(steered(plant, dt=10.0), window=1e9)


def masses(plant, pitch=-0.4, turn=0.0, lift=-2e-4, samples=60):
    """A log in which everything stands still."""
    engine = neutral_engine(plant, START["depth_m"]) + lift
    columns = {"buoyancy_volume_m3": engine, "battery_position_m": battery_for(plant, pitch, engine)}
    columns[turning_input(plant)[0]] = turn
    time = plant.dt * np.arange(samples)
    return Record.from_arrays(time, {name: np.full(samples, value) for name, value in (columns | START).items()})


def run(plant, record):
    start = np.array([START.get(name, 0.0) for name in plant.family.states])
    return dict(zip(plant.outputs, plant.run(record, record.segments, start[None]).T, strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_with_its_masses_it_flies_as_with_the_attitude_that_they_give(name):
    attitude = load_vehicle(name)
    plant = steered(attitude, dt=10.0)
    record = masses(plant)
    found = run(plant, record)
    pitch, heading = found["pitch_rad"], found["heading_rad"]
    assert pitch == pytest.approx(np.full(len(record), -0.4), abs=1e-9)
    inputs = {"buoyancy_volume_m3": record["buoyancy_volume_m3"], "pitch_rad": pitch, "heading_rad": heading}
    as_input = replace(attitude, dt=10.0)
    start = np.array([[START["depth_m"], 0.0, 0.0, 0.0, 0.0]])
    log = Record.from_arrays(record.time, inputs)
    other = as_input.run(log, log.segments, start)
    assert found["depth_m"] == pytest.approx(other[:, 0], abs=1e-6)
    # the heading of a log goes on evenly between samples, and that of a turn does within a few centimetres
    assert found["north_m"] == pytest.approx(other[:, 1], abs=0.1)
    assert found["east_m"] == pytest.approx(other[:, 2], abs=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_it_turns_by_its_relation_in_dives_and_climbs(name):
    plant = steered(load_vehicle(name), dt=10.0)
    s, (channel, limit) = plant.parameters.steering, turning_input(plant)
    for side in (-1.0, 1.0):
        record = masses(plant, 0.3 * side, 0.5 * limit, 1.5e-4 * side)
        found = run(plant, record)
        flight = nominal_flight(plant, START["depth_m"], 1.5e-4 * side, 0.3)
        roll = s.roll + s.roll_mass * 0.5 * limit if channel == "battery_roll_rad" else s.roll
        expected = flight.speed * (s.turn_roll * flight.attack * sin(roll) + s.turn_rudder * 0.5 * limit)
        assert found["roll_rad"] == pytest.approx(np.full(60, roll), abs=1e-9)
        # a compressible hull changes its buoyancy over the run
        assert np.gradient(found["heading_rad"], record.time).mean() == pytest.approx(expected, rel=0.05)


def test_a_glider_with_wings_behind_its_middle_turns_away_from_its_roll_in_a_dive(glider):
    left, right = (run(glider, masses(glider, turn=turn))["heading_rad"] - 0.3 for turn in (-0.4, 0.3297))
    assert left[-1] > 0.1
    assert right[-1] == pytest.approx(-left[-1], rel=0.01)  # upright at 0.0352 rad of battery, see steering.roll


def test_masses_move_at_their_rates_and_stop_at_their_ends(glider):
    x = glider.initial(np.array([START.get(name, 0.0) for name in glider.outputs]))
    at = [glider.states.index(f"{name} position") for name in glider.inputs[:3]]
    x[at] = -5e-4, 0.0, 0.0
    found = glider.step(x, np.array([0.0, 1.0, 9.0, 0.0, 15.0, 1027.5, 0.0]))[at]
    s = glider.parameters.steering
    assert found[0] == pytest.approx(-5e-4 + 10.0 / s.pump_slowness)
    assert found[1:] == pytest.approx([s.battery_high, s.roll_limit])


def test_trims_shift_attitude_and_that_of_climbs_acts_in_climbs_alone(glider):
    dive, climb = masses(glider), masses(glider, 0.4, lift=2e-4)
    for path in (*STEERED, "effects.inclinometer.roll_bias"):
        for record, rising in ((dive, False), (climb, True)):
            acts = rising or path != "effects.steering.roll_climb"
            neutral, half, whole = (run(replace_at(glider, path, size), record) for size in (0.0, 0.01, 0.02))
            name = "pitch_rad" if path.endswith(".pitch") else "roll_rad"
            assert whole[name][10:] - neutral[name][10:] == pytest.approx(np.full(50, 0.02 * acts), abs=1e-12), path
            first, second = (one["depth_m"] - neutral["depth_m"] for one in (half, whole))
            assert second == pytest.approx(2.0 * first, rel=0.2, abs=1e-9)  # at first order
            turned = (whole["heading_rad"] - neutral["heading_rad"])[-1]
            assert (abs(turned) > 1e-3) == (acts and path.startswith("effects.steering.roll")) or name == "pitch_rad"
    assert not {*STEERED} & {*without_effects(glider).family.measured}
    assert {*STEERED} < {*load_vehicle("seaglider").family.measured}  # nothing to look for where attitude is measured


def test_afloat_it_drifts_and_does_not_fly(glider):
    plant = replace_at(glider, "effects.current.east", 0.1)
    record = masses(plant, 0.4, lift=3e-4)
    start = np.zeros((1, 6))
    found = dict(zip(plant.outputs, plant.run(record, record.segments, start).T, strict=True))
    assert found["depth_m"] == pytest.approx(np.zeros(60), abs=1e-12)
    assert found["north_m"] == pytest.approx(np.zeros(60), abs=1e-12)
    assert found["east_m"] == pytest.approx(0.1 * record.time)


def test_a_rise_ends_at_the_surface(glider):
    plant = replace(glider, dt=30.0, longest_step=30.0)
    found = run(plant, masses(plant, 0.5, lift=3e-4, samples=80))["depth_m"]
    assert found[:5].min() > 10.0
    assert found.min() > -2.0  # m: it rises by up to 0.35 m/s, and the shortest step is 5 s
    assert found[-1] <= 0.0


def test_half_the_step_is_a_sixteenth_of_the_error(glider):
    """Of a turn that the battery's rate begins; where it moves, the heading is smooth but for its stop."""

    def end(step):
        return run(replace(glider, dt=40.0, longest_step=step), masses(replace(glider, dt=40.0), turn=0.5))["north_m"][
            -1
        ]

    exact = end(0.5)
    coarse, fine = end(40.0) - exact, end(20.0) - exact
    assert np.log2(abs(coarse / fine)) == pytest.approx(4.0, abs=0.3)


def test_a_vehicle_without_a_relation_is_refused():
    with pytest.raises(ValueError, match=r"seaglider cannot be steered: it needs steering\.pitch_mass"):
        steered(replace_at(load_vehicle("seaglider"), "steering.pitch_mass", 0.0))
    with pytest.raises(ValueError, match=r"slocum_flight cannot be steered: .*turn_rudder"):
        steered(replace_at(load_vehicle("slocum_flight"), "steering.turn_rudder", 0.0))


def test_a_file_of_a_steered_glider_is_read_back(glider, tmp_path):
    save_vehicle(glider, tmp_path / "mine.toml")
    assert load_vehicle(tmp_path / "mine.toml").family is GLIDE_STEERED
    assert np.array_equal(load_vehicle(tmp_path / "mine.toml").vector, glider.vector)


def test_a_log_without_attitude_is_one_of_a_steered_glider(glider):
    record = masses(glider).with_channels({"depth_m": 250.0 + 0.15 * 10.0 * np.arange(60)})
    assert len(described(glider, record)) == 60
    level = record.with_channels({"pitch_rad": np.r_[np.full(40, -0.4), np.full(20, 0.02)]})
    assert len(described(glider, level)) == 40
