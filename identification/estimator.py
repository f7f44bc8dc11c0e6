"""What every identification method is and gives: settings in the constructor, records into `fit`, a new result out."""

from __future__ import annotations

from typing import Protocol

from auv_gym.model import Model
from auv_gym.record import Record


class Fit(Protocol):
    """The result of a fit; `model` runs wherever a Model runs."""

    @property
    def model(self) -> Model: ...


class Estimator(Protocol):
    """A method with its settings; `fit` changes nothing in it and raises ValueError if the data cannot do."""

    def fit(self, *records: Record) -> Fit: ...
