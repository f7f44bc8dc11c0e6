"""Buoyant volumes, and their change with depth."""

from math import exp

from auv_gym.compiled import compiled

GRAVITY = 9.81  # m/s^2
ATMOSPHERE = 101325.0  # Pa, the standard atmosphere


@compiled
def air_volume(at_surface, depth, density):
    """Volume of trapped air at a depth, m^3: Boyle's law at constant temperature.

    at_surface: m^3 under one atmosphere.  depth: m.  density: of the water, kg/m^3.
    """
    return at_surface / (1.0 + density * GRAVITY * max(depth, 0.0) / ATMOSPHERE)


@compiled
def exposed_volume(depth, waterplane):
    """Volume, m^3, of a float above the water when its reference point is above the surface.

    waterplane: cross-section at the surface, m^2.  depth: m, negative above the surface.
    """
    return waterplane * max(-depth, 0.0)


@compiled
def volume_change(volume, compressibility, pressure, expansion, warmer):
    """Change of a volume, m^3, from its value at the surface and at its reference temperature.

    compressibility: 1/Pa.  pressure: of the water above, Pa.  expansion: 1/K.  warmer: temperature above the reference,
    K.
    Source: Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4): V exp(expansion warmer - compressibility pressure).
    """
    return volume * (exp(expansion * warmer - compressibility * pressure) - 1.0)
