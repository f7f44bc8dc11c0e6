"""Vertical motion of a profiling float that changes its volume by a piston or an oil bladder.

Source: Zhong, Yu, Bai, Zeng and Lian 2024, "Diving dynamics identification and motion prediction for marine crafts
using field data", J. Ocean Eng. Sci. 9(4): equations (2) to (5).  Depth and vertical velocity are positive down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, inf, pi, sin, sqrt

from auv_gym.compiled import compiled, view_as
from auv_gym.param import list_paths, param, part, record_type
from auv_gym.physics.actuators import shaped_command
from auv_gym.physics.buoyancy import GRAVITY, air_volume, exposed_volume
from auv_gym.physics.discovered import N_HEAVE, any_term, discovered_heave_damping, discovered_heave_force
from auv_gym.vehicles.depth_sensor import sense, settle_sensors
from auv_gym.vehicles.family import Family, RightHandSide, copied, registered
from auv_gym.vehicles.float_effects import FloatEffects


@dataclass(frozen=True)
class FloatHull:
    """Mass, drag and buoyancy engine; a float is neutral at `density` with its piston at `piston_neutral` and no oil.

    Equation (5) has M_z = mass + added_mass, D_z = drag_linear + drag_quadratic |w|, N_1 = -density g piston_area and
    N_2 = -piston_square, about the neutral position. N_3, a force from the piston's speed, is omitted: in Table 1 it is
    0.5 % s of N_1, less than a thousandth of the buoyancy at any piston speed.
    """

    density: float = param(1000.0, "kg/m^3", "water density at neutral trim", bounds=(900.0, 1100.0))
    mass: float = param(60.0, "kg", "mass", bounds=(0.1, 1e5))
    added_mass: float = param(15.0, "kg", "added mass", bounds=(0.0, 1e5))
    drag_quadratic: float = param(14.0, "kg/m", "quadratic drag", bounds=(1e-3, 1e4), probe=1.4)
    drag_linear: float = param(6.0, "kg/s", "linear drag", bounds=(0.0, 1e4), probe=0.6)
    piston_area: float = param(2e-3, "m^2", "volume per piston travel", bounds=(1e-6, 1.0), probe=1e-4)
    piston_square: float = param(
        0.0, "N/m^2", "part of the piston's lift that grows with its square", bounds=(-1e4, 1e4)
    )
    piston_neutral: float = param(0.0, "m", "piston position at neutral trim", bounds=(-10.0, 10.0))
    piston_low: float = param(-0.05, "m", "lowest piston position", bounds=(-10.0, 10.0))
    piston_high: float = param(0.05, "m", "highest piston position", bounds=(-10.0, 10.0))
    piston_slowness: float = param(0.0, "s/m", "rate limit of the piston, as time per travel", bounds=(0.0, 1e5))
    waterplane: float = param(0.03, "m^2", "cross-section at the surface", bounds=(1e-4, 10.0))
    temperature: float = param(15.0, "degC", "hull temperature at neutral trim", bounds=(-5.0, 60.0))
    quasi_steady: float = param(0.0, "1", "1 where drag balances buoyancy at every moment", bounds=(0.0, 1.0))
    trim_known: float = param(1.0, "1", "0 where each dive starts with a volume of its own", bounds=(0.0, 1.0))


@dataclass(frozen=True)
class FloatParameters:
    """The parameter tree of a profiling float."""

    hull: FloatHull = part(FloatHull)
    effects: FloatEffects = part(FloatEffects)


@compiled
def moving_mass(hull):
    """Mass and added mass, kg."""
    return hull.mass + hull.added_mass


@compiled
def heave(depth, time, water):
    """Velocity of the water down, m/s, and its acceleration, m/s^2, at a depth, m, and a time, s.

    From a steady current, which may grow with depth and is then accelerated along its way, and from an internal wave.
    """
    growth = water.current_with_depth if depth > 0.0 else 0.0
    velocity, wave = water.current + growth * depth, 0.0
    if water.heave_sin != 0.0 or water.heave_cos != 0.0:  # the usual case skips the trigonometry
        rate = 2.0 * pi / water.heave_period
        s, c = sin(rate * time), cos(rate * time)
        velocity += water.heave_sin * s + water.heave_cos * c
        wave = rate * (water.heave_sin * c - water.heave_cos * s)
    return velocity, wave + growth * velocity


@compiled
def lifting_volume(depth, unknown, piston, hull_temperature, time, inputs, p):
    """Displaced volume beyond neutral trim, m^3; positive lifts.

    unknown: m^3, of this dive.  piston: m.  hull_temperature: degC.  time: s, since the dive began.
    """
    hull, volume, oil = p.hull, p.effects.volume, p.effects.oil
    displaced = hull.mass / hull.density
    local = inputs[3] + inputs[8] * (depth - inputs[9])
    square = piston * abs(piston) - hull.piston_neutral * abs(hull.piston_neutral)
    return (
        hull.piston_area * (piston - hull.piston_neutral)
        + hull.piston_square / (hull.density * GRAVITY) * square
        + inputs[2]
        + oil.pump_gain * inputs[5]
        - oil.valve_gain * inputs[6]
        - oil.valve_with_depth * inputs[7]
        + unknown
        + volume.offset
        + volume.compressibility * depth
        + air_volume(volume.air, depth, hull.density)
        + volume.expansion * (hull_temperature - hull.temperature)
        - volume.leak * time
        + displaced * (local - hull.density + p.effects.water.gradient * depth) / hull.density
        - exposed_volume(depth, hull.waterplane)
    )


@compiled
def drag_coefficients(depth, p):
    """Linear drag, kg/s, and quadratic drag, kg/m, including the tether paid out to this depth."""
    hull, errors = p.hull, p.effects.drag
    quadratic = hull.drag_quadratic * (1.0 + errors.quadratic) + p.effects.tether.drag * max(depth, 0.0)
    return hull.drag_linear * (1.0 + errors.linear), quadratic


@compiled
def steady_speed(force, linear, quadratic):
    """The speed, m/s, at which (linear + quadratic |w|) w balances a force, N."""
    root = sqrt(linear * linear + 4.0 * quadratic * abs(force))
    return 2.0 * force / (linear + root) if root > 0.0 else 0.0


_ABOVE = -5.0  # m; a pressure sensor may be wrong by a few metres at the surface, not more
_MOST_OIL = 0.02  # m^3
_FASTER = 0.2  # m/s that a float may accelerate before the step is evaluated again
_NEAR_SURFACE = 15.0  # m that it may rise in that time
_BLOCK = 4  # steps
_AT_SURFACE = 2.0  # s, step at the surface of a float without inertia
_FASTEST = 0.25  # m/s at which such a float may rise without passing the surface before the step is evaluated again
_RATE_LAG = 30.0  # s, with which the depth rate state follows the balance; the depth itself has no such lag


@compiled
def stable_step(x, inputs, p):
    """The longest RK4 step, s, that keeps drag and floating at the surface stable, with a margin of two."""
    hull = p.hull
    if hull.quasi_steady != 0.0:
        return min(max(x[0] / (_BLOCK * _FASTEST), _AT_SURFACE), 2.0 * _RATE_LAG)
    linear, quadratic = drag_coefficients(x[0], p)
    linear += discovered_heave_damping(p.effects.discovered.heave, abs(x[1]) + _FASTER)
    step = 1.4 * moving_mass(hull) / (linear + 2.0 * quadratic * (abs(x[1]) + _FASTER))
    if x[0] < _NEAR_SURFACE:
        step = min(step, 1.4 * sqrt(moving_mass(hull) / (hull.density * GRAVITY * hull.waterplane)))
    return step


@compiled
def derivative(x, actuators, inputs, p, dx, scratch):
    """State derivative of [depth, depth rate, unknown volume, time into the sample] into dx: equation (5).

    actuators: [piston m, hull temperature degC].  inputs: as in the family, held over a sample; the water's density is
    linear in depth around the depth at which it was measured.
    Accelerating water carries the float with it: the added mass and the displaced water both experience the water's
    acceleration (Morison's inertia force; Faltinsen 1990, sec. 3.1).  With `quasi_steady` the acceleration is zero;
    otherwise, a float whose M/D is a second, sampled once in minutes, would be a stiff system.
    """
    hull = p.hull
    time = inputs[4] + x[3]
    water, acceleration = heave(x[0], time, p.effects.water)
    lift = lifting_volume(x[0], x[2], actuators[0], actuators[1], time, inputs, p)
    force = -hull.density * GRAVITY * lift - p.effects.tether.pull
    found = p.effects.discovered.heave
    if any_term(found, N_HEAVE):
        warmer = inputs[1] - hull.temperature
        force += discovered_heave_force(found, x[0], x[1] - water, actuators[0] - hull.piston_neutral, warmer, time)
    linear, quadratic = drag_coefficients(x[0], p)
    if hull.quasi_steady != 0.0:
        rate = water + steady_speed(force, linear, quadratic)
        if x[0] <= 0.0:  # afloat
            rate = max(rate, 0.0)
        dx[0] = rate
        dx[1] = (rate - x[1]) / _RATE_LAG
    else:
        flow = x[1] - water
        dx[0] = x[1]
        dx[1] = (force - (linear + quadratic * abs(flow)) * flow) / moving_mass(hull) + acceleration
    dx[2] = 0.0
    dx[3] = 1.0


@compiled
def enter(x, z):
    """Convert kept states to integrated ones, by adding a clock that starts with the sample."""
    z[0], z[1], z[2], z[3] = x[0], x[1], x[2], 0.0


@compiled
def shape(inputs, memory, p, shaped):
    """Write the piston command after memoryless effects, backlash and stiction, and water temperature, into shaped."""
    hull, piston = p.hull, p.effects.piston
    middle, half = 0.5 * (hull.piston_high + hull.piston_low), 0.5 * (hull.piston_high - hull.piston_low)
    position, last = shaped_command(
        inputs[0] - middle, memory[0] - middle, piston.gain, piston.offset, 0.0, piston.backlash, piston.stiction, half
    )
    shaped[0], memory[0] = middle + position, middle + last
    shaped[1] = inputs[1]


@compiled
def actuator_times(index, p):
    """Dead time s, lag s and slowness of the piston (0), and of the hull's temperature (1), which lags the water's."""
    if index == 1:
        return 0.0, p.effects.volume.expansion_lag, 0.0
    piston = p.effects.piston
    return piston.dead_time, piston.lag, p.hull.piston_slowness + piston.slowness


@compiled
def output(x, actuators, sensors, p, y):
    """Write the outputs [measured depth, rate of change of the true depth] into y."""
    depth = p.effects.depth
    y[0] = x[0] + depth.scale * x[0] + sensors[0] + depth.bias
    y[1] = x[1]


def piston_problem(parameters: FloatParameters) -> str:
    """The problem of the piston's range, or nothing."""
    hull = parameters.hull
    if not hull.piston_low < hull.piston_high:
        return "hull.piston_low must be less than hull.piston_high"
    if not hull.piston_low <= hull.piston_neutral <= hull.piston_high:
        return "hull.piston_neutral must lie between hull.piston_low and hull.piston_high"
    return ""


FLOAT_PISTON = Family(
    name="float_piston",
    kind="float",
    title="vertical motion of a profiling float with a piston",
    parameters=FloatParameters,
    inputs=(
        "piston_m",
        "temperature_C",
        "oil_volume_m3",
        "density_kgpm3",
        "elapsed_s",
        "pumped_volume_m3",
        "valved_volume_m3",
        "valved_depth_m4",
        "density_gradient_kgpm4",
        "density_depth_m",
    ),
    constants={
        "piston_m": "hull.piston_neutral",
        "temperature_C": "hull.temperature",
        "density_kgpm3": "hull.density",
    },
    required=("piston_m",),
    states=("depth_m", "depth_rate_mps", "volume_m3"),
    integrated=4,
    block=_BLOCK,
    differences=(1e-2, 1e-4),
    derived=len(list_paths(FloatParameters())),
    problem=piston_problem,
    actuators=("piston_m", "temperature_C"),
    sensors=("depth_lag_m",),
    outputs=("depth_m", "depth_rate_mps"),
    coefficients=("hull.drag_quadratic", "hull.drag_linear"),
    doubted=lambda parameters: ("hull.added_mass",) if parameters.hull.added_mass else (),
    twins={"effects.drag.quadratic": "hull.drag_quadratic", "effects.drag.linear": "hull.drag_linear"},
    ranges={
        "depth_m": (_ABOVE, inf),
        "piston_m": ("hull.piston_low", "hull.piston_high"),
        "oil_volume_m3": (-_MOST_OIL, _MOST_OIL),
        "density_kgpm3": (900.0, 1100.0),
        "temperature_C": (-5.0, 60.0),
    },
    afloat=1.0,
    drifting=("depth_m",),
    measured={"effects.water.gradient": "density_kgpm3"},
    shared={"volume_m3": "effects.volume.offset"},
    shared_unless="hull.trim_known",
    adding={"effects.volume.leak": "effects.volume.offset"},
    view=view_as(record_type(FloatParameters), "float"),
    hooks=RightHandSide(
        derivative=derivative,
        stable_step=stable_step,
        shape=shape,
        actuator_times=actuator_times,
        sense=sense,
        settle_sensors=settle_sensors,
        output=output,
        enter=enter,
        leave=copied,
        derive=copied,
    ),
)
FLOAT_OIL = replace(
    FLOAT_PISTON,
    name="float_oil",
    title="vertical motion of a profiling float with an oil bladder",
    required=("oil_volume_m3",),
    stepped=("oil_volume_m3",),
)
registered(FLOAT_PISTON)
registered(FLOAT_OIL)
