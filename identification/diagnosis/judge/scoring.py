"""Free-run errors of the vehicle as given, refitted, and with the effects, in parts that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.explained import explained_share, many_windows
from identification.diagnosis.judge.result import Stage
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.searching import Searched
from identification.diagnosis.search.survival import chosen_without
from identification.diagnosis.search.workbench import State
from identification.fit.validation import FreeRuns, fitted_runs, free_runs, joined_runs

REFITTED = 'Free runs of the refitted vehicle ("before" is the vehicle as given instead)'


@dataclass(frozen=True, eq=False)
class Scored:
    """The vehicle as given, with its coefficients refitted, and with the effects found."""

    given: Stage
    refitted: Stage
    after: Stage


@dataclass(frozen=True, eq=False)
class Scoring:
    """The scoring of the states of a search; extras: collects failures of optional parts of a diagnosis."""

    log: CheckedLog
    searched: Searched
    extras: Extras

    def scored(self, state: State, rounds: Sequence[Round]) -> Scored:
        """The stages of a search that ends in a state; rounds: those in which its effects were chosen.

        In each part, the effects are those that would have been chosen from the other parts.  If free runs diverge with
        the refitted coefficients, the vehicle as given is scored instead.
        """
        known, nominal, count = self.searched.known, self.searched.nominal, len(self.searched.candidates)
        parts = range(len(self.log.parts))
        given = self.stage(known.given, [known.given for _ in parts])

        def refitted(chosen: Sequence[State]) -> Stage:
            return self.extras.attempt(REFITTED, lambda: self.stage(nominal, chosen), given)

        chosen = [chosen_without(known.bench, nominal, state, rounds, count, k) for k in parts]
        if state is nominal:
            found = refitted(chosen)
            return Scored(given, found, found)
        after = self.stage(state, chosen)
        return Scored(given, refitted([nominal for _ in parts]), after)

    def stage(self, state: State, chosen: Sequence[State] = ()) -> Stage:
        """The stage of a state; chosen: the states that would have been chosen without each part (default: this)."""
        known, nominal, log, plant = self.searched.known, self.searched.nominal, self.log, state.plant
        given, runs, flown = known.given.plant, list[FreeRuns](), list[Plant]()
        for k, one in enumerate(chosen or [state for _ in log.parts]):
            unseen = (known.bench.unseen(one, k), known.bench.unseen(nominal, k), given) if one.paths else (given,)
            run, flew = first_that_flies(unseen, log.record, log.windows[k], log.settle)
            runs.append(run)
            flown.append(flew)
        joined = joined_runs(runs)
        every = free_runs(plant, log.record, log.every_window, log.settle)
        fitted = fitted_runs(plant, log.record, log.every_window)
        white = {name: fitted.white(c) for c, name in enumerate(fitted.channels)}
        own = replace(plant, longest_step=log.plant.longest_step)
        return Stage(own, joined, every, fitted, joined.scores(log.record), white, tuple(flown))

    def explained(self, before: Stage, after: Stage) -> float:
        """Share of the squared error above the measurement noise that is removed from one stage to the next."""
        return explained_share(before, after, many_windows(self.log.every_window, self.log.steady))

    def every_run(self, plant: Plant) -> FreeRuns | None:
        """Free runs over every window, or None if they diverge."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                return free_runs(plant, self.log.record, self.log.every_window, self.log.settle)
        except Diverged:
            return None

    def changes(self, path: str, neutral: float, after: Stage) -> dict[str, float]:
        """RMS change of a stage's free runs, by channel, when a parameter is put back to neutral."""
        without = self.every_run(replace_at(after.plant, path, neutral))
        if without is None:
            return dict.fromkeys(after.every.channels, np.inf)
        change = (without.model - after.every.model)[after.every.scored]
        if without.signals is not None:  # angles jump when the vehicle passes the vertical; their residuals do not
            change = np.nan_to_num((after.every.residual - without.residual)[after.every.scored])
        return dict(zip(after.every.channels, np.sqrt((change**2).mean(axis=0)).tolist(), strict=True))


def first_that_flies(
    plants: Sequence[Plant], record: Record, windows: Sequence[slice], settle: float
) -> tuple[FreeRuns, Plant]:
    """Free runs of the first plant whose runs stay finite, and that plant; raises Diverged if all diverge."""
    for plant in plants[:-1]:
        with suppress(Diverged), np.errstate(over="ignore", invalid="ignore"):
            return free_runs(plant, record, windows, settle), plant
    return free_runs(plants[-1], record, windows, settle), plants[-1]
