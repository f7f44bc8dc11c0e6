"""From records to models, and from the models' errors to the physical effect that is missing.

Experiments, estimators (grey box first), comparison on data that took no part in the fit, diagnosis and its pages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
