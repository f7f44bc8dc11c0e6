"""Gains found by simulation, and whether they meet stated requirements over all vehicles that the data allow."""
