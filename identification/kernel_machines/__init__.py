"""Least-squares support vector machines: regression, hull forces, nonlinear difference equations, diving models."""
