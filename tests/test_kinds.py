"""What each layer knows of each kind of vehicle, and what it says where it knows nothing."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym import load_vehicle, replace_at
from auv_gym.envs.kinds import KINDS as ENVIRONMENTS
from auv_gym.models.linear.kinds import KINDS as STEADY
from auv_gym.vehicles import FAMILIES, compose
from auv_gym.vehicles.body.body import Part
from auv_gym.vehicles.family import registered
from controllers.autopilots import autopilot
from controllers.kinds import KINDS as CONTROL
from identification.experiments.kinds import KINDS as EXPERIMENTS
from identification.experiments.missions import check_mission, mission_of, run_mission
from identification.planning import next_experiment

LAYERS = (ENVIRONMENTS, STEADY, CONTROL, EXPERIMENTS)
THRUSTER = Part("t1", "thruster", "share")
MASSES = [Part("battery", "moving_mass", "both"), Part("ballast", "buoyancy_engine")]
FAMILIES_OF_ALL_KINDS = (*FAMILIES.values(), compose([]), compose([THRUSTER]), compose(MASSES))


@pytest.mark.parametrize("kinds", LAYERS)
def test_a_layer_knows_the_kind_of_every_family_and_no_other(kinds):
    assert set(kinds.names) == {family.kind for family in FAMILIES_OF_ALL_KINDS}
    for family in FAMILIES_OF_ALL_KINDS:
        assert kinds.of(family) is kinds.of(replace(family, name="another of its kind"))


def test_thrusters_hover_unless_another_part_steers_or_drives_by_its_role():
    fins = [Part("rudder", "fin", "yaw"), Part("elevator", "fin", "pitch"), Part("propeller", "propeller", "voltage")]
    tether, engine = Part("tether", "tether"), Part("engine", "buoyancy_engine")
    assert compose([THRUSTER, tether, engine]).kind == "hover"
    assert [compose([THRUSTER, fin]).kind for fin in fins] == ["body"] * 3
    assert compose([tether, engine]).kind == "body"


def test_volume_and_masses_glide_unless_another_part_steers_drives_or_pushes():
    slides, turns = Part("trim", "moving_mass", "slides"), Part("keel", "moving_mass", "turns")
    assert compose([*MASSES, Part("wings", "wings")]).kind == "glide_body"
    assert compose([slides, turns, MASSES[1]]).kind == "glide_body"
    assert compose([*MASSES, THRUSTER]).kind == "hover"
    for other in (Part("rudder", "fin", "yaw"), Part("propeller", "propeller", "voltage")):
        assert compose([*MASSES, other]).kind == "body"
    for fewer in (MASSES[:1], MASSES[1:], [slides, MASSES[1]], [turns, MASSES[1]]):
        assert compose(fewer).kind == "body"


@pytest.mark.parametrize("kinds", LAYERS)
def test_a_kind_that_a_layer_does_not_know_is_refused_with_what_to_add(kinds):
    with pytest.raises(
        ValueError,
        match=r"vehicles of kind body, float, glide, glide_body, glider, hover, got family 'crab' of kind 'walker'",
    ) as e:
        kinds.of(replace(FAMILIES["glider"], name="crab", kind="walker"))
    assert f"{kinds._package}.walker with an object KIND" in str(e.value)


def test_the_refusal_reaches_those_who_ask_for_a_controller_or_a_mission():
    glider = load_vehicle("slocum")
    walker = replace(glider, family=replace(glider.family, kind="walker"))
    with pytest.raises(
        ValueError,
        match="Controllers know vehicles of kind body, float, glide, glide_body, glider, hover, got family 'glider'",
    ):
        autopilot(walker)
    with pytest.raises(ValueError, match="There are experiments with vehicles of kind"):
        mission_of(walker)


def test_a_mission_that_samples_by_its_own_settings_refuses_effects_that_it_would_ignore():
    glider = replace_at(load_vehicle("slocum"), "effects.sampling.compass.noise", 0.1)
    with pytest.raises(ValueError, match=r"has no effects\.sampling\.compass\.noise: leave it out"):
        run_mission(glider, np.random.default_rng(0))
    with pytest.raises(ValueError, match="has no setting 'lenght'"):
        check_mission(load_vehicle("slocum"), ["lenght"])
    check_mission(replace_at(load_vehicle("remus100"), "effects.sampling.compass.noise", 0.1), ["duration"])


@pytest.mark.parametrize("name", ["qiandao_float", "seaglider"])
def test_the_next_experiment_is_simulated_without_sampling(name):
    plant = replace_at(load_vehicle(name), "effects.sampling.depth.noise", 0.1)
    design = EXPERIMENTS.of(plant.family).designs(plant)[0]
    found = next_experiment._flown(design, plant, plant, 5.0, 0)
    assert not isinstance(found, str), found


def test_a_name_of_a_family_is_given_once():
    with pytest.raises(ValueError, match="There is a family 'glider' already"):
        registered(replace(FAMILIES["glider"], title="another"))
    assert registered(FAMILIES["glider"]) is FAMILIES["glider"]
