"""What no effect explains: a term found in the data, and where and when the errors are large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.judge.habitat import Habitat, residual_habitat
from identification.diagnosis.judge.reporting import Reported
from identification.diagnosis.judge.result import WORSE, Stage
from identification.diagnosis.judge.scoring import Scoring
from identification.diagnosis.search.discovery import Discovery, discover, library_of
from identification.diagnosis.search.remainder import what_is_left
from identification.diagnosis.search.workbench import State, Workbench


@dataclass(frozen=True, eq=False)
class Remaining:
    """The description of the remaining errors.

    after: the vehicle, with the discovered term if it holds.  habitat: where the error lives that still
    remains; None if random accelerations push the vehicle.
    """

    after: Stage
    discovery: Discovery | None = None
    habitat: Habitat | None = None


def what_remains(scoring: Scoring, found: Reported, after: Stage) -> Remaining:
    """A search for a term that explains what the effects leave, and a description of what then remains.

    The term is refused if it makes free runs in unseen parts of the record worse.
    """
    log, bench, state, extras = scoring.log, scoring.searched.known.bench, found.state, scoring.extras
    rng = np.random.default_rng(log.asked.seed)
    discovery = Discovery(state.plant, state.paths, state)
    library = library_of(state.plant)  # a family may have no terms to choose from
    if library and bench.goes_on("looked for a term that no effect is"):
        discovery = extras.attempt(
            "The search for a term that no effect is",
            lambda: discover(bench, state, library, rng, log.settle),
            discovery,
        )
    still: object = found.left
    if discovery.holds:
        tried = scoring.stage(discovery.state)
        if scoring.explained(after, tried) < 0.0:
            discovery = discovery.refused(state, WORSE.format(it="it"))
        else:
            after, still = tried, what_is_left(bench, discovery.state)
    habitat = None
    if still and not _pushed(bench, discovery.state):
        habitat = extras.attempt(
            "The description of what remains", lambda: residual_habitat(after.fitted, log.record, rng), None
        )
    return Remaining(after, discovery, habitat)


def _pushed(bench: Workbench, state: State) -> bool:
    """Whether random accelerations push the vehicle: they make free runs err, wherever and however long they do."""
    return bench.problem.is_pushed(state.point)
