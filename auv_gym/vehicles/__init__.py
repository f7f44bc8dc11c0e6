"""Vehicle families: the parameters and right-hand side of each, and the presets."""

from collections.abc import Sequence

from auv_gym.vehicles.body.compose import Body, Part, compose
from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GLIDER
from auv_gym.vehicles.profiling_float import FLOAT_OIL, FLOAT_PISTON

# Reduced families by name; that of a body is made of its parts, see `compose`.
FAMILIES: dict[str, Family] = {family.name: family for family in (GLIDER, FLOAT_PISTON, FLOAT_OIL)}
FAMILY_NAMES = ("body", *FAMILIES)


def family_named(name: str, parts: Sequence[Part] = ()) -> Family:
    """The family of a name, of a body with these parts; raises KeyError on an unknown name."""
    return compose(parts) if name == "body" else FAMILIES[name]


__all__ = ["FAMILIES", "FAMILY_NAMES", "Body", "Family", "Part", "compose", "family_named"]
