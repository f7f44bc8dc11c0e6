import numpy as np
import pytest
from scipy.linalg import logm

from auv_gym.models.linear import linearise
from auv_gym.plant import list_vehicles, load_vehicle
from auv_gym.plant.cruise import find_cruise, find_helm
from auv_gym.plant.float_engine import find_engine

TORPEDOES = ["npsauv", "heu_torpedo", "remus100", "vt690"]


def start_of(plant, point, commands):
    """The full state in steady motion."""
    n, actuators = len(plant.family.states), len(plant.family.actuators)
    x = np.zeros(len(plant.states))
    x[:n] = point
    for at in (n, n + actuators, x.size - actuators):
        x[at : at + actuators] = commands[:actuators]
    return x


def responses(plant, model, size, samples=5):
    """Changes of the outputs after a step of each input: of the plant, and of its linear form."""
    cruise = find_cruise(plant)
    x, u = start_of(plant, cruise.state, cruise.commands), cruise.commands.copy()
    z = np.zeros(len(model.states))
    for name in model.inputs:
        u[plant.inputs.index(name)] += size
    v = np.array([u[plant.inputs.index(name)] for name in model.inputs])
    at = [plant.outputs.index(name) for name in model.outputs]
    for _ in range(samples):
        for _ in range(round(model.dt / plant.dt)):
            x = plant.step(x, u)
        z = model.step(z, v)
    return plant.output(x)[at], model.output(z)


@pytest.mark.parametrize("vehicle", ["npsauv", "vt690"])
def test_a_torpedo_dives_by_the_published_equations(vehicle):
    """theta' = q, zeta' = w - u theta, and the righting moment through the inverse mass; in the plane of the cruise."""
    plant = load_vehicle(vehicle)
    model = linearise(plant)
    cruise = find_cruise(plant)
    rates = (logm(model.a) / model.dt).real[:4, :4]  # states w, q, pitch, depth
    assert rates[2] == pytest.approx([0.0, 1.0, 0.0, 0.0], abs=1e-6)
    assert rates[3] == pytest.approx([1.0, 0.0, -cruise.speed, 0.0], abs=1e-6)
    assert rates[:2, 3] == pytest.approx([0.0, 0.0], abs=1e-6)
    hull, computed = plant.hull, plant.family.view(plant.derived).computed
    stiffness = computed.z_g * computed.weight - hull.z_b * computed.buoyancy
    inverse = computed.inverse_mass
    assert rates[0, 2] == pytest.approx(-inverse[2, 4] * stiffness, abs=1e-6)
    assert rates[1, 2] == pytest.approx(-inverse[4, 4] * stiffness, abs=1e-6)


@pytest.mark.parametrize("vehicle", TORPEDOES)
@pytest.mark.parametrize("axis", ["vertical", "horizontal", "surge"])
def test_its_error_is_of_second_order_in_the_step(vehicle, axis):
    plant = load_vehicle(vehicle)
    inputs = {"vertical": None, "horizontal": (plant.inputs[0],), "surge": (plant.inputs[find_helm(plant).drive],)}[
        axis
    ]
    # all that moves: planes that couple a little are a first-order error of a form that leaves the others out
    states = [name for name in plant.family.states if not name.startswith(("north", "east", "wave"))]
    model = linearise(plant, inputs, states=states, dt=2.0 * plant.dt)
    large = -0.02 * plant.parts.propeller.limit if axis == "surge" else 0.005
    errors = []
    for size in (large, 0.5 * large):
        true, linear = responses(plant, model, size)
        errors.append(np.abs(true - linear).max())
        assert errors[-1] < 0.25 * np.abs(true - model.output_offset).max()
    order = np.log2(errors[0] / errors[1])
    assert order > 1.9  # 2, and 3 in a plane in which the vehicle is symmetric


def test_an_actuator_with_a_lag_is_a_state():
    model = linearise(load_vehicle("npsauv"))
    lag = load_vehicle("npsauv").parts.stern_plane.lag
    at = model.states.index("stern_plane_rad position change")
    assert model.a[at, at] == pytest.approx(np.exp(-model.dt / lag), abs=1e-6)
    assert model.inputs == ("stern_plane_rad", "bow_plane_rad")
    assert linearise(load_vehicle("heu_torpedo")).inputs == ("stern_plane_rad",)


