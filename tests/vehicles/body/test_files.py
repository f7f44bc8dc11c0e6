"""Vehicle files of a hull and its parts: what is written is read, former files are read, and bad ones are refused."""

import pickle
import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest

from auv_gym.channels import channel
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import list_vehicles, load_vehicle, save_vehicle, vehicle_of_text, vehicle_text
from auv_gym.vehicles import Part, compose
from auv_gym.vehicles.former import convert_former_vehicle, current_torpedo_path

FILES = sorted((Path(__file__).parents[3] / "examples" / "vehicles").glob("*.toml"))
BODY = 'family = "body"\nname = "mine"\n'
RUDDER = '[parts.rudder]\nkind = "surface"\naxis = "yaw"\n'
THRUSTER = '[parts.t1]\nkind = "thruster"\ncommand = "share"\n'
CURVE = "curve = [[-1, -40], [0, 0], [1, 50]]\n"

BAD = {
    "no kind": (BODY + "[parts.rudder]\nlift = 1.0\n", "parts.rudder: kind is missing: give one of surface, fin, "),
    "unknown kind": (
        BODY + '[parts.t1]\nkind = "thrustr"\n',
        "parts.t1: there is no kind of part 'thrustr'. Did you mean 'thruster'? Kinds: surface, fin, ",
    ),
    "kind that is no text": (BODY + "[parts.t1]\nkind = 3\n", "parts.t1: kind needs text in quotes, one of surface, "),
    "unknown form": (
        BODY + '[parts.rudder]\nkind = "surface"\naxis = "roll"\n',
        "parts.rudder: a part of kind 'surface' needs axis = one of yaw, pitch, got 'roll'",
    ),
    "no form": (
        BODY + '[parts.rudder]\nkind = "surface"\n',
        "parts.rudder: a part of kind 'surface' needs axis = one of yaw, pitch, got ''",
    ),
    "twice": (BODY + RUDDER + RUDDER, "is not valid TOML: Cannot declare ('parts', 'rudder') twice"),
    "name of the hull": (
        BODY + RUDDER.replace("rudder", "hull"),
        "parts: a part cannot be called 'hull', which is the name of something else: choose another",
    ),
    "name of an effect": (BODY + RUDDER.replace("rudder", "current"), "parts: a part cannot be called 'current'"),
    "name of another": (BODY + RUDDER.replace("rudder", "load"), "parts: a part cannot be called 'load'"),
    "digit first": (BODY + RUDDER.replace("rudder", "1"), "that does not begin with a digit, got '1'"),
    "keyword": (
        BODY + RUDDER.replace("rudder", "as"),
        "a part cannot be called 'as', which is a word of Python: choose",
    ),
    "keyword None": (
        BODY + RUDDER.replace("rudder", "None"),
        "a part cannot be called 'None', which is a word of Python",
    ),
    "odd name": (BODY + RUDDER.replace("rudder", '"t 1"'), "a part needs a name of letters, digits and underscores"),
    "one channel for two": (
        BODY + RUDDER + RUDDER.replace("rudder", "fin").replace("axis", 'channel = "rudder_rad"\naxis'),
        "parts: two parts take their commands from rudder_rad: name another channel for one of them",
    ),
    "too many channels": (
        BODY + RUDDER + 'channel = ["a_rad", "b_rad"]\n',
        "parts.rudder: channel needs the name of each of its 1 commands, got ('a_rad', 'b_rad')",
    ),
    "channel without a unit": (BODY + RUDDER + 'channel = "rudder"\n', "'rudder' does not say its unit"),
    "unknown number": (
        BODY + RUDDER + "lifts = 1.0\n",
        "No parameter 'parts.rudder.lifts'. Did you mean 'parts.rudder.lift",
    ),
    "text for a number": (BODY + RUDDER + 'lift = "much"\n', "parts.rudder: lift is text, 'much': "),
    "wrong unit": (
        BODY + RUDDER + 'limit = { value = 20.0, unit = "deg" }\n',
        "parts.rudder.limit is in rad, got unit 'deg': convert the value",
    ),
    "beyond bounds": (
        BODY + RUDDER + "limit = 20.0\n",
        "parts.rudder.limit needs a value from 0 to 1.5708 rad, got 20",
    ),
    "a part that is no table": (BODY + "[parts]\nrudder = 3\n", "parts.rudder needs a table with kind = ..., got 3"),
    "no direction": (
        BODY + THRUSTER + "to_x = 0.0\n" + CURVE,
        "parts.t1: to_x, to_y, to_z is a direction of length 0: say where its thrust points",
    ),
    "falling curve": (
        BODY + THRUSTER + "curve = [[-1, -40], [0, 0], [0.5, -3], [1, 50]]\n",
        "parts.t1: curve needs commands that rise and thrusts that do not fall, got [0.0, 0.0] before [0.5, -3.0]: ",
    ),
    "falling points": (
        BODY + THRUSTER + "[parts.t1.curve]\np050 = 9.0\np055 = 3.0\n",
        "parts.t1.curve falls after p050",
    ),
    "short curve": (
        BODY + THRUSTER + "curve = [[0, 0], [1, 50]]\n",
        "curve needs finite rows from command -1 to command 1",
    ),
    "unknown curve": (BODY + THRUSTER + 'curve = "t20"\n', "curve has no name 't20'. Did you mean 't200'? Known: t200"),
    "no rows": (BODY + THRUSTER + "curve = [1, 2]\n", "curve needs rows of command and thrust, N, such as"),
    "volumes out of order": (
        BODY + '[parts.b]\nkind = "buoyancy_engine"\nlow = 2e-4\nneutral = 1e-4\nhigh = 5e-4\n',
        "parts.b: low, neutral and high need to rise, low below high, got 0.0002, 0.0001 and 0.0005 m^3",
    ),
    "a direction of another length": (
        BODY + '[parts.m]\nkind = "moving_mass"\nmotion = "slides"\naxis_x = 0.5\n',
        "parts.m: axis_x, axis_y and axis_z need the length 1, got 0.5: divide them by it",
    ),
    "two hulls": (
        BODY + '[hull.surge]\nu_u = -2.0\n[parts.wings]\nkind = "wings"\ndrag_0 = 3.0\n',
        "parts.wings stands for the whole vehicle, but the hull has coefficients of its own, hull.surge.u_u, which "
        "would count twice: leave them out, or give parts.wings.covers = 0",
    ),
    "no mass": (
        BODY + "[hull.added_mass]\ny_vdot = -1.0\nn_vdot = 900.0\ny_rdot = 900.0\n",
        "the mass matrix with added mass is not positive definite",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_with_its_key_and_what_to_do(case, tmp_path):
    text, expected = BAD[case]
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ValueError, match=r"^Vehicle file mine\.toml") as caught:
        load_vehicle(tmp_path / "mine.toml")
    assert expected in str(caught.value)


def test_a_part_far_outside_the_hull_is_doubted_and_near_it_not():
    text = BODY + "[hull]\nlength = 2.0\n" + THRUSTER + CURVE
    with pytest.warns(UserWarning, match=r"parts\.t1\.y = 5 m is more than a length outside the hull, which is 2 m"):
        vehicle_of_text(text.replace("curve", "y = 5.0\ncurve"), "mine")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vehicle_of_text(text.replace("curve", "y = 1.0\nx = -2.9\ncurve"), "mine")


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_file_of_parts_reads_back_bit_for_bit_with_its_sources(file, tmp_path):
    plant = replace_at(load_vehicle(file), {"effects.ballast.offset": 1e-4, "effects.current.north": 0.1})
    save_vehicle(plant, tmp_path / "again.toml")
    again = load_vehicle(tmp_path / "again.toml")
    assert again == plant
    assert again.family is plant.family
    assert again.notes == plant.notes
    np.testing.assert_array_equal(again.vector, plant.vector)
    copy = pickle.loads(pickle.dumps(plant))
    assert copy == plant
    assert copy.family is plant.family
    assert pickle.loads(pickle.dumps(plant.effects)) == plant.effects


def test_a_named_curve_and_own_channels_read_back():
    text = BODY + THRUSTER + 'channel = "thruster1_share"\ncurve = "t200"\n'
    plant = vehicle_of_text(text, "mine")
    assert plant.inputs == ("thruster1_share", "supply_V", "elapsed_s")
    assert (value_at(plant, "parts.t1.curve.p100"), value_at(plant, "parts.t1.curve.m050")) == (50.0, -16.1)
    assert value_at(plant, "parts.t1.curve.p005") == 0.0
    assert vehicle_of_text(vehicle_text(plant), "mine") == plant
    assert channel("thruster1_share").kind == "input"


FORMER = """
family = "torpedo"
name = "old"
[hull]
length = 2.0
[hull.rudder]
lift = { value = 9.0, unit = "kg/m", deviation = 1.0, source = "tank" }
[hull.stern_plane]
moment = -6.0
[hull.propulsion]
t_nn = 0.001
[hull.propulsion.table.v1]
at_0 = 3.0
[hull.slipstream]
c_t1 = 0.01
pitch = 0.05
k_up = 2.0
z_uu_stern = 4.0
[effects.rudder]
offset = 0.02
[effects.rudder_fin]
lost = 0.25
[effects.propeller]
thrust_loss = 0.1
[effects.bow_plane]
offset = 0.1
"""


def test_a_former_file_is_read_as_a_hull_and_its_parts():
    plant = vehicle_of_text(FORMER, "old")
    assert plant.family is compose(
        [
            Part("rudder", "surface", "yaw"),
            Part("stern_plane", "surface", "pitch"),
            Part("propeller", "propeller", "shaft_speed"),
        ]
    )
    for path, value in {
        "parts.rudder.lift": 9.0,
        "parts.stern_plane.moment": -6.0,
        "parts.propeller.t_nn": 0.001,
        "parts.propeller.table.v1.at_0": 3.0,
        "parts.propeller.wake.c_t1": 0.01,
        "parts.propeller.wake.k_up": 2.0,
        "parts.stern_plane.wake.lift": 4.0,
        "effects.rudder.offset": 0.02,
        "effects.rudder.lost": 0.25,
        "effects.propeller.lost": 0.1,
    }.items():
        assert value_at(plant, path) == value
    assert (plant.deviations, plant.notes) == ({"parts.rudder.lift": 1.0}, {"parts.rudder.lift": "tank"})


def test_every_number_of_a_former_file_has_its_path_now():
    content = tomllib.loads(FORMER)
    assert convert_former_vehicle({"family": "glider"}) == {"family": "glider"}
    now = set(list_paths(vehicle_of_text(FORMER, "old")))

    def leaves(table, prefix=""):
        for key, value in table.items():
            if isinstance(value, dict) and "value" not in value:
                yield from leaves(value, f"{prefix}{key}.")
            else:
                yield f"{prefix}{key}"

    former = [p for p in leaves({k: content[k] for k in ("hull", "effects")}) if "bow_plane" not in p]
    assert {current_torpedo_path(p) for p in former} <= now
    assert current_torpedo_path("hull.surge.u_u") == "hull.surge.u_u"


@pytest.mark.parametrize(
    "family, channel_name",
    [("torpedo", "propeller_rpm"), ("torpedo_voltage", "propeller_V"), ("torpedo_speed", "speed_cmd_mps")],
)
def test_former_families_differ_in_the_propellers_command(family, channel_name):
    bow = "[hull.bow_plane]\nlift = 2.0\n"
    plain = vehicle_of_text(FORMER.replace('"torpedo"', f'"{family}"'), "old")
    assert plain.inputs == ("rudder_rad", "stern_plane_rad", channel_name)
    with_bow = vehicle_of_text(FORMER.replace('"torpedo"', f'"{family}"') + bow, "old")
    assert with_bow.inputs == ("rudder_rad", "stern_plane_rad", "bow_plane_rad", channel_name)
    assert value_at(with_bow, "effects.bow_plane.offset") == 0.1


def test_presets_say_where_every_number_of_their_parts_comes_from():
    bodies = [plant for plant in map(load_vehicle, (*list_vehicles(), *FILES)) if plant.family.body is not None]
    assert len(bodies) >= 6
    for plant in bodies:
        given = {p for p in list_paths(plant) if p.startswith("parts.") and value_at(plant, p) != 0.0}
        neutral = plant.family.parameters()
        unnamed = [p for p in given if p not in plant.notes and value_at(plant, p) != value_at(neutral, p)]
        assert not unnamed, (plant.name, unnamed)


def test_the_order_of_the_parts_in_a_file_does_not_matter():
    parts = [Part("propeller", "propeller", "shaft_speed"), Part("p", "surface", "pitch"), Part("r", "surface", "yaw")]
    assert compose(parts).inputs == ("r_rad", "p_rad", "propeller_rpm")
    assert re.fullmatch(r"body(_[a-z_]+\d+)+", compose(parts).program)
