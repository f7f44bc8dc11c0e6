"""From records to models, and from the models' errors to the missing physical effect.

Experiments, estimators (grey box first), comparison on held-out data, diagnosis and its pages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
