"""Models in the vehicle's place: linear and nonlinear, spliced into a plant, read from files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
