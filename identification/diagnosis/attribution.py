"""Which effect, added to the vehicle, makes its free runs agree with data that took no part in the fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.record import Record
from identification.diagnosis.candidates import SEEN, Candidate, Screening, screen
from identification.estimate import half_width
from identification.shooting import Point, Shooting, colour, covariance, evidence, window_costs
from identification.validation import head_windows

FALSE_ALARM = 1e-3  # probability of any false name on a log without a missing effect, over all candidates
HELD_LEAST = 2.7  # evidence from the held-out windows alone: the 5 % point of one parameter, one-sided
HELD_SHARE = 0.02  # of the evidence in the fitted windows that the held-out ones must repeat
MANY_WINDOWS = 8  # held-out windows from which on they are judged one by one
HELD_RANKS = 0.01  # p value of the signed-rank test over held-out windows
LEAST_TRACE = 2.0  # evidence that the screening must promise before a candidate without a corner is fitted
FIRST_ITERATIONS, ITERATIONS = 5, 15  # of each start, and then of the best of them
FAR_FROM_GIVEN = 0.1  # change of a coefficient from which on candidates are also sought from its given value
SURE = 3.0  # standard errors, with the residual's colour, by which a size must differ from neutral
ALIKE = 0.99  # cosine between two signatures from which on one effect is fitted again where the other one succeeded
SAME = 1e-4  # 1 - cosine^2 between signatures below which two effects count as one: difference quotients see no more
TIE = 9.0  # evidence between two candidates below which a record does not tell them apart: three standard errors
TIE_ERRORS = 1.64  # the same where windows disagree among themselves, in standard errors over the windows

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class State:
    """A vehicle with its free parameters fitted in the training windows, and its runs in both sets of windows."""

    plant: Plant
    paths: tuple[str, ...]
    train: Point
    held: Point
    colour: np.ndarray


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate fitted jointly with everything fitted before it.

    train, held: evidence for it in the fitted and in the held-out windows.  objection: why it is not accepted, or "".
    """

    candidate: Candidate
    state: State | None
    train: float
    held: float
    screening: Screening
    objection: str

    @property
    def total(self) -> float:
        """Evidence from all windows, less what a second component or a sought period is expected to gain by chance."""
        return self.train + self.held - 2.0 * (len(self.candidate.paths) - 1 + float(np.log(self.screening.tried)))


@dataclass(frozen=True, eq=False)
class Round:
    """One step of the forward selection: all trials, the chosen one, and those that the record cannot tell from it."""

    trials: tuple[Trial, ...]
    chosen: Trial | None
    tied: tuple[Trial, ...]


class Workbench:
    """A record in training and held-out windows, and the fits made on it."""

    def __init__(self, plant: Plant, record: Record, train: Sequence[slice], held: Sequence[slice], settle: float):
        self.plant = plant
        self.heads = Shooting(plant, record, head_windows(record, held, settle))
        self.train = Shooting(plant, record, train)
        self.held = Shooting(plant, record, held)

    def fit(self, plant: Plant, paths: Sequence[str], near: State | None = None) -> State:
        """The state of least cost in the training windows over the paths, started from the plant's values."""
        train = self.train.solve(plant, paths, near.train.starts if near else None)
        fitted = self.train.plant_at(train, paths)
        held = self.held.solve(fitted, (), near.held.starts if near else None)
        return State(fitted, tuple(paths), train, held, colour(self.train, train))

    def gains(self, before: State, after: State) -> tuple[float, float]:
        """Evidence for the change in the training and in the held-out windows."""
        return (
            evidence(self.train, before.train, after.train, after.colour),
            evidence(self.held, before.held, after.held, after.colour),
        )

    def free_run_errors(self, plant: Plant) -> np.ndarray:
        """Sum of squared errors of free runs by held-out window and channel, (W, C), started as an operator would.

        The initial states are fitted to the settling time of each window alone, and its samples are not counted.
        """
        starts = self.heads.solve(plant, (), max_iterations=12, tolerance=1e-5).starts
        squares = np.where(self.held.finite, self.held.point(plant.vector, starts).residual, 0.0) ** 2
        past = np.arange(self.held.runs.rows) - self.held.offsets[self.held.window_of_row]
        settled = past >= (self.heads.runs.stop - self.heads.runs.begin)[self.held.window_of_row]
        return np.add.reduceat(squares * settled[:, None], self.held.offsets, axis=0)

    def intervals(self, state: State) -> dict[str, tuple[float, float, float]]:
        """Value, standard error and half width of the 95 % interval of each fitted path."""
        linear = self.train.linearise(state.train, state.paths, self.train.sigma(state.train))
        matrix, freedom = covariance(self.train, state.train, linear, state.colour)
        errors = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        width = half_width(freedom)
        result = {}
        for path, error in zip(state.paths, errors, strict=True):
            size = float(error * self.train.scale(path))
            result[path] = (value_at(state.plant, path), size, width * size)
        return result

    def costs(self, state: State, reference: State) -> np.ndarray:
        """Cost of each window, training then held-out, in units of the reference's innovation variance; shape (W,)."""
        parts = []
        for problem, point, against in (
            (self.train, state.train, reference.train),
            (self.held, state.held, reference.held),
        ):
            unit = window_costs(problem, against, reference.colour).sum(axis=0) / np.maximum(problem.counts, 1)
            parts.append((window_costs(problem, point, reference.colour) / (unit + 1e-30)).sum(axis=1))
        return np.concatenate(parts)


