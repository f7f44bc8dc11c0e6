"""Nonlinear difference equations by kernel machines."""
