"""What holds for every effect: neutral is the identity bit for bit, and a probe shows at first order."""

from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
import pytest
from bare_families import bare

from auv_gym.effects import BodyEffects
from auv_gym.model import inputs_of
from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.plant.cruise import command_ranges, find_helm
from auv_gym.records.record import Record
from auv_gym.vehicles import FAMILIES, effects_by_kind

# A heading sensor resolves about a thousandth of a degree, a velocity log some mm/s, a track a centimetre.
RESOLUTION = {"rad": 1e-3, "radps": 1e-3, "mps": 5e-3, "m": 1e-2}
FLOATS = ("qiandao_float", "mermaid")
TRACK = ("north_m", "east_m")
# of a heave and an expansion that are not there while the others are neutral
COMPANIONS = {"effects.water.heave_period": 70.0, "effects.volume.expansion_lag": 50.0}


# a probe of these is no small change where thrusters move as quickly as in the log here
NOT_SMALL = ("effects.t1.dead_time", "effects.t1.slowness")
ABOUT_ITSELF = ("effects.t1.shift_z", "effects.t1.turn_z")  # of a thruster that pushes up or down


def effect_paths(plant: Plant) -> list[str]:
    return [path for path in list_paths(plant) if path.startswith("effects.")]


def showing() -> list[tuple[str, str]]:
    """Effects that a fit may free, and a vehicle on which each must show."""
    glider, torpedo, rov = load_vehicle("slocum"), load_vehicle("heu_torpedo"), load_vehicle("bluerov")
    diver = load_vehicle("qiandao_float")
    free = [(name, p) for name in ("ganeshblue", "slocum") for p in effect_paths(glider) if spec_at(glider, p).probe]
    free += [
        ("heu_torpedo", path)
        for path in effect_paths(torpedo)
        if spec_at(torpedo, path).probe and ".supply." not in path
    ]
    # what upright thrusters and those that push ahead can show
    free += [("bluerov", path) for path in effect_paths(rov) if path.startswith(("effects.t1.", "effects.supply."))]
    free = [(name, path) for name, path in free if path not in (*ABOUT_ITSELF, *NOT_SMALL)]
    free += [("bluerov", path.replace(".t1.", ".t3.")) for path in ABOUT_ITSELF]
    with_bow_plane = load_vehicle("npsauv")
    for path in effect_paths(with_bow_plane):
        if spec_at(with_bow_plane, path).probe and ".bow_plane." in path:
            free.append(("npsauv", path))
    flyer = load_vehicle("seaglider")
    unseen = {*COMPANIONS, *(path for path, channel in flyer.family.measured.items() if channel == "pitch_rad")}
    free += [("seaglider", p) for p in effect_paths(flyer) if spec_at(flyer, p).probe and p not in unseen]
    for path in effect_paths(diver):
        if spec_at(diver, path).probe and path not in COMPANIONS:
            free += [("qiandao_float", path)] if ".oil." not in path else []
            free += [("mermaid", path)] if ".piston." not in path else []
    return free


SHOWING = showing()


@lru_cache
def vehicle(name: str) -> Plant:
    """A preset; quick bow planes and piston: a small rate limit does not show behind a lag, nor a lag behind one."""
    quick = {"npsauv": {"parts.bow_plane.lag": 0.0}, "qiandao_float": {"hull.piston_slowness": 0.0}}
    return replace_at(load_vehicle(name), quick.get(name, {}))


def glider_record(plant: Plant, samples: int = 150) -> Record:
    """Every input moves, the rudder also into its stops, in small steps and back; and the vehicle turns all ways."""
    k = np.arange(samples)
    limit = plant.hull.rudder_limit
    rudder = limit * (0.9 * np.sin(0.11 * k) + 0.4 * np.sin(0.71 * k) + 0.1 * np.sign(np.sin(2.3 * k)))
    return Record.from_arrays(
        plant.dt * k,
        {
            "rudder_rad": rudder,
            "bow_thruster_N": 0.3 * np.sin(0.05 * k),
            "stern_thruster_N": 0.2 * np.cos(0.07 * k),
            "u_mps": plant.hull.speed * (1.2 + 0.4 * np.sin(0.06 * k)),
            "w_mps": 0.05 * np.sin(0.08 * k),
            "q_radps": 0.03 * np.cos(0.09 * k),
            "pitch_rad": 0.4 * np.sin(0.02 * k),
            "roll_rad": 0.15 * np.cos(0.04 * k + 1.0),
        },
    )


