"""State-space models by subspace methods, and their refinement."""
