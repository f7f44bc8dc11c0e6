"""How well a diagnosis explains its record: the share of the error that goes, what is left, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.diagnosis.judge.verdict import Stage, Verdict
from identification.diagnosis.search.acceptance import MANY_WINDOWS
from identification.diagnosis.search.joined import joined_errors
from identification.diagnosis.search.workbench import Workbench
from identification.fit.residual import noise_floor
from identification.fit.validation import whiteness

WHITE = 1e-4  # p value of the whiteness test below which a residual is coloured
EXCESS = 0.05  # of the noise variance: a coloured residual smaller than this is left to the noise
EXPLAINED = 0.5  # share of the excess error that named effects must remove to count as the explanation


def explained_share(before: Stage, after: Stage, bench: Workbench) -> float:
    """Share of the squared error above the measurement noise that the effects remove.

    Of free runs in the held-out windows; where these are few or say nothing, of runs from fitted states in all windows.
    """
    many = len(bench.held.windows) >= MANY_WINDOWS and bench.steady
    excess = {}
    for name, stage in (("before", before), ("after", after)):
        runs = stage.held if many else stage.fitted
        total = 0.0
        for c in range(len(runs.channels)):
            floor = noise_floor(after.fitted.residual[:, c], after.fitted.window)
            squares = runs.residual[runs.scored, c] ** 2
            total += max(float(np.nanmean(squares)) / floor**2 - 1.0, 0.0)
        excess[name] = total
    return 1.0 - excess["after"] / excess["before"] if excess["before"] > 0.0 else 0.0


def verdict_of(effects, tied, explained: float, left: bool, refit_is_all: bool, wrong: bool) -> Verdict:
    """Effects must explain most of the excess error; a refit alone must leave no more than noise."""
    if (refit_is_all and left) or (effects and explained < EXPLAINED):
        return "unexplained"
    if effects:
        return "tied" if tied else "named"
    return "coefficients" if wrong else "none"


def disagrees(after: Stage, bench: Workbench, paths: Sequence[str], length: float) -> bool:
    """Whether what remains is coloured, and more than the noise could be.

    What remains: of runs from fitted starts in all windows.  Where windows had to be shortened their starts, twelve
    numbers to a few tens of samples, take the slow part of it, colour the rest, and leave less than the noise; there
    it is the one-step errors over windows joined to the length that was asked, s, with the paths at their best.
    """
    runs = after.fitted
    errors, window = runs.residual, runs.window
    if not bench.steady:
        windows = sorted((*bench.train.windows, *bench.held.windows), key=lambda w: w.start)
        joined = joined_errors(after.plant, bench.train.record, windows, paths, length)
        if joined is not None:
            errors, window = joined.errors, joined.window
    return any(_coloured(error, window) for error in errors.T)


def _coloured(error: np.ndarray, window: np.ndarray) -> bool:
    excess = float(np.nanmean(error**2)) / noise_floor(error, window) ** 2 - 1.0
    return excess > EXCESS and whiteness(error, window).p_value < WHITE
