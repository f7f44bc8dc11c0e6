"""Components of generalised predictive control: incremental models, and the quadratic program."""
