"""Vehicle families: the parameters and right-hand side of each, and the presets."""

from collections.abc import Sequence
from typing import Any

from auv_gym.vehicles import glide_steered, glider, profiling_float  # noqa: F401  # each registers its families
from auv_gym.vehicles.body.body import Body, Part
from auv_gym.vehicles.body.compose import compose
from auv_gym.vehicles.family import FAMILIES, Family

FAMILY_NAMES = ("body", *FAMILIES)


def family_named(name: str, parts: Sequence[Part] = ()) -> Family:
    """The family of this name, or of a body with these parts; raises KeyError for an unknown name."""
    if name not in FAMILY_NAMES:
        raise KeyError(name)
    return FAMILIES[name] if name in FAMILIES else compose(parts)


def effects_by_kind() -> dict[str, Any]:
    """The neutral effects of each kind of vehicle; for a body, those independent of its parts."""
    return {family.kind: family.parameters().effects for family in (*FAMILIES.values(), compose(()))}


__all__ = ["FAMILIES", "FAMILY_NAMES", "Body", "Family", "Part", "compose", "effects_by_kind", "family_named"]
