"""The grey box and what every fit of a plant shares: windows, free runs, likelihood, process noise."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
