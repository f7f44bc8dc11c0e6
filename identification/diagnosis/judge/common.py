"""The common prediction of tied effects: their free runs averaged by probability, and how far these differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed
from auv_gym.plant import Plant
from identification.diagnosis.wording import quantity, short
from identification.fit.validation import FreeRuns


@dataclass(frozen=True)
class Common:
    """The common prediction of tied effects, from free runs over all windows.

    members: the probability of each within the tie, by path.  error: RMS error of the averaged runs, by channel.
    spread: RMS difference between the two members that differ most, by channel; infinite if a member's runs diverge.
    """

    members: Mapping[str, float]
    error: Mapping[str, float]
    spread: Mapping[str, float]

    def words(self, titles: Mapping[str, str], reach: str) -> str:
        """A sentence about the tie; reach: how far a free run goes, in words."""
        names = listed([short(titles.get(path, path)) for path in self.members], "or")
        if not all(np.isfinite(size) for size in self.spread.values()):
            return f"It matters whether the cause is {names}: free runs {reach} diverge with one of them."
        apart = [f"{quantity(size, channel(n).unit)} in {channel(n).label}" for n, size in self.spread.items()]
        return f"Free runs {reach} with {names} differ by at most {', '.join(apart)} (RMS)."


def common_prediction(members: Sequence[tuple[str, float, Plant]], fly: Callable[[Plant], FreeRuns | None]) -> Common:
    """The common prediction of tied effects, each given as its path, its probability and the vehicle that has it.

    fly: returns the free runs of a vehicle over the windows to compare, or None if they diverge.
    """
    total = sum(p for _, p, _ in members)
    shares = {path: p / total for path, p, _ in members}
    runs = {path: fly(plant) for path, _, plant in members}
    told = {path: run for path, run in runs.items() if run is not None}
    if not told:
        return Common(shares, {}, {})
    first = next(iter(told.values()))
    scored, weight = first.scored, sum(shares[path] for path in told)
    residual = np.sum([shares[path] / weight * run.residual[scored] for path, run in told.items()], axis=0)
    spread = np.zeros(len(first.channels))
    for one, other in combinations(told.values(), 2):
        spread = np.maximum(spread, _rms(one.model[scored] - other.model[scored]))
    if len(told) < len(runs):
        spread[:] = np.inf
    error, apart = (dict(zip(first.channels, v.tolist(), strict=True)) for v in (_rms(residual), spread))
    return Common(shares, error, apart)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean(values**2, axis=0))
