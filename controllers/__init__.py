"""Controllers of underwater vehicles: each maps a measurement and a target to a command, once per sample.

They read `auv_gym` channels by name and are independent of identification.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
