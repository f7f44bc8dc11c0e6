"""What generalised predictive control is made of: a model driven by changes of its inputs, and a quadratic program."""
