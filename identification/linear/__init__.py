"""Identification of linear models in discrete time: polynomials, and state spaces by subspaces."""
