"""Tests of which set of effects is reported, of all that explain a record."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identification.diagnosis.judge import weighing
from identification.diagnosis.judge.holding import Held
from identification.diagnosis.judge.weighing import weigh
from identification.diagnosis.search import explanations
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.survival import Survival
from tests.identification.diagnosis.search.test_explanations import A, B, C, Sets, round_of
from tests.identification.diagnosis.stand_ins import PLANT, state_of


class Bench(Sets):
    """A workbench whose refits change nothing."""

    def goes_on(self, step):
        return True

    def fit(self, plant, paths, near):
        return near


@pytest.fixture
def reported(monkeypatch):
    """The reported paths for a record in which C instead of B is likelier, but idle."""

    def confirmed(bench, nominal, state, rounds, count):
        kept = [r for r in rounds if r.chosen.candidate.paths != (C,)]
        return state_of(PLANT, *(r.chosen.candidate.paths[0] for r in kept)), kept

    monkeypatch.setattr(explanations, "likenesses", lambda bench, chosen, others: {t.candidate: [] for t in others})
    monkeypatch.setattr(weighing, "confirmed", confirmed)

    def of(likely: dict, shown: tuple[str, ...] = (), holds: bool = True, *, only: bool = False) -> tuple[str, ...]:
        survived = Survival(1.0 if holds else 0.0, {})
        monkeypatch.setattr(weighing, "survival", lambda bench, made, before, count: survived)
        bench: Any = Bench(likely)
        known: Any = SimpleNamespace(bench=bench)
        mismatches = [SimpleNamespace(path=path, tied=()) for path in shown]
        searched: Any = SimpleNamespace(
            known=known, nominal=state_of(PLANT), candidates=(), kinematics=SimpleNamespace(mismatches=mismatches)
        )
        rounds = [round_of(B, C)] if only else [round_of(A), round_of(B, C, before=(A,))]
        state = state_of(PLANT, *(r.chosen.candidate.paths[0] for r in rounds))
        survivals = (Survival(1.0, {}),) * len(rounds)
        held = Held(state, tuple(rounds), tuple(rounds), survivals, {}, Left())
        found = weigh(searched, held, 3)
        assert found.needless == (only and likely[C,] > likely[B,])  # members of a tie have no size in these states
        return found.state.paths

    return of


def test_an_effect_that_was_needed_in_a_valley_only_goes(reported):
    """The set with C is likelier, but C is idle in it: its fit ended at a point where B is not needed either."""
    assert reported({(A, B): 100.0, (A, C): 130.0, (A,): 130.0}) == (A,)
    assert reported({(A, B): 100.0, (A, C): 130.0, (A,): 80.0}) == (A, B)


def test_what_sensors_show_does_not_go(reported):
    likely = {(A, B): 100.0, (A, C): 130.0, (A,): 130.0}
    assert reported(likely, shown=(B,)) == (A, B)
    assert reported(likely, shown=(A,)) == (A,)


def test_what_halves_refute_or_holds_nothing_is_not_reported_instead(reported):
    likely = {(A, B): 100.0, (A, C): 130.0, (A,): 130.0}
    assert reported(likely, holds=False) == (A, B)
    assert reported({(B,): 100.0, (C,): 130.0, (): 130.0}, only=True) == (B,)


def test_without_rounds_nothing_is_weighed():
    known: Any = SimpleNamespace(bench=Bench({(): 0.0}))
    searched: Any = SimpleNamespace(known=known, nominal=state_of(PLANT), candidates=())
    found = weigh(searched, Held(state_of(PLANT), (), (), (), {}, Left()), 3)
    assert (found.rounds, found.tied, found.found.sets) == ((), (), ())
    assert np.isfinite(found.state.point.scores).all()
