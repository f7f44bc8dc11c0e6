"""scikit-learn: kernel ridge and support vector regression, grid search, Nystroem features under a ridge.

Inputs are divided by their spreads and the kernel is exp(-gamma d^2), so that gamma = 1 / sigma^2 and alpha = 1 / C
say what C and sigma do. Kernel ridge has no bias, and SVR's epsilon and C are in units of the targets: these are taken
from their mean, over their spread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.compose import TransformedTargetRegressor
from sklearn.kernel_approximation import Nystroem
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR

from scripts.benchmarks.peers.kernel_runner import Method, main

EPSILON = 0.05  # of SVR, in spreads of the targets: the noise level
FOLDS = 5

Jobs = Mapping[str, Any]


def _scaled(estimator: Any) -> Any:
    pipeline = make_pipeline(StandardScaler(), estimator)
    return TransformedTargetRegressor(pipeline, transformer=StandardScaler())


def _ridge(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> tuple[Any, dict[str, Any]]:
    machine = KernelRidge(alpha=1.0 / jobs["penalty"], kernel="rbf", gamma=jobs["sigma"] ** -2)
    return _scaled(machine).fit(x, y), {}


def _vectors(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> tuple[Any, dict[str, Any]]:
    machine = SVR(C=jobs["penalty"], kernel="rbf", gamma=jobs["sigma"] ** -2, epsilon=EPSILON, cache_size=1000)
    return _scaled(MultiOutputRegressor(machine)).fit(x, y), {}


def _grid(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> tuple[Any, dict[str, Any]]:
    """The penalties and widths of the jobs, with five folds."""
    grid = {
        "regressor__kernelridge__alpha": [1.0 / penalty for penalty in jobs["penalties"]],
        "regressor__kernelridge__gamma": [sigma**-2 for sigma in jobs["sigmas"]],
    }
    machine = GridSearchCV(_scaled(KernelRidge(kernel="rbf")), grid, cv=FOLDS, scoring="neg_mean_squared_error").fit(
        x, y
    )
    return machine, {"solved": FOLDS * len(jobs["penalties"]) * len(jobs["sigmas"])}


def _features(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> tuple[Any, dict[str, Any]]:
    features = Nystroem(kernel="rbf", gamma=jobs["sigma"] ** -2, n_components=min(jobs["size"], len(x)), random_state=0)
    pipeline = make_pipeline(StandardScaler(), features, Ridge(alpha=1.0 / jobs["penalty"]))
    return TransformedTargetRegressor(pipeline, transformer=StandardScaler()).fit(x, y), {}


def _predict(machine: Any, x: np.ndarray) -> np.ndarray:
    return machine.predict(x)


METHODS = (
    Method("machines", "KernelRidge", _ridge, _predict),
    Method("machines", "SVR, each output", _vectors, _predict),
    Method("tuning", "GridSearchCV, KernelRidge", _grid, _predict),
    Method("long", "Nystroem + Ridge", _features, _predict),
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
