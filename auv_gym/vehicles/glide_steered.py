"""A glider that flies by its polar and is steered by its masses; attitude and turn follow, so no log is needed.

It uses the static relation of `Steering`, with first-order lag and rate limits of the actuators; steady flight,
displacement and effects are those of `glide`.  Source of the turn by roll: Eriksen et al. 2001, IEEE J. Oceanic Eng.
26(4), 424-436.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi, sin

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.physics.actuators import command_within
from auv_gym.physics.sensors import deviation
from auv_gym.vehicles.family import registered
from auv_gym.vehicles.glide import FLATTEST, GLIDE, beyond, carry, flight_at, net_buoyancy

# s: longest step, and step at the surface; m/s: fastest rise there, and one that does not count; steps between
_LONGEST, _AT_SURFACE, _CALM, _RISING, _KEPT = 60.0, 5.0, 0.5, 0.02, 2
_STALL = 0.5  # rad of attack; above this, the turn rate does not increase; assumed, twice the attack of a Seaglider


@compiled
def attitude(actuators, rising, p):
    """True pitch and roll, rad, of a glider with its engine, battery and battery angle at `actuators`.

    rising: whether it climbs.
    """
    steering, trim = p.steering, p.effects.steering
    pitch = steering.pitch + steering.pitch_mass * actuators[1] + steering.pitch_engine * actuators[0] + trim.pitch
    roll = steering.roll + steering.roll_mass * actuators[2] + trim.roll
    return pitch, roll + trim.roll_climb if rising else roll


@compiled
def derivative(x, actuators, inputs, p, dx, scratch):
    """State derivative of [depth, depth rate, north, east, unknown volume, heading, time into the sample] into dx."""
    time = inputs[6] + x[6]
    pitch, roll = attitude(actuators, x[1] < 0.0, p)
    depth = max(x[0], 0.0)
    speed, path, attack = 0.0, 0.0, 0.0
    if x[0] > 0.0 or net_buoyancy(depth, x[4], actuators[0], actuators[4], inputs[5], time, p) < 0.0:  # not afloat
        speed, path, attack = flight_at(depth, x[4], actuators[0], actuators[4], pitch, inputs[5], time, p)
    carry(x, speed, path, x[5], time, p, dx)
    dx[4] = 0.0
    lifting = min(max(attack, -_STALL), _STALL)
    dx[5] = speed * (p.steering.turn_roll * lifting * sin(roll) + p.steering.turn_rudder * actuators[3])
    dx[6] = 1.0


@compiled
def stable_step(x, inputs, p):
    """The longest RK4 step, s, in which a rising glider does not leave the water."""
    return min(max(x[0] / (_KEPT * _CALM), _AT_SURFACE), _LONGEST) if x[1] < -_RISING else _LONGEST


@compiled
def enter(x, z):
    """Convert kept states to integrated ones, by adding a clock that starts with the sample."""
    z[0], z[1], z[2], z[3], z[4], z[5], z[6] = x[0], x[1], x[2], x[3], x[4], x[5], 0.0


@compiled
def shape(inputs, memory, p, shaped):
    """Write the engine's volume after its gain, actuators within their stops, and water temperature into shaped."""
    hull, steering = p.hull, p.steering
    rest, low, high = hull.engine_neutral, hull.engine_low, hull.engine_high
    gain = p.effects.engine.gain
    shaped[0], memory[0] = command_within(inputs[0], memory[0], rest, low, high, gain, 0.0, 0.0, 0.0, 0.0, 0.0)
    shaped[1] = min(max(inputs[1], steering.battery_low), steering.battery_high)
    shaped[2] = min(max(inputs[2], -steering.roll_limit), steering.roll_limit)
    shaped[3] = min(max(inputs[3], -steering.rudder_limit), steering.rudder_limit)
    shaped[4] = inputs[4]


@compiled
def actuator_times(index, p):
    """Dead time s, lag s and slowness of the engine, the battery, its angle, the rudder and the hull's temperature."""
    engine, steering = p.effects.engine, p.steering
    if index == 0:
        return engine.dead_time, engine.lag, p.hull.engine_slowness + steering.pump_slowness + engine.slowness
    if index == 1:
        return 0.0, steering.lag, steering.battery_slowness
    if index == 2:
        return 0.0, steering.lag, steering.roll_slowness
    if index == 3:
        return 0.0, steering.lag, 0.0
    return 0.0, p.effects.volume.expansion_lag, 0.0


@compiled
def output(x, actuators, sensors, p, y):
    """Write the outputs [measured depth, north, east, roll, pitch, heading] into y."""
    depth, inclinometer = p.effects.depth, p.effects.inclinometer
    y[0] = x[0] + depth.scale * x[0] + sensors[0] + depth.bias
    y[1] = x[2]
    y[2] = x[3]
    pitch, roll = attitude(actuators, x[1] < 0.0, p)
    y[3] = roll + inclinometer.roll_bias
    y[4] = pitch + inclinometer.pitch_bias
    y[5] = x[5] + deviation(x[5], p.effects.compass) + p.effects.compass.bias


def _beyond(time: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Masks of samples that steady flight does not describe, as in `glide`.

    Without a measured pitch, every sample counts as steep enough.
    """
    rate = np.gradient(columns["depth_m"], time) if time.size > 1 else np.zeros(time.size)
    assumed = np.where(rate > 0.0, -2.0 * FLATTEST, 2.0 * FLATTEST)
    return beyond(time, {"pitch_rad": assumed, **columns})


GLIDE_STEERED = registered(
    replace(
        GLIDE,
        name="glide_steered",
        program="glide_steered",
        title="steady flight of an underwater glider that its masses steer",
        inputs=(
            "buoyancy_volume_m3",
            "battery_position_m",
            "battery_roll_rad",
            "rudder_rad",
            "temperature_C",
            "density_kgpm3",
            "elapsed_s",
        ),
        required=("buoyancy_volume_m3", "battery_position_m"),
        states=("depth_m", "depth_rate_mps", "north_m", "east_m", "volume_m3", "heading_rad"),
        integrated=7,
        block=_KEPT,
        actuators=("buoyancy_volume_m3", "battery_position_m", "battery_roll_rad", "rudder_rad", "temperature_C"),
        outputs=("depth_m", "north_m", "east_m", "roll_rad", "pitch_rad", "heading_rad"),
        doubted=lambda parameters: tuple(
            f"steering.{name}"
            for name in ("pitch_mass", "roll_mass", "turn_roll", "turn_rudder")
            if getattr(parameters.steering, name) != 0.0
        ),
        ranges={
            **GLIDE.ranges,
            "battery_position_m": ("steering.battery_low", "steering.battery_high"),
            "battery_roll_rad": (-pi, pi),
        },
        measured={"effects.water.gradient": "density_kgpm3"},
        interpolated=(
            "buoyancy_volume_m3",
            "battery_position_m",
            "battery_roll_rad",
            "rudder_rad",
            "temperature_C",
            "density_kgpm3",
        ),
        beyond=_beyond,
        hooks=replace(
            GLIDE.hooks,
            derivative=derivative,
            stable_step=stable_step,
            shape=shape,
            actuator_times=actuator_times,
            output=output,
            enter=enter,
        ),
    )
)
