"""Identification of linear models in discrete time: polynomials, and state spaces by subspaces."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
