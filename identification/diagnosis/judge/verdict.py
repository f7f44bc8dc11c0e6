"""The result of a diagnosis, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass

from identification.diagnosis.judge.result import Result
from identification.diagnosis.judge.summary import paragraphs


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """The result of comparing a record with a vehicle, see `Result`; `summary` puts it into words."""

    def __repr__(self) -> str:
        found = ", ".join(f"{e.path} = {e.value:.3g} {e.unit}".strip() for e in self.effects) or "none"
        return f"Diagnosis({self.given.plant.name}: {self.verdict}; effects: {found}; summary() says more)"

    def summary(self) -> str:
        """The verdict in plain words, with the error before and after."""
        return " ".join(self.paragraphs())

    def paragraphs(self) -> list[str]:
        """The paragraphs of the summary; see `identification.diagnosis.judge.summary`."""
        return paragraphs(self)
