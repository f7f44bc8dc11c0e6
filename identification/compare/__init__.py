"""Comparison of models with records, and with the vehicle in its environment."""
