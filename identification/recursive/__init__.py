"""Recursive identification of a float's diving model: sample by sample, or over whole records."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
