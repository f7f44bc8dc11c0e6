"""The buoyancy engine of a float, and the speed and time scales that follow from it.

The environments scale observations, targets and times by these, so that one task fits floats of any size.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from auv_gym.plant import Plant, without_effects

OIL = 2e-4  # m^3 by which an oil bladder goes to either side of neutral trim; logs of MERMAID floats move about as much
PUMP = 0.81e-6  # m^3/s, the rate of MERMAID's pump; oil returns at this rate, too
_DEPTH = 1e3  # m; depth at which the speed is computed, far below the surface


@dataclass(frozen=True)
class Engine:
    """The input that moves a float, between middle - half and middle + half, in the channel's unit; rate: per s.

    volume: m^3 displaced per unit of the channel.  speed: m/s, the slower of the steady speeds at the two ends, without
    effects.  time: s, three times what the engine needs from the middle to an end plus the float to reach its speed.
    """

    channel: str
    middle: float
    half: float
    rate: float
    volume: float
    speed: float
    time: float


def find_engine(plant: Plant) -> Engine:
    """The engine of a float; raises if it can move the float in one direction only, or not at all."""
    clean, hull = without_effects(plant), plant.hull
    channel = plant.family.required[0]
    if channel == "piston_m":
        middle, half = 0.5 * (hull.piston_high + hull.piston_low), 0.5 * (hull.piston_high - hull.piston_low)
        rate, volume = 1.0 / hull.piston_slowness if hull.piston_slowness > 0.0 else inf, hull.piston_area
    else:
        middle, half, rate, volume = 0.0, OIL, PUMP, 1.0
    up, down = (_steady_rate(clean, middle + side * half) for side in (1.0, -1.0))
    speed = min(-up, down)
    if not speed > 1e-6:
        raise ValueError(
            f"The environment dives both ways, which {plant.name!r} cannot between {middle - half:g} and "
            f"{middle + half:g} of {channel}: it goes down at {down:.3g} and {up:.3g} m/s there. Check its neutral "
            "position, the piston's range, and the density."
        )
    inertia = (hull.mass + hull.added_mass) / (hull.drag_linear + 2.0 * hull.drag_quadratic * speed)
    return Engine(channel, middle, half, rate, volume, speed, 3.0 * (half / rate + inertia))


def _steady_rate(plant: Plant, value: float) -> float:
    """Depth rate, m/s, that a float reaches after an hour with its engine at a value."""
    inputs = np.array([plant.constants.get(name, value) for name in plant.inputs])
    x = plant.initial(np.array([_DEPTH, 0.0]))
    return float(plant.step_over(x, inputs, 3600.0)[plant.states.index("depth_rate_mps")])
