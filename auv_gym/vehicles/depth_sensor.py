"""The depth sensor of a vehicle whose first two states are its depth and its depth rate."""

from __future__ import annotations

from auv_gym.compiled import compiled
from auv_gym.physics.sensors import lag_error


@compiled
def sense(before, x, sensors, duration, p):
    """Update the sensors' states [depth lag error] after the vehicle went from `before` to `x`."""
    depth = p.effects.depth
    sensors[0] = lag_error(sensors[0], (1.0 + depth.scale) * (x[0] - before[0]), depth.lag, duration)


@compiled
def settle_sensors(x, actuators, sensors, p):
    """Set the sensors' states of a vehicle that has moved at its present rate for long."""
    sensors[0] = -p.effects.depth.lag * (1.0 + p.effects.depth.scale) * x[1]
