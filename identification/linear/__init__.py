"""Identification of discrete-time linear models: polynomial models, and state-space models by subspace methods."""