def torpedo_record(plant: Plant, samples: int = 400) -> Record:
    """Every command moves, also into its stops, in small steps and back."""
    t, parts = plant.dt * np.arange(samples), plant.parts

    def moved(slow: float, quick: float, phase: float) -> np.ndarray:
        return 1.1 * np.sin(slow * t + phase) + 0.4 * np.sin(quick * t) + 0.1 * np.sign(np.sin(2.3 * t + phase))

    columns = {
        "rudder_rad": parts.rudder.limit * moved(0.35, 2.6, 0.5),
        "stern_plane_rad": parts.stern_plane.limit * moved(0.9, 2.9, 1.0),
        plant.inputs[find_helm(plant).drive]: parts.propeller.limit * (0.7 + 0.4 * moved(0.4, 1.3, 0.0)),
    }
    if "bow_plane_rad" in plant.inputs:
        columns["bow_plane_rad"] = parts.bow_plane.limit * moved(0.7, 1.1, 2.0)
    return Record.from_arrays(t, columns)


def float_record(plant: Plant, samples: int = 300) -> Record:
    """The piston moves, also into its stops, in small steps and back, or pump and valve run in turn; down and up."""
    k = np.arange(samples)
    hull, t = plant.hull, plant.dt * k
    middle, half = 0.5 * (hull.piston_high + hull.piston_low), 0.5 * (hull.piston_high - hull.piston_low)
    stroke = 0.9 * np.cos(0.05 * k) + 0.3 * np.sin(0.31 * k) + 0.1 * np.sign(np.sin(2.3 * k)) - 0.2
    pumped, valved = 5e-5 * (k // 60), 4e-5 * ((k + 25) // 50)
    return Record.from_arrays(
        t,
        {
            "piston_m": middle + half * stroke,
            "temperature_C": hull.temperature + 5.0 * np.sin(0.02 * k),
            "oil_volume_m3": pumped - valved,
            "pumped_volume_m3": pumped,
            "valved_volume_m3": valved,
            "valved_depth_m4": 400.0 * valved,
            "density_kgpm3": hull.density + 0.3 * np.sin(0.03 * k),
            "density_gradient_kgpm4": 5e-3 * np.cos(0.04 * k),
            "density_depth_m": 300.0 + 0.05 * k,
        },
    )


def glide_record(plant: Plant, samples: int = 300) -> Record:
    """The engine goes into its stops, in steps and back; the glider dives, climbs and turns, never to the surface."""
    k = np.arange(samples)
    hull, wave = plant.hull, np.sin(0.05 * k) + 0.1 * np.sin(0.31 * k)
    half = 1.05 * max(hull.engine_neutral - hull.engine_low, hull.engine_high - hull.engine_neutral)
    return Record.from_arrays(
        plant.dt * k,
        {
            "buoyancy_volume_m3": hull.engine_neutral - half * wave,
            "temperature_C": hull.temperature - 5.0 + 5.0 * np.sin(0.02 * k),
            "pitch_rad": -0.5 * np.tanh(5.0 * wave) + 0.02 * np.sin(0.2 * k),
            "heading_rad": 0.02 * k,
            "density_kgpm3": hull.density + 0.3 * np.sin(0.03 * k),
        },
    )


def thruster_record(plant: Plant, samples: int = 120) -> Record:
    """Every thruster moves, also into its stops, in small steps and back, while the supply sags."""
    k, columns = np.arange(samples), {"supply_V": 15.0 + np.cos(0.05 * np.arange(samples))}
    for i, (name, (low, rest, high)) in enumerate(zip(plant.inputs, command_ranges(plant), strict=False)):
        moved = 0.8 * np.sin(0.11 * k + i) + 0.5 * np.sin(0.31 * k + 2.0 * i) + 0.05 * np.sign(np.sin(2.3 * k))
        columns[name] = rest + 0.5 * (high - low) * moved
    return Record.from_arrays(plant.dt * k, columns)


STEPS = {"hover": 0.01}
STARTS = {
    "glider": [0.4, 0.01, 5.0, -3.0],
    "hover": [0.3, 0.05, -0.05, 0.02, 0.01, 0.02, 5.0, -3.0, 6.0, 0.05, -0.05, 0.4, 0.0],
    "body": [1.2, 0.05, -0.05, 0.02, 0.01, 0.02, 5.0, -3.0, 6.0, 0.05, -0.05, 0.4, 0.0],
    "float": [300.0, 0.05, 1e-5],
    "glide": [300.0, 0.05, 5.0, -3.0, 1e-5],
}


def rich_record(plant: Plant) -> Record:
    makers = {"glider": glider_record, "body": torpedo_record, "hover": thruster_record, "float": float_record}
    makers["glide"] = glide_record
    return makers[plant.family.kind](plant)


def outputs(plant: Plant, record: Record) -> np.ndarray:
    return plant.run(record, record.segments, np.array([STARTS[plant.family.kind]]))


def stepped(plant: Plant, record: Record, start: list[float]) -> np.ndarray:
    """Outputs of a plant that is stepped by hand: of a bare family less is compiled for it than for `outputs`."""
    inputs = inputs_of(plant, record)
    x, read = plant.settled(np.array(start), inputs[0]), []
    for u in inputs:
        read.append(plant.output(x))
        x = plant.step(x, u)
    return np.array(read)


@lru_cache
def neutral_run(name: str) -> tuple[Record, np.ndarray]:
    record = rich_record(vehicle(name))
    return record, outputs(vehicle(name), record)


def change(name: str, path: str, probes: float) -> np.ndarray:
    """What an effect of so many probes does to the outputs."""
    record, neutral = neutral_run(name)
    spec = spec_at(vehicle(name), path)
    return outputs(replace_at(vehicle(name), path, spec.neutral + probes * spec.probe), record) - neutral


OF_THE_SAME_PARTS = ("bluerov2", "bluerov2_heavy", "heu_torpedo", "npsauv", "vt690")


def bare_form_of(name: str):
    """The preset, slow where another one of the same parts is tried: each bare form is compiled for this test only."""
    return pytest.param(name, marks=pytest.mark.slow) if name in OF_THE_SAME_PARTS else name


# of masses that move there is no bare form
@pytest.mark.parametrize("name", [bare_form_of(name) for name in sorted({*list_vehicles()} - {"seawing"})])
def test_neutral_effects_are_the_identity_bit_for_bit(name):
    plant = load_vehicle(name)
    # the bare family does not limit its steps to what is stable: of a vehicle that spins they are shorter anyway
    plant = replace(plant, longest_step=STEPS.get(plant.family.kind, plant.longest_step))
    neutral = replace_at(plant, {path: spec_at(plant, path).neutral for path in effect_paths(plant)})
    record, start = rich_record(plant), STARTS[plant.family.kind]
    without = stepped(replace(neutral, family=bare(plant.family)), record, start)
    assert np.isfinite(without).all()
    assert np.array_equal(stepped(neutral, record, start), without)


@pytest.mark.parametrize("name, path", SHOWING)
def test_an_effect_set_to_neutral_leaves_no_trace(name, path):
    record, neutral = neutral_run(name)
    plant = vehicle(name)
    spec = spec_at(plant, path)
    probed = replace_at(plant, path, spec.neutral + 3.0 * spec.probe)
    restored = replace_at(probed, path, spec.neutral)
    assert value_at(plant, path) == spec.neutral
    assert restored == plant
    assert np.array_equal(outputs(restored, record), neutral)
    assert not np.array_equal(outputs(probed, record), neutral)


@pytest.mark.parametrize("name, path", SHOWING)
def test_three_probes_of_an_effect_show(name, path):
    spec = spec_at(vehicle(name), path)
    visible = [RESOLUTION[channel.rsplit("_", 1)[1]] for channel in vehicle(name).outputs]
    for probes in (3.0, -3.0):
        if spec.bounds[0] <= spec.neutral + probes * spec.probe <= spec.bounds[1]:
            assert np.any(np.abs(change(name, path, probes)).max(axis=0) > visible), probes


@pytest.mark.parametrize("name, path", [(n, p) for n, p in SHOWING if not p.endswith(".stiction")])
def test_an_effect_shows_at_first_order(name, path):
    names = vehicle(name).outputs
    scale = np.array([RESOLUTION[channel.rsplit("_", 1)[1]] for channel in names])
    local = [channel not in TRACK for channel in names]

    def response(probes):
        found = change(name, path, probes) / scale
        return float(np.sqrt(np.mean(found[:, local] ** 2)) or np.sqrt(np.mean(found**2)))

    # One hundredth but for curvature: what a probe adds to the track of a heading, or how often the rudder is in a band
    # of its width. A second-order effect would give 1e-4.
    assert 0.005 < response(0.01) / response(1.0) < 0.02
    assert response(0.001) / response(0.01) == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize(
    "name, among",
    [("heu_torpedo", "effects.waves.direction"), *((name, path) for name in FLOATS for path in COMPANIONS)],
)
def test_what_only_describes_an_effect_changes_nothing_without_it(name, among):
    """Where a fin would be stuck, which way or how often waves would go, how a reading is sampled: bit for bit."""
    record, neutral = neutral_run(name)
    plant = vehicle(name)
    companions = [p for p in effect_paths(plant) if spec_at(plant, p).probe == 0.0 and ".discovered." not in p]
    values = {p: 0.4 if p.startswith("effects.sampling") else 1.1 for p in companions}
    values |= {p: value for p, value in COMPANIONS.items() if p in effect_paths(plant)}
    assert among in values
    assert "effects.sampling.depth.noise" in values
    assert np.array_equal(outputs(replace_at(plant, values), record), neutral)


@pytest.mark.parametrize(
    "name, count", [("heu_torpedo", 6 * 35), ("slocum", 18), ("qiandao_float", 14), ("mermaid", 14)]
)
def test_every_discovered_term_acts_and_leaves_no_trace(name, count):
    record, neutral = neutral_run(name)
    plant = vehicle(name)
    paths = [p for p in effect_paths(plant) if ".discovered." in p]
    size = 0.1 if name == "heu_torpedo" else 1e-4
    assert len(paths) == count
    for path in paths:
        if name == "mermaid" and ".piston" in path:  # it has none
            continue
        changed = replace_at(plant, path, size)
        assert not np.array_equal(outputs(changed, record), neutral), path
        assert np.array_equal(outputs(replace_at(changed, path, 0.0), record), neutral), path


@pytest.mark.parametrize("family", FAMILIES.values(), ids=list(FAMILIES))
def test_the_effects_of_a_kind_are_those_of_its_families(family):
    assert type(family.parameters().effects) is type(effects_by_kind()[family.kind])


@pytest.mark.parametrize("name", [name for name in sorted(list_vehicles()) if load_vehicle(name).family.body])
def test_the_effects_of_a_body_are_those_of_its_parts_and_of_every_body(name):
    plant = load_vehicle(name)
    found = {field.name: type(getattr(plant.effects, field.name)) for field in fields(plant.effects)}
    parts = {part.name: part.found.effects for part in plant.family.body.parts}
    shared = {field.name: type(getattr(BodyEffects(), field.name)) for field in fields(BodyEffects)}
    assert len(found) == len(parts) + len(shared)
    assert found == {**parts, **shared}
