"""Policies learned in the environments: training (stable-baselines3), policies as files, evaluation on fresh seeds."""

from auv_gym.rl.evaluation import Evaluation, Summary, evaluate, fresh_seeds, returns
from auv_gym.rl.hyperparameters import Hyperparameters, hyperparameters_for
from auv_gym.rl.policy import Policy
from auv_gym.rl.settings import Training
from auv_gym.rl.training import Trained, train

__all__ = [
    "Evaluation",
    "Hyperparameters",
    "Policy",
    "Summary",
    "Trained",
    "Training",
    "evaluate",
    "fresh_seeds",
    "hyperparameters_for",
    "returns",
    "train",
]
