"""Kinematic comparison of sensors: the error that one of them must have, whatever the forces were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from auv_gym.channels import channel
from auv_gym.param import list_paths, spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from auv_gym.records.time_axis import near_limit
from identification.deciding import (
    CLEARED,
    FEWEST_BLOCKS,
    KINEMATIC_BLOCK,
    LEAST_OF_BLOCK,
    NEARLY,
    PLAINLY,
    TIE,
    WORTH_TELLING,
)
from identification.diagnosis.log.kinematic_equations import Equation, segment_equations

MOST = 6


@dataclass(frozen=True)
class Mismatch:
    """A sensor effect that kinematics supports.

    evidence: twice the gain in log-likelihood.  tied: effects that would explain the same.  between: titles of the
    equations that it improves.
    """

    path: str
    value: float
    ci95: tuple[float, float]
    unit: str
    evidence: float
    tied: tuple[str, ...]
    between: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class Clear:
    """A sensor effect that kinematics can determine from the record and finds neutral."""

    path: str
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Kinematics:
    """The kinematic findings about a record's sensors.

    equations: the comparisons that were possible, in words.
    """

    mismatches: tuple[Mismatch, ...]
    clears: tuple[Clear, ...]
    equations: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _System:
    """The equations of all segments as one whitened regression: y = X theta + noise of unit variance.

    block: the block of each row, `group` its equation.
    """

    paths: tuple[str, ...]
    titles: tuple[str, ...]
    x: np.ndarray
    y: np.ndarray
    block: np.ndarray
    group: np.ndarray


def kinematic_findings(record: Record, plant: Plant) -> Kinematics:
    """The sensor effects and currents of a plant that kinematics supports, and those that it clears.

    Effects are selected one by one, the one with the most evidence first, as long as the evidence reaches `PLAINLY`
    standard errors and is significant over the blocks.  One that is too small to tell is not reported, but no other
    one takes its place.
    Intervals come from the scatter between blocks, so that noise may have any colour within a block.
    """
    system = _system(record, plant)
    if system is None:
        return Kinematics((), (), ())
    chosen: list[int] = []
    ties: list[list[int]] = []
    gains: list[float] = []
    for _ in range(MOST):
        rest = [k for k in range(len(system.paths)) if k not in chosen]
        rest = [k for k in rest if _possible(plant, system.paths[k], _estimate(system, [*chosen, k], k)[0])]
        before, loss = _loss(system, chosen), {k: _loss(system, [*chosen, k]) for k in rest}
        # limited to what the scatter over the blocks supports
        evidence = {k: min(before - loss[k], _errors(system, [*chosen, k]) ** 2) for k in rest}
        top = max(rest, key=lambda k: evidence[k], default=None)
        if top is None or evidence[top] < PLAINLY**2 or not _sure(system, [*chosen, top]):
            break
        # among those with nearly as much evidence, the likelihood decides: it includes equations of little weight
        best = min((k for k in rest if evidence[k] > NEARLY * evidence[top]), key=lambda k: loss[k])
        ties.append([k for k in rest if k != best and loss[k] < loss[best] + TIE])
        gains.append(evidence[best])
        chosen.append(best)
    made = [_mismatch(system, plant, chosen, k, tied, gain) for k, tied, gain in zip(chosen, ties, gains, strict=True)]
    mismatches = [m for m in made if _worth_telling(plant, m.path, m.value)]
    suspected = {*chosen, *(k for tied in ties for k in tied)}
    clears = []
    for k in range(len(system.paths)):
        if k in suspected:
            continue
        value, half = _estimate(system, [*chosen, k], k)
        if abs(value) + half < CLEARED * spec_at(plant, system.paths[k]).probe:
            clears.append(Clear(system.paths[k], value, (value - half, value + half)))
    order = sorted(mismatches, key=lambda m: -m.evidence)
    return Kinematics(tuple(order), tuple(clears), system.titles)


def _possible(plant: Plant, path: str, value: float) -> bool:
    """Whether a value is within the effect's bounds."""
    low, high = spec_at(plant, path).bounds
    return low <= value <= high


def _worth_telling(plant: Plant, path: str, value: float) -> bool:
    """Whether a value is large enough to report."""
    return abs(value) > WORTH_TELLING * spec_at(plant, path).probe


def _mismatch(system: _System, plant: Plant, chosen: list[int], k: int, tied: Sequence[int], gain: float) -> Mismatch:
    path = system.paths[k]
    spec = spec_at(plant, path)
    value, half = _estimate(system, chosen, k)
    without = [j for j in chosen if j != k]
    before, after = _residual(system, without) ** 2, _residual(system, chosen) ** 2
    fall = np.bincount(system.group, before - after, minlength=len(system.titles))
    between = tuple(system.titles[g] for g in np.argsort(-fall) if fall[g] > 0.2 * fall.max())
    others = tuple(system.paths[j] for j in tied)
    unit = "" if spec.unit == "1" else f" {spec.unit}"
    text = (
        f"{between[0]} shows a {spec.title} of {value:.3g}{unit} (95 % interval {value - half:.3g} to "
        f"{value + half:.3g})"
    )
    if others:
        text += f", or an equivalent error: {', '.join(spec_at(plant, other).title for other in others)}"
    return Mismatch(path, value, (value - half, value + half), spec.unit, gain, others, between, text)


