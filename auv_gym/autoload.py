"""Lets `gymnasium.make("auv_gym/...")` find the environments without an import of this package.

Gymnasium 1.0 gave up the entry points that earlier versions read. The installed package therefore has, beside it, a file
`auv_gym_autoload.pth` that imports this module when Python starts; the module waits for gymnasium, and does nothing
where that is never imported.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

_AWAITED = "gymnasium.envs.registration"


class _RegisterAfter(Loader):
    """The loader of gymnasium's registry, which then registers our environments."""

    def __init__(self, loader: Loader):
        self.loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self.loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self.loader.exec_module(module)
        # The module gets its own loader back: from here on it is what it would have been without us.
        module.__loader__ = self.loader
        if module.__spec__ is not None:
            module.__spec__.loader = self.loader
        from auv_gym.envs.registration import register_envs

        register_envs()


class _Watch(MetaPathFinder):
    """Finds nothing but gymnasium's registry, once."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != _AWAITED:
            return None
        sys.meta_path.remove(self)
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _RegisterAfter(spec.loader)
        return spec


def watch() -> None:
    """Register the environments now if gymnasium is there, else as soon as it is imported."""
    if _AWAITED in sys.modules:
        from auv_gym.envs.registration import register_envs

        register_envs()
    elif not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())


watch()
