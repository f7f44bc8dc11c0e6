"""Forward selection of the effects that make a vehicle's predictions agree with held-out data."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auv_gym.param import spec_at
from auv_gym.threads import side_by_side
from identification.deciding import ALIKE, HOPELESS, IDLE, PLAIN, SAME, SEEN, SURPRISE, TIE
from identification.diagnosis.log.kinematics import Mismatch
from identification.diagnosis.search.acceptance import GONE, Weighed
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.ties import Likeness, cheaper_rival, imitations, least_cost_trial, likenesses, tied
from identification.diagnosis.search.trials import Progress, Trial, gate, judged, sure, trials_of
from identification.diagnosis.search.workbench import State, Workbench

LEADERS = 3  # most changes of the leading trial in a round
FURTHER = "looked for a further effect"  # the step that is left out if no time is left for another round


@dataclass(frozen=True, eq=False)
class Round:
    """One step of the forward selection: all trials, the chosen one, and those that the record cannot tell from it.

    angles: between the signatures of the chosen one and of others, degrees, by candidate.  evidence: for the chosen one
    in the final model against that model without it, and on held-out parts (`confirmed`).  before: without any trial.
    instead: coefficients that would otherwise be far from their stated values, if little else supports the chosen one.
    """

    trials: tuple[Trial, ...]
    chosen: Trial | None
    tied: tuple[Trial, ...]
    angles: dict[Candidate, float]
    evidence: tuple[float, float] = (0.0, 0.0)
    before: State | None = None
    instead: tuple[str, ...] = ()


def attribute(
    bench: Workbench,
    start: State,
    candidates: Sequence[Candidate],
    most: int,
    sensors: Sequence[Mismatch],
    progress: Progress,
    sought: Collection[str],
) -> tuple[State, list[Round]]:
    """Forward selection of up to `most` effects; returns the final fitted state and its rounds.

    sensors: kinematic findings about them, which decide if runs cannot tell a sensor from a force.  Plain kinematic
    findings come before any force.  sought: paths that are fitted to the end whatever they promise.

    Each round screens every candidate by regression, fits the promising ones jointly with everything fitted before, and
    accepts the one with most evidence if parts of the record predict it of each other.
    """
    state, rounds, left, count = start, [], list(candidates), len(candidates)
    for number in range(most + 1 if left else 0):
        if number and not bench.goes_on(FURTHER):
            break
        done, share = number / (most + 1), 1.0 / (most + 1)
        made = selected(
            bench,
            state,
            left,
            count,
            sensors,
            lambda f, text, d=done, s=share: progress(d + s * f, text),
            number < most,
            sought,
        )
        rounds.append(made)
        if made.chosen is None:
            break
        assert made.chosen.state is not None
        # one fit a round from the given coefficients, however far behind they are at first; trials could not afford it
        state = bench.likelier_from_given(made.chosen.state, np.inf)
        left = [c for c in left if c is not made.chosen.candidate]
        if bench.in_suited_steps(state) is not bench:  # everything after it would be repeated
            break
    return state, rounds


def selected(
    bench: Workbench,
    state: State,
    left: Sequence[Candidate],
    count: int,
    sensors: Sequence[Mismatch],
    progress: Progress = lambda fraction, text: None,
    more: bool = True,
    sought: Collection[str] = (),
) -> Round:
    """One round beside everything fitted before; nothing is chosen if no trial is accepted or no `more` are wanted.

    count: of all candidates, for the bar.  sought: as in `attribute`.
    """
    plain = {path for m in sensors if m.evidence >= PLAIN for path in (m.path, *m.tied)}
    trials = trials_of(bench, state, left, count, progress, {*plain, *sought})
    accepted = [t for t in trials if not t.objection]
    if not more:
        return Round(tuple(trials), None, (), {}, before=state)
    known = [t for t in accepted if not plain.isdisjoint(t.candidate.paths)]
    best, trials = _first_sure(bench, state, trials, known, count)
    if best is not None:
        accepted = known
    else:
        best, trials = _first_sure(bench, state, trials, [t for t in accepted if t not in known], count)
    if best is None:
        return Round(tuple(trials), None, (), {}, before=state)
    for _ in range(LEADERS):  # an effect like the chosen one may do better when started from its solution
        chosen = best
        others = [t for t in trials if t.candidate is not chosen.candidate]
        alike = likenesses(bench, chosen, others)
        if not bench.goes_on("fitted effects like those it names again"):
            break
        others = side_by_side(partial(_beside, bench, state, chosen, alike, count), others)
        rivals = [t for t in others if not t.objection and t not in accepted]
        while (best := cheaper_rival(bench, chosen, rivals)) is not chosen:
            passed = sure(bench, state, best, count)
            others = [passed if t is best else t for t in others]
            rivals = [t for t in rivals if t is not best]
            if not passed.objection:
                best = passed
                break
        trials = [chosen, *others]
        if best is chosen:
            break
    others = [_if_tied(bench, state, chosen, t, alike[t.candidate], count) for t in others]
    trials = [chosen, *others]
    group = [t for t in others if tied(bench, chosen, t, alike[t.candidate])]
    chosen, group = _by_kinematics(chosen, group, sensors)
    return Round(tuple(trials), chosen, tuple(group), _angles(alike), before=state)


def _first_sure(
    bench: Workbench, state: State, trials: Sequence[Trial], accepted: Sequence[Trial], count: int
) -> tuple[Trial | None, list[Trial]]:
    """The trial of least cost, among the accepted ones, that is `sure`, and all trials with the result of that test."""
    trials, left = list(trials), list(accepted)
    while left:
        best = least_cost_trial(bench, left)
        passed = sure(bench, state, best, count)
        trials, left = [passed if t is best else t for t in trials], [t for t in left if t is not best]
        if not passed.objection:
            return passed, trials
    return None, trials


def _if_tied(
    bench: Workbench, state: State, chosen: Trial, other: Trial, alike: Sequence[Likeness], count: int
) -> Trial:
    """A trial, after the complete gate if it is tied with the chosen one and does not have the same signature."""
    same = any(1.0 - way.cosine**2 < SAME for way in alike)
    return other if same or not tied(bench, chosen, other, alike) else sure(bench, state, other, count)


def _by_kinematics(chosen: Trial, group: list[Trial], sensors: Sequence[Mismatch]) -> tuple[Trial, list[Trial]]:
    """The chosen one of a tie and the rest of it, after the kinematic findings are applied."""
    for mismatch in sensors:
        possible = {mismatch.path, *mismatch.tied}
        kept = [t for t in (chosen, *group) if not possible.isdisjoint(t.candidate.paths)]
        if kept and not any(t.objection for t in kept):
            return kept[0], kept[1:]
    return chosen, group


def _angles(alike: dict[Candidate, list[Likeness]]) -> dict[Candidate, float]:
    """Degrees between signatures, with the other parameters refitted if that leaves anything of them."""
    return {c: float(np.rad2deg(np.arccos(w[-1].cosine))) for c, w in alike.items() if w}


def _beside(
    bench: Workbench,
    state: State,
    chosen: Trial,
    alike: Mapping[Candidate, Sequence[Likeness]],
    count: int,
    trial: Trial,
) -> Trial:
    """A trial behind the chosen one, refitted from the chosen solution if the two act alike; else unchanged.

    Two effects with one signature explain a record equally well.  A fit of one that stopped early, or a screening that
    saw no trace of it with the other missing, must not hide that.
    """
    own_alike = alike[trial.candidate]
    ways = [way for way in own_alike if way.cosine >= ALIKE]
    if not ways or trial.screening.seen < SEEN or tied(bench, chosen, trial, own_alike):
        return trial
    assert chosen.state is not None
    found, paths = [trial], (*state.paths, *trial.candidate.free)
    for plant in imitations(chosen, trial, ways):
        point = bench.problem.with_gains(chosen.state.point, plant.vector)
        if np.isfinite(point.scores).all():
            point = bench.problem.descended(point, paths)
            near = State(bench.problem.plant_at(point, paths), paths, point)
            if bench.gain(near, chosen.state) < HOPELESS:
                found.append(judged(bench, state, trial.candidate, trial.screening, near, count))
    return max(found, key=lambda t: (not t.objection, t.total))


def confirmed(
    bench: Workbench, nominal: State, state: State, rounds: Sequence[Round], count: int
) -> tuple[State, list[Round]]:
    """The state and the rounds with only those effects that pass the gate against the model without them.

    A later effect, a swap or the other effect of a pair may have made an effect idle, and what was accepted beside one
    set of effects must hold beside the final one.  The one with least evidence is removed first, since the others may
    pass without it.
    nominal: without any effect.
    """
    kept = list(rounds)
    while True:
        passed = [_in_place(bench, nominal, state, r, count) for r in kept]
        failed = [(found.total, i, without) for i, (found, without) in enumerate(passed) if found.objection]
        if not failed:
            return state, [
                replace(r, evidence=(w.train, w.held), instead=_instead(bench, without, state, w))
                for r, (w, without) in zip(kept, passed, strict=True)
            ]
        _, worst, state = min(failed, key=lambda item: item[:2])
        del kept[worst]


def _in_place(bench: Workbench, nominal: State, state: State, made: Round, count: int) -> tuple[Weighed, State]:
    """The result of the gate for a round's effect beside all the others, and the state without it."""
    if made.chosen is None:
        return Weighed(0.0, 0.0, ""), state
    own = [p for p in made.chosen.candidate.free if p in state.paths]
    if not own:
        return Weighed(0.0, 0.0, GONE), state
    alone = set(state.paths) - set(own) == set(nominal.paths)
    without = nominal if alone else bench.without(state, own)
    return gate(bench, without, state, [(made.chosen.candidate, made.chosen.screening)], count), without


