"""Which candidates a record does not tell from the chosen one: by evidence, and by the angle between signatures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import spec_at, value_at
from identification.diagnosis.candidates import Candidate
from identification.diagnosis.trials import MANY_WINDOWS, SMALL, Trial
from identification.diagnosis.workbench import Workbench

ALIKE = 0.99  # cosine between two signatures from which on one effect is fitted again where the other one succeeded
SAME = 1e-4  # 1 - cosine^2 between signatures below which two effects count as one: difference quotients see no more
EQUAL = 0.01  # evidence between two candidates that stopped fits alone may make
TIE = 9.0  # evidence between two candidates below which a record does not tell them apart: three standard errors
TIE_ERRORS = 1.64  # the same where windows disagree among themselves, in standard errors over the windows


@dataclass(frozen=True)
class Likeness:
    """How alike two effects act at the solution with one of them: by the angle between their signatures.

    size: of the other one, from neutral, that does the same.  evidence: what the difference between them amounts to.
    moves: changes of what else was fitted that go with it.
    """

    cosine: float
    size: float
    evidence: float
    moves: Mapping[str, float]


def likenesses(bench: Workbench, chosen: Trial, others: Sequence[Trial]) -> dict[Candidate, list[Likeness]]:
    """The likenesses of others to the chosen one, by themselves, and with all else that is fitted refitted.

    None where an effect has more components.  A pump's gain is a valve's only if the drag may change with it.
    """
    found: dict[Candidate, list[Likeness]] = {t.candidate: [] for t in others}
    single = [t.candidate for t in others if len(t.candidate.paths) == 1]
    if len(chosen.candidate.paths) != 1 or not single:
        return found
    assert chosen.state is not None
    path, here, problem = chosen.candidate.paths[0], chosen.state.train, bench.train
    beside = [p for p in chosen.state.paths if p != path]
    paths = [path, *beside, *(c.paths[0] for c in single)]
    signatures = problem.linearise(here, paths, problem.sigma(here), problem.steps[-1]).columns
    flat, apart = signatures.reshape(len(paths), -1), 1 + len(beside)
    own, given, theirs = flat[:1], flat[1:apart], flat[apart:]
    moved = value_at(chosen.state.plant, path) - spec_at(problem.plant, path).neutral
    moved /= problem.scale(path)
    nothing: list[str] = []
    for fitted, basis in [(nothing, given[:0]), (beside, given)]:
        columns = np.concatenate([own, theirs])
        imitated = np.linalg.lstsq(basis.T, columns.T, rcond=1e-10)[0]
        rest = columns - imitated.T @ basis
        sizes, whole = np.linalg.norm(rest, axis=1), np.linalg.norm(columns, axis=1)
        for k, candidate in enumerate(single, start=1):
            least, most = min(sizes[0], sizes[k]), max(whole[0], whole[k])
            if least < 1e-9 or (fitted and least < SAME * most) or candidate.paths[0] in beside:
                continue
            cosine = float(rest[0] @ rest[k] / (sizes[0] * sizes[k]))
            size = cosine * moved * sizes[0] / sizes[k]
            changes = moved * imitated[:, 0] - size * imitated[:, k]
            moves = {p: float(c) * problem.scale(p) for p, c in zip(fitted, changes, strict=True)}
            evidence = float((1.0 - cosine**2) * (moved * sizes[0]) ** 2)
            found[candidate].append(Likeness(cosine, size * problem.scale(candidate.paths[0]), evidence, moves))
    return found


def best_of(bench: Workbench, accepted: Sequence[Trial]) -> Trial:
    """The accepted trial of least cost over all windows, all measured by one colour and variance of the residuals.

    Of trials that differ by no more than a fit leaves open, the first one in the order of the vehicle's parameters.
    """
    top = max(accepted, key=lambda t: t.total)
    costs = [float(_extra_cost(bench, top, t).sum()) + 2.0 * len(t.candidate.paths) for t in accepted]
    near = [t for t, cost in zip(accepted, costs, strict=True) if cost <= min(costs) + EQUAL]
    return min(near, key=lambda t: bench.train.index[t.candidate.paths[0]])


def _extra_cost(bench: Workbench, best: Trial, other: Trial) -> np.ndarray:
    """What another trial costs more than the best, per window."""
    assert best.state is not None
    assert other.state is not None
    return bench.costs(other.state, best.state) - bench.costs(best.state, best.state)


def tied(bench: Workbench, best: Trial, other: Trial, alike: Sequence[Likeness]) -> bool:
    """Whether the record does not tell two candidates apart (Vuong 1989, with the windows as the sample).

    Also where their signatures differ by less than that: a fit that stopped a little early is no difference.
    """
    if other.state is None or other.objection not in ("", SMALL):
        return False
    if any(way.evidence < TIE or 1.0 - way.cosine**2 < SAME for way in alike):
        return True
    extra = _extra_cost(bench, best, other)
    error = float(np.std(extra) * np.sqrt(extra.size))
    return extra.sum() < TIE or (extra.sum() < TIE_ERRORS * error and extra.size >= MANY_WINDOWS)
