"""Parameter paths: reading, replacing with bounds, packing in the layout of the compiled view."""

import math
import re
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.param import (
    Spec,
    check_count,
    check_names,
    check_number,
    did_you_mean,
    list_paths,
    pack,
    param,
    part,
    positions,
    record_type,
    replace_at,
    spec_at,
    value_at,
)
from auv_gym.plant import load_vehicle
from auv_gym.vehicles import FAMILIES


@dataclass(frozen=True)
class Fin:
    area: float = param(0.02, "m^2", "fin area", bounds=(0.0, 1.0), probe=1e-3)
    angle: float = param(0.0, "rad")


@dataclass(frozen=True)
class Tail:
    upper: Fin = field(default_factory=Fin)
    arm: float = param(0.8, "m", bounds=(0.0, 10.0))
    lower: Fin = field(default_factory=lambda: Fin(area=0.03))


PATHS = ["upper.area", "upper.angle", "arm", "lower.area", "lower.angle"]


def test_paths_are_in_the_order_of_the_fields():
    assert list_paths(Tail()) == PATHS
    assert positions(Tail()) == {path: index for index, path in enumerate(PATHS)}


def test_the_packed_vector():
    assert np.array_equal(pack(Tail()), [0.02, 0.0, 0.8, 0.03, 0.0])


def test_a_parameter_is_known_by_its_declaration():
    spec = spec_at(Tail(), "upper.area")
    assert spec == Spec("m^2", "fin area", neutral=0.02, bounds=(0.0, 1.0), probe=1e-3)
    assert spec_at(Tail(), "lower.angle").bounds == (-math.inf, math.inf)


def test_replacing_makes_a_copy():
    tail = Tail()
    changed = replace_at(tail, "lower.area", 0.5)
    assert (value_at(tail, "lower.area"), value_at(changed, "lower.area")) == (0.03, 0.5)
    assert changed == replace_at(tail, {"lower.area": 0.5})
    assert replace_at(changed, {"lower.area": 0.03, "arm": 0.8}) == tail


@pytest.mark.parametrize("value", [0.0, 1.0, 1, np.float64(0.5), np.float32(0.5), np.int64(1)])
def test_numbers_within_bounds_are_taken_and_kept_as_float(value):
    found = replace_at(Tail(), "upper.area", value).upper.area
    assert type(found) is float
    assert found == value


@pytest.mark.parametrize("value", [-1e-9, 1.0 + 1e-9, math.inf, -math.inf, math.nan])
def test_values_out_of_bounds_are_refused(value):
    with pytest.raises(
        ValueError, match=r"upper\.area needs a value from 0 to 1 m\^2, got .*: check its unit and sign"
    ):
        replace_at(Tail(), "upper.area", value)


@pytest.mark.parametrize("value", [None, "0.5", True, [0.5], np.array([0.5])])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match=r"upper\.area needs a number in m\^2, got"):
        replace_at(Tail(), "upper.area", value)


@pytest.mark.parametrize("path", ["upper.aera", "upper", "", "area", "upper.area.x"])
def test_an_unknown_path_is_refused_with_those_known(path):
    for use in (spec_at, value_at, lambda tree, name: replace_at(tree, name, 0.1)):
        with pytest.raises(ValueError, match=rf"No parameter {path!r}\. .*Known: upper\.area, upper\.angle"):
            use(Tail(), path)


def test_a_near_miss_is_guessed():
    with pytest.raises(ValueError, match=r"Did you mean 'upper\.area'"):
        value_at(Tail(), "upper.aera")
    with pytest.raises(ValueError, match=r"Did you mean 'effects\.rudder\.offset'"):
        value_at(load_vehicle("slocum"), "effects.rudder.ofset")
    assert did_you_mean("xyz", ["slocum"]) == ""


def test_a_plant_takes_the_paths_of_its_parameters():
    plant = load_vehicle("slocum")
    changed = replace_at(plant, "effects.rudder.offset", 0.05)
    assert list_paths(plant) == list_paths(plant.parameters)
    assert value_at(changed, "effects.rudder.offset") == changed.effects.rudder.offset == 0.05
    assert (changed.name, changed.dt, plant.effects.rudder.offset) == (plant.name, plant.dt, 0.0)


@given(values=st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5))
def test_the_record_reads_what_was_packed(values):
    tail = replace_at(Tail(), dict(zip(PATHS, values, strict=True)))
    record = pack(tail).view(record_type(Tail))[0]
    for path in PATHS:
        read = record
        for name in path.split("."):
            read = read[name]
        assert read == value_at(tail, path) == pack(tail)[positions(tail)[path]]


@dataclass(frozen=True)
class Terms:
    as_array = True
    u: float = param(1.0, "kg/s")
    u_u: float = param(2.0, "kg/m")


@dataclass(frozen=True)
class Hull:
    mass: float = param(50.0, "kg")
    surge: Terms = part(Terms, "surge")
    length: float = param(2.0, "m")


