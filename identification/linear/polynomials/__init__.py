"""Polynomial models: ARX, ARMAX, output error, and the choice of their orders."""
