"""Registry of each layer's object for each kind of vehicle, found by the name of its module."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from pkgutil import iter_modules
from typing import Generic, TypeVar

from auv_gym.vehicles.family import Family

Known = TypeVar("Known")


class Kinds(Generic[Known]):
    """The kinds of vehicle that a layer supports; a new one is a new module.

    A module of the package has the name of a kind (`Family.kind`) and an object `KIND`.  It is imported when a vehicle
    of this kind is used, so that the others cost nothing.
    """

    def __init__(self, package: str, knows: str):
        """package: that of the modules.  knows: beginning of the error text, such as "Controllers know"."""
        self._package, self._knows = package, knows

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The kinds by name."""
        return tuple(sorted(m.name for m in iter_modules(import_module(self._package).__path__) if m.name[0] != "_"))

    def of(self, family: Family) -> Known:
        """The layer's object for a family's kind; raises ValueError if there is none."""
        if family.kind not in self.names:
            raise ValueError(
                f"{self._knows} vehicles of kind {', '.join(self.names)}, got family {family.name!r} of kind "
                f"{family.kind!r}: add a module {self._package}.{family.kind} with an object KIND."
            )
        return import_module(f"{self._package}.{family.kind}").KIND