def test_a_group_may_be_an_array_in_the_record():
    hull = replace_at(Hull(), "surge.u_u", 7.0)
    record = pack(hull).view(record_type(Hull))[0]
    assert list_paths(hull) == ["mass", "surge.u", "surge.u_u", "length"]
    assert np.array_equal(record.surge, [1.0, 7.0])
    assert (record.mass, record.length) == (50.0, 2.0)


def test_of_many_parameters_the_neighbours_of_an_unknown_one_are_listed():
    plant = load_vehicle("remus100")
    with pytest.raises(
        ValueError, match=r"Known: parts\.rudder\.lift, parts\.rudder\.moment, .*parts\.rudder\.wake\.drag_slip\.$"
    ):
        value_at(plant, "parts.rudder.lifting")
    with pytest.raises(ValueError, match=r"Known: effects\.rudder, effects\.stern_plane, .*effects\.clock\.$"):
        value_at(plant, "effects.rudders.offset")
    with pytest.raises(ValueError, match=r"Known: hull\.density, hull\.gravity.*, effects\.rudder, "):
        value_at(plant, "nothing")


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
def test_every_family_has_a_leaf_for_each_place_in_its_vector(family):
    tree = family.parameters()
    assert record_type(family.parameters).itemsize == 8 * len(list_paths(tree)) == pack(tree).nbytes


# What no fit frees by itself: terms that a search brings, what is drawn at random, and what describes another effect.
NOT_FREED = re.compile(
    r"effects\.(discovered|sampling)\."
    r"|effects\.(current\.reference_depth|waves\.(period|direction)|load\.tether_station|\w+_fin\.stuck_at)$"
)

# what was before the samples that a family describes is not known, so that no log tells a slow lag
NOT_SEEN = {("glide", "effects.volume.expansion_lag")}


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
def test_every_parameter_says_what_it_is_and_is_neutral_within_its_bounds(family):
    tree = family.parameters()
    for path in list_paths(tree):
        spec = spec_at(tree, path)
        low, high = spec.bounds
        assert spec.unit, path
        assert spec.title, path
        assert low <= spec.neutral <= high, path
        assert spec.neutral + spec.probe <= high, path
        assert "{}" not in spec.title, path
        if path.startswith("effects."):
            held = NOT_FREED.match(path) or (family.kind, path) in NOT_SEEN
            assert (spec.probe > 0.0) != bool(held), path
    assert family.coefficients
    for path in family.coefficients:
        # a coefficient of a vehicle of any size has no smallest change: a fit steps by a share of its value
        assert path.startswith("hull."), path
        assert spec_at(tree, path).probe > 0.0 or spec_at(tree, path).unit.startswith("kg"), path


def test_a_number_without_unit_has_none_in_an_error():
    plant = load_vehicle("slocum")
    with pytest.raises(ValueError, match=r"effects.rudder.gain needs a value from 0.05 to 5, got 9: check"):
        replace_at(plant, "effects.rudder.gain", 9.0)
    with pytest.raises(ValueError, match=r"effects.rudder.gain needs a number, got 'x': give"):
        replace_at(plant, "effects.rudder.gain", "x")
    with pytest.raises(ValueError, match=r"effects.rudder.offset needs a number in rad, got 'x'"):
        replace_at(plant, "effects.rudder.offset", "x")


def test_a_unit_of_the_channel_is_said_in_words():
    with pytest.raises(ValueError, match=r"needs a value from 0 to 100 in the channel's unit, got -1: check"):
        replace_at(load_vehicle("remus100"), "effects.sampling.depth.noise", -1.0)


@pytest.mark.parametrize("value", [0, -1, 2.5, True, "3", None])
def test_a_setting_that_is_no_whole_number_is_refused(value):
    with pytest.raises(ValueError, match=f"Pid: lag needs a whole number of at least 1, got {value!r}"):
        check_count("Pid: lag", value)


@pytest.mark.parametrize(
    "value, bounds, words",
    [
        ("3", {}, "needs a number in s, got '3'"),
        (math.nan, {}, "needs a number in s, got nan"),
        (0.0, {"above": 0.0}, "needs a number above 0 in s, got 0.0"),
        (9.0, {"at_least": 1.0, "at_most": 4.0}, "needs a number of at least 1 and of at most 4 in s, got 9.0"),
    ],
)
def test_a_setting_outside_its_bounds_is_refused(value, bounds, words):
    with pytest.raises(ValueError, match=f"window {words}"):
        check_number("window", value, "s", **bounds)


def test_a_name_has_no_parameters():
    with pytest.raises(ValueError, match="Parameters belong to a vehicle, got a str: load_vehicle reads one by name"):
        list_paths("slocum")


@pytest.mark.parametrize("given, words", [("depth_m", r"write \['depth_m'\]"), (3, "got 3"), ([3], r"got \[3\]")])
def test_names_come_in_a_list(given, words):
    with pytest.raises(ValueError, match=f"targets needs a list of names, .*{words}"):
        check_names("targets", given)
