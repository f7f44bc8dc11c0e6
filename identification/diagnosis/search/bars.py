"""The evidence that a name needs."""

from scipy import stats

from identification.deciding import FALSE_ALARM


def threshold(candidates: int, parameters: int = 1, level: float = FALSE_ALARM) -> float:
    """The evidence that a candidate needs to be named, with a correction for the number of candidates.

    level: probability that any passes by chance.
    """
    return float(stats.chi2.isf(level / max(candidates, 1), parameters))
