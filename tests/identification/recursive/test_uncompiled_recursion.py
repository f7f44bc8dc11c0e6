"""The recursions and the diving model as plain Python give what their compiled forms give."""

import sys

import numpy as np
import pytest
from dives_by_equation import TRUTH, dive_log

from auv_gym.model import simulate
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.ivls import Ivls
from identification.recursive.refined_iv import RefinedIv
from identification.recursive.rwls import Rwls
from tests.plain_python import run_plain


def results() -> dict[str, np.ndarray]:
    """theta and its covariance by each method, with a prior that keeps rounding small, and a free run."""
    record = dive_log(150, 0.01, np.random.default_rng(0))
    found = {"run": simulate(TRUTH, record)["depth_m"]}
    for estimator in (Rwls(spread=1.0), Ivls(spread=1.0), CorrectedIvls(spread=1.0, passes=2), RefinedIv()):
        fit = estimator.fit(record)
        found[type(estimator).__name__] = np.concatenate([fit.theta, fit.covariance.ravel()])
    return found


@pytest.mark.slow
def test_plain_python_agrees_with_compiled_code(tmp_path):
    out = tmp_path / "plain.npz"
    run_plain(__file__, out)
    with np.load(out) as plain:
        assert not plain["numba_imported"]
        for name, compiled in results().items():
            # sums in another order, over rows whose least certain direction has a spread of 1e4
            np.testing.assert_allclose(plain[name], compiled, rtol=1e-7, atol=1e-12, err_msg=name)


if __name__ == "__main__":
    found = results()
    np.savez(sys.argv[1], numba_imported="numba" in sys.modules, **found)
