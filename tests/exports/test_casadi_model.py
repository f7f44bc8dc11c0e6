import numpy as np
import pytest

ca = pytest.importorskip("casadi", reason="the extra `casadi` is not installed")

from auv_gym.exports import casadi_model  # noqa: E402
from auv_gym.plant import load_vehicle  # noqa: E402

STEP = 1e-3  # s, one step of RK4: in Euler angles and in quaternions it is the same to STEP^5


def rk4(rhs, x, u, h):
    """The classical step of Runge and Kutta."""
    k1 = rhs(x, u)
    k2 = rhs(x + h / 2 * k1, u)
    k3 = rhs(x + h / 2 * k2, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rhs(x + h * k3, u))


def drawn(plant, rng):
    """Random states of a vehicle that moves, its attitude away from the vertical, and commands within its limits."""
    sizes = {"mps": 1.0, "radps": 0.3, "rad": 1.0, "m": 5.0}
    states = [rng.uniform(-1, 1) * sizes.get(name.rsplit("_", 1)[-1], 0.0) for name in plant.family.states]
    u = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
    if plant.family.body is not None:
        low, _, high = plant.family.body.ranges(plant.parameters).T
        u[: len(low)] = rng.uniform(low, high)
    else:
        u[:] = rng.uniform(-0.4, 0.4, u.size)
    return np.array(states), u


@pytest.mark.parametrize("name", ["ganeshblue", "ganeshblue_corrected", "npsauv", "remus100", "bluerov2_heavy"])
def test_the_right_hand_side_is_that_of_the_simulator(name):
    """One small step of the vehicle's own program and one of the CasADi function, at 200 random states."""
    plant = load_vehicle(name)
    model, n, worst = casadi_model(plant), len(plant.family.states), 0.0
    rng = np.random.default_rng(3)
    lagged = [plant.states.index(state) for state in model.states[n:]]
    for _ in range(200):
        states, u = drawn(plant, rng)
        full = plant.settled(states, u)
        x = full[[*range(n), *lagged]]
        theirs = (np.array(rk4(model.rhs, x, u, STEP)).ravel() - x)[:n] / STEP
        ours = (plant.step_over(full, u, STEP) - full)[:n] / STEP
        worst = max(worst, np.max(np.abs(theirs - ours) / (1.0 + np.abs(ours))))
    assert worst < 1e-9, worst
