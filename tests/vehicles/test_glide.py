"""A glider that flies by its polar: buoyancy, water, sensors, attitude between samples, and what it leaves out."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.flying import neutral_engine, steady_flight, steered
from auv_gym.plant.record_check import check_ranges, described
from auv_gym.records.record import Record
from auv_gym.vehicles.glide import GlideParameters, beyond, engine_problem, net_buoyancy

PRESETS = ("seaglider", "slocum_flight", "seaexplorer")
GRAVITY = 9.81


@pytest.fixture(scope="module")
def glider() -> Plant:
    return load_vehicle("seaglider")


def dive(plant: Plant, samples: int = 60, **changes) -> Record:
    """A dive from 20 m at a constant engine and pitch, without noise; changes: None leaves a channel out."""
    t = plant.dt * np.arange(samples)
    columns = {
        "buoyancy_volume_m3": np.full(samples, neutral_engine(plant, 100.0) - 1.5e-4),
        "pitch_rad": np.full(samples, -0.35),
        "heading_rad": np.full(samples, 0.5),
        "temperature_C": np.full(samples, 8.0),
        "density_kgpm3": np.full(samples, 1028.0),
        "depth_m": 20.0 + 0.12 * t,
        **changes,
    }
    return Record.from_arrays(t, {name: column for name, column in columns.items() if column is not None})


def run(plant: Plant, record: Record, depth: float = 20.0) -> np.ndarray:
    return plant.run(record, record.segments, np.array([[depth, 0.0, 0.0, 0.0, 0.0]]))


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_glides_down_and_up_at_a_gliders_speed(name):
    plant = load_vehicle(name)
    neutral = neutral_engine(plant, 100.0)
    assert plant.hull.engine_low < neutral < plant.hull.engine_high
    for side in (1.0, -1.0):
        flight = steady_flight(plant, 100.0, buoyancy_volume_m3=neutral + side * 1.5e-4, pitch_rad=side * 0.4)
        assert 0.15 < flight.speed < 0.6
        assert side * flight.path > 0.4  # a glide path is steeper than the pitch
    assert all(path in plant.notes for path in ("hull.drag_0", "hull.lift_1", "hull.mass", "hull.volume"))


def test_neutral_is_where_it_neither_sinks_nor_rises(glider):
    engine = neutral_engine(glider, 200.0)
    assert steady_flight(glider, 200.0, buoyancy_volume_m3=engine, pitch_rad=0.3).speed == pytest.approx(0.0, abs=1e-4)
    with pytest.raises(ValueError, match="no input 'pitch'"):
        steady_flight(glider, 200.0, pitch=0.3)


@pytest.mark.parametrize(
    "inputs, words",
    [
        ({"buoyancy_volume_m3": 150.0}, "buoyancy_volume_m3 from .* m3, got 150.0: check its unit"),
        ({"pitch_rad": -23.0}, "pitch_rad from -1.57 to 1.57 rad, got -23.0"),
        ({"pitch_rad": np.nan}, "pitch_rad from .*, got nan"),
        ({"temperature_C": np.inf}, "finite temperature_C, got inf"),
    ],
)
def test_steady_flight_refuses_what_no_glider_flies_at(glider, inputs, words):
    with pytest.raises(ValueError, match=words):
        steady_flight(glider, 100.0, **inputs)
    with pytest.raises(ValueError, match="finite depth, got nan"):
        steady_flight(glider, np.nan)


@pytest.mark.parametrize(
    "call", [lambda plant: neutral_engine(plant, 10.0), lambda plant: steady_flight(plant, 10.0), steered]
)
def test_a_vehicle_without_a_polar_is_refused(call):
    with pytest.raises(ValueError, match=r"A glider that flies by a polar is needed.*got 'bluerov2' of family"):
        call(load_vehicle("bluerov2"))


def test_steady_flight_of_a_glider_steered_by_masses_is_refused():
    with pytest.raises(ValueError, match="needs a glider whose pitch is an input, and 'slocum_flight' is steered"):
        steady_flight(steered(load_vehicle("slocum_flight")), 100.0, battery_position_m=0.01)


def test_a_run_is_steady_flight_over_ground(glider):
    plant = replace_at(glider, {"hull.compressibility": 0.0, "hull.expansion": 0.0})
    record = dive(plant)
    found = run(replace_at(plant, {"effects.current.east": 0.1, "effects.water.current": 0.02}), record)
    inputs = {name: float(record[name][0]) for name in plant.inputs if record.has(name)}
    speed, path, _ = steady_flight(plant, 20.0, **inputs)
    rates = np.array([-speed * np.sin(path) + 0.02, speed * np.cos(path) * np.cos(0.5), 0.0])
    rates[2] = speed * np.cos(path) * np.sin(0.5) + 0.1
    assert found == pytest.approx(np.array([20.0, 0.0, 0.0]) + np.outer(record.time, rates), abs=1e-8)


def test_water_may_sink_faster_with_depth(glider):
    plant = replace_at(glider, {"hull.compressibility": 0.0, "hull.expansion": 0.0})
    record, growth = dive(plant), 1e-4
    still = run(plant, record)
    rate = (still[-1, 0] - still[0, 0]) / record.duration_s
    found = run(replace_at(plant, "effects.water.current_with_depth", growth), record)
    depth = (20.0 + rate / growth) * np.exp(growth * record.time) - rate / growth
    assert found[:, 0] == pytest.approx(depth, abs=1e-6)
    assert np.array_equal(found[:, 1:], still[:, 1:])


def test_pressure_warmth_air_and_a_leak_change_the_buoyancy_as_they_say(glider):
    """Each against the engine's volume that does the same."""
    hull, depth = glider.hull, 150.0
    pressure = hull.density * GRAVITY * depth
    base = {"buoyancy_volume_m3": neutral_engine(glider, depth) - 1e-4, "pitch_rad": -0.35, "density_kgpm3": 1028.0}
    squeezed = np.exp(-(hull.compressibility + 2e-10) * pressure) - np.exp(-hull.compressibility * pressure)
    warmed = np.exp(-hull.compressibility * pressure) * (
        np.exp(-5.0 * (hull.expansion + 1e-5)) - np.exp(-5.0 * hull.expansion)
    )
    cases = {
        "compressibility": (2e-10, {}, hull.volume * squeezed),
        "expansion": (1e-5, {"temperature_C": hull.temperature - 5.0}, hull.volume * warmed),
        "air": (8e-5, {}, 8e-5 / (1.0 + pressure / 101325.0)),
        "leak": (5e-9, {"elapsed_s": 3000.0}, -1.5e-5),
        "offset": (1e-5, {}, 1e-5),
    }
    for name, (size, inputs, volume) in cases.items():
        effect = replace_at(glider, f"effects.volume.{name}", size)
        engine = {"buoyancy_volume_m3": base["buoyancy_volume_m3"] + volume}
        if name == "leak":
            p, u = effect.family.view(effect.derived), {**base, **inputs}
            by_effect = net_buoyancy(depth, 0.0, u["buoyancy_volume_m3"], 15.0, 1028.0, 3000.0, p)
            by_engine = net_buoyancy(depth, 0.0, engine["buoyancy_volume_m3"], 15.0, 1028.0, 0.0, p)
            assert by_effect == pytest.approx(by_engine, rel=1e-9)
            continue
        flown = steady_flight(effect, depth, **base | inputs)
        assert flown == pytest.approx(steady_flight(glider, depth, **base | inputs | engine), rel=1e-6), name


