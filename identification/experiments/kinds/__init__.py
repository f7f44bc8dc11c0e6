"""The experiments with each kind of vehicle: one module per kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.designs import Design


@dataclass(frozen=True)
class Mission:
    """An experiment; settings: the names of its arguments, in SI, in addition to the plant and the generator.

    sampled: whether its sensors use `effects.sampling`; otherwise its own settings give the noise.
    """

    title: str
    settings: tuple[str, ...]
    make: Callable[..., Record]
    sampled: bool = False


@dataclass(frozen=True)
class ExperimentKind:
    """Experiments with a kind of vehicle.

    mission: the standard one.  designs: the candidates for the next experiment.  minutes: shortest sensible and longest
    allowed duration.  environment: the one in which a model of such a vehicle runs, if there is a single one.
    """

    mission: Callable[[Plant], Mission]
    designs: Callable[[Plant], tuple[Design, ...]]
    minutes: Callable[[Plant], tuple[float, float]]
    environment: str = ""


KINDS: Kinds[ExperimentKind] = Kinds("identification.experiments.kinds", "There are experiments with")
