"""Models against records, and against the vehicle in its environment."""
