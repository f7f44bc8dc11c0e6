"""The whole diagnosis of one record: refit, attribute, judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.record import Record
from identification.checks import check_excitation, check_ranges
from identification.diagnosis.attribution import Round, attribute, without_idle_parts
from identification.diagnosis.candidates import Screening, candidates_of, screen
from identification.diagnosis.residual import noise_floor, remains_of
from identification.diagnosis.trials import MANY_WINDOWS, Progress, threshold
from identification.diagnosis.verdict import Coefficient, Detectable, Diagnosis, Effect, Stage, Verdict
from identification.diagnosis.workbench import State, Workbench, calm_length
from identification.validation import fitted_runs, free_runs, whiteness
from identification.windows import LEAST_SAMPLES, free_run_windows, held_out

MOST_EFFECTS = 3
LEAST_WINDOWS = 4
WHITE = 1e-4  # p value of the whiteness test below which a residual is coloured
EXCESS = 0.5  # of the noise variance: a coloured residual smaller than this is left to the noise
LEAST_CHANGE = 0.02  # of a coefficient, from which on it may count as wrong
DOUBT = 0.1  # standard deviation of a vehicle's own coefficients, relative; twice that counts as wrong beyond bounds
SETTLE_SHARE = 0.2  # of a window that had to be shortened
EXPLAINED = 0.5  # share of the excess error that named effects must remove to count as the explanation


def diagnose(
    record: Record,
    plant: Plant,
    *,
    window: float | None = None,
    settle: float | None = None,
    seed: int = 0,
    most: int = MOST_EFFECTS,
    doubt: float = DOUBT,
    source: str = "",
    progress: Progress = lambda fraction, text: None,
) -> Diagnosis:
    """Which effect the plant lacks to explain the record, with the error before and after on held-out windows.

    window: s, length of the free runs (see `free_run_windows`, `held_out`).  settle: s at a window's start to which its
    initial states are fitted.  Both default to the vehicle's; an unstable vehicle's windows are shortened.
    doubt: standard deviation of the vehicle's own coefficients, relative.  seed: kept with the result.
    Raises ValueError if the record is too short, lacks a channel, or does not excite the vehicle.
    """
    window, settle = window or plant.window, plant.settle if settle is None else settle
    windows = _checked_windows(record, plant, window, settle)
    calm = calm_length(plant, record, window)
    if calm < window:
        window, settle = calm, min(settle, SETTLE_SHARE * calm)
        windows = _checked_windows(record, plant, window, settle)
    train, held = held_out(plant, record, windows)
    bench = Workbench(plant, record, train, held, settle, doubt)
    longest_step, plant = plant.longest_step, bench.plant
    coefficients = _free_coefficients(bench, plant)
    progress(0.0, "refitting the coefficients")
    given = bench.fit(plant, ())
    nominal = bench.fit(plant, coefficients, given)
    candidates = candidates_of(plant, record)
    state, rounds = attribute(bench, nominal, candidates, most, lambda f, t: progress(0.05 + 0.8 * f, t))
    chosen = [r.chosen for r in rounds if r.chosen is not None]
    state = without_idle_parts(bench, state, [t.candidate.paths for t in chosen])
    state, rounds = _pruned(bench, nominal, state, rounds, len(candidates))
    progress(0.85, "scoring free runs")
    stages = {
        name: _stage(fitted.plant, record, windows, held, settle, longest_step)
        for name, fitted in (("given", given), ("before", nominal), ("after", state))
    }
    count = len(candidates)
    screening = tuple(
        screen(
            bench.train, state.train, state.paths, candidates_of(state.plant, record), state.colour, threshold(count)
        )
    )
    sizes = bench.intervals(state)
    found = tuple(_coefficient(plant, p, sizes[p], count) for p in coefficients)
    effects, tied = _effects(state, rounds, sizes)
    explained, from_given = (_explained(stages[name], stages["after"], len(held)) for name in ("before", "given"))
    wrong = any(c.wrong for c in found) and from_given >= EXPLAINED
    refit_is_all = not effects
    if wrong:
        if refit_is_all:
            stages["before"], explained = stages["given"], from_given
        groups = _twins_of(plant, found)
        effects += _as_effects(groups, effects, found, plant, bench.gains(given, nominal))
        tied += [group for group in groups if not any(group[0] in other for other in tied)]
    verdict = _verdict(effects, tied, explained, stages["after"], refit_is_all, wrong)
    progress(1.0, "done")
    return Diagnosis(
        verdict=verdict,
        record=record,
        given=stages["given"],
        before=stages["before"],
        after=stages["after"],
        effects=tuple(effects),
        tied=tuple(tied),
        coefficients=found,
        detectable=_detectable(plant, screening, rounds, {e.path for e in effects}),
        rounds=tuple(rounds),
        state=state,
        screening=screening,
        explained=explained,
        remains=remains_of(stages["after"].fitted, record),
        windows=(tuple(train), tuple(held)),
        window=window,
        settle=settle,
        seed=seed,
        source=source,
        versions=_versions(),
    )


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
            f"(longest stretch {longest:.0f} s): record longer or choose shorter windows."
        )
    shortest = min(w.stop - w.start for w in windows)
    if shortest < LEAST_SAMPLES:
        raise ValueError(
            f"A window of {window:g} s holds only {shortest} samples; at least {LEAST_SAMPLES} are needed: "
            "choose longer windows."
        )
    return windows


def _free_coefficients(bench: Workbench, plant: Plant) -> tuple[str, ...]:
    """The coefficients that the record's inputs excite."""
    point = bench.train.point(plant.vector, bench.train.first_guess)
    paths = plant.family.coefficients
    if not np.isfinite(point.cost):
        return paths
    linear = bench.train.linearise(point, paths, bench.train.sigma(point))
    free = tuple(p for p, size in zip(paths, linear.raw, strict=True) if size > 1e-6)
    return free or paths


