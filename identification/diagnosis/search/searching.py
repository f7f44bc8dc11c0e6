"""Third step of a diagnosis: effects that make the vehicle agree with what no fit has counted."""

from __future__ import annotations

from dataclasses import dataclass

from identification.deciding import FEW_STATES
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.log.kinematics import Kinematics, kinematic_findings
from identification.diagnosis.search.attribution import Round, attribute, confirmed, settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, candidates_of
from identification.diagnosis.search.known import Known
from identification.diagnosis.search.remainder import Left, what_is_left
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import State


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search found.

    known: what was fitted before, in the steps of integration that suit what was found.
    nominal, state: without and with the effects; nominal is the vehicle as given where its refit is refuted.
    rounds: those that chose the effects, and the last one.  left: what the errors still hold.
    """

    known: Known
    candidates: tuple[Candidate, ...]
    kinematics: Kinematics
    nominal: State
    state: State
    rounds: tuple[Round, ...]
    left: Left

    @property
    def chosen(self) -> int:
        """How many effects there are."""
        return sum(made.chosen is not None for made in self.rounds)


@dataclass(frozen=True, eq=False)
class Noisier:
    """Noises that a search must begin again with, and what it had found so far, beside them."""

    known: Known
    state: State


def search_effects(log: CheckedLog, known: Known, progress: Progress, noises: bool = True) -> Searched:
    """Forward selection, what it chose confirmed, and second thoughts where something is left.

    Where the steps of integration turn out to be too long for what was found, all is repeated in shorter ones: an
    effect that is there leaves less noise than its absence.  So it is where trials show that the fit without any effect
    has stopped too early.  With `noises` it is also repeated where errors show a swell, or readings whose errors last,
    that explain more than the effect that is found next: beside errors that last, all effects seem certain.  A search
    beside these that has lost the way, and explains the log less well than what was found before, does not count.
    """
    found: Searched | Known | Noisier = known
    while isinstance(found, Known):
        known, found = found, _searched(log, found, progress, noises)
    if isinstance(found, Searched):
        return found
    again = search_effects(log, found.known, progress)
    ahead = found.known.bench.problem.objective(found.state.point, found.state.paths)
    ahead -= again.known.bench.problem.objective(again.state.point, again.state.paths)
    more = max(len(found.state.paths) - len(again.state.paths), 1)
    lost = 2.0 * ahead > more * threshold(len(again.candidates))
    return search_effects(log, known, progress, noises=False) if lost else again


def _searched(log: CheckedLog, known: Known, progress: Progress, noises: bool) -> Searched | Known | Noisier:
    """A search, or what was fitted before it where that must be repeated, and the search with it."""
    bench, nominal, given, most = known.bench, known.nominal, known.given, log.asked.most
    kinematics = kinematic_findings(log.record, bench.plant)
    candidates = [] if log.slipped else candidates_of(bench.plant, log.record)
    noisier, beside = known, nominal

    def outdone(state: State, evidence: float) -> bool:
        nonlocal noisier, beside
        noisier, beside = known.with_further_noises(state, 0.5 * evidence)
        return noisier is not known

    state, rounds = attribute(
        bench, nominal, candidates, most, kinematics.mismatches, lambda f, t: progress(0.05 + 0.75 * f, t),
        outdone if noises else None,
    )  # fmt: skip
    if noisier is not known:
        return Noisier(noisier, beside)
    anew = known.in_suited_steps(state)
    if anew is known and state is nominal and rounds:
        anew = known.out_of_valley(rounds[-1].trials, threshold(len(candidates)))
    if anew is not known:
        return anew
    state, rounds = settled(bench, nominal, state, rounds, len(candidates))
    left = what_is_left(bench, state)
    second = Reconsidering(bench, candidates, most, kinematics.mismatches)
    again = state
    if rounds and (left or bench.problem.is_pushed(state.point)) and bench.goes_on("tried pairs of effects"):
        progress(0.8, "trying pairs of effects")
        again, rounds = second.paired(state, rounds)
    few = bench.followed <= FEW_STATES  # elsewhere it takes minutes
    if rounds and few and bench.goes_on("tried pairs of effects in each one's place"):
        progress(0.82, "trying pairs of effects in each one's place")
        again, rounds = second.paired_instead(again, rounds)
    if rounds and left and few and bench.goes_on("tried other effects in each one's place"):
        progress(0.85, "trying other effects in each one's place")
        again, rounds = second.swapped(again, rounds)
    if again is not state:
        again, rounds = confirmed(bench, nominal, again, rounds, len(candidates))
        if again is not state:
            state = again
            left = what_is_left(bench, state)
    if state is nominal and left and not what_is_left(bench, given):
        state = nominal = given  # what the errors refute is the refit, not the vehicle
        left = what_is_left(bench, given)
    suited = known.in_suited_steps(state)
    if suited is not known:
        return suited
    return Searched(known, tuple(candidates), kinematics, nominal, state, tuple(rounds), left)
