"""Ties: candidates that a record cannot tell from the chosen one, by evidence and by the angle of signatures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from identification.deciding import EQUAL, PRICE, SAME, SEEN, TIE
from identification.diagnosis.search.acceptance import UNREPEATED
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import Workbench


@dataclass(frozen=True)
class Likeness:
    """The similarity of two effects at the solution with one of them: by the angle between their signatures.

    sizes: of the other effect's components, from neutral, that act most similarly.  evidence: that of the difference
    between them.  moves: the accompanying changes of the other fitted parameters.
    """

    cosine: float
    sizes: tuple[float, ...]
    evidence: float
    moves: Mapping[str, float]


def likenesses(bench: Workbench, chosen: Trial, others: Sequence[Trial]) -> dict[Candidate, list[Likeness]]:
    """The likenesses of others to the chosen one, alone, and with all other fitted parameters refitted.

    The chosen one acts as fitted; an effect of several components may use them all to match it.  A pump's gain is like
    a valve's only if the drag may change with it.
    """
    found: dict[Candidate, list[Likeness]] = {t.candidate: [] for t in others}
    others = [t for t in others if t.candidate.sloped]  # the period of a neutral effect is arbitrary
    if not others:
        return found
    assert chosen.state is not None
    own, here, problem = chosen.candidate.paths, chosen.state.point, bench.problem
    beside = [p for p in chosen.state.paths if p not in own]
    paths = [*own, *beside, *(p for t in others for p in t.candidate.paths)]
    flat = problem.flat_slopes(here, paths)
    moved = np.array([value_at(chosen.state.plant, p) - spec_at(problem.plant, p).neutral for p in own])
    moved /= [problem.scale(p) for p in own]
    if chosen.candidate.jumps:  # its whole effect
        back = [(p, -float(size)) for p, size in zip(own, moved, strict=True)]
        flat[: len(own)] = problem.flattened(problem.columns_of(here, back))
    scale = float(np.linalg.norm(moved)) or 1.0
    basis = flat[len(own) : len(own) + len(beside)]
    columns = np.concatenate([(moved / scale) @ flat[: len(own)][None], flat[len(own) + len(beside) :]])
    for fitted, given in (([], basis[:0]), (beside, basis)):
        imitated = np.linalg.lstsq(given.T, columns.T, rcond=1e-10)[0]
        rest, row = columns - imitated.T @ given, 1
        size, whole = float(np.linalg.norm(rest[0])), float(np.linalg.norm(columns[0]))
        for t in others:
            rows = range(row, row + len(t.candidate.paths))
            row += len(rows)
            theirs = rest[rows]
            least = min(size, float(np.linalg.norm(theirs)))
            most = max(whole, float(np.linalg.norm(columns[rows])))
            if least < 1e-9 or (fitted and least < SEEN * most) or not set(beside).isdisjoint(t.candidate.paths):
                continue
            share = np.linalg.lstsq(theirs.T, rest[0], rcond=1e-10)[0]
            cosine = min(float(np.linalg.norm(share @ theirs)) / size, 1.0)
            changes = scale * (imitated[:, 0] - imitated[:, rows] @ share)
            moves = {p: float(c) * problem.scale(p) for p, c in zip(fitted, changes, strict=True)}
            sizes = [float(scale * x) * problem.scale(p) for p, x in zip(t.candidate.paths, share, strict=True)]
            evidence = float((1.0 - cosine**2) * (scale * size) ** 2)
            found[t.candidate].append(Likeness(cosine, tuple(sizes), evidence, moves))
    return found


def imitations(chosen: Trial, other: Trial, ways: Sequence[Likeness]) -> list[Plant]:
    """The vehicle of the chosen trial with another effect in its place that acts nearly the same, for each way."""
    assert chosen.state is not None
    here, found = chosen.state.plant, []
    for way in ways:
        values = {p: spec_at(here, p).neutral for p in chosen.candidate.paths}
        values |= {p: spec_at(here, p).neutral + x for p, x in zip(other.candidate.paths, way.sizes, strict=True)}
        values |= {p: value_at(here, p) + move for p, move in way.moves.items()}
        found.append(replace_at(here, {p: float(np.clip(v, *spec_at(here, p).bounds)) for p, v in values.items()}))
    return found


def least_cost_trial(bench: Workbench, accepted: Sequence[Trial]) -> Trial:
    """The likeliest accepted trial over all windows.

    If trials differ by no more than the precision of a fit, the first one in the order of the vehicle's parameters.
    """
    top = max(accepted, key=lambda t: t.total)
    costs = [float(_extra_cost(bench, top, t).sum()) + PRICE * len(t.candidate.paths) for t in accepted]
    near = [t for t, cost in zip(accepted, costs, strict=True) if cost <= min(costs) + EQUAL]
    return min(near, key=lambda t: bench.problem.index[t.candidate.paths[0]])


def cheaper_rival(bench: Workbench, chosen: Trial, rivals: Sequence[Trial]) -> Trial:
    """The rival of least cost, if it is cheaper by more than a tie; else the chosen one."""
    if not rivals:
        return chosen
    best = least_cost_trial(bench, [chosen, *rivals])
    return best if _extra_cost(bench, best, chosen).sum() > TIE else chosen


def _extra_cost(bench: Workbench, best: Trial, other: Trial) -> np.ndarray:
    """The cost of another trial above the best, per window."""
    assert best.state is not None
    assert other.state is not None
    return bench.costs(other.state) - bench.costs(best.state)


def tied(bench: Workbench, best: Trial, other: Trial, alike: Sequence[Likeness]) -> bool:
    """Whether the record as a whole cannot tell two candidates apart; for disagreement of its parts, see `survival`.

    They are also tied if their signatures differ by less than that, since a fit that stopped a little early is no
    difference.  A trial that only the parts refused is tied if it explains the whole as well as the best.
    """
    if other.state is None or other.objection not in ("", UNREPEATED):
        return False
    if other.objection == UNREPEATED:
        return bool(_extra_cost(bench, best, other).sum() <= 0.0)
    if any(way.evidence < TIE or 1.0 - way.cosine**2 < SAME for way in alike):
        return True
    return bool(_extra_cost(bench, best, other).sum() < TIE)
