from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ca = pytest.importorskip("casadi", reason="the extra `casadi` is not installed")

from auv_gym.exports import casadi_model  # noqa: E402
from auv_gym.exports.for_casadi import _defaults  # noqa: E402
from auv_gym.param import replace_at  # noqa: E402
from auv_gym.plant import load_vehicle  # noqa: E402

EXAMPLES = Path(__file__).parents[2] / "examples" / "vehicles"
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


def worst_error(plant):
    """Of one small step of the vehicle's own program and one of the CasADi function, at 200 random states."""
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
    return worst


@pytest.mark.parametrize("name", ["ganeshblue", "ganeshblue_corrected", "npsauv", "remus100", "bluerov2_heavy"])
def test_the_right_hand_side_is_that_of_the_simulator(name):
    assert worst_error(load_vehicle(name)) < 1e-9


def test_effects_are_in_it():
    effects = {
        "effects.rudder.deadband": 0.05,
        "effects.stern_plane.gain": 0.8,
        "effects.propeller.lost": 0.1,
        "effects.hull.fouling": 0.2,
        "effects.current.shear_north": 0.01,
        "effects.waves.amplitude_cos": 0.3,
        "effects.load.tether_east": 2.0,
    }
    assert worst_error(replace_at(load_vehicle("remus100"), effects)) < 1e-9


def test_an_actuator_lags_and_is_limited_in_rate():
    """From rest to a far command at full rate, to a near one by the lag."""
    plant = load_vehicle("remus100")
    model, own = casadi_model(plant), plant.parts.rudder
    at = model.states.index("rudder_rad position")
    rates = [float(model.rhs(np.zeros(len(model.states)), [angle, 0.0, 0.0])[at]) for angle in (0.3, 0.01, 3.0)]
    assert rates == pytest.approx([1 / own.slowness, 0.01 / own.lag, 1 / own.slowness])


def test_slopes_are_finite_on_a_straight_run():
    """Strips without cross flow have a root of nothing, whose slope is infinite."""
    model = casadi_model(load_vehicle("npsauv"))
    x, u = model.rhs.sx_in()
    slopes = ca.Function("slopes", [x, u], [ca.jacobian(model.rhs(x, u), x)])
    assert np.isfinite(np.array(slopes([2.0] + [0.0] * (len(model.states) - 1), [0.0, 0.0, 0.0, 1000.0]))).all()


def test_inputs_have_the_units_and_defaults_of_the_vehicle():
    model = casadi_model(load_vehicle("bluerov2_heavy"))
    assert tuple(model.defaults) == model.inputs
    assert (model.defaults["t1_share"], model.defaults["supply_V"]) == (0.0, 16.0)
    units = model.units
    assert (units["t1_share"], units["t1_share position"], units["roll_rad"], units["supply_V"]) == (
        "1",
        "1",
        "rad",
        "V",
    )
    assert _defaults(load_vehicle("bluerov"))["t1_us"] == 1500.0  # at rest
    assert casadi_model(load_vehicle("mermaid")).defaults["density_kgpm3"] == 1028.0


@pytest.mark.parametrize(
    "name, changed, reason",
    [
        ("remus100", {"effects.rudder.dead_time": 0.5}, "a dead time or a delay"),
        ("remus100", {"effects.clock.delay": 0.5}, "a dead time or a delay"),
        ("remus100", {"effects.clock.rate": 0.01}, "clock that runs fast"),
        ("remus100", {"effects.rudder.backlash": 0.02}, "backlash"),
        ("remus100", {"effects.rudder.stiction": 0.02}, "stiction"),
        ("remus100", {"parts.rudder.lag": 0.0}, "rate limit of rudder_rad and no lag"),
        ("seaexplorer", {}, "searches for a balance .* Use its linear model"),
    ],
)
def test_what_is_no_right_hand_side_is_refused(name, changed, reason):
    with pytest.raises(ValueError, match=reason):
        casadi_model(replace_at(load_vehicle(name), changed))


@pytest.mark.slow
def test_moving_masses_and_learned_hulls_are_refused():
    with pytest.raises(ValueError, match="a mass that moves"):
        casadi_model(load_vehicle(EXAMPLES / "tethys.toml"))
    with pytest.raises(ValueError, match="a learned hull"):
        casadi_model(replace(load_vehicle("remus100"), learned=object()))
