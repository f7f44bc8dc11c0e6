"""Last step of a diagnosis: sizes, errors, what is left, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from itertools import compress

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at
from auv_gym.plant import Plant
from auv_gym.plant.currents import dive_currents
from auv_gym.records.record import Record
from identification.deciding import UNSTEADY
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.closing import closed_loop
from identification.diagnosis.judge.detectable import detectable_effects
from identification.diagnosis.judge.findings import (
    as_coefficients,
    coefficient_of,
    coefficient_twins,
    effects_of,
    twin_effects,
)
from identification.diagnosis.judge.found import Effect
from identification.diagnosis.judge.habitat import residual_habitat
from identification.diagnosis.judge.judgement import explained_share, many_windows, unsteady_of, verdict_of
from identification.diagnosis.judge.verdict import LEANS, RARE, VARIES, WORSE, Diagnosis, Stage
from identification.diagnosis.judge.weighing import Weighed, common_predictions, rounds_told, weigh
from identification.diagnosis.log.checking import CheckedLog
from identification.diagnosis.search.attribution import confirmed
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Regression, candidates_of
from identification.diagnosis.search.constancy import sizes_by_dive, steadiness
from identification.diagnosis.search.discovery import Discovery, discover, library_of
from identification.diagnosis.search.explanations import Explanations
from identification.diagnosis.search.remainder import passing_effect, what_is_left
from identification.diagnosis.search.searching import Searched
from identification.diagnosis.search.survival import chosen_without, survival
from identification.diagnosis.search.trials import Progress, Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.residual import residual_summary
from identification.fit.validation import FreeRuns, fitted_runs, free_runs, joined_runs, whiteness

_REFITTED = 'Free runs of the refitted vehicle ("before" is the vehicle as given instead)'


def judge(log: CheckedLog, searched: Searched, source: str, progress: Progress) -> Diagnosis:
    """What is said of a record, its vehicle, and the effects that a search has found.

    source: of the record, for those who read the result.
    """
    known = searched.known
    bench, record, asked, settle, plant = known.bench, log.record, log.asked, log.settle, known.plant
    nominal, state, left, count = searched.nominal, searched.state, searched.left, len(searched.candidates)
    rounds, survivals, dropped = [], [], dict[Trial, str]()
    for made in searched.rounds:
        if made.chosen is None:
            continue
        found = survival(bench, made, made.before or nominal, count)
        if not found.holds:
            dropped[made.chosen] = RARE
        elif rounds and _varies(bench, state, made.chosen):
            dropped[made.chosen] = VARIES  # beside a stronger effect; without that, nothing constant is named
        else:
            rounds.append(made)
            survivals.append(found)
    held = rounds
    if dropped:  # the others must hold without these
        state = bench.without(state, [p for t in dropped for p in t.candidate.free if p in state.paths])
        state, rounds = confirmed(bench, nominal, state if rounds else nominal, rounds, count)
        kept = {made.chosen.candidate for made in rounds if made.chosen is not None}
        stays = [made.chosen is not None and made.chosen.candidate in kept for made in held]
        dropped |= {made.chosen: LEANS for made, stay in zip(held, stays, strict=True) if made.chosen and not stay}
        held, survivals = list(compress(held, stays)), list(compress(survivals, stays))
        left = what_is_left(bench, state)
    progress(0.82, "weighing what explains the log as well")
    weighed = weigh(known, searched, state, rounds, survivals, asked.most)
    if weighed.state is not state:
        state, left = weighed.state, what_is_left(bench, weighed.state)
    rounds, survivals = weighed.rounds, weighed.survivals
    differing = [d for d in (sizes_by_dive(bench, state, p) for p in plant.family.by_dive) if d is not None]
    dives = next((d for d in differing if d.path in state.paths), None)
    if dives is not None:
        left = what_is_left(dives.bench, dives.state)
    elif differing:  # an effect that the search has not found, since its mean does little
        left = replace(left, changes=left.changes or differing[0].path)
    sizes = bench.intervals(state)
    effects, tied = effects_of(bench, state, weighed.tied, sizes, survivals, count, weighed.found)
    if dives is not None:
        effects = [replace(e, by_dive=dives.sizes) if e.path == dives.path else e for e in effects]
    varying = [e.path for e in unsteady_of(effects)] + [t.candidate.paths[0] for t, w in dropped.items() if w == VARIES]
    if varying and not left.changes:
        left = replace(left, changes=varying[0])
    progress(0.84, "scoring free runs")
    parts = range(len(log.parts))

    def stage(of: State, chosen: Sequence[State]) -> Stage:
        """The stage of a state, of which others were chosen without each part."""
        unseen = [
            (bench.unseen(s, k), bench.unseen(nominal, k), known.given.plant) if s.paths else (known.given.plant,)
            for k, s in enumerate(chosen)
        ]
        return _stage(of.plant, record, log, unseen)

    extras, as_given = Extras(), stage(known.given, [known.given for _ in parts])

    def refitted_stage(chosen: Sequence[State]) -> Stage:
        """That of the vehicle without effects; that of the vehicle as given where free runs diverge with a refit."""
        return extras.attempt(_REFITTED, lambda: stage(nominal, chosen), as_given)

    chosen = [chosen_without(bench, nominal, state, rounds, count, k) for k in parts]
    after = refitted_stage(chosen) if state is nominal else stage(state, chosen)
    before = after if state is nominal else refitted_stage([nominal for _ in parts])
    why = {t.candidate.paths[0]: reason for t, reason in dropped.items()}
    many = many_windows(log.every_window, log.steady)
    if rounds and left and explained_share(before, after, many) < 0.0:
        why |= {r.chosen.candidate.paths[0]: WORSE for r in rounds if r.chosen is not None}
        state, after, held, rounds, effects, tied = nominal, before, [], (), [], []
        weighed, sizes = Weighed(nominal, (), (), Explanations(())), bench.intervals(nominal)
        left = what_is_left(bench, nominal) or left
    rest = [] if log.slipped else candidates_of(state.plant, record)
    if rest and not replace(left, gusts=()) and dives is None:
        progress(0.86, "looking for an effect that acts in a part of the log")
        left = replace(left, passing=passing_effect(bench, state, rest))
    regression = Regression(bench.problem, state.point, state.paths, threshold(count))
    screening = tuple(regression.screened(rest))
    found = tuple(
        coefficient_of(plant, p, sizes[p], count, plant.deviation(p, asked.doubt))
        for p in known.coefficients
        if p in sizes
    )
    effects = [replace(e, changes=_changes(e.path, e.neutral, after, record, log)) for e in effects]
    common = common_predictions(effects, tied, weighed.found, state, lambda plant: _every(plant, record, log))
    explained, from_given = (explained_share(one, after, many) for one in (before, as_given))
    wrong = any(c.wrong for c in found)
    refit_is_all, refitted = not effects, before
    if wrong:
        if refit_is_all:
            before, explained = as_given, from_given
        groups = coefficient_twins(plant, found)
        effects += twin_effects(groups, effects, found, bench, state, count)
        tied += [group for group in groups if not any(group[0] in other for other in tied)]
    verdict = verdict_of(effects, tied, explained, bool(left), refit_is_all, wrong)
    effects = as_coefficients(known.given.plant, effects)
    alike: list[Effect] = []
    if verdict == "unexplained":
        alike, effects, tied, common = effects, [], [], ()
    discovery, habitat, rng = None, None, np.random.default_rng(asked.seed)
    if log.slipped or (log.doubts and verdict == "unexplained"):
        verdict = "doubted"
    elif left:
        progress(0.88, "looking for a term that no effect is")
        discovery = Discovery(state.plant, state.paths, state)
        # a family may have no terms to choose from
        library = library_of(state.plant)
        if library and bench.goes_on("looked for a term that no effect is"):
            discovery = extras.attempt(
                "The search for a term that no effect is",
                lambda: discover(bench, state, library, rng, settle),
                discovery,
            )
        still: object = left
        if discovery.holds:
            tried = stage(discovery.state, [discovery.state for _ in parts])
            if explained_share(after, tried, many) < 0.0:
                discovery = discovery.refused(state, WORSE.format(it="it"))
            else:
                after, still = tried, what_is_left(bench, discovery.state)
        if still:
            habitat = extras.attempt(
                "The description of what remains", lambda: residual_habitat(after.fitted, record, rng), None
            )
    progress(1.0, "done")
    diagnosis = Diagnosis(
        verdict=verdict,
        record=record,
        given=as_given,
        refitted=refitted,
        before=before,
        after=after,
        effects=tuple(effects),
        alike=tuple(alike),
        tied=tuple(tied),
        coefficients=found,
        detectable=detectable_effects(regression, screening, {e.path for e in (*effects, *alike)}),
        rounds=rounds_told(searched, held, weighed),
        dropped=why,
        state=state,
        screening=screening,
        explained=explained,
        remains=residual_summary(after.fitted, record),
        windows=log.windows,
        window=log.window,
        settle=settle,
        seed=asked.seed,
        asked=asked,
        doubts=log.doubts,
        resting=tuple(sorted(plant.family.resting(bench.problem.channels))),
        left_out=log.left_out,
        kinematics=searched.kinematics,
        discovery=discovery,
        habitat=habitat,
        noise=bench.problem.noise_at(state.point),
        averaged=bench.problem.averaged,
        left=left,
        source=source,
        versions=_versions(),
        common=common,
        unfinished=tuple(bench.unfinished),
    )
    loops = extras.attempt("The closed loop with each model", lambda: closed_loop(record, diagnosis.plants), ())
    final = discovery.state if discovery is not None and discovery.holds else state
    spread = bench.spread(final) if final.finite else ()
    currents = extras.attempt("The current of each dive", lambda: dive_currents(after.plant, record, spread), ())
    return replace(diagnosis, loops=loops, spread=spread, currents=currents, failures=tuple(extras.failures))


def _varies(bench: Workbench, state: State, trial: Trial) -> bool:
    """Whether parts of the record contradict each other in the size of an effect, but not as dives may."""
    own = [p for p in trial.candidate.free if p in state.paths and p not in bench.plant.family.by_dive]
    return bool(own) and steadiness(bench, state, own).probability < UNSTEADY


def _stage(plant: Plant, record: Record, log: CheckedLog, unseen: Sequence[Sequence[Plant]]) -> Stage:
    """The runs of a plant, and those that are scored: in each part, of plants that have not seen it.

    unseen: for each part in the order in which they are tried: one whose free runs diverge would have been refused.
    """
    flown = [_flown(p, record, own, log.settle) for p, own in zip(unseen, log.windows, strict=True)]
    runs = joined_runs([own for own, _ in flown])
    every = free_runs(plant, record, log.every_window, log.settle)
    fitted = fitted_runs(plant, record, log.every_window)
    white = {n: whiteness(fitted.residual[:, c], fitted.window) for c, n in enumerate(fitted.channels)}
    own = replace(plant, longest_step=log.plant.longest_step)
    return Stage(own, runs, every, fitted, runs.scores(record), white, tuple(part for _, part in flown))


def _every(plant: Plant, record: Record, log: CheckedLog) -> FreeRuns | None:
    """Free runs over every window, or None where they diverge."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return free_runs(plant, record, log.every_window, log.settle)
    except Diverged:
        return None


