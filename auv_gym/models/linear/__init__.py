"""Linear models in discrete time: state space, polynomials, and the linear form of a vehicle about its cruise."""

from auv_gym.models.linear.linearise import linearise
from auv_gym.models.linear.polynomial import Polynomial
from auv_gym.models.linear.state_space import StateSpace

__all__ = ["Polynomial", "StateSpace", "linearise"]
