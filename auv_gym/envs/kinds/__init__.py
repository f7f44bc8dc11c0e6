"""The kinds of vehicle that environments know: one package each, named as `Family.kind` is, with one `KIND` in it."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from auv_gym.envs.kind import EnvKind
from auv_gym.vehicles.family import Family


def env_kind(family: Family) -> EnvKind:
    """The environments' kind of a family, imported when first asked for; raises ValueError where there is none."""
    known = [module.name for module in iter_modules(__path__)]
    if family.kind not in known:
        raise ValueError(
            f"Environments need a vehicle of a kind that they know ({', '.join(known)}), got family {family.name!r} of "
            f"kind {family.kind!r}: take another vehicle, or add a package for this kind to auv_gym.envs.kinds."
        )
    return import_module(f"{__name__}.{family.kind}").KIND
