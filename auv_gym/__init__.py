"""Simulation, identification and diagnosis of underwater vehicles: the vehicles and their environments.

`controllers` and `identification` are the sister packages; this one imports neither of them.
"""

__version__ = "0.1.0"
