"""A fitted parameter with its interval, the entry in every fit's list of parameters."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import stdtrit


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter.

    ci95: 95 % interval, infinite if the records do not determine the parameter; `problem` then says why.
    """

    path: str
    unit: str
    value: float
    error: float
    ci95: tuple[float, float]
    problem: str = ""

    @property
    def identifiable(self) -> bool:
        return not self.problem


def half_width(freedom: float) -> float:
    """Half-width of a 95 % interval in standard errors, by Student's t."""
    return float(stdtrit(freedom, 0.975))
