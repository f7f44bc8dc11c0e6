"""Identification with kernels."""
