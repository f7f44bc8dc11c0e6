"""Detectable sizes: the smallest size of each candidate that a record would have shown, or why it cannot show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import spec_at
from identification.diagnosis.judge.effects import Detectable
from identification.diagnosis.search.candidates import Regression, Screening, deviations_shown
from identification.diagnosis.wording import quantity

_NOTHING = 1e-3  # of the change that the record would show; an effect that changes less is taken to change nothing
_STEP = 2.0  # ratio between one tried size and the next
_HALVINGS = 2  # bisections of the last of these steps
_FEWEST = 1e-3  # probes; no smaller size is tried


@dataclass(frozen=True)
class Shown:
    """The smallest size that a record shows, infinite if none; hidden: the size up to which nothing changes."""

    size: float
    hidden: float = 0.0


def detectable_effects(
    regression: Regression, screening: Sequence[Screening], named: set[str]
) -> tuple[Detectable, ...]:
    """Each candidate that is not named, with the smallest size that the record would have shown.

    For smooth effects, the slope at a probe gives the size.  Effects with a corner at neutral are run at several sizes:
    a lag hides a rate limit up to some size, and a saturation above the largest command does nothing.
    An effect that acts like a refitted coefficient has no size of its own: it would show as a change of that
    coefficient.
    """
    plant = regression.problem.plant
    refitted = {effect: path for effect, path in plant.twins.items() if path in regression.fitted}
    sizes = [(s, path, size) for s in screening for path, size in zip(s.candidate.paths, s.detectable, strict=True)]
    sizes = [(s, path, float(size)) for s, path, size in sizes if path not in named]
    shown = sizes_shown(regression, {path: size for s, path, size in sizes if s.candidate.kinked})
    result = []
    for s, path, size in sizes:
        spec = spec_at(plant, path)
        found = shown.get(path, Shown(size))
        size, reason, far = found.size, "", max(abs(bound - spec.neutral) for bound in spec.bounds)
        if found.hidden >= far or (path not in shown and not np.isfinite(size)):
            reason = s.unseen or "changes nothing that was measured"
        elif size > far:
            imitated = s.unseen if s.seen > 0.0 else ""
            size, reason = np.inf, imitated or "changes too little of what was measured"
        elif found.hidden > 0.0:
            reason = f"up to {quantity(found.hidden, spec.unit)}, it changes nothing that was measured"
        if path in refitted:
            size, reason = np.inf, f"{spec_at(plant, refitted[path]).title} has the same effect"
        result.append(Detectable(path, spec.title, spec.unit, size, reason))
    return tuple(result)


def sizes_shown(regression: Regression, expected: Mapping[str, float]) -> dict[str, Shown]:
    """The smallest size of each effect that a record shows, found by running the vehicle with several sizes of it.

    expected: where the search starts, in the parameters' units (for example the size by the slope); if infinite, it
    starts at a probe.
    """
    problem, bar = regression.problem, deviations_shown(regression.threshold)
    most = {path: problem.bounds(path)[1] / problem.scale(path) for path in expected}
    begin = {path: size / problem.scale(path) if np.isfinite(size) else 1.0 for path, size in expected.items()}
    tried: dict[str, dict[float, float]] = {path: {0.0: 0.0} for path in expected}

    def run(sizes: Mapping[str, float]) -> None:
        for path, change in regression.shown(sizes).items() if sizes else ():
            tried[path][sizes[path]] = change

    def bracket(path: str) -> tuple[float, float]:
        """The largest size that is hidden, and the smallest larger one that is shown (infinite if none is yet)."""
        seen = min((size for size, change in tried[path].items() if change >= bar), default=np.inf)
        return max(size for size in tried[path] if size < seen), seen

    going = {path: float(np.clip(begin[path], _FEWEST, most[path])) for path in expected}
    while going:
        run(going)
        going = _next(going, {path: bracket(path) for path in going}, most)
    for _ in range(_HALVINGS):
        between = {path: bracket(path) for path in expected}
        run({path: float(np.sqrt(low * high)) for path, (low, high) in between.items() if low > 0.0 and high < np.inf})
    found = {path: _between(tried[path], *bracket(path), bar) for path in expected}
    half = {path: size / _STEP for path, size in found.items() if np.isfinite(size)}
    run(half)
    shown = {}
    for path, size in found.items():
        hidden = max(s for s, change in tried[path].items() if s < size and change <= _NOTHING * bar)
        scale = problem.scale(path)
        shown[path] = Shown(size * scale, hidden * scale if hidden >= half.get(path, 0.0) else 0.0)
    return shown


def _between(changes: Mapping[float, float], low: float, high: float, bar: float) -> float:
    """The size that is just shown, interpolated between two; the larger one if the smaller one changes nothing."""
    if not np.isfinite(high) or (low > 0.0 and changes[low] <= _NOTHING * bar):
        return high
    return low + (high - low) * (bar - changes[low]) / (changes[high] - changes[low])


def _next(
    going: Mapping[str, float], brackets: Mapping[str, tuple[float, float]], most: Mapping[str, float]
) -> dict[str, float]:
    """The next size to try for each effect that is not yet bracketed by a hidden and a shown size."""
    found = {}
    for path, size in going.items():
        low, high = brackets[path]
        if not np.isfinite(high) and size < most[path]:
            found[path] = min(_STEP * size, most[path])
        elif np.isfinite(high) and low == 0.0 and high > _FEWEST:
            found[path] = max(high / _STEP, _FEWEST)
    return found
