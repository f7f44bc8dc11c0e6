"""Vehicle families: the parameters and right-hand side of each, and the presets."""

from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GLIDER
from auv_gym.vehicles.profiling_float import FLOAT_OIL, FLOAT_PISTON
from auv_gym.vehicles.torpedo import TORPEDO, TORPEDO_SPEED, TORPEDO_VOLTAGE

_ALL = (GLIDER, TORPEDO, TORPEDO_VOLTAGE, TORPEDO_SPEED, FLOAT_PISTON, FLOAT_OIL)
FAMILIES: dict[str, Family] = {family.name: family for family in _ALL}
