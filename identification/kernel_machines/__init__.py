"""Least-squares support vector machines: regression, hulls, nonlinear difference equations, diving models."""