def _pruned(
    bench: Workbench, nominal: State, state: State, rounds: list[Round], count: int
) -> tuple[State, list[Round]]:
    """Backward elimination: an effect that a later one has made idle goes."""
    chosen = [r.chosen for r in rounds if r.chosen is not None]
    if len(chosen) < 2:
        return state, rounds
    for trial in chosen[:-1]:
        paths = tuple(p for p in trial.candidate.free if p in state.paths)
        plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in paths})
        without = bench.fit(plant, [p for p in state.paths if p not in paths], state)
        if sum(bench.gains(without, state)) < threshold(count, len(paths)):
            state = without
            rounds = [r for r in rounds if r.chosen is not trial]
    return state, rounds


def _stage(
    plant: Plant, record: Record, windows: Sequence[slice], held: Sequence[slice], settle: float, longest_step: float
) -> Stage:
    runs = free_runs(plant, record, held, settle)
    every = free_runs(plant, record, windows, settle)
    fitted = fitted_runs(plant, record, windows)
    white = {n: whiteness(fitted.residual[:, c], fitted.window) for c, n in enumerate(fitted.channels)}
    return Stage(replace(plant, longest_step=longest_step), runs, every, fitted, runs.scores(record), white)


def _effects(state: State, rounds: list[Round], sizes) -> tuple[list[Effect], list[tuple[str, ...]]]:
    effects, groups = [], []
    for r in rounds:
        if r.chosen is None:
            continue
        own = tuple(p for p in r.chosen.candidate.paths if p in state.paths)
        others = tuple(p for t in r.tied for p in t.candidate.paths)
        if others:
            groups.append((*own, *others))
        period = r.chosen.candidate.period
        with_period = f" with a period of {value_at(state.plant, period):.3g} s" if period else ""
        for path in own:
            spec = spec_at(state.plant, path)
            effects.append(
                Effect(
                    path=path,
                    title=spec.title + with_period,
                    value=sizes[path][0],
                    neutral=spec.neutral,
                    unit=spec.unit,
                    ci95=_span(sizes[path]),
                    evidence_train=r.chosen.train,
                    evidence_held=r.chosen.held,
                    tied_with=others,
                )
            )
    return effects, groups


