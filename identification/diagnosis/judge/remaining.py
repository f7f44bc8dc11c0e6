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


@dataclass(frozen=True, eq=False)
class Remaining:
    """What is said of the errors that are left.

    after: the vehicle with the term, if one holds.  habitat: of what is left even so.
    """

    after: Stage
    discovery: Discovery | None = None
    habitat: Habitat | None = None


def what_remains(scoring: Scoring, found: Reported, after: Stage) -> Remaining:
    """The term that explains what effects leave, unless unseen parts of the record are worse with it, and the rest."""
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
    if still:
        habitat = extras.attempt(
            "The description of what remains", lambda: residual_habitat(after.fitted, log.record, rng), None
        )
    return Remaining(after, discovery, habitat)
