"""Linear models in discrete time: state space, polynomials, and the linear form of a vehicle about its cruise."""

from auv_gym.linear.linearise import linearise
from auv_gym.linear.polynomial import Polynomial
from auv_gym.linear.state_space import StateSpace

__all__ = ["Polynomial", "StateSpace", "linearise"]
