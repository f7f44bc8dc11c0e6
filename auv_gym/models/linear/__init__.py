"""Discrete-time linear models: state space, polynomials, and the linearisation of a vehicle about cruise."""

from auv_gym.models.linear.linearise import linearise
from auv_gym.models.linear.polynomial import Polynomial
from auv_gym.models.linear.state_space import StateSpace

__all__ = ["Polynomial", "StateSpace", "linearise"]
