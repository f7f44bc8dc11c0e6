"""The search for missing effects: candidates, trials, and the gate before every name."""