def _coefficient(plant: Plant, path: str, size: tuple[float, float, float], count: int) -> Coefficient:
    """A refitted coefficient; wrong where it left its given value by a little, and surely."""
    spec, given, (value, error, _) = spec_at(plant, path), value_at(plant, path), size
    moved = abs(value - given)
    wrong = moved > LEAST_CHANGE * abs(given) and moved > np.sqrt(threshold(count)) * error
    return Coefficient(path, spec.title, spec.unit, given, value, _span(size), bool(wrong))


def _twins_of(plant: Plant, found: Sequence[Coefficient]) -> list[tuple[str, ...]]:
    """Wrong coefficients as which an effect acts, each with that effect."""
    wrong = {c.path: c for c in found if c.wrong and c.given != 0.0}
    return [
        (effect, path)
        for effect, path in plant.family.twins.items()
        if path in wrong and abs(wrong[path].value / wrong[path].given - 1.0) > spec_at(plant, effect).probe
    ]


def _as_effects(groups, effects, found, plant, gains: tuple[float, float]) -> list[Effect]:
    """Effects that act as a coefficient does which left its bounds: the record does not tell which it was."""
    added = []
    for group in groups:
        path = group[0]
        c = next(c for c in found if c.path == group[-1])
        if any(e.path == path for e in effects) or abs(c.value / c.given - 1.0) <= 2.0 * DOUBT:
            continue
        spec = spec_at(plant, path)
        shift = spec.neutral - 1.0  # gains are neutral at one, errors at zero
        low, high = sorted(shift + v / c.given for v in c.ci95)
        limits = (low, high)
        added.append(
            Effect(path, spec.title, shift + c.value / c.given, spec.neutral, spec.unit, limits, *gains, group[1:])
        )
    return added


def _explained(before: Stage, after: Stage, held_windows: int) -> float:
    """Share of the squared error above the measurement noise that the effects remove.

    Of free runs in the held-out windows; where these are few, of runs from fitted states in all windows.
    """
    many = held_windows >= MANY_WINDOWS
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


def _verdict(effects, tied, explained: float, after: Stage, refit_is_all: bool, wrong: bool) -> Verdict:
    """Effects must explain most of the excess error; a refit alone must leave no more than noise."""
    if (refit_is_all and _disagrees(after)) or (effects and explained < EXPLAINED):
        return "unexplained"
    if effects:
        return "tied" if tied else "named"
    return "coefficients" if wrong else "none"


def _disagrees(after: Stage) -> bool:
    """Whether what remains is coloured, and more than the noise could be."""
    for c, name in enumerate(after.fitted.channels):
        floor = noise_floor(after.fitted.residual[:, c], after.fitted.window)
        excess = float(np.nanmean(after.fitted.residual[:, c] ** 2)) / floor**2 - 1.0
        if after.whiteness[name].p_value < WHITE and excess > EXCESS:
            return True
    return False


def _detectable(
    plant: Plant, screening: Sequence[Screening], rounds: Sequence[Round], named: set[str]
) -> tuple[Detectable, ...]:
    result = []
    for s in screening:
        for path, size in zip(s.candidate.paths, s.detectable, strict=True):
            if path in named:
                continue
            spec = spec_at(plant, path)
            reason = ""
            if not np.isfinite(size):
                reason = s.unseen or "changes nothing that was measured"
            result.append(Detectable(path, spec.title, spec.unit, float(size), reason))
    return tuple(result)


def _span(size: tuple[float, float, float]) -> tuple[float, float]:
    return (size[0] - size[2], size[0] + size[2])


def _versions() -> dict[str, str]:
    found = {}
    for package in ("auv-gym", "numpy", "scipy", "numba", "xarray"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            from auv_gym import __version__

            found[package] = __version__
    return found
