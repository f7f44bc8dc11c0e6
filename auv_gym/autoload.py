"""Registration of the environments for `gymnasium.make("auv_gym/...")` without an import of this package.

Gymnasium 1.0 dropped the entry points that earlier versions read.  Therefore a file `auv_gym_autoload.pth` beside the
installed package imports this module when Python starts; the module waits for gymnasium, and does nothing if that is
never imported.  It imports almost nothing itself, since every start of Python pays for it.
"""

import sys
from importlib.machinery import PathFinder

_AWAITED = "gymnasium.envs.registration"


class _RegisterAfter:
    """The loader of gymnasium's registry, which then registers our environments."""

    def __init__(self, loader):
        self.loader = loader

    def create_module(self, spec):
        return self.loader.create_module(spec)

    def exec_module(self, module):
        # The module gets its own loader, as it would without us.
        module.__loader__ = module.__spec__.loader = self.loader
        self.loader.exec_module(module)
        _register()


class _Watch:
    """A finder of gymnasium's registry only, used once."""

    def find_spec(self, name, path, target=None):
        if name != _AWAITED:
            return None
        sys.meta_path.remove(self)
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            # No subclass of importlib.abc.Loader, whose import takes twice as long as Python's whole start.
            spec.loader = _RegisterAfter(spec.loader)  # ty: ignore[invalid-assignment]
        return spec


def watch() -> None:
    """Register the environments now if gymnasium is there, else as soon as it is imported."""
    if _AWAITED in sys.modules:
        _register()
    elif not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())


def _register() -> None:
    from auv_gym.envs.registration import register_envs

    register_envs()


watch()
