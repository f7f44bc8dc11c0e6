"""Vehicles and records in the forms of other tools: Gazebo, CasADi, Minari, python-control."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
