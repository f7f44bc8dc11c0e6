"""The whole diagnosis of one record: refit, attribute, judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.record_check import check_excitation, check_ranges
from auv_gym.records.record import Record
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.closing import closed_loop
from identification.diagnosis.judge.findings import (
    as_coefficients,
    coefficient_of,
    coefficient_twins,
    detectable_effects,
    effects_of,
    twin_effects,
)
from identification.diagnosis.judge.habitat import residual_habitat
from identification.diagnosis.judge.judgement import explained_share, many_windows, verdict_of, what_is_left
from identification.diagnosis.judge.verdict import Asked, Diagnosis, Stage
from identification.diagnosis.log.kinematics import kinematic_findings
from identification.diagnosis.log.plausibility import log_doubts
from identification.diagnosis.search.acceptance import threshold
from identification.diagnosis.search.attribution import attribute, confirmed, without_idle_parts
from identification.diagnosis.search.candidates import candidates_of, screen
from identification.diagnosis.search.discovery import Discovery, discover, library_of
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.trials import Progress
from identification.diagnosis.search.workbench import State, Workbench, noise_limited_length
from identification.fit.parameters import moves_of
from identification.fit.residual import residual_summary
from identification.fit.validation import fitted_runs, free_runs, whiteness
from identification.fit.windows import LEAST_SAMPLES, free_run_windows, held_out

MOST_EFFECTS = 3
LEAST_WINDOWS = 4
DOUBT = 0.1  # standard deviation of a vehicle's own coefficients, relative
SETTLE_SHARE = 0.2  # of a window that is shorter than the vehicle's
FEW_STATES = 4  # that the filter follows, up to which effects are exchanged for each other where something is left


def diagnose(
    record: Record,
    plant: Plant,
    *,
    window: float | None = None,
    settle: float | None = None,
    seed: int = 0,
    most: int = MOST_EFFECTS,
    doubt: float = DOUBT,
    trust: bool = False,
    source: str = "",
    progress: Progress = lambda fraction, text: None,
) -> Diagnosis:
    """Which effect the plant lacks to explain the record, with the error before and after on held-out windows.

    window: s, length of the free runs (see `free_run_windows`, `held_out`).  settle: s at a window's start to which its
    initial states are fitted.  Both default to the vehicle's; an unstable vehicle's windows are shortened, and settling
    times with short windows.
    doubt: standard deviation of the vehicle's own coefficients, relative, where it states none; 0 holds all of them.
    seed: of what resamples windows.  trust: also of logs that look mislabelled.
    Raises ValueError if the record is too short, lacks a channel, or does not excite the vehicle.
    """
    asked = Asked(window, settle, seed, most, doubt, trust)
    window = window or plant.window
    if settle is None:
        settle = plant.settle if window >= plant.window else min(plant.settle, SETTLE_SHARE * window)
    windows = _checked_windows(record, plant, window, settle)
    blocks = held_out(plant, record, windows)
    longest, calm = window, noise_limited_length(plant, record, window)
    if calm < window:
        window, settle = calm, min(settle, SETTLE_SHARE * calm)
        windows = _checked_windows(record, plant, window, settle)
    progress(0.0, "looking for slips in the log")
    doubts = () if trust else log_doubts(record, plant, windows, settle)
    slipped = any(d.slip is not None for d in doubts)
    if slipped and not any(d.firm for d in doubts):
        anyway = _in_spite(record, plant, asked, source, progress)
        if anyway is not None:
            return anyway
    bench = Workbench(plant, record, *blocks, doubt)
    held = [w for w in windows if any(b.start <= w.start and w.stop <= b.stop for b in blocks[1])]
    longest_step, plant = plant.longest_step, bench.plant
    progress(0.02, "filtering with the vehicle as given")
    given = bench.fit(plant, ())
    coefficients = _free_coefficients(bench, given)
    progress(0.03, "refitting the coefficients")
    nominal = bench.fit(plant, () if slipped else coefficients, given)
    kinematics = kinematic_findings(record, plant)
    candidates = [] if slipped else candidates_of(plant, record)
    state, rounds = attribute(
        bench, nominal, candidates, most, kinematics.mismatches, lambda f, t: progress(0.05 + 0.75 * f, t)
    )
    chosen = [r.chosen for r in rounds if r.chosen is not None]
    state = without_idle_parts(bench, state, [t.candidate.paths for t in chosen])
    state, rounds = confirmed(bench, nominal, state, rounds, len(candidates))
    library = library_of(state.plant)
    left = what_is_left(bench, state, library)
    few = sum(i < len(plant.family.states) for i in bench.problem.live) <= FEW_STATES  # elsewhere it takes minutes
    if rounds and few and left:
        progress(0.8, "trying other effects in each one's place")
        again, rounds = Reconsidering(bench, candidates, most, kinematics.mismatches).improved(state, rounds)
        again, rounds = confirmed(bench, nominal, again, rounds, len(candidates))
        if again is not state:
            state = again
            left = what_is_left(bench, state, library)
    if state is nominal and left and not what_is_left(bench, given, library):
        state = nominal = given  # what the errors refute is the refit, not the vehicle
        left = what_is_left(bench, given, library)
    progress(0.84, "scoring free runs")

    def stage(of: Plant) -> Stage:
        return _stage(of, record, windows, held, settle, longest_step)

    after, as_given = stage(state.plant), stage(given.plant)
    before = after if state is nominal else stage(nominal.plant)
    count, rest = len(candidates), [] if slipped else candidates_of(state.plant, record)
    screening = tuple(screen(bench.problem, state.point, state.paths, rest, threshold(count)))
    sizes = bench.intervals(state)
    found = tuple(
        coefficient_of(plant, p, sizes[p], count, plant.deviation(p, doubt)) for p in coefficients if p in sizes
    )
    effects, tied = effects_of(bench, state, rounds, sizes)
    many = many_windows(held, calm == longest)
    explained, from_given = (explained_share(one, after, many) for one in (before, as_given))
    wrong = any(c.wrong for c in found)
    refit_is_all = not effects
    if wrong:
        if refit_is_all:
            before, explained = as_given, from_given
        groups = coefficient_twins(plant, found)
        effects += twin_effects(groups, effects, found, bench, state, count)
        tied += [group for group in groups if not any(group[0] in other for other in tied)]
    verdict = verdict_of(effects, tied, explained, bool(left), refit_is_all, wrong)
    discovery, habitat, rng, extras = None, None, np.random.default_rng(seed), Extras()
    if slipped or (doubts and verdict == "unexplained"):
        verdict = "doubted"
    elif left:
        progress(0.88, "looking for a term that no effect is")
        discovery = extras.attempt(
            "The search for a term that no effect is",
            lambda: discover(bench, state, library, rng, settle),
            Discovery(state.plant, state.paths, state),
        )
        still: object = left
        if discovery.holds:
            after = stage(discovery.plant)
            still = what_is_left(bench, discovery.state, library_of(discovery.plant))
        if still:
            habitat = extras.attempt(
                "The description of what remains", lambda: residual_habitat(after.fitted, record, rng), None
            )
    progress(1.0, "done")
    diagnosis = Diagnosis(
        verdict=verdict,
        record=record,
        given=as_given,
        before=before,
        after=after,
        effects=tuple(as_coefficients(given.plant, effects)),
        tied=tuple(tied),
        coefficients=found,
        detectable=detectable_effects(plant, screening, rounds, {e.path for e in effects}),
        rounds=tuple(rounds),
        state=state,
        screening=screening,
        explained=explained,
        remains=residual_summary(after.fitted, record),
        windows=(tuple(w for w in windows if w not in held), tuple(held)),
        window=window,
        settle=settle,
        seed=seed,
        asked=asked,
        doubts=doubts,
        kinematics=kinematics,
        discovery=discovery,
        habitat=habitat,
        noise=bench.noise(state),
        coloured=left.coloured,
        source=source,
        versions=_versions(),
    )
    loops = extras.attempt("The closed loop with each model", lambda: closed_loop(record, diagnosis.plants), ())
    return replace(diagnosis, loops=loops, failures=tuple(extras.failures))


def _in_spite(record: Record, plant: Plant, asked: Asked, source: str, progress: Progress) -> Diagnosis | None:
    """The diagnosis of a log that looks mislabelled, if effects explain it to the noise; else None."""
    trusting = replace(asked, trust=True)
    found = diagnose(record, plant, **vars(trusting), source=source, progress=progress)
    return None if found.unexplained else replace(found, asked=asked)


def _checked_windows(record: Record, plant: Plant, window: float, settle: float) -> list[slice]:
    outputs = [name for name in plant.outputs if record.has(name)]
    first = plant.family.leading
    if first not in outputs:
        raise ValueError(
            f"The diagnosis of {plant.name} needs the channel {first}, got {', '.join(record.names)}: "
            "rename the column by a mapping file."
        )
    check_ranges(plant, record)
    check_excitation(plant, record)
    if not settle < 0.5 * window:
        raise ValueError(f"The settling time must be less than half a window of {window:g} s, got {settle:g} s.")
    windows = free_run_windows(plant, record, window)
    if len(windows) < LEAST_WINDOWS:
        longest = max(float(np.ptp(record.time[s])) for s in record.segments)
        raise ValueError(
            f"A diagnosis needs at least {LEAST_WINDOWS} windows of {window:g} s without a gap, got {len(windows)} "
            f"(longest stretch {longest:.0f} s, samples {record.sample_interval:g} s apart): "
            + (
                "choose longer windows."
                if window < 2.0 * record.sample_interval
                else "record longer or choose shorter windows."
            )
        )
    shortest = min(w.stop - w.start for w in windows)
    if shortest < LEAST_SAMPLES:
        raise ValueError(
            f"A window of {window:g} s holds only {shortest} samples; at least {LEAST_SAMPLES} are needed: "
            "choose longer windows."
        )
    return windows


def _free_coefficients(bench: Workbench, given: State) -> tuple[str, ...]:
    """The coefficients that the record's inputs excite, and that are not known exactly."""
    plant, problem = bench.plant, bench.problem
    paths = tuple(p for p in plant.coefficients if plant.deviation(p, bench.doubt) > 0.0)
    if not paths or not given.finite:
        return paths
    columns = problem.columns_of(given.point, moves_of(paths))
    free = tuple(p for p, own in zip(paths, columns, strict=True) if np.abs(own).max() > 1e-6)
    return free or paths


def _stage(
    plant: Plant, record: Record, windows: Sequence[slice], held: Sequence[slice], settle: float, longest_step: float
) -> Stage:
    runs = free_runs(plant, record, held, settle)
    every = free_runs(plant, record, windows, settle)
    fitted = fitted_runs(plant, record, windows)
    white = {n: whiteness(fitted.residual[:, c], fitted.window) for c, n in enumerate(fitted.channels)}
    return Stage(replace(plant, longest_step=longest_step), runs, every, fitted, runs.scores(record), white)


def _versions() -> dict[str, str]:
    found = {}
    for package in ("auv-gym", "numpy", "scipy", "numba", "xarray"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            from auv_gym import __version__

            found[package] = __version__
    return found
