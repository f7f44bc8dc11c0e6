"""Second step of a diagnosis: the vehicle as given, and with its coefficients refitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.plant import Plant
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.parameters import moves_of


@dataclass(frozen=True, eq=False)
class Known:
    """What is fitted before anything is sought.

    coefficients: paths that are free.  given: the vehicle as it came, noises fitted.  nominal: with its coefficients.
    """

    bench: Workbench
    coefficients: tuple[str, ...]
    given: State
    nominal: State

    @property
    def plant(self) -> Plant:
        """The vehicle as given, in the steps of the fits."""
        return self.bench.plant


def fit_known(log: CheckedLog, progress: Progress) -> Known:
    """The fits of a vehicle without effects; of a log that looks mislabelled nothing is refitted."""
    bench = Workbench(log.plant, log.record, log.parts, log.asked.doubt, log.every_window)
    progress(0.02, "filtering with the vehicle as given")
    given = bench.fit(bench.plant, ())
    coefficients = _free_coefficients(bench, given)
    progress(0.03, "refitting the coefficients")
    nominal = bench.fit(bench.plant, () if log.slipped else coefficients, given)
    return Known(bench, coefficients, given, nominal)


def _free_coefficients(bench: Workbench, given: State) -> tuple[str, ...]:
    """The coefficients that the record's inputs excite, and that are not known exactly."""
    plant, problem = bench.plant, bench.problem
    paths = tuple(p for p in plant.coefficients if plant.deviation(p, bench.doubt) > 0.0)
    if not paths or not given.finite:
        return paths
    columns = problem.columns_of(given.point, moves_of(paths))
    free = tuple(p for p, own in zip(paths, columns, strict=True) if np.abs(own).max() > 1e-6)
    return free or paths