@pytest.mark.parametrize(
    "effect, size, coefficient",
    [
        ("polar.growth", 0.3, "drag_0"),
        ("polar.lift", -0.2, "lift_1"),
        ("volume.compressibility", 1e-10, "compressibility"),
    ],
)
def test_an_effect_that_acts_as_a_coefficient_does(glider, effect, size, coefficient):
    path = f"hull.{coefficient}"
    _, law = glider.family.coefficients_of(glider.parameters).get(
        f"effects.{effect}", (path, lambda g, s: g * (1.0 + s))
    )
    changed = replace_at(glider, path, law(value_at(glider, path), size))
    record = dive(glider)
    assert run(replace_at(glider, f"effects.{effect}", size), record) == pytest.approx(run(changed, record), abs=1e-9)


def test_attitude_between_samples_is_taken_at_the_middle_of_an_interval(glider):
    """Second order: half the interval, a quarter of the error; holding each sample would leave half of it."""

    def end(dt: float) -> float:
        t = dt * np.arange(round(560.0 / dt) + 1)
        columns = {"pitch_rad": -0.45 + 0.1 * np.sin(t / 60.0), "buoyancy_volume_m3": np.full(t.size, -6.5e-4)}
        plant = replace(glider, dt=dt)
        return float(run(plant, Record.from_arrays(t, columns))[-1, 0])

    exact = end(0.5)
    coarse, fine = end(20.0) - exact, end(10.0) - exact
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)


