"""Third step of a diagnosis: the search for effects by which the vehicle predicts held-out data."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from identification.deciding import FEW_STATES, LEAST_OF_SWELL, TIMED
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.log.kinematics import Kinematics, kinematic_findings
from identification.diagnosis.search.attribution import FURTHER, Round, attribute, confirmed, settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, candidates_of
from identification.diagnosis.search.known import Known
from identification.diagnosis.search.remainder import Left, likeliest_to_change, what_is_left
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import State


@dataclass(frozen=True, eq=False)
class Searched:
    """The result of a search.

    known: the fits before it, in integration steps that suit the result.
    nominal, state: without and with the effects; nominal is the vehicle as given if its refit is refuted.
    rounds: those that chose the effects, and the last one.  left: what the errors still hold.
    """

    known: Known
    candidates: tuple[Candidate, ...]
    kinematics: Kinematics
    nominal: State
    state: State
    rounds: tuple[Round, ...]
    left: Left


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The result of forward selection.

    noisier: if waves or lasting sensor errors explain more beside the chosen effects, the fits with these noises, and
    the state beside them.
    """

    known: Known
    candidates: tuple[Candidate, ...]
    kinematics: Kinematics
    state: State
    rounds: tuple[Round, ...]
    noisier: tuple[Known, State] | None

    @property
    def paths(self) -> tuple[str, ...]:
        """The paths of the chosen effects."""
        return tuple(p for made in self.rounds if made.chosen is not None for p in made.chosen.candidate.paths)


def search_effects(log: CheckedLog, known: Known, progress: Progress) -> Searched:
    """The result of a search, beside waves from the beginning if that suffices, else with effects first."""
    return _in_waves(log, known, progress) or _sought(log, known, progress)


def _in_waves(log: CheckedLog, known: Known, progress: Progress) -> Searched | None:
    """The result of a search beside waves that the errors show before it, which saves one search; or None.

    None if the errors show no waves, if the waves vanish beside the found effects, if nothing was found, or if
    something is left: an effect that makes the vehicle oscillate, or an oscillating sensor, may have looked like waves.
    """
    progress(0.04, "looking for waves")
    noisier = known if log.slipped else known.with_waves()
    if noisier is known:
        return None
    found = _sought(log, noisier, progress)
    return found if _beside_waves(found) else None


def _beside_waves(found: Searched) -> bool:
    """Whether effects were found, waves push the vehicle beside them, and nothing else is left."""
    noise = found.known.bench.problem.noise_at(found.state.point)
    waves = any(len(pushed) >= LEAST_OF_SWELL for pushed in noise.swell.values())
    return waves and not found.left and any(made.chosen is not None for made in found.rounds)


def _sought(log: CheckedLog, known: Known, progress: Progress, sought: Collection[str] = ()) -> Searched:
    """The result of forward selection, its confirmation, and second thoughts if something is left.

    If the integration steps are too long for the result, all is repeated in shorter ones: a model with the missing
    effect has less noise.  It is also repeated if trials show that the fit without effects has stopped too early, or if
    the errors beside the found effects show waves or lasting sensor errors: without these noises, effects and
    differences between parts seem more certain than they are.  That search counts unless it went astray, or ended for
    want of time where the one without these noises did not.

    sought: paths that are fitted to the end whatever they promise; beside further noises, those chosen without them.
    """
    found: Searched | Known = known
    while isinstance(found, Known):
        chosen = _selected(log, found, progress, sought)
        if isinstance(chosen, Known):
            found = chosen
            continue
        if chosen.noisier is not None:
            noisier, beside = chosen.noisier
            again = _sought(log, noisier, progress, chosen.paths)
            cut_short = FURTHER in again.known.bench.unfinished and FURTHER not in found.bench.unfinished
            if not cut_short and not noisier.led_astray(beside, again.known, again.state, len(again.candidates)):
                return again
        found = _reconsidered(log, chosen, progress)
    return found


def may_differ(searched: Searched) -> list[str]:
    """Paths of the effects that one of several logs may have alone: all, or with many states those that differ most."""
    paths = [p for c in searched.candidates if c.sloped for p in c.paths]
    bench = searched.known.bench
    if bench.followed <= FEW_STATES:
        return paths
    likely = likeliest_to_change(bench, searched.state, paths, TIMED)
    return [p for c in searched.candidates if not set(likely).isdisjoint(c.paths) for p in c.paths]


def _selected(log: CheckedLog, known: Known, progress: Progress, sought: Collection[str]) -> _Chosen | Known:
    """The result of forward selection, or the fits before it if the selection must be repeated."""
    bench, nominal = known.bench, known.nominal
    kinematics = kinematic_findings(log.record, bench.plant)
    candidates = [] if log.slipped else candidates_of(bench.plant, log.record)
    most, sensors = log.asked.most, kinematics.mismatches
    state, rounds = attribute(
        bench, nominal, candidates, most, sensors, lambda f, t: progress(0.05 + 0.75 * f, t), sought
    )
    anew = known.in_suited_steps(state)
    if anew is known and state is nominal and rounds:
        anew = known.out_of_valley(rounds[-1].trials, threshold(len(candidates)))
    if anew is not known:
        return anew
    noisier = None
    if rounds and (rounds[-1].chosen is None or not sought):
        progress(0.8, "looking for waves and for sensor errors that last")
        beside = known.with_further_noises(state)
        noisier = None if beside[0] is known else beside
    return _Chosen(known, tuple(candidates), kinematics, state, tuple(rounds), noisier)


def _reconsidered(log: CheckedLog, chosen: _Chosen, progress: Progress) -> Searched | Known:
    """The confirmed result of forward selection after second thoughts; or the fits if it must be repeated."""
    known, state, rounds, candidates = chosen.known, chosen.state, list(chosen.rounds), chosen.candidates
    bench, nominal, given, most = known.bench, known.nominal, known.given, log.asked.most
    kinematics = chosen.kinematics
    state, rounds = settled(bench, nominal, state, rounds, len(candidates))
    left = what_is_left(bench, state)
    second = Reconsidering(bench, candidates, most, kinematics.mismatches)
    again = state
    if rounds and (left or bench.problem.is_pushed(state.point)) and bench.goes_on("tried pairs of effects"):
        progress(0.8, "trying pairs of effects")
        again, rounds = second.paired(state, rounds)
    few = bench.followed <= FEW_STATES  # with more states it takes minutes
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
        state = nominal = given  # the errors refute the refit, not the vehicle as given
        left = what_is_left(bench, given)
    suited = known.suited_to(state)
    if suited is known:
        suited = _in_single_readings(known, state, left)
    if suited is not known:
        return suited
    return Searched(known, candidates, kinematics, nominal, state, tuple(rounds), left)


def _in_single_readings(known: Known, state: State, left: Left) -> Known:
    """The fits to single readings, if only averaging makes the errors depend on a command; else the fits unchanged.

    Commands that answer readings within an average, which the filter has not seen, look as if pushes followed them.
    """
    if left.depends is None or left.depends.signal not in known.plant.inputs:
        return known
    finer = known.bench.in_shortest_rows()
    if finer is known.bench or what_is_left(finer, finer.taken_over(state)):
        return known
    return known.on(finer)
