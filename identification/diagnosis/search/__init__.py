"""The search for what a model lacks: candidates, trials, the gate before every name."""