def threshold(candidates: int, parameters: int = 1) -> float:
    """The evidence that a candidate needs to be named, with a correction for the number of candidates."""
    return float(stats.chi2.isf(FALSE_ALARM / max(candidates, 1), parameters))


def attribute(
    bench: Workbench, start: State, candidates: Sequence[Candidate], most: int, progress: Progress
) -> tuple[State, list[Round]]:
    """Forward selection of up to `most` effects; the fitted state that it ends in, and its rounds.

    Each round screens every candidate by regression, fits the promising ones jointly with all that was fitted before,
    and accepts the one with most evidence if the held-out windows repeat it.
    """
    state, rounds, left = start, [], list(candidates)
    for number in range(most + 1):
        trials = _trials(bench, state, left, len(candidates), progress, number / (most + 1), 1.0 / (most + 1))
        accepted = [t for t in trials if not t.objection]
        if not accepted or number == most:
            rounds.append(Round(tuple(trials), None, ()))
            break
        chosen = _best(bench, accepted)
        alike = {t.candidate: _likenesses(bench, chosen, t) for t in trials if t is not chosen}
        trials = [
            t if t is chosen else _beside(bench, state, chosen, t, alike[t.candidate], len(candidates)) for t in trials
        ]
        tied = tuple(t for t in trials if t is not chosen and _tie(bench, chosen, t, alike[t.candidate]))
        rounds.append(Round(tuple(trials), chosen, tied))
        assert chosen.state is not None
        state = bench.fit(chosen.state.plant, chosen.state.paths, chosen.state)
        left = [c for c in left if c is not chosen.candidate]
    return state, rounds


def _trials(bench, state, candidates, count, progress, done, share) -> list[Trial]:
    bases = [state]
    other = _with_given_coefficients(bench, state)
    if other is not None:
        bases.append(other)
    bar = threshold(count)
    screenings = [screen(bench.train, b.train, state.paths, candidates, b.colour, bar) for b in bases]
    from_given = {s.candidate: s for s in screenings[-1]}
    trials = []
    for number, s in enumerate(screenings[0]):
        progress(done + share * number / max(len(candidates), 1), s.candidate.title)
        seen = [s, from_given[s.candidate]][: len(bases)]
        trials.append(_trial(bench, state, list(zip(bases, seen, strict=True)), count))
    return sorted(trials, key=lambda t: -t.total)


def _with_given_coefficients(bench: Workbench, state: State) -> State | None:
    """The state with its coefficients as the vehicle was given, if the fit has taken them far from there.

    Coefficients that were fitted without the missing effect may be so wrong that its signature at them means nothing.
    """
    coefficients = [p for p in state.paths if p in bench.plant.family.coefficients]
    given = {p: value_at(bench.plant, p) for p in coefficients}
    if all(abs(value_at(state.plant, p) - v) <= FAR_FROM_GIVEN * abs(v) for p, v in given.items()):
        return None
    other = bench.fit(replace_at(state.plant, given), (), state)
    return other if np.isfinite(other.train.cost) else None


def _trial(bench: Workbench, state: State, bases: Sequence[tuple[State, Screening]], count: int) -> Trial:
    screening = bases[0][1]
    candidate = screening.candidate
    if max(s.seen for _, s in bases) < SEEN:
        by = f": {screening.unseen}" if screening.unseen else ""
        return Trial(candidate, None, 0.0, 0.0, screening, f"cannot be seen in this record{by}")
    traces = [(b, s) for b, s in bases if candidate.kinked or s.evidence >= LEAST_TRACE]
    if not traces:
        return Trial(candidate, None, screening.evidence, 0.0, screening, "leaves no trace in the residual")
    paths = (*state.paths, *candidate.free)
    found = []
    for base, s in traces:
        period = {candidate.period: s.period} if candidate.period else {}
        for values in _first_values(base.plant, s):
            plant = replace_at(base.plant, dict(zip(candidate.paths, values, strict=True)) | period)
            found.append(bench.train.solve(plant, paths, base.train.starts, FIRST_ITERATIONS, 1e-5))
    best = min(found, key=lambda point: point.cost)
    if not np.isfinite(best.cost):
        return Trial(candidate, None, 0.0, 0.0, screening, "no stable run with it")
    return _judged(bench, state, candidate, screening, bench.train.plant_at(best, paths), best.starts, count)