def _changes(path: str, neutral: float, after: Stage, record: Record, log: CheckedLog) -> dict[str, float]:
    """By how much free runs of a stage change, RMS by channel, where a parameter is put back to neutral."""
    without = _every(replace_at(after.plant, path, neutral), record, log)
    if without is None:
        return dict.fromkeys(after.every.channels, np.inf)
    change = (without.model - after.every.model)[after.every.scored]
    if without.signals is not None:  # angles jump at the vertical, turns do not
        change = np.nan_to_num((after.every.residual - without.residual)[after.every.scored])
    return dict(zip(after.every.channels, np.sqrt((change**2).mean(axis=0)).tolist(), strict=True))


def _flown(plants: Sequence[Plant], record: Record, windows: Sequence[slice], settle: float) -> tuple[FreeRuns, Plant]:
    """Free runs of the first plant with which they stay finite, and that plant; raises Diverged where there is none."""
    for plant in plants[:-1]:
        with suppress(Diverged), np.errstate(over="ignore", invalid="ignore"):
            return free_runs(plant, record, windows, settle), plant
    return free_runs(plants[-1], record, windows, settle), plants[-1]


def _versions() -> dict[str, str]:
    found = {}
    for package in ("auv-gym", "numpy", "scipy", "numba", "xarray"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            from auv_gym import __version__

            found[package] = __version__
    return found
