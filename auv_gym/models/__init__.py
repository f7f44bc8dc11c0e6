"""Models in the vehicle's place: linear and nonlinear, spliced into a plant, read from files."""
