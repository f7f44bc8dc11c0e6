"""Identification of linear models in discrete time."""