def _instead(bench: Workbench, without: State, state: State, passed: Weighed) -> tuple[str, ...]:
    """The coefficients that replace an effect in a state without it, unless the record shows that they do not."""
    if passed.known <= 0.0 or passed.train - passed.known >= TIE:
        return ()
    paths = [p for p in without.paths if p in state.paths]
    far, near = (np.abs(bench.problem.pulls(s.point.vector, paths)[0]) for s in (without, state))
    return tuple(p for p, one, other in zip(paths, far, near, strict=True) if one > SURPRISE and other < 0.5 * one)


def settled(
    bench: Workbench, nominal: State, state: State, rounds: Sequence[Round], count: int
) -> tuple[State, list[Round]]:
    """The result of a search, without idle components of pairs, and confirmed."""
    state = without_idle_parts(bench, state, [r.chosen.candidate.paths for r in rounds if r.chosen is not None])
    return confirmed(bench, nominal, state, rounds, count)


def without_idle_parts(bench: Workbench, state: State, groups: Sequence[tuple[str, ...]]) -> State:
    """The state without those components of pairs whose size is within two standard errors of neutral."""
    pairs = [paths for paths in groups if len(paths) > 1]
    sizes = bench.intervals(state) if pairs else {}
    idle = [
        p for paths in pairs for p in paths if abs(sizes[p][0] - spec_at(state.plant, p).neutral) < IDLE * sizes[p][1]
    ]
    if not idle:
        return state
    return bench.without(state, idle)
