"""Plant: stepping against the compiled rollout, state handling, and the vehicle files."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant, check_vehicle, list_vehicles, load_vehicle, save_vehicle
from auv_gym.plant.cruise import find_helm
from auv_gym.presets import Heading, list_preset_headings
from auv_gym.records.record import Record
from auv_gym.vehicles import FAMILY_NAMES
from identification.fit.parameters import Parameters

PRESETS = sorted(list_vehicles())
TORPEDOES = [name for name in PRESETS if (body := load_vehicle(name).family.body) and body.steered]
GLIDERS = [name for name in PRESETS if load_vehicle(name).family.kind == "glider"]
EFFECTS = {
    "none": {},
    "dead time": {"rudder.dead_time": 2.7},
    "dead time of whole samples": {"rudder.dead_time": 8.0},
    "lag and rate limit": {"rudder.lag": 3.0, "rudder.slowness": 12.0},
    "backlash": {"rudder.backlash": 0.1},
    "stiction": {"rudder.stiction": 0.1},
    "offset, gain, deadband, stop": {
        "rudder.offset": 0.03,
        "rudder.gain": 1.2,
        "rudder.deadband": 0.05,
        "rudder.lost_travel": 0.2,
    },
    "compass": {"compass.lag": 6.0, "compass.deviation_sin": 0.1, "compass.deviation_cos": -0.05, "compass.bias": 0.2},
    # A dead time of 4 s cuts no sample. The rollout takes the first command for what has always been, `step` does not:
    # where the vehicle moves from the start, a cut in one of the two makes them differ by the integrator's error.
    "all together": {
        "rudder.dead_time": 4.0,
        "rudder.lag": 2.0,
        "rudder.slowness": 5.0,
        "rudder.backlash": 0.05,
        "yaw.moment": 0.1,
        "yaw.quadratic_damping": 100.0,
        "compass.lag": 3.0,
        "current.north": 0.1,
    },
}
TORPEDO_EFFECTS = {
    "none": {},
    "dead times": {"rudder.dead_time": 0.27, "stern_plane.dead_time": 0.4, "propeller.dead_time": 1.0},
    "lags and rate limits": {"rudder.lag": 0.5, "stern_plane.slowness": 3.0, "propeller.lag": 2.0},
    "shaped commands": {
        "stern_plane.backlash": 0.1,
        "rudder.stiction": 0.06,
        "rudder.deadband": 0.05,
        "propeller.gain": 0.8,
    },
    "water": {"current.east": 0.3, "current.shear_north": 0.02, "waves.amplitude_cos": 0.5, "water.density": 0.01},
    "loads and damage": {"load.payload": 0.5, "load.tether_drag": 1.0, "rudder.lost": 0.3, "hull.fouling": 0.2},
    "sensors": {"depth.lag": 2.0, "gyros.lag": 0.3, "compass.lag": 1.0, "dvl_ground.lag": 0.5, "dvl_water.lag": 1.0},
    "sensor errors": {"gyros.misalignment": 0.1, "compass.deviation_sin": 0.1, "depth.scale": 0.02, "depth.bias": 0.5},
}


def with_effects(plant: Plant, effects: dict[str, float]) -> Plant:
    return replace_at(plant, {f"effects.{path}": value for path, value in effects.items()})


def make_record(plant: Plant, samples: int = 60) -> Record:
    """A record whose first commands are zero, as they count as having been before `initial`."""
    k = np.arange(samples)
    rudder = np.where(k < 4, 0.0, 0.5 * np.sin(0.4 * k) + 0.1 * np.sign(np.sin(1.3 * k)))
    rest = {"u_mps": 0.35 + 0.05 * np.sin(0.2 * k), "roll_rad": 0.1 * np.cos(0.3 * k)}
    if plant.family.kind == "body":
        full = np.where(k < 4, 0.0, plant.parts.propeller.design)
        rest = {"stern_plane_rad": -0.6 * rudder, plant.inputs[find_helm(plant).drive]: full}
    return Record.from_arrays(plant.dt * k, {"rudder_rad": rudder, **rest})


def stepped(plant: Plant, record: Record, x: np.ndarray) -> np.ndarray:
    """Outputs from x on, step by step."""
    found = []
    for u in inputs(plant, record):
        found.append(plant.output(x))
        x = plant.step(x, u)
    return np.array(found)


def inputs(plant: Plant, record: Record) -> np.ndarray:
    return np.stack(
        [record[n] if record.has(n) else np.full(len(record), plant.constants[n]) for n in plant.inputs], axis=1
    )


@pytest.mark.parametrize("name", GLIDERS)
@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_stepping_is_the_compiled_rollout(name, effects):
    plant = with_effects(load_vehicle(name), effects)
    record = make_record(plant)
    x = plant.initial(np.array([0.5, 0.0, 1.0, 2.0]))
    # times are sums in one and differences in the other: dead times switch some 1e-14 s apart
    assert stepped(plant, record, x) == pytest.approx(plant.run(record, record.segments, x[None, :]), abs=1e-9)


@pytest.mark.parametrize("name", TORPEDOES)
@pytest.mark.parametrize("effects", TORPEDO_EFFECTS.values(), ids=TORPEDO_EFFECTS)
def test_stepping_in_six_degrees_of_freedom_is_the_compiled_rollout(name, effects):
    plant = with_effects(load_vehicle(name), effects)
    record = make_record(plant)
    y = np.zeros(len(plant.outputs))
    y[[plant.outputs.index(name) for name in ("heading_rad", "north_m", "depth_m")]] = 0.5, 2.0, 8.0
    x = plant.initial(y)
    assert stepped(plant, record, x) == pytest.approx(plant.run(record, record.segments, x[None, :]), abs=1e-9)


def test_stepping_over_other_times_is_the_rollout_over_them():
    plant = with_effects(load_vehicle("slocum"), EFFECTS["lag and rate limit"])
    time = np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).uniform(0.5, 9.0, 30))])
    record = Record.from_arrays(time, {"rudder_rad": np.where(time > 0.0, 0.3 * np.sin(0.3 * time), 0.0)})
    x = plant.initial(np.zeros(4))
    together = plant.run(record, record.segments, x[None, :])
    for k, u in enumerate(inputs(plant, record)[:-1]):
        x = plant.step_over(x, u, time[k + 1] - time[k])
    assert plant.output(x) == pytest.approx(together[-1], abs=1e-12)


def test_a_step_over_dt_is_a_step():
    plant = with_effects(load_vehicle("slocum"), EFFECTS["all together"])
    x, u = plant.initial(np.zeros(4)), np.full(8, 0.1)
    assert np.array_equal(plant.step_over(x, u, plant.dt), plant.step(x, u))


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_step_output_and_correct_leave_their_arguments_alone(effects):
    plant = with_effects(load_vehicle("ganeshblue"), effects)
    x = plant.step(plant.initial(np.array([0.1, 0.2, 3.0, 4.0])), np.full(8, 0.1))
    u, y = np.full(8, 0.2), np.array([0.3, np.nan, 1.0, np.nan])
    kept = x.copy(), u.copy(), y.copy()
    results = [(plant.step(x, u), plant.output(x), plant.correct(x, y), plant.initial(y)) for _ in range(2)]
    for one, two in zip(*results, strict=True):
        assert np.array_equal(one, two)
        assert one is not x
    for now, before in zip((x, u, y), kept, strict=True):
        assert np.array_equal(now, before, equal_nan=True)


@given(
    y=st.tuples(st.floats(-30.0, 30.0), st.floats(-0.5, 0.5), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    lag=st.floats(0.0, 20.0),
    deviation=st.floats(-0.5, 0.5),
    bias=st.floats(-3.0, 3.0),
)
def test_an_initial_state_has_the_outputs_it_was_made_for(y, lag, deviation, bias):
    effects = {"compass.lag": lag, "compass.deviation_sin": deviation, "compass.bias": bias}
    plant = with_effects(load_vehicle("slocum"), effects)
    x = plant.initial(np.array(y))
    assert plant.output(x) == pytest.approx(np.array(y), rel=2e-13, abs=2e-13)
    assert plant.output(plant.correct(x, plant.output(x))) == pytest.approx(plant.output(x), rel=2e-13, abs=2e-13)


def test_a_free_run_starts_at_the_measured_outputs_of_a_turning_vehicle():
    plant = with_effects(load_vehicle("slocum"), EFFECTS["compass"])
    record, y0 = make_record(plant), np.array([0.5, 0.03, 1.0, 2.0])
    # the sensors settle anew in the rollout, at a heading that three passes have fixed to about 0.1^3 of 0.2 rad x 1e-2
    assert plant.run(record, record.segments, plant.initial(y0)[None, :])[0] == pytest.approx(y0, abs=1e-5)


def test_what_was_not_measured_starts_at_zero_and_is_not_corrected():
    plant = load_vehicle("slocum")
    x = plant.initial(np.array([0.3, np.nan, np.nan, np.nan]))
    assert np.array_equal(plant.output(x), [0.3, 0.0, 0.0, 0.0])
    x = plant.correct(x, np.array([np.nan, 0.1, np.nan, 5.0]))
    assert np.array_equal(plant.output(x), [0.3, 0.1, 0.0, 5.0])


def test_a_state_names_its_entries():
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.dead_time", 5.0)
    assert plant.states == (
        "heading_rad",
        "r_radps",
        "north_m",
        "east_m",
        "rudder_rad position",
        "rudder_rad play",
        "heading_lag_rad",
        "rudder_rad[-2]",
        "rudder_rad[-1]",
        "rudder_rad[-0]",
    )
    assert plant.initial(np.zeros(4)).shape == (10,)


def test_a_commanded_rudder_is_kept_until_its_dead_time_is_over():
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.dead_time", 5.0)
    u = np.zeros(8)
    x = plant.initial(np.zeros(4))
    for command in (0.1, 0.2):
        u[0] = command
        x = plant.step(x, u)
    assert np.array_equal(x[-3:], [0.0, 0.1, 0.2])
    assert x[4] == 0.1  # since 5 s


def test_arguments_of_the_wrong_size_are_refused():
    plant = load_vehicle("slocum")
    x, u = plant.initial(np.zeros(4)), np.zeros(8)
    with pytest.raises(ValueError, match=r"inputs of shape \(8,\): rudder_rad, .*; got \(8,\) and \(1,\)"):
        plant.step(x, u[:1])
    with pytest.raises(ValueError, match=r"needs a state of shape \(8,\), as `initial` returns it"):
        plant.step(x[:4], u)
    with pytest.raises(ValueError, match=r"has shape \(8,\), got \(4,\)"):
        plant.output(x[:4])


def test_integers_and_strided_arrays_step_as_floats_do():
    plant = load_vehicle("slocum")
    x, u = plant.initial(np.zeros(4)), np.array([0, 0, 0, 1, 0, 0, 0, 0])
    assert np.array_equal(plant.step(x, u), plant.step(x, u.astype(float)))
    assert np.array_equal(plant.step(x, np.repeat(u, 2)[::2]), plant.step(x, u.astype(float)))


@pytest.mark.parametrize("change", [{"dt": 0.0}, {"dt": -1.0}, {"longest_step": math.nan}, {"dt": math.inf}])
def test_a_plant_needs_positive_times(change):
    with pytest.raises(ValueError, match=r"A plant's (dt|longest_step) needs a number above 0 in s"):
        replace(load_vehicle("slocum"), **change)


@pytest.mark.parametrize("name", PRESETS)
def test_what_follows_from_the_parameters_follows_them(name):
    plant = load_vehicle(name)
    heavier = replace_at(plant, "hull.mass", 1.1 * plant.hull.mass)
    for one in (plant, heavier):
        assert np.array_equal(one.derived[: one.vector.size], one.vector)
        assert one.derived.shape == (one.family.derived,)
        assert np.isfinite(one.derived).all()
    if plant.family.kind == "body":
        surge = [np.linalg.inv(p.family.view(p.derived).computed.inverse_mass)[0, 0] for p in (plant, heavier)]
        assert surge[1] - surge[0] == pytest.approx(0.1 * plant.hull.mass, rel=1e-9)


def test_constants_follow_the_hull():
    plant = replace_at(load_vehicle("slocum"), "hull.speed", 0.5)
    assert plant.constants["u_mps"] == 0.5
    assert "rudder_rad" not in plant.constants


def test_what_is_known_of_an_effect(tmp_path):
    """At neutral it is sought, held by what is known; elsewhere it is refitted as a coefficient is."""
    file = tmp_path / "v.toml"
    file.write_text(
        'family = "glider"\n[effects.rudder]\noffset = { value = 0.0, deviation = 0.01, source = "the makers" }\n'
        "lag = { value = 0.5, deviation = 0.1 }\n"
    )
    plant = load_vehicle(file)
    assert plant.coefficients == (*plant.family.coefficients, "effects.rudder.lag")
    for doubt in (0.0, 0.1):  # of coefficients
        assert plant.deviation("effects.rudder.offset", doubt) == 0.01
    assert plant.deviation("effects.rudder.offset", math.inf) == math.inf
    assert plant.deviation("effects.rudder.gain", 0.1) == math.inf
    assert [plant.deviation("effects.rudder.lag", doubt) for doubt in (0.0, 0.1)] == [0.0, 0.1]
    save_vehicle(plant, tmp_path / "again.toml")
    assert load_vehicle(tmp_path / "again.toml") == plant
    assert load_vehicle("mermaid").deviation("effects.oil.pump_gain", 0.1) == 0.02


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_cites_every_number_it_sets(name):
    plant = load_vehicle(name)
    changed = [p for p in list_paths(plant) if value_at(plant, p) != spec_at(plant, p).neutral]
    assert plant.title
    assert plant.description
    assert set(changed) <= set(plant.notes)
    assert list_vehicles()[name] == plant.title
    assert list_preset_headings()[name] == Heading(plant.family.name, plant.title, plant.dt)
    assert plant.fitted_to


def test_what_is_known_of_a_coefficient(tmp_path):
    file = tmp_path / "v.toml"
    file.write_text(
        'family = "body"\nfitted_to = "dive 3"\n[hull]\nlength = 2.0\ndensity = 1000.0\n'
        'x_g = { value = 0.1, unit = "m", deviation = 0.02, source = "weighed" }\n'
        '[hull.sway]\nuv = { value = -0.02, unit = "prime", deviation = 0.001 }\n'
    )
    plant = load_vehicle(file)
    assert plant.coefficients == ("hull.sway.uv", "hull.x_g")  # what the file leaves at zero is no part of the model
    assert plant.deviation("hull.x_g", 0.1) == 0.02
    assert plant.deviation("hull.sway.uv", 0.1) == pytest.approx(0.001 * 0.5 * 1000.0 * 2.0**2)
    assert plant.deviation("hull.sway.uv", math.inf) == math.inf  # nothing is to be taken as known
    assert plant.deviation("hull.sway.uv", 0.0) == 0.0  # or everything
    stated = replace_at(plant, "hull.sway.ur", -3.0)
    assert stated.deviation("hull.sway.ur", 0.1) == pytest.approx(0.3)
    assert stated.deviation("hull.z_g", 0.1) == math.inf
    assert "hull.sway.ur" in stated.coefficients
    save_vehicle(plant, tmp_path / "again.toml")
    assert load_vehicle(tmp_path / "again.toml") == plant
    with pytest.raises(ValueError, match=r"Did you mean 'hull\.x_g'"):
        replace(plant, deviations={"hull.xg": 0.1})


def test_a_vehicle_that_hovers_has_drag_in_each_axis_stated_or_not(tmp_path):
    file = tmp_path / "v.toml"
    file.write_text(
        'family = "body"\n[hull]\nmass = 20.0\ni_yy = 0.8\n[hull.added_mass]\nx_udot = -10.0\nm_qdot = -0.4\n'
        "[hull.surge]\nu = { value = -9.0, deviation = 4.0 }\n[hull.pitch]\nq = -1.0\n"
        '[parts.bow]\nkind = "thruster"\ncommand = "share"\ncurve = [[-1.0, -30.0], [1.0, 30.0]]\n'
        "to_y = 1.0\nto_x = 0.0\n"
    )
    plant = load_vehicle(file)
    drag = [f"hull.{axis}" for axis in ("surge.u", "surge.u_u", "roll.p", "roll.p_p", "pitch.q", "pitch.q_q")]
    assert set(drag) < set(plant.coefficients)
    known = {path: plant.deviation(path, 0.1) for path in drag}
    assert known["hull.surge.u"] == 4.0
    assert known["hull.pitch.q"] == pytest.approx(0.1)  # a tenth of what is stated
    assert known["hull.surge.u_u"] == pytest.approx(30.0 / 0.3)  # stops 30 kg from 0.3 m/s within a second
    assert known["hull.pitch.q_q"] == pytest.approx(1.2 / 0.3)
    assert known["hull.roll.p"] == pytest.approx(0.3 * known["hull.roll.p_p"])
    assert plant.deviation("hull.pitch.q_q", math.inf) == math.inf
    assert Parameters(plant, 0.1).bounds("hull.pitch.q_q") == (pytest.approx(-5.0 * 1.2 / 0.3), 0.0)  # drag stays drag


def test_another_sample_time():
    assert load_vehicle("slocum", dt=2.0) == replace(load_vehicle("slocum"), dt=2.0)


# Vehicle files

# What a mass matrix is made of cannot be any number, nor can the ends of a piston's range, or a thruster's curve and
# direction.
BOUND_TOGETHER = re.compile(
    r"density|length|mass|inertia|rdot|hull\.(i_..|[xyz]_g)|load\.(payload|._g)|piston_(low|high|neutral)"
    r"|\.curve\.|\.to_[xyz]"
)


@given(data=st.data())
def test_a_vehicle_file_is_read_back_bit_for_bit(data, tmp_path_factory):
    plant = load_vehicle(data.draw(st.sampled_from(PRESETS)))
    free = [p for p in list_paths(plant) if not BOUND_TOGETHER.search(p)]
    paths = data.draw(st.lists(st.sampled_from(free), max_size=5))
    bounds = {p: np.clip(spec_at(plant, p).bounds, -1e300, 1e300) for p in paths}
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
    plant = replace(
        replace_at(plant, {p: data.draw(st.floats(*map(float, bounds[p]))) for p in paths}),
        name=data.draw(text),
        title=data.draw(text),
        description=data.draw(text),
        dt=data.draw(st.floats(1e-3, 100.0)),
        longest_step=data.draw(st.floats(1e-3, 100.0)),
        window=data.draw(st.floats(10.0, 1e5)),
        settle=data.draw(st.floats(1e-3, 4.0)),
    )
    file = tmp_path_factory.mktemp("vehicle") / "vehicle.toml"
    notes = {"hull.mass": data.draw(text)}
    save_vehicle(plant, file, notes)
    loaded = load_vehicle(file)
    assert loaded == plant  # every field but the notes
    assert np.array_equal(loaded.vector, plant.vector)
    assert loaded.notes == {**plant.notes, **notes}
    assert [f.name for f in file.parent.iterdir()] == ["vehicle.toml"]


def test_neutral_effects_are_not_written(tmp_path):
    plant = replace_at(load_vehicle("slocum"), "effects.yaw.moment", 0.1)
    save_vehicle(plant, tmp_path / "a.toml", {"effects.yaw.moment": "log 7"})
    text = (tmp_path / "a.toml").read_text()
    assert 'moment = { value = 0.1, unit = "N m", source = "log 7" }' in text
    assert "[effects.rudder]" not in text


def test_a_vehicle_cannot_be_saved_where_there_is_no_folder(tmp_path):
    with pytest.raises(ValueError, match=r"Cannot write .*: No such file or directory"):
        save_vehicle(load_vehicle("slocum"), tmp_path / "none" / "a.toml")


def test_an_older_file_stays_where_writing_fails(tmp_path):
    (tmp_path / "a.toml").mkdir()
    with pytest.raises(ValueError, match=r"Cannot write .*: Is a directory"):
        save_vehicle(load_vehicle("slocum"), tmp_path / "a.toml")
    assert [f.name for f in tmp_path.iterdir()] == ["a.toml"]


NAMES = ", ".join(FAMILY_NAMES)
HEAD, BODY = 'family = "glider"\n', 'family = "body"\n'
RUDDER = BODY + '[parts.rudder]\nkind = "surface"\naxis = "yaw"\n'
BAD_FILES = {
    "not TOML": ("family = ", "Vehicle file v.toml is not valid TOML: "),
    "no family": ("dt_s = 1.0", f"needs family = one of {NAMES}, got none"),
    "another family": ('family = "blimp"', f"needs family = one of {NAMES}, got 'blimp'"),
    "family of another type": ("family = [1]", f"needs family = one of {NAMES}, got [1]"),
    "unknown key": (HEAD + "dt = 1.0", "unknown key 'dt'. Did you mean 'dt_s'? Known: family, name"),
    "unknown table": (HEAD + "[hulls]\nmass = 3.0", "unknown key 'hulls'. Did you mean 'hull'?"),
    "number for a table": (HEAD + "hull = 3", "hull needs a table, got 3"),
    "table for a name": (HEAD + "[name]\na = 3", "name needs text in quotes, got {'a': 3}"),
    "number for a title": (HEAD + "title = 3", "title needs text in quotes, got 3"),
    "text for a time": (HEAD + 'dt_s = "1"', "dt_s needs a number of seconds, got '1'"),
    "truth for a time": (HEAD + "dt_s = true", "dt_s needs a number of seconds, got True"),
    "negative time": (HEAD + "dt_s = -1.0", "A plant's dt needs a number above 0 in s, got -1.0"),
    "unknown parameter": (HEAD + "[hull]\nmas = 5.0", "v.toml: No parameter 'hull.mas'. Did you mean 'hull.mass'"),
    "unknown effect": (HEAD + "[effects.ruder]\noffset = 0.1", "Did you mean 'effects.rudder.offset'"),
    "unknown key of a parameter": (
        HEAD + '[hull]\nmass = { value = 50.0, units = "kg" }',
        "hull.mass has an unknown key 'units'. Known: deviation, source, unit, value.",
    ),
    "another unit": (
        HEAD + '[hull]\nrudder_limit = { value = 30.0, unit = "deg" }',
        "hull.rudder_limit is in rad, got unit 'deg': convert the value",
    ),
    "negative deviation": (
        HEAD + "[hull]\nmass = { value = 50.0, deviation = -1.0 }",
        "v.toml: hull.mass needs a deviation of at least 0 kg (one standard deviation; 0 holds the value), got -1.0",
    ),
    "text for a deviation": (HEAD + '[hull]\nmass = { value = 50.0, deviation = "5 kg" }', "got '5 kg'"),
    "deviation of what a pilot sets": (
        'family = "glide_steered"\n[steering]\nlag = { value = 0.1, deviation = 0.1 }',
        "steering.lag cannot have a deviation: only numbers of the hull and of parts, and effects, do",
    ),
    "no value": (HEAD + '[hull]\nmass = { unit = "kg" }', "hull.mass needs a number in kg, got None"),
    "text for a value": (HEAD + '[hull]\nmass = "50"', "hull.mass needs a number in kg, got '50'"),
    "truth for a value": (HEAD + "[hull]\nmass = true", "hull.mass needs a number in kg, got True"),
    "list for a value": (HEAD + "[hull]\nmass = [50.0]", "hull.mass needs a number in kg, got [50.0]"),
    "out of bounds": (HEAD + "[hull]\nmass = -50.0", "hull.mass needs a value from 1 to 10000 kg, got -50"),
    "NaN": (HEAD + "[hull]\nmass = nan", "hull.mass needs a value from 1 to 10000 kg, got nan"),
    "infinite": (HEAD + "[effects.yaw]\nmoment = inf", "effects.yaw.moment needs a value from -50 to 50 N m, got inf"),
    "unknown term": (BODY + "[hull.surge]\nuu = -5.0", "No parameter 'hull.surge.uu'. Did you mean 'hull.surge."),
    "key of another group": (RUDDER + "mass = 5.0", "No parameter 'parts.rudder.mass'. "),
    "unknown group": (BODY + "[effects.wave]\nperiod = 5.0", "Did you mean 'effects.waves.period'"),
    "angle in degrees": (
        RUDDER + 'limit = { value = 20.0, unit = "deg" }',
        "parts.rudder.limit is in rad, got unit 'deg': convert the value",
    ),
    "prime angle": (
        RUDDER + 'limit = { value = 0.3, unit = "prime" }',
        "parts.rudder.limit is in rad, which has no prime form: give the value in rad",
    ),
    "prime linear damping": (
        BODY + '[hull.surge]\nu = { value = -0.3, unit = "prime" }',
        "hull.surge.u is in kg/s, which has no prime form: give the value in kg/s",
    ),
    "prime of a glider": (HEAD + '[hull]\nn_r = { value = -0.3, unit = "prime" }', "hull.n_r is in 1, which has no"),
    "prime text": (
        BODY + '[hull.sway]\nuv = { value = "-0.3", unit = "prime" }',
        "hull.sway.uv needs a number in kg/m, got '-0.3'",
    ),
    "prime out of bounds": (
        BODY + '[hull]\nlength = 2.0\ndensity = 1000.0\n[hull.added_mass]\ny_vdot = { value = 0.5, unit = "prime" }',
        "hull.added_mass.y_vdot needs a value from -1e+07 to 0 kg, got 2000",
    ),
    "unreal inertia": (
        BODY + "[hull]\nmass = 50.0\nz_g = 1.0\ni_xx = 3.0\ni_yy = 80.0",
        "the mass matrix of the rigid body is not positive definite (smallest eigenvalue -28.7, mostly in roll): "
        "check hull.mass, the inertias, the centre of gravity and hull.added_mass (negative there).",
    ),
    "unreal added mass": (
        BODY + "[hull.added_mass]\nz_qdot = 30.0\nm_wdot = 30.0",
        "v.toml: the mass matrix with added mass is not positive definite (smallest eigenvalue -13.2, mostly in pitch)",
    ),
    "no inertia left": (HEAD + "[hull]\ninertia = 1.0", "minus the added inertia D5 N_rdot must be positive"),
}  # fmt: skip


@pytest.mark.parametrize("text, message", BAD_FILES.values(), ids=BAD_FILES)
def test_a_bad_vehicle_file_says_what_is_wrong(tmp_path, text, message):
    (tmp_path / "v.toml").write_text(text)
    with pytest.raises(ValueError, match=re.escape(message)):
        load_vehicle(tmp_path / "v.toml")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match=r"No vehicle file '.*v\.toml': give a path to a TOML file or one of"):
        load_vehicle(tmp_path / "v.toml")


def test_a_file_that_is_not_text(tmp_path):
    (tmp_path / "v.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"Cannot read vehicle file v\.toml: .*Give a TOML file in UTF-8"):
        load_vehicle(tmp_path / "v.toml")


@pytest.mark.parametrize("name, meant", [("sloccum", "slocum"), ("ganeshblu", "ganeshblue")])
def test_an_unknown_vehicle_is_guessed(name, meant):
    with pytest.raises(ValueError, match=rf"No vehicle '{name}'\. Did you mean '{meant}'.*Presets: bluerov"):
        load_vehicle(name)


def test_a_plain_number_is_taken_in_the_parameters_unit(tmp_path):
    (tmp_path / "v.toml").write_text(HEAD + "[hull]\nmass = 50\n[effects.rudder]\noffset = 0.02\n")
    plant = load_vehicle(tmp_path / "v.toml")
    assert (plant.hull.mass, plant.effects.rudder.offset, plant.name) == (50.0, 0.02, "v")


def test_prime_values_are_made_dimensional_by_density_and_length(tmp_path):
    text = """
        [hull.added_mass]
        y_vdot = { value = -0.03, unit = "prime", source = "table 2" }
        y_rdot = { value = 0.002, unit = "prime" }
        m_qdot = { value = -0.003, unit = "prime" }
        [hull.sway]
        v_v = { value = -0.2, unit = "prime" }
        ur = { value = 0.02, unit = "prime" }
        [hull.roll]
        up = { value = -0.01, unit = "prime" }
        qr = { value = 0.01, unit = "prime" }
        [parts.rudder]
        kind = "surface"
        axis = "yaw"
        lift = { value = 0.03, unit = "prime" }
        moment = { value = -0.02, unit = "prime" }
        [hull]
        density = 1000.0
        length = 1.5
    """
    (tmp_path / "v.toml").write_text(BODY + text)
    plant = load_vehicle(tmp_path / "v.toml")
    hull, rudder, base = plant.hull, plant.parts.rudder, 0.5 * 1000.0
    powers = {
        (hull.sway.v_v, -0.2): 2,
        (rudder.lift, 0.03): 2,
        (hull.added_mass.y_vdot, -0.03): 3,
        (hull.sway.ur, 0.02): 3,
        (rudder.moment, -0.02): 3,
        (hull.added_mass.y_rdot, 0.002): 4,
        (hull.roll.up, -0.01): 4,
        (hull.added_mass.m_qdot, -0.003): 5,
        (hull.roll.qr, 0.01): 5,
    }
    for (found, prime), power in powers.items():
        assert found == pytest.approx(prime * base * 1.5**power, rel=1e-15)
    assert plant.notes["hull.added_mass.y_vdot"] == "table 2"
    save_vehicle(plant, tmp_path / "w.toml")
    assert "prime" not in (tmp_path / "w.toml").read_text()
    assert np.array_equal(load_vehicle(tmp_path / "w.toml").vector, plant.vector)


def test_a_name_is_no_vehicle():
    with pytest.raises(ValueError, match=r"steer needs a vehicle, got 'remus100': give load_vehicle\('remus100'\)"):
        check_vehicle("steer", "remus100")


def test_a_vehicle_is_saved_under_its_own_ending(tmp_path):
    with pytest.raises(ValueError, match=r"A vehicle file ends in \.toml, got 'a\.json': rename it"):
        save_vehicle(load_vehicle("slocum"), tmp_path / "a.json")
