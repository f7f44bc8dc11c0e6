"""The experiments with each kind of vehicle: one module a kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.designs import Design


@dataclass(frozen=True)
class Mission:
    """An experiment; settings: the names that it takes, in SI, beside the plant and the generator.

    sampled: whether its sensors have `effects.sampling`; else its own settings say how noisy they are.
    """

    title: str
    settings: tuple[str, ...]
    make: Callable[..., Record]
    sampled: bool = False


@dataclass(frozen=True)
class ExperimentKind:
    """Experiments with a kind of vehicle.

    mission: the standard one.  designs: those from which the next one is chosen.  minutes: how long one should at
    least, and may at most, take.  environment: where a model of such a vehicle runs, if there is one such place.
    """

    mission: Callable[[Plant], Mission]
    designs: Callable[[Plant], tuple[Design, ...]]
    minutes: Callable[[Plant], tuple[float, float]]
    environment: str = ""


KINDS: Kinds[ExperimentKind] = Kinds("identification.experiments.kinds", "There are experiments with")