def _judged(bench, state: State, candidate: Candidate, screening: Screening, plant: Plant, starts, count: int) -> Trial:
    """The trial of a candidate fitted from a plant and its starts."""
    paths = (*state.paths, *candidate.free)
    best = bench.train.solve(plant, paths, starts, ITERATIONS, 1e-5)
    plant = bench.train.plant_at(best, paths)
    held = bench.held.solve(plant, (), state.held.starts, 12, 1e-5)
    after = State(plant, paths, best, held, colour(bench.train, best))
    train, test = bench.gains(state, after)
    objection = _objection(bench, state, after, candidate, train, test, count + screening.tried - 1)
    return Trial(candidate, after, train, test, screening, objection)


def _beside(
    bench: Workbench, state: State, chosen: Trial, trial: Trial, alike: Sequence[_Likeness], count: int
) -> Trial:
    """A trial that is behind the chosen one, fitted again from the chosen solution if it acts alike; else as it is.

    Two effects with one signature explain a record equally well, and a fit of one of them that stopped early, or a
    screening that saw no trace of it where the other was missing, must not hide that.
    """
    ways = [way for way in alike if abs(way.cosine) >= ALIKE]
    if not ways or trial.screening.seen < SEEN or _tie(bench, chosen, trial, alike):
        return trial
    assert chosen.state is not None
    path, other = chosen.candidate.paths[0], trial.candidate.paths[0]
    found = [trial]
    for way in ways:
        values = {path: value_at(state.plant, path), other: spec_at(state.plant, other).neutral + way.size}
        values |= {p: value_at(chosen.state.plant, p) + move for p, move in way.moves.items()}
        bounded = {p: float(np.clip(value, *spec_at(state.plant, p).bounds)) for p, value in values.items()}
        plant, starts = replace_at(chosen.state.plant, bounded), chosen.state.train.starts
        found.append(_judged(bench, state, trial.candidate, trial.screening, plant, starts, count))
    return max(found, key=lambda t: t.total)


@dataclass(frozen=True)
class _Likeness:
    """How alike two effects act at the solution with one of them: by the angle between their signatures.

    size: of the other one, from neutral, that does the same.  evidence: what the difference between them amounts to.
    moves: changes of what else was fitted that go with it.
    """

    cosine: float
    size: float
    evidence: float
    moves: Mapping[str, float]


def _likenesses(bench: Workbench, chosen: Trial, other: Trial) -> list[_Likeness]:
    """The likeness of two effects of one component each, by themselves, and with all else that is fitted refitted.

    Empty where an effect has more components.  A pump's gain is a valve's only if the drag may change with it.
    """
    if len(chosen.candidate.paths) > 1 or len(other.candidate.paths) > 1:
        return []
    assert chosen.state is not None
    paths, here, problem = (*chosen.candidate.paths, *other.candidate.paths), chosen.state.train, bench.train
    beside = [p for p in chosen.state.paths if p not in paths]
    signatures = problem.linearise(here, (*paths, *beside), problem.sigma(here), problem.steps[-1]).columns
    columns = signatures.reshape(len(signatures), -1)
    moved = value_at(chosen.state.plant, paths[0]) - spec_at(problem.plant, paths[0]).neutral
    moved /= problem.scale(paths[0])
    found = []
    for fitted in ([], beside):
        given = columns[2 : 2 + len(fitted)].T
        imitated = np.linalg.lstsq(given, columns[:2].T, rcond=1e-10)[0]
        one, two = columns[:2] - imitated.T @ given.T
        own, its = float(np.linalg.norm(one)), float(np.linalg.norm(two))
        if min(own, its) < 1e-9 or (fitted and min(own, its) < SAME * np.linalg.norm(columns[:2], axis=1).max()):
            continue
        cosine = float(one @ two / (own * its))
        size = cosine * moved * own / its
        changes = moved * imitated[:, 0] - size * imitated[:, 1]
        moves = {p: float(c) * problem.scale(p) for p, c in zip(fitted, changes, strict=True)}
        evidence = (1.0 - cosine**2) * (moved * own) ** 2
        found.append(_Likeness(cosine, size * problem.scale(paths[1]), evidence, moves))
    return found


