"""Vehicle families: the parameters and right-hand side of each, and the presets."""

from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GLIDER

FAMILIES: dict[str, Family] = {family.name: family for family in (GLIDER,)}
