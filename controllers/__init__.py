"""Controllers of underwater vehicles: each turns a measurement and a target into a command, once per sample.

They read channels of `auv_gym` by name and know nothing of identification.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