def test_the_compass_turns_the_track_and_nothing_else(glider):
    plant = replace_at(glider, {"effects.compass.bias": 0.1, "effects.compass.deviation_cos": 0.05})
    record = dive(glider)
    straight, turned = run(glider, record), run(plant, record)
    assert np.array_equal(turned[:, 0], straight[:, 0])
    angle = np.arctan2(turned[-1, 2], turned[-1, 1])
    # what the compass reads is the heading, its deviation there and the bias
    assert angle + 0.05 * np.cos(angle) + 0.1 == pytest.approx(0.5, abs=2e-4)


def test_a_depth_sensor_lags_behind_and_scales(glider):
    plant = replace_at(glider, {"effects.depth.lag": 10.0, "effects.depth.scale": 0.02, "effects.depth.bias": 0.5})
    record = dive(glider, samples=120)
    true, read = run(glider, record)[:, 0], run(plant, record)[:, 0]
    rate = np.gradient(true, record.time)
    assert read[60:] == pytest.approx(1.02 * true[60:] + 0.5 - 1.02 * 10.0 * rate[60:], abs=2e-3)


def test_an_engine_whose_range_is_upside_down_is_refused():
    hull = {"hull.engine_low": 1e-4, "hull.engine_high": -1e-4}
    assert "engine_low must be less" in engine_problem(replace_at(GlideParameters(), hull))
    assert "must lie between" in engine_problem(replace_at(GlideParameters(), "hull.engine_neutral", 5e-4))
    assert engine_problem(GlideParameters()) == ""


def test_what_steady_flight_does_not_describe_is_told_apart():
    t = 10.0 * np.arange(40)
    depth = np.r_[np.linspace(4.0, 60.0, 20), np.linspace(60.0, 4.0, 20)]
    engine = np.r_[np.full(20, -1e-4), np.full(20, 1e-4)]
    pitch = np.r_[np.full(20, -0.4), np.full(20, 0.4)]
    pitch[30] = -0.3  # nose down, and rising
    density = np.full(40, 1027.0)
    density[35] = np.nan
    masks = beyond(t, {"depth_m": depth, "pitch_rad": pitch, "buoyancy_volume_m3": engine, "density_kgpm3": density})
    surface, pumping, stalls, missing = masks.values()
    assert np.array_equal(surface, depth < 10.0)
    assert list(np.flatnonzero(pumping)) == [19, 20, 21]  # the samples beside it, and those within 20 s
    assert set(np.flatnonzero(stalls)) <= {19, 20, 30}
    assert stalls[30]
    assert list(np.flatnonzero(missing)) == [35]


def test_a_log_says_how_much_of_it_is_left_out_and_what_is_assumed(glider):
    record = dive(glider, samples=100, depth_m=5.0 + 0.6 * np.arange(100), density_kgpm3=None)
    kept = described(glider, record)
    assert len(kept) == 91
    assert kept.notes[-1] == ("9 % of the log is left out, since seaglider does not describe it: 9 % near the surface.")
    assert "no water density (density_kgpm3): 1027.5 kg/m3 is assumed throughout" in kept.notes[-2]
    assert kept["elapsed_s"][0] == pytest.approx(9 * glider.dt)  # since the log began, not since what is kept of it


def test_a_dive_cut_at_the_surface_is_refused(glider):
    with pytest.raises(ValueError, match=r"100 % of the log is left out.*near the surface.*Check signs and units"):
        described(glider, dive(glider, depth_m=np.linspace(0.5, 4.0, 60)))


def test_a_log_without_attitude_is_refused(glider):
    with pytest.raises(ValueError, match="pitch_rad"):
        described(glider, dive(glider, pitch_rad=None))


@pytest.mark.parametrize("values, beyond_it", [(np.full(60, -650.0), "-650"), (np.full(60, 6.5e-4), "0.00065")])
def test_cubic_centimetres_called_cubic_metres_and_a_volume_upside_down_are_refused(glider, values, beyond_it):
    message = (
        f"buoyancy engine from -0.00083 to 0 m3; buoyancy_volume_m3 is {beyond_it}.*check the column's sign and unit"
    )
    with pytest.raises(ValueError, match=message):
        check_ranges(glider, dive(glider, buoyancy_volume_m3=values))