def test_a_trimmed_vehicle_is_linear_about_its_trim():
    plant = load_vehicle("remus100")
    model, cruise = linearise(plant), find_cruise(plant)
    assert model.input_offset == pytest.approx([cruise.commands[1]])
    at_rest = model.output(np.zeros(len(model.states)))
    assert at_rest[model.outputs.index("pitch_rad")] == pytest.approx(cruise.state[10])


def test_other_states_outputs_and_points_can_be_asked_for():
    plant = load_vehicle("vt690")
    rolling = linearise(
        plant, ("rudder_rad",), ("heading_rad",), states=("v_mps", "r_radps", "p_radps", "roll_rad", "heading_rad")
    )
    assert rolling.outputs == ("heading_rad",)
    assert "roll_rad change" in rolling.states
    cruise = find_cruise(plant)
    deep = cruise.state.copy()
    deep[8] = 50.0
    at_depth = linearise(plant, at=(deep, cruise.commands))
    assert at_depth.output_offset[at_depth.outputs.index("depth_m")] == 50.0
    assert at_depth.a == pytest.approx(linearise(plant).a, abs=1e-7)


@pytest.mark.parametrize("vehicle", ["slocum", "ganeshblue", "ganeshblue_corrected"])
def test_a_glider_is_linear_already(vehicle):
    plant = load_vehicle(vehicle)
    model = linearise(plant)
    x, z = plant.initial(np.zeros(4)), model.initial(np.zeros(2))
    u = np.array([plant.constants.get(name, 0.3) for name in plant.inputs])
    for _ in range(20):
        x, z = plant.step(x, u), model.step(z, u[:1])
    assert model.output(z) == pytest.approx(plant.output(x)[:2], abs=1e-8)


@pytest.mark.parametrize("vehicle", ["qiandao_float", "mermaid"])
def test_a_float_is_linear_near_rest(vehicle):
    """At a tenth of the fastest speed, of which the linear form has the drag."""
    plant = load_vehicle(vehicle)
    engine, model = find_engine(plant), linearise(plant)
    x, z = plant.initial(np.array([100.0, 0.0])), model.initial(np.array([100.0, 0.0]))
    hull, slow = plant.hull, 0.1 * engine.speed
    weight = slow * (hull.drag_linear + hull.drag_quadratic * slow)
    piston = {"piston_m": hull.piston_neutral}
    u = np.array([plant.constants.get(name, piston.get(name, 0.0)) for name in plant.inputs])
    u[plant.inputs.index(engine.channel)] -= weight / (hull.density * 9.81 * engine.volume)
    v = u[[plant.inputs.index(engine.channel)]]
    if engine.channel == "piston_m":
        x[plant.states.index("piston_m position")] = u[0]
    for _ in range(200):
        x, z = plant.step(x, u), model.step(z, v)
    travelled, expected = plant.output(x)[0] - 100.0, model.output(z)[0] - 100.0
    assert travelled > 0.0
    assert expected == pytest.approx(travelled, rel=0.05)


@pytest.mark.parametrize("name", list_vehicles())
def test_every_preset_has_a_linear_form(name):
    assert np.abs(linearise(load_vehicle(name)).b).max() > 0.0


@pytest.mark.parametrize(
    "options, message",
    [
        ({"inputs": ("stern_plane",)}, "no input 'stern_plane'"),
        ({"outputs": ("heading_rad",)}, "outputs that its states move"),
        ({"states": ("w_mps", "yaw")}, "no state 'yaw'"),
        ({"inputs": ()}, "needs inputs, got none"),
    ],
)
def test_what_the_vehicle_lacks_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        linearise(load_vehicle("npsauv"), **options)


def test_unsteady_motion_is_refused():
    plant = load_vehicle("npsauv")
    cruise = find_cruise(plant)
    sinking = cruise.state.copy()
    sinking[2] = 0.3
    with pytest.raises(ValueError, match="steady motion"):
        linearise(plant, at=(sinking, cruise.commands))
