"""Effects that are reported as a coefficient, compared with that coefficient."""

from pathlib import Path

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle


def acting(name: str | Path) -> int:
    """How many such effects of a vehicle act; each does what its coefficient does, in the derivative, at any motion."""
    plant = load_vehicle(name)
    told = plant.family.coefficients_of(plant.parameters)
    rng, tried = np.random.default_rng(5), 0
    z = np.concatenate([0.3 * rng.normal(size=6) + [1.0, 0, 0, 0, 0, 0], [0.0, 0.0, 30.0, 0.5, 0.5, -0.5, 0.5, 0.0]])
    actuators = np.abs(rng.normal(size=2 * len(plant.inputs))) * 0.1
    actuators[-len(plant.inputs) :] = 0.0
    for index, channel in enumerate(plant.inputs):
        actuators[index] *= 3000.0 if channel == "propeller_rpm" else 1e-3 if channel == "ballast_m3" else 1.0

    def rates(changed) -> np.ndarray:
        family, dz = changed.family, np.zeros(14)
        family.hooks.derivative(
            z, actuators, actuators[: len(plant.inputs)], family.view(changed.derived), dz, np.zeros(family.scratch)
        )
        return dz

    for effect, (path, law) in told.items():
        size = 3.0 * spec_at(plant, effect).probe
        given = value_at(plant, path)
        by_effect = rates(replace_at(plant, effect, size))
        by_coefficient = rates(replace_at(plant, path, law(given, size)))
        np.testing.assert_allclose(by_effect, by_coefficient, rtol=1e-9, atol=1e-12, err_msg=effect)
        tried += not np.array_equal(by_effect, rates(plant))
    return tried