def _objection(bench, before: State, after: State, candidate: Candidate, train: float, held: float, count: int) -> str:
    sizes, at_bound = [], False
    for path in candidate.paths:
        spec, value = spec_at(after.plant, path), value_at(after.plant, path)
        sizes.append(abs(value - spec.neutral) / spec.probe)
        reach = spec.bounds[1] - spec.bounds[0]
        edges = [edge for edge in spec.bounds if edge != spec.neutral]
        at_bound |= any(abs(value - edge) < 1e-6 * reach for edge in edges)
    if train + held < threshold(count, len(candidate.free)):
        return "not significant"
    if held < max(HELD_LEAST, HELD_SHARE * train):
        return "does not hold in the held-out windows"
    if not _holds(bench, before, after):
        return "free runs in the held-out windows did not improve in enough of them"
    if at_bound:
        return "only helps at the limit of what is physical"
    if max(sizes) < 1.0:
        return "smaller than its probe"
    intervals = bench.intervals(after)
    if all(
        abs(intervals[p][0] - spec_at(after.plant, p).neutral) < SURE / 1.96 * intervals[p][2] for p in candidate.paths
    ):
        return "its size is too uncertain"
    return ""


def _holds(bench: Workbench, before: State, after: State) -> bool:
    """Whether free runs through the held-out windows got better, window by window; True where these are few.

    In a few windows the noise of their first seconds, to which the initial states are fitted, decides; there the
    evidence, for which the states are fitted to the whole window, has to do.
    """
    if len(bench.held.windows) < MANY_WINDOWS:
        return True
    unit = bench.held.sigma(after.held) ** 2
    better = ((bench.free_run_errors(before.plant) - bench.free_run_errors(after.plant)) / unit).sum(axis=1)
    return bool(np.asarray(stats.wilcoxon(better, alternative="greater"))[1] < HELD_RANKS)


def _first_values(plant: Plant, screening: Screening) -> list[tuple[float, ...]]:
    """Where to start a fit: at the screening's estimate, one probe off neutral on the side it points to, and opposite.

    Coefficients that were fitted without the effect may turn the estimate's sign, and a fit then stays on that side.
    """
    starts = []
    for far in (False, True):
        values = []
        for path, estimate in zip(screening.candidate.paths, screening.estimate, strict=True):
            spec = spec_at(plant, path)
            side = 1.0 if estimate >= 0.0 or spec.bounds[0] >= spec.neutral else -1.0
            if screening.candidate.kinked:
                side = 1.0
            size = np.clip(abs(estimate), 1.0, 12.0) if far else 1.0
            values.append(float(np.clip(spec.neutral + side * size * spec.probe, *spec.bounds)))
        starts.append(tuple(values))
    if screening.candidate.kinked:
        starts.append(
            tuple(
                min(v + 5.0 * spec_at(plant, p).probe, spec_at(plant, p).bounds[1])
                for p, v in zip(screening.candidate.paths, starts[0], strict=True)
            )
        )
    elif len(screening.candidate.paths) == 1:
        spec = spec_at(plant, screening.candidate.paths[0])
        opposite = float(np.clip(2.0 * spec.neutral - starts[0][0], *spec.bounds))
        starts += [(opposite,)] * (opposite != spec.neutral)
    return list(dict.fromkeys(starts))


def _best(bench: Workbench, accepted: Sequence[Trial]) -> Trial:
    """The accepted trial of least cost over all windows, all measured by one colour and variance of the residuals."""
    top = max(accepted, key=lambda t: t.total)
    return min(accepted, key=lambda t: _extra_cost(bench, top, t).sum() + 2.0 * len(t.candidate.paths))


def _extra_cost(bench: Workbench, best: Trial, other: Trial) -> np.ndarray:
    """What another trial costs more than the best, per window."""
    assert best.state is not None
    assert other.state is not None
    return bench.costs(other.state, best.state) - bench.costs(best.state, best.state)


def _tie(bench: Workbench, best: Trial, other: Trial, alike: Sequence[_Likeness]) -> bool:
    """Whether the record does not tell two candidates apart (Vuong 1989, with the windows as the sample).

    Also where their signatures differ by less than that: a fit that stopped a little early is no difference.
    """
    if other.state is None or other.objection:
        return False
    if any(way.evidence < TIE or 1.0 - way.cosine**2 < SAME for way in alike):
        return True
    extra = _extra_cost(bench, best, other)
    error = float(np.std(extra) * np.sqrt(extra.size))
    return extra.sum() < TIE or (extra.sum() < TIE_ERRORS * error and extra.size >= MANY_WINDOWS)


def without_idle_parts(bench: Workbench, state: State, groups: Sequence[tuple[str, ...]]) -> State:
    """The state with components of a pair dropped whose size is within two standard errors and less than a probe."""
    sizes = bench.intervals(state)
    idle = [
        p
        for paths in groups
        if len(paths) > 1
        for p in paths
        if abs(sizes[p][0] - spec_at(state.plant, p).neutral) < max(2.0 * sizes[p][1], spec_at(state.plant, p).probe)
    ]
    if not idle:
        return state
    plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in idle})
    return bench.fit(plant, [p for p in state.paths if p not in idle], state)
