"""Vehicles in six degrees of freedom: a hull and its parts."""
