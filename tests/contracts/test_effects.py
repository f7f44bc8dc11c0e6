"""What holds for every effect: neutral is the identity bit for bit, and a probe shows at first order."""

from dataclasses import replace
from math import cos, sin

import numpy as np
import pytest

from auv_gym.compiled import compiled
from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.record import Record
from auv_gym.vehicles.glider import GLIDER, GRAVITY, stable_step

VEHICLES = sorted(list_vehicles())
# One family so far; another brings its effect-free twin below.
PATHS = [path for path in list_paths(load_vehicle("slocum")) if path.startswith("effects.")]


@compiled
def bare_derivative(x, actuators, inputs, p, dx, scratch):
    """Equation (11) with (15), without a word about effects."""
    hull = p.hull
    u = inputs[3]
    d3 = 0.5 * hull.density * hull.length**3
    d4 = d3 * hull.length
    u_damping = hull.speed + hull.speed_scaling * (u - hull.speed)
    u_squared = hull.speed**2 + hull.speed_scaling * (u**2 - hull.speed**2)
    damping = d4 * (hull.n_r * u_damping + hull.n_wr * inputs[4]) - hull.mass * hull.x_g * u_damping
    weight = GRAVITY * (hull.y_g * hull.mass - hull.y_b * hull.density * hull.volume) * sin(inputs[6])
    moment = (
        hull.damping_factor * damping * x[1]
        + hull.rudder_factor * (d3 * u_squared * hull.n_delta * actuators[0])
        + hull.bow_thruster_arm * inputs[1]
        + hull.stern_thruster_arm * inputs[2]
        + weight
        - hull.i_xy * inputs[5] ** 2
    )
    inertia = hull.inertia - 0.5 * hull.density * hull.length**5 * hull.n_rdot
    dx[0] = x[1] + hull.rudder_heading_rate * actuators[0]
    dx[1] = moment / inertia + hull.heading_stiffness * x[0]
    dx[2] = u * cos(x[0])
    dx[3] = u * sin(x[0])


@compiled
def bare_shape(inputs, memory, p, shaped):
    shaped[0] = min(max(inputs[0], -p.hull.rudder_limit), p.hull.rudder_limit)


@compiled
def bare_times(index, p):
    return 0.0, 0.0, 0.0


@compiled
def bare_sense(before, x, sensors, duration, p):
    sensors[0] = 0.0


@compiled
def bare_settle(x, actuators, sensors, p):
    sensors[0] = 0.0


@compiled
def bare_output(x, actuators, sensors, p, y):
    y[0] = x[0]
    y[1] = x[1] + p.hull.rudder_heading_rate * actuators[0]
    y[2] = x[2]
    y[3] = x[3]


BARE = replace(
    GLIDER,
    name="bare_glider",
    kind="bare_glider",
    hooks={
        "derivative": bare_derivative,
        "stable_step": stable_step,
        "shape": bare_shape,
        "actuator_times": bare_times,
        "sense": bare_sense,
        "settle_sensors": bare_settle,
        "output": bare_output,
        **{name: GLIDER.hooks[name] for name in ("enter", "leave", "derive")},
    },
)


def rich_record(plant: Plant, samples: int = 150) -> Record:
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


def outputs(plant: Plant, record: Record) -> np.ndarray:
    return plant.run(record, record.segments, np.array([[0.4, 0.01, 5.0, -3.0]]))


@pytest.mark.parametrize("name", VEHICLES)
def test_neutral_effects_are_the_identity_bit_for_bit(name):
    plant = load_vehicle(name)
    neutral = replace_at(plant, {path: spec_at(plant, path).neutral for path in PATHS})
    record = rich_record(plant)
    assert np.array_equal(outputs(neutral, record), outputs(replace(neutral, family=BARE), record))


@pytest.mark.parametrize("path", PATHS)
def test_an_effect_set_to_neutral_leaves_no_trace(path):
    plant = load_vehicle("ganeshblue")
    spec, record = spec_at(plant, path), rich_record(plant)
    probed = replace_at(plant, path, spec.neutral + 3.0 * spec.probe)
    restored = replace_at(probed, path, spec.neutral)
    assert value_at(plant, path) == spec.neutral
    assert restored == plant
    assert np.array_equal(outputs(restored, record), outputs(plant, record))
    assert not np.array_equal(outputs(probed, record), outputs(plant, record))


# A heading sensor resolves about a thousandth of a degree, a track a millimetre; three probes show well above.
VISIBLE = np.array([1e-3, 1e-3, 1e-2, 1e-2])


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", ["ganeshblue", "slocum"])
def test_three_probes_of_an_effect_show(name, path):
    plant = load_vehicle(name)
    spec, record = spec_at(plant, path), rich_record(plant)
    for side in (1.0, -1.0):
        value = spec.neutral + side * 3.0 * spec.probe
        if spec.bounds[0] <= value <= spec.bounds[1]:
            change = outputs(replace_at(plant, path, value), record) - outputs(plant, record)
            assert np.any(np.abs(change).max(axis=0) > VISIBLE), side


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", ["ganeshblue", "slocum"])
def test_an_effect_shows_at_first_order(name, path):
    plant = load_vehicle(name)
    spec, record = spec_at(plant, path), rich_record(plant)
    neutral = outputs(plant, record)

    def response(scale):
        change = outputs(replace_at(plant, path, spec.neutral + scale * spec.probe), record) - neutral
        return float(np.sqrt(np.mean(change[:, :2] ** 2)) or np.sqrt(np.mean(change**2)))

    # One hundredth but for curvature: what a probe adds to the track of a heading, or how often the rudder is in a band
    # of its width. A second-order effect would give 1e-4.
    assert 0.005 < response(0.01) / response(1.0) < 0.02
    assert response(0.001) / response(0.01) == pytest.approx(0.1, rel=0.2)
