"""Vehicle families: the parameters and right-hand side of each, and the presets."""

from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GLIDER
from auv_gym.vehicles.torpedo import TORPEDO, TORPEDO_SPEED, TORPEDO_VOLTAGE

FAMILIES: dict[str, Family] = {family.name: family for family in (GLIDER, TORPEDO, TORPEDO_VOLTAGE, TORPEDO_SPEED)}
