"""Campaigns: one file says which experiments to run, which models to fit to them and what to compare."""
