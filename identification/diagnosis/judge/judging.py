"""The last step of a diagnosis: which effects hold, what they explain, what is left, and the verdict."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

from auv_gym.plant.currents import dive_currents
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.closing import closed_loop
from identification.diagnosis.judge.concluding import concluded
from identification.diagnosis.judge.detectable import detectable_effects
from identification.diagnosis.judge.holding import what_holds
from identification.diagnosis.judge.remaining import Remaining, what_remains
from identification.diagnosis.judge.reporting import Reported, reported, withdrawn
from identification.diagnosis.judge.result import VARIES
from identification.diagnosis.judge.scoring import Scored, Scoring
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.judge.weighing import weigh
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.log.several import last_log
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Regression, candidates_of
from identification.diagnosis.search.remainder import passing_effect
from identification.diagnosis.search.searching import Searched
from identification.diagnosis.search.trials import Progress
from identification.fit.residual import residual_summary
from identification.fit.strides import cannot_be_shorter


def judge(log: CheckedLog, searched: Searched, source: str, progress: Progress) -> Diagnosis:
    """The diagnosis of a record and its vehicle, given the effects that a search has found.

    source: where the record came from, for the reader of the result.
    """
    bench, record, asked, extras = searched.known.bench, log.record, log.asked, Extras()
    scoring = Scoring(log, searched, extras)

    def weighed(varying: bool) -> tuple[Reported, Scored, bool]:
        held = what_holds(searched, varying)
        progress(0.82, "weighing what explains the log as well")
        found = reported(searched, held, weigh(searched, held, asked.most))
        progress(0.84, "scoring free runs")
        scored = scoring.scored(found.state, found.weighed.rounds)
        worse = bool(found.left) and scoring.explained(scored.refitted, scored.after) < 0.0
        return found, scored, bool(found.weighed.rounds) and (worse or found.weighed.needless)

    found, scored, worse = weighed(False)
    if worse and VARIES in found.dropped.values():  # the others may need the effect that differs between parts
        whole = weighed(True)
        found, scored, worse = (found, scored, worse) if whole[2] else whole
    if worse:
        found, scored = withdrawn(searched, found), replace(scored, after=scored.refitted)
    state, rest = found.state, [] if log.slipped else candidates_of(found.state.plant, record)
    if rest and not replace(found.left, gusts=()) and found.dives is None:
        progress(0.86, "looking for an effect that acts in a part of the log")
        found = replace(found, left=replace(found.left, passing=passing_effect(bench, state, rest)))
    regression = Regression(bench.problem, state.point, state.paths, threshold(len(searched.candidates)))
    screening = tuple(regression.screened(rest))
    told, remaining = concluded(scoring, found, scored), Remaining(scored.after)
    if found.left and told.verdict != "doubted":
        progress(0.88, "looking for a term that no effect is")
        remaining = what_remains(scoring, found, scored.after)
    after, discovery = remaining.after, remaining.discovery
    left = told.verdict in ("unexplained", "doubted")  # otherwise the log is not far from the vehicle with its effects
    progress(1.0, "done")
    diagnosis = Diagnosis(
        verdict=told.verdict,
        record=record,
        given=scored.given,
        refitted=scored.refitted,
        before=told.before,
        after=after,
        effects=told.effects,
        alike=told.alike,
        tied=told.tied,
        coefficients=told.coefficients,
        detectable=detectable_effects(regression, screening, {e.path for e in (*told.effects, *told.alike)}),
        rounds=found.told,
        dropped=found.dropped,
        state=state,
        screening=screening,
        explained=told.explained,
        remains=residual_summary(after.fitted, record),
        windows=log.windows,
        window=log.window,
        settle=log.settle,
        seed=asked.seed,
        asked=asked,
        doubts=(*told.doubts, *(doubt for doubt in log.doubts if left or doubt.slip is not None)),
        resting=tuple(sorted(bench.plant.family.resting(bench.problem.channels))),
        left_out=log.left_out,
        kinematics=searched.kinematics,
        discovery=discovery,
        habitat=remaining.habitat,
        noise=bench.problem.noise_at(state.point),
        averaged=bench.problem.averaged,
        shortest=cannot_be_shorter(bench.problem),
        left=found.left,
        source=source,
        versions=_versions(),
        common=told.common,
        unfinished=tuple(bench.unfinished),
    )
    steered, name = last_log(after.plant, record)
    last = "after" if "after" in diagnosis.stages else "refitted"
    loops = extras.attempt(
        "The closed loop with each model", lambda: closed_loop(steered, diagnosis.plants, name, last), ()
    )
    final = discovery.state if discovery is not None and discovery.holds else state
    spread = bench.spread(final) if final.finite else ()
    currents = extras.attempt("The current of each dive", lambda: dive_currents(after.plant, record, spread), ())
    return replace(diagnosis, loops=loops, spread=spread, currents=currents, failures=tuple(extras.failures))


def _versions() -> dict[str, str]:
    found = {}
    for package in ("auv-gym", "numpy", "scipy", "numba", "xarray"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            from auv_gym import __version__

            found[package] = __version__
    return found
