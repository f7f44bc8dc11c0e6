"""How a vehicle is composed: kinds found, effects that are coefficients, roles, and what a record must have."""

from dataclasses import replace
from pathlib import Path

import pytest

from auv_gym.param import list_paths, spec_at
from auv_gym.plant import load_vehicle
from auv_gym.vehicles import Part, compose
from auv_gym.vehicles.body.kinds import part_kind, part_kinds, register_part
from auv_gym.vehicles.former import convert_former_vehicle
from tests.vehicles.body.coefficient_effects import acting

FILES = Path(__file__).parents[3] / "examples" / "vehicles"


@pytest.mark.parametrize("name", ["remus100", "npsauv", "seawing"])
def test_an_effect_that_is_reported_as_a_coefficient_does_what_the_coefficient_does(name):
    assert acting(name) >= 4  # most of them act


def test_damping_of_several_coefficients_is_an_effect_of_its_own():
    plant = load_vehicle("remus100")
    assert "effects.hull.damping_yaw" not in plant.family.coefficients_of(plant.parameters)
    alone = load_vehicle(FILES / "tethys.toml")
    assert alone.family.coefficients_of(alone.parameters)["effects.hull.damping_yaw"][0] == "hull.yaw.r_r"


@pytest.mark.parametrize("name, title", [("stern_plane", "stern plane"), ("th_ap", "th_ap"), ("fin_1", "fin_1")])
def test_parts_are_called_as_in_the_file_unless_their_names_are_words(name, title):
    family = compose([Part(name, "thruster", "share")])
    assert spec_at(family.parameters(), f"effects.{name}.gain").title == f"{title} gain"


def test_inputs_effects_and_candidates_follow_from_the_parts():
    family = compose(
        [Part("t1", "thruster", "pulse"), Part("t2", "thruster", "pulse"), Part("ballast", "buoyancy_engine")]
    )
    assert family.inputs == ("t1_us", "t2_us", "ballast_m3", "supply_V", "elapsed_s")
    assert family.required == ("t1_us", "t2_us")
    paths = list_paths(family.parameters())
    assert {"parts.t1.x", "effects.t2.lost", "effects.ballast.offset", "effects.load.payload"} <= set(paths)
    assert spec_at(family.parameters(), "effects.t2.lost").title == "share of the thrust of t2 lost"
    assert family.body.by_role() == {}


def test_a_second_part_of_a_role_may_lack_in_a_record():
    plant = load_vehicle("npsauv")
    assert plant.family.body.by_role()["pitch"] == ("stern_plane_rad", "bow_plane_rad")
    assert plant.family.required == ("rudder_rad", "stern_plane_rad", "propeller_rpm")
    assert plant.constants == {"bow_plane_rad": 0.0}


def test_kinds_are_found_by_name_and_cannot_be_taken():
    assert list(part_kinds())[:2] == ["surface", "fin"]
    with pytest.raises(ValueError, match=r"There is a kind of part 'tether' already: choose another name"):
        register_part(replace(part_kind("tether"), order=3))
    assert register_part(part_kind("tether")) is part_kind("tether")
    with pytest.raises(ValueError, match="needs a force"):
        replace(part_kind("tether"), force=None)
    with pytest.raises(ValueError, match="identifier"):
        replace(part_kind("tether"), name="a tether")


def test_former_files_do_not_mix_with_parts():
    with pytest.raises(ValueError, match=r'family = "torpedo" has no parts'):
        convert_former_vehicle({"family": "torpedo", "parts": {}})
