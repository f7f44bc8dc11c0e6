"""The evidence that a candidate needs to be named."""

from scipy import stats

from identification.deciding import FALSE_ALARM


def threshold(candidates: int, parameters: int = 1) -> float:
    """The evidence that a candidate needs to be named; `FALSE_ALARM` is the probability that any passes by chance."""
    return float(stats.chi2.isf(FALSE_ALARM / max(candidates, 1), parameters))
