"""Least-squares support vector machine with a linear kernel, and the resulting diving model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.records.record import Record
from identification.recursive.diving_fit import DivingFit, diving_fit, scatter
from identification.recursive.diving_model import PARAMETERS, regressors
from identification.recursive.samples import Samples

NO_COVARIANCE = "an LS-SVM has no parameter covariance: its penalty is a choice, not a noise variance"


@dataclass(frozen=True, eq=False)
class LinearMachine:
    """f(x) = weights @ x + bias."""

    weights: np.ndarray
    bias: float

    def __call__(self, features: np.ndarray) -> np.ndarray:
        return features @ self.weights + self.bias


def linear_machine(features: np.ndarray, target: np.ndarray, penalty: float) -> LinearMachine:
    """The machine that minimises |weights|^2 / 2 + penalty / 2 |target - f(features)|^2.

    features: (n, m).  The system is solved for the weights, (m, m); for a linear kernel this is equivalent to the dual
    system of n + 1 unknowns, with less work.  The bias is not penalised.
    Source: Suykens, Van Gestel, De Brabanter, De Moor and Vandewalle 2002, Least Squares Support Vector Machines, sec.
    3.1; Zhong et al. 2024, equations (35) to (37).
    """
    middle, level = features.mean(axis=0), float(target.mean())
    centred = features - middle
    # the stacked form keeps the digits that a normal matrix of collinear features would lose
    stacked = np.concatenate([centred, np.eye(features.shape[1]) / np.sqrt(penalty)])
    weights = np.linalg.lstsq(stacked, np.concatenate([target - level, np.zeros(features.shape[1])]), rcond=None)[0]
    return LinearMachine(weights, level - float(middle @ weights))


@dataclass(frozen=True)
class LsSvm:
    """Diving model from an LS-SVM with a linear kernel on the regressor of equation (8).

    penalty: C of equation (36); 5.8731 in the paper, found by trial.
    The model leaves out the machine's bias and theta_1: at mid-depth, the bias cancels the excess of theta_1 over 1.
    There is no covariance. Depth noise biases the weights as it does those of `Rwls`.
    Source: Zhong et al. 2024, equations (35) to (37).

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import LsSvm, depth_control
        >>> dive = depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        >>> fit = LsSvm().fit(dive)
        >>> round(fit.model.damping, 2)  # biased by depth noise: RefinedIv gives 0.11
        1.12
    """

    penalty: float = 5.8731

    def __post_init__(self) -> None:
        if not 0.0 < self.penalty < np.inf:
            raise ValueError(f"LsSvm needs penalty > 0, got {self.penalty!r}: a larger one trusts the data more.")

    def fit(self, *records: Record) -> DivingFit:
        """Fit over all records; theta holds the weights."""
        samples = Samples.of(records, "LsSvm", len(PARAMETERS) + 1)
        rows = np.zeros((samples.depth.size, len(PARAMETERS)))
        regressors(samples.depth, samples.piston, samples.interval, rows)
        used = rows[:, 2] != 0.0
        theta = linear_machine(rows[used], samples.depth[used], self.penalty).weights
        _, noise = scatter(samples, theta, np.zeros((theta.size, theta.size)), rows)
        return diving_fit(samples, theta, None, noise=noise, reason=NO_COVARIANCE)
