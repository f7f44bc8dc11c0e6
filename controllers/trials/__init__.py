"""Closed-loop trials of controllers on a plant, and measures of their tracking."""
