"""Simulation of underwater vehicles, for identification, diagnosis and learning: the vehicles and their environments.

`controllers` and `identification` are the sister packages; this one imports neither of them.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
