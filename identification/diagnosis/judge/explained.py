"""How well a diagnosis explains its record: the share of the error that it removes, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

from identification.deciding import EXPLAINED, MANY_WINDOWS
from identification.diagnosis.judge.effects import Effect
from identification.diagnosis.judge.result import Stage, Verdict
from identification.fit.residual import noise_floors


def explained_share(before: Stage, after: Stage, many: bool) -> float:
    """Share of the squared error above the measurement noise that the effects remove.

    Computed from free runs in unseen parts of the record or, if there are not `many` windows, from runs whose initial
    states are fitted to whole windows.
    """
    fitted, excess = after.fitted, {}
    floors = noise_floors(fitted.residual, fitted.window, fitted.readings)
    for name, stage in (("before", before), ("after", after)):
        runs = stage.unseen if many else stage.fitted
        total = 0.0
        for c in range(len(runs.channels)):
            squares = runs.errors(c) ** 2
            total += max(float(squares.mean()) / floors[c] ** 2 - 1.0, 0.0) if squares.size else 0.0
        excess[name] = total
    return 1.0 - excess["after"] / excess["before"] if excess["before"] > 0.0 else 0.0


def many_windows(windows: Sequence[slice], steady: bool) -> bool:
    """Whether there are enough windows, and steady enough conditions, to judge by free runs."""
    return len(windows) >= MANY_WINDOWS and steady


def unsteady_of(effects: Sequence[Effect]) -> list[Effect]:
    """Effects whose size differs significantly between parts of the record, but not by dive; most significant first."""
    return sorted((e for e in effects if e.unsteady), key=lambda e: e.steady)


def verdict_of(
    effects: Sequence[Effect], tied, explained: float, left: bool, refit_is_all: bool, wrong: bool
) -> Verdict:
    """The verdict on a record.

    If something is left, effects must explain most of the excess error; a refit alone is not enough.  If the size of
    an effect differs between parts of the record, constant effects do not explain the record, however small the
    remaining error: they were fitted together, so the variation has leaked into all of their sizes.
    """
    if unsteady_of(effects) or (left and (refit_is_all or explained < EXPLAINED)):
        return "unexplained"
    if effects:
        return "tied" if tied else "named"
    return "coefficients" if wrong else "none"
