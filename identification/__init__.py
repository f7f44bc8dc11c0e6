"""From records to models, and from the models' errors to the physical effect that is missing.

Excitation, estimators (grey box first), validation on data not used for the fit, diagnosis and its report.
"""
