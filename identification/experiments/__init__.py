"""Experiments that make a vehicle show itself: excitation, driven episodes, missions of each kind of vehicle."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
