"""Tuning of gains by simulation, and checks of requirements over all vehicles that the data allow."""
