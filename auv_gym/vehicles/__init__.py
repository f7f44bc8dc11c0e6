"""Vehicle families: the parameters and right-hand side of each, and the presets."""

from auv_gym.vehicles.body.compose import Part, compose
from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GLIDER
from auv_gym.vehicles.profiling_float import FLOAT_OIL, FLOAT_PISTON

# Families by name; that of a body is made of its parts, see `compose`.
FAMILIES: dict[str, Family] = {family.name: family for family in (GLIDER, FLOAT_PISTON, FLOAT_OIL)}
FAMILY_NAMES = ("body", *FAMILIES)

__all__ = ["FAMILIES", "FAMILY_NAMES", "Family", "Part", "compose"]