def _system(record: Record, plant: Plant) -> _System | None:
    """The whitened regression; None if no sensors can be compared."""
    known = [p for p in list_paths(plant) if p.startswith("effects.") and spec_at(plant, p).probe > 0.0]
    parts: dict[str, list[tuple[Equation, slice]]] = {}
    for block in _blocks(record):
        mask = np.zeros(len(record), dtype=bool)
        mask[block] = True
        for equation in segment_equations(_read_throughout(record.select(mask)), plant.inputs):
            parts.setdefault(equation.title, []).append((equation, block))
    parts = {title: found for title, found in parts.items() if len(found) >= FEWEST_BLOCKS}
    moved = {p for found in parts.values() for e, _ in found for p, c in e.columns.items() if np.ptp(c) > 0.0}
    paths = tuple(p for p in known if p in moved)
    if not paths:
        return None
    rows = [_whitened(found, paths) for found in parts.values()]
    x, y = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
    starts = np.concatenate([r[2] for r in rows])
    group = np.repeat(np.arange(len(rows)), [len(r[1]) for r in rows])
    return _System(paths, tuple(parts), x, y, np.unique(starts, return_inverse=True)[1], group)


def _read_throughout(block: Record) -> Record:
    """A block without the channels that were not read for a while: between far readings, the motion is unknown."""
    limit = near_limit(block.sample_interval)
    return block.without([n for n in block.names if not channel(n).held and block.longest_unread(n) > limit])


def _blocks(record: Record) -> list[slice]:
    samples = max(round(KINEMATIC_BLOCK / record.sample_interval), LEAST_OF_BLOCK)
    return [slice(a, a + samples) for s in record.segments for a in range(s.start, s.stop - samples + 1, samples)]


def _whitened(found: list[tuple[Equation, slice]], paths: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of one equation minus their block means, as unit-variance innovations of a first-order process."""
    xs, ys, blocks = [], [], []
    for equation, block in found:
        x = np.stack([equation.columns.get(p, np.zeros(len(equation.rest))) for p in paths], axis=1)
        keep = np.isfinite(equation.rest) & np.isfinite(x).all(axis=1)
        if keep.sum() < LEAST_OF_BLOCK // 2:
            continue
        xs.append(x[keep] - x[keep].mean(axis=0))
        ys.append(equation.rest[keep] - equation.rest[keep].mean())
        blocks.append(np.full(int(keep.sum()), block.start))
    edges = np.cumsum([0, *(len(y) for y in ys)])
    x, y = np.concatenate(xs), np.concatenate(ys)
    size = np.sqrt((x**2).mean(axis=0))
    size[size == 0.0] = 1.0
    x = x / size
    first = np.zeros(len(y), dtype=bool)
    first[edges[:-1]] = True
    phi = 0.0
    for _ in range(3):  # alternate between the correlation of the residual and the effects given that correlation
        u, v = (_innovations(a, phi, first) for a in (x, y))
        rest = y - x @ np.linalg.lstsq(u, v, rcond=1e-9)[0]
        inner = ~first
        phi = float(np.clip(rest[inner] @ np.roll(rest, 1)[inner] / max(float(rest @ rest), 1e-300), 0.0, 0.995))
    u, v = (_innovations(a, phi, first) for a in (x, y))
    rest = v - u @ np.linalg.lstsq(u, v, rcond=1e-9)[0]
    scale = max(float(np.sqrt(np.mean(rest**2))), 1e-12)
    return u * size / scale, v / scale, np.concatenate(blocks)


def _innovations(values: np.ndarray, phi: float, first: np.ndarray) -> np.ndarray:
    changed = values - phi * np.roll(values, 1, axis=0)
    changed[first] = values[first] * np.sqrt(1.0 - phi**2)
    return changed


def _residual(system: _System, chosen: Sequence[int]) -> np.ndarray:
    if not len(chosen):
        return system.y
    x = system.x[:, list(chosen)]
    x = x / np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-300)
    return system.y - x @ np.linalg.lstsq(x, system.y, rcond=1e-9)[0]


def _loss(system: _System, chosen: Sequence[int]) -> float:
    """Minus twice the log-likelihood of the chosen effects, up to a constant."""
    rest = _residual(system, chosen)
    return len(rest) * float(np.log(max(float(rest @ rest), 1e-300)))


def _estimate(system: _System, chosen: Sequence[int], k: int) -> tuple[float, float]:
    """The value of an effect beside the chosen ones, and half its 95 % interval, from the scatter of the blocks."""
    x = system.x[:, list(chosen)]
    size = np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-300)
    bread = np.linalg.pinv((x / size).T @ (x / size), rcond=1e-9, hermitian=True)
    value = bread @ ((x / size).T @ system.y)
    rest = system.y - (x / size) @ value
    count = int(system.block.max()) + 1
    scores = np.zeros((count, len(chosen)))
    np.add.at(scores, system.block, (x / size) * rest[:, None])
    place = list(chosen).index(k)
    robust = (bread @ (scores.T @ scores) @ bread)[place, place] * count / max(count - 1, 1)
    plain = bread[place, place] * float(np.mean(rest**2))
    half = float(stats.t.ppf(0.975, _freedom(system))) * np.sqrt(max(robust, plain))
    return float(value[place] / size[place]), float(half / size[place])


def _sure(system: _System, chosen: Sequence[int]) -> bool:
    """Whether the last of these effects is significant at the level of `PLAINLY`, given the few blocks."""
    bar = stats.t.isf(stats.norm.sf(PLAINLY), _freedom(system))
    return bool(_errors(system, chosen) > bar)


def _errors(system: _System, chosen: Sequence[int]) -> float:
    """Distance of the last of these effects from neutral, in its standard errors over the blocks."""
    value, half = _estimate(system, chosen, chosen[-1])
    error = half / stats.t.ppf(0.975, _freedom(system))
    return float(abs(value) / error) if error > 0.0 else 0.0


def _freedom(system: _System) -> int:
    """Degrees of freedom of the scatter over the blocks."""
    return max(int(system.block.max()), 1)
