"""Change of the hull's volume with pressure and temperature: compressibility and thermal expansion."""

from __future__ import annotations

from dataclasses import dataclass

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import param
from auv_gym.physics.buoyancy import volume_change
from auv_gym.vehicles.body.kinds import PartKind, force_at


@dataclass(frozen=True)
class HullVolume:
    """The volume V = volume exp(-compressibility P + expansion (T - temperature)), and the lift of V - volume.

    The lift acts at x, y, z. The hull's buoyancy is that of the volume at the surface and at `temperature`. P is the
    pressure of the water above, T the channel temperature_C; without that channel, T is always `temperature`.
    Source: Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4), the Seaglider's volume, with P in Pa instead of dbar.
    """

    volume: float = param(0.0, "m^3", "volume of the hull at the surface", bounds=(0.0, 1e4))
    compressibility: float = param(0.0, "1/Pa", "compressibility of the hull", bounds=(0.0, 1e-6))
    expansion: float = param(0.0, "1/K", "thermal expansion of the hull", bounds=(-1e-3, 1e-2))
    temperature: float = param(10.0, "degC", "temperature at which the volume is stated", bounds=(-5.0, 50.0))
    x: float = param(0.0, "m", "where the change of volume acts, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "where the change of volume acts, starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "where the change of volume acts, down", bounds=(-10.0, 10.0))


HullVolumeEffects = effects_on_commands(
    "HullVolumeEffects", __name__, "m^3", {"offset": 2e-5}, span=0.01, titles={"offset": "volume bias of the hull"}
)


@compiled
def force(at, actuators, inputs, shared, motion, part, effects, derived):
    """The lift of the change in volume, and its moment, in body axes.  Source: Fossen 2021, eq. (4.6)."""
    pressure = motion.water * motion.gravity * max(motion.depth, 0.0)
    warmer = inputs[shared] - part.temperature
    change = volume_change(part.volume, part.compressibility, pressure, part.expansion, warmer)
    lift = motion.water * motion.gravity * (change + effects.offset)
    x, y, z = -lift * motion.r31, -lift * motion.r32, -lift * motion.r33
    return force_at(x, y, z, part.x, part.y, part.z)


KIND = PartKind(
    name="hull_volume",
    title="change of the hull's volume with pressure and temperature",
    parameters=HullVolume,
    effects=HullVolumeEffects,
    order=80,
    force=force,
    coefficients=("compressibility",),
    shared={"temperature_C": "temperature"},
)
