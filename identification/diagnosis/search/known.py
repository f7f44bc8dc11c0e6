"""Second step of a diagnosis: the vehicle as given, and with its coefficients refitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from auv_gym.plant import Plant
from identification.deciding import FORETELLS, HELD, LEAST_TRACE
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.further_noises import with_further_noises
from identification.diagnosis.search.trials import Progress, Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.parameters import moves_of
from identification.fit.sensitivities import TRIAL_GAIN

Found = TypeVar("Found", bound=tuple[Any, ...])


@dataclass(frozen=True, eq=False)
class Known:
    """The fits before any search.

    coefficients: paths that are free.  given: the vehicle as it came, with fitted noises.  nominal: with its
    coefficients.
    """

    bench: Workbench
    coefficients: tuple[str, ...]
    given: State
    nominal: State

    @property
    def plant(self) -> Plant:
        """The vehicle as given, in the integration steps of the fits."""
        return self.bench.plant

    def in_suited_steps(self, state: State) -> Known:
        """The same fits in other integration steps if the present ones do not suit a state, else unchanged."""
        return self.on(self.bench.in_suited_steps(state))

    def suited_to(self, state: State) -> Known:
        """The same fits with shorter averages or integration steps if the present ones mislead a state, else unchanged.

        state: the end of a search; before it, missing effects may mislead in another way.
        """
        rows = self.bench.in_suited_rows(state)
        if rows is self.bench:
            return self.in_suited_steps(state)
        found = self.on(rows)
        return found.in_suited_steps(found.nominal)

    def on(self, bench: Workbench) -> Known:
        """The same fits on a bench with other steps or rows."""
        if bench is self.bench:
            return self
        given = bench.taken_over(self.given)
        nominal = given if self.nominal is self.given else bench.taken_over(self.nominal)
        return Known(bench, self.coefficients, given, nominal)

    def with_further_noises(self, state: State) -> tuple[Known, State]:
        """The same fits with waves and lasting sensor errors that a state's errors show, if any; and the state.

        state: with the effects that a search has found, so that these are not taken for noise.
        """
        return self._noisier(state, waves_alone=False)

    def with_waves(self) -> Known:
        """The same fits with waves that the errors show before any search, if any."""
        return self._noisier(self.nominal, waves_alone=True)[0]

    def _noisier(self, state: State, waves_alone: bool) -> tuple[Known, State]:
        states = list(dict.fromkeys([state, self.given, self.nominal]))  # some may be identical
        bench, found = with_further_noises(self.bench, states, waves_alone)
        if bench is self.bench:
            return self, state
        there = dict(zip(states, found, strict=True))
        return Known(bench, self.coefficients, there[self.given], there[self.nominal]), there[state]

    def beside_noises(self, state: State, search: Callable[[Known], Found], count: int) -> Found | None:
        """The result of a search beside the noises that a state's errors show; None without any, or if it went astray.

        search: returns the fits, the state that it found, and more.  count: of all candidates, for the bar.
        """
        noisier, beside = self.with_further_noises(state)
        if noisier is self:
            return None
        found = search(noisier)
        return None if noisier.led_astray(beside, found[0], found[1], count) else found

    def led_astray(self, state: State, again: Known, there: State, count: int) -> bool:
        """Whether a search beside these noises explains the record less well than what was found without them.

        Both the likelihood beside the same noises and free runs are compared: noises may take an effect's place, but
        predict nothing.
        state: what was found without them, fitted beside them.  again, there: the fits of the search, and what it
        found.
        count: of all candidates, for the bar.
        """
        bench = self.bench
        ahead = bench.problem.objective(state.point, state.paths)
        ahead -= again.bench.problem.objective(there.point, there.paths)
        more = max(len(state.paths) - len(there.paths), 1)
        return 2.0 * ahead > more * threshold(count) or bench.nearer(there, state) > FORETELLS

    def out_of_valley(self, trials: Sequence[Trial], bar: float) -> Known:
        """The fits with the nominal one continued from the end of the likeliest trial, if likelier, else unchanged.

        trials: of which none was accepted.  If one gains more than chance without a certain size, it has found a path
        that the fit without it had missed.  bar: evidence that chance does not reach.
        """
        fitted = [t for t in trials if t.state is not None and t.train >= bar]
        if not fitted:
            return self
        best = max(fitted, key=lambda t: t.train).state
        assert best is not None
        nominal = self.bench.likelier_beside(self.nominal, best)
        if self.bench.gain(self.nominal, nominal) < LEAST_TRACE * bar:
            return self
        return replace(self, nominal=nominal)


def fit_known(log: CheckedLog, progress: Progress) -> Known:
    """The fits of a vehicle without effects, in suitable integration steps.

    For a log that looks mislabelled, nothing is refitted.
    """
    bench = Workbench(log.plant, log.record, log.parts, log.asked.doubt, log.every_window)
    progress(0.02, "filtering with the vehicle as given")
    given = bench.fit(bench.plant, ())
    first = _first_coefficients(bench, given)
    if log.slipped:
        return Known(bench, first, given, given)
    progress(0.03, "refitting the coefficients")
    near = bench.fit(bench.plant, first, given, gain=TRIAL_GAIN)
    further = _further_coefficients(bench, near)
    nominal = bench.fit(near.plant, (*first, *further), near)
    return Known(bench, (*first, *further), given, nominal).in_suited_steps(nominal)


def _first_coefficients(bench: Workbench, given: State) -> tuple[str, ...]:
    """The coefficients of a first fit: those that the record's inputs excite and that are not known exactly."""
    plant, problem = bench.plant, bench.problem
    paths = tuple(p for p in plant.coefficients if plant.deviation(p, bench.doubt) > 0.0)
    if not paths or not given.finite:
        return paths
    columns = problem.columns_of(given.point, moves_of(paths))
    free = tuple(p for p, own in zip(paths, columns, strict=True) if np.abs(own).max() > 1e-6)
    return free or paths


def _further_coefficients(bench: Workbench, state: State) -> tuple[str, ...]:
    """The other uncertain coefficients, without those that are negligible even all together.

    Holding a coefficient that is one deviation off moves an estimate, in standard errors, by at most the root sum
    square over the record of its effect on the prediction errors, in their deviations (Cauchy and Schwarz).
    """
    plant, problem = bench.plant, bench.problem
    paths = [p for p in plant.doubted if p not in state.paths and 0.0 < plant.deviation(p, bench.doubt) < np.inf]
    if not paths or not state.finite:
        return ()
    rates = problem.pulls(state.point.vector, paths)[1]
    columns = problem.columns_of(state.point, moves_of(paths))
    squares = (columns**2).sum(axis=(1, 2)) / rates**2
    order = np.argsort(squares)
    held = {paths[k] for k, whole in zip(order, np.cumsum(squares[order]), strict=True) if whole < HELD**2}
    return tuple(p for p in paths if p not in held)
