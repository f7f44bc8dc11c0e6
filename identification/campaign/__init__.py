"""Campaigns: one file defines the experiments to run, the models to fit to them, and the comparisons to make."""
