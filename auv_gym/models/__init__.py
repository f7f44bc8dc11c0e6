"""Models that can replace a vehicle: linear and nonlinear, spliced into a plant, read from files."""
