"""What may be missing: the candidate effects of a vehicle, and how far a record could tell each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import list_paths, spec_at, value_at
from auv_gym.plant import Plant
from identification.shooting import Point, Shooting, whitened

# Two components of one physical thing are one candidate; a component that turns out small is dropped at the end.
TOGETHER = (
    ("compass deviation", ("effects.compass.deviation_sin", "effects.compass.deviation_cos")),
    ("steady current", ("effects.current.north", "effects.current.east")),
)
SEEN = 1e-4  # share of a signature that must remain beside the coefficients' and the initial states' signatures
KINKED = ("deadband", "backlash", "dead_time", "lag", "slowness", "lost_travel")


@dataclass(frozen=True)
class Candidate:
    """One effect, or the components of one, that the vehicle may lack."""

    title: str
    paths: tuple[str, ...]

    @property
    def kinked(self) -> bool:
        """Whether it works in one direction from its neutral value, with a corner there."""
        return self.paths[0].rpartition(".")[2] in KINKED


@dataclass(frozen=True)
class Screening:
    """What the regression of the residual on a candidate's signature says before any fit.

    estimate: (len(paths),), in probes.  evidence: twice the gain in log-likelihood that it promises.
    seen: share of the signature that neither coefficients nor initial states can imitate.
    detectable: (len(paths),), the size in the parameters' units that this record would show with 95 % probability.
    absorbed_by: the coefficient that imitates it, if one does.
    """

    candidate: Candidate
    estimate: np.ndarray
    evidence: float
    seen: float
    detectable: np.ndarray
    absorbed_by: str = ""


def candidates_of(plant: Plant) -> list[Candidate]:
    """Every effect that the plant has at its neutral value and that may be probed, pairs together."""
    free = [
        path
        for path in list_paths(plant)
        if path.startswith("effects.")
        and spec_at(plant, path).probe > 0.0
        and value_at(plant, path) == spec_at(plant, path).neutral
    ]
    found, used = [], set()
    for path in free:
        if path in used:
            continue
        title, paths = next(((t, p) for t, p in TOGETHER if path in p), (spec_at(plant, path).title, (path,)))
        paths = tuple(p for p in paths if p in free)
        used.update(paths)
        found.append(Candidate(title, paths))
    return found


def screen(
    problem: Shooting,
    point: Point,
    fitted: Sequence[str],
    candidates: Sequence[Candidate],
    colour: np.ndarray,
    threshold: float,
) -> list[Screening]:
    """Regression of the free-run residual on each candidate's signature, most promising first.

    A signature is the change of the outputs when the candidate leaves neutral by one probe, aligned in time because it
    is simulated, with what initial states and fitted coefficients can imitate taken out.
    threshold: the evidence that a finding needs, for the detectable sizes.
    """
    paths = [p for c in candidates for p in c.paths]
    sigma = problem.sigma(point)
    probes = problem.linearise(point, paths, sigma, step=1.0)
    base = problem.linearise(point, list(fitted), sigma)
    scale = np.maximum(_spread(problem, point, colour, sigma), 1e-9)

    def flat(columns):
        return (whitened(problem, columns, colour) / scale).reshape(len(columns), -1)

    residual = flat((point.residual / sigma)[None])[0]
    nuisance = flat(base.columns)
    signatures = flat(probes.columns)
    if len(nuisance):
        q, _ = np.linalg.qr(nuisance.T)
        rest, left = signatures - (signatures @ q) @ q.T, residual - q @ (q.T @ residual)
    else:
        rest, left = signatures, residual
    result, row = [], 0
    for candidate in candidates:
        span = slice(row, row + len(candidate.paths))
        row = span.stop
        own, whole = rest[span], signatures[span]
        size = np.einsum("ij,ij->i", own, own)
        full = np.einsum("ij,ij->i", whole, whole)
        seen = float(np.min(size / np.maximum(full, 1e-30))) if np.all(probes.raw[span] > 1e-9) else 0.0
        if not np.any(full > 1e-12):
            seen = 0.0
        absorbed = ""
        if seen < SEEN and np.any(full > 1e-12) and len(nuisance):
            overlap = [abs(whole[0] @ n) / np.sqrt(full[0] * (n @ n) + 1e-30) for n in nuisance]
            absorbed = fitted[int(np.argmax(overlap))] if max(overlap) > 0.9 else ""
        gram = own @ own.T
        if seen >= SEEN:
            estimate = np.linalg.lstsq(gram, own @ left, rcond=1e-10)[0]
            promised = float(estimate @ (own @ left))
            deviations = np.sqrt(np.diag(np.linalg.pinv(gram, hermitian=True)))
            units = np.array([problem.scale(p) for p in candidate.paths])
            detectable = (
                np.maximum(np.sqrt(threshold), 1.0 / deviations) * deviations * units + 1.645 * deviations * units
            )
        else:
            estimate, promised = np.zeros(len(candidate.paths)), 0.0
            detectable = np.full(len(candidate.paths), np.inf)
        result.append(Screening(candidate, estimate, promised, seen, detectable, absorbed))
    return sorted(result, key=lambda s: -s.evidence)


def _spread(problem: Shooting, point: Point, colour: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Root mean square of the innovations of the scaled residual, per channel."""
    e = whitened(problem, point.residual / sigma, colour)
    return np.sqrt((e**2).sum(axis=0) / np.maximum(problem.counts, 1))
