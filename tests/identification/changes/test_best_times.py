"""Tests of effects that are compared at times of their own, with stand-ins for the fits."""

from types import SimpleNamespace

import pytest

from identification.changes import best_times
from identification.changes.forms import kind_of
from identification.changes.timed_forms import Forms
from identification.diagnosis.search.acceptance import INSIGNIFICANT, UNSURE
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate


@pytest.mark.parametrize(
    "ahead, chosen, tied",
    [(5.0, "b", ("a",)), (20.0, "b", ()), (-5.0, "a", ("b",)), (-20.0, "a", ())],
)
def test_rivals_are_compared_at_times_of_their_own(monkeypatch, ahead, chosen, tied):
    """Behind at the times of the chosen one; at its own, so far ahead of it."""

    def trial(name, total, objection=""):
        return SimpleNamespace(candidate=name, total=total, state=name, objection=objection)

    first, second = trial("a", 60.0), trial("b", 50.0)
    others = [trial("c", -20.0), trial("d", 55.0, "not significant")]  # hopeless, and refused
    made = Round((first, second, *others), first, (), {})  # type: ignore[arg-type]
    bench = SimpleNamespace(gain=lambda one, other: ahead)
    monkeypatch.setattr(best_times, "at_best_times", lambda bench, trial: SimpleNamespace(state=trial.state))
    found, reached = best_times.each_at_its_times(bench, made, SimpleNamespace(state="a"))  # type: ignore[arg-type]
    assert (found.chosen.candidate, tuple(t.candidate for t in found.tied)) == (chosen, tied)
    assert reached.state == chosen


def test_what_comes_near_the_first_is_compared_at_times_of_its_own_too(monkeypatch):
    """Half of the evidence at coarse times is near; an effect throughout has no times to be moved."""

    def trial(path, train):
        return SimpleNamespace(candidate=Candidate(path, (path,)), train=train, state=path, total=train)

    first, near, far = (
        trial("changes.from1.a", 60.0),
        trial("changes.between0.b", 31.0),
        trial("changes.until2.c", 29.0),
    )
    whole, gained = trial("effects.d", 60.0), {first.state: 0.0, near.state: 20.0, far.state: 40.0, "effects.d": 0.0}
    bench = SimpleNamespace(gain=lambda one, other: gained[other] - gained[one])
    monkeypatch.setattr(best_times, "at_best_times", lambda bench, t: SimpleNamespace(bench=bench, state=t.state))
    made = Round((first, near, far, whole), first, (), {})  # type: ignore[arg-type]
    assert best_times.best_at_its_times(bench, made, first)[0] is near  # type: ignore[arg-type]
    assert best_times.best_at_its_times(bench, made, whole)[0] is whole  # type: ignore[arg-type]
    gained[near.state] = -1.0
    assert best_times.best_at_its_times(bench, made, first)[0] is first  # type: ignore[arg-type]


@pytest.mark.parametrize("ahead, form", [(16.0, "from"), (17.5, "between"), (None, "between")])
def test_a_second_time_must_pass_the_bar_for_it(monkeypatch, ahead, form):
    """It is 16.7 for 23 times; None: one time alone explains nothing."""
    span, groups = Candidate("a", ("changes.between0.a",)), []
    for kind in ("from", "until"):
        groups.append(tuple(Candidate("a", (f"changes.{kind}{k}.a",)) for k in range(1, 24)))
    forms = [Forms(Candidate("a", ("a",)), (*groups, (Candidate("a", ("changes.growing.a",)),)), (span,))]
    one_time = None if ahead is None else SimpleNamespace(candidate=groups[0][3], state="from")
    made = Round((), SimpleNamespace(candidate=span, state="between"), (), {})  # type: ignore[arg-type]
    bench = SimpleNamespace(gain=lambda before, after: ahead)
    monkeypatch.setattr(best_times, "placed", lambda bench, state, rows: (bench, state))
    monkeypatch.setattr(best_times, "promising", lambda bench, state, asked, bar: (list(asked[0].groups[0][3:4]), {}))
    monkeypatch.setattr(best_times, "selected", lambda *given: Round((), one_time, (), {}))  # type: ignore[arg-type]
    monkeypatch.setattr(
        best_times, "at_best_times", lambda bench, trial: SimpleNamespace(bench=bench, state=trial.state)
    )
    reached = SimpleNamespace(bench=bench, state="between")
    made, there = best_times.unless_at_one_time(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert (there.state, kind_of(made.chosen.candidate.paths[0].split(".")[1])) == (form, form)


@pytest.mark.parametrize(
    "form, row, gained, kind",
    [
        ("from1", 70, 20.0, "between"),
        ("from1", 20, 20.0, "outside"),
        ("until1", 20, 20.0, "between"),
        ("until1", 70, 20.0, "outside"),
        ("from1", 70, 16.0, "from"),
        ("from1", 50, 20.0, "from"),
    ],
)
def test_a_second_time_is_tried_beside_the_first_where_that_is_right_by_now(monkeypatch, form, row, gained, kind):
    """The first time is row 50; 16.7 are needed for another one."""
    groups = [tuple(Candidate("a", (f"changes.{f}{k}.a",)) for k in range(1, 24)) for f in ("from", "until")]
    spans = tuple(Candidate("a", (f"changes.{k}0.a",)) for k in ("between", "outside"))
    forms, chosen = [Forms(Candidate("a", ("a",)), tuple(groups), spans)], groups[form == "until1"][0]
    bench = SimpleNamespace(problem=None, gain=lambda before, after: gained)
    reached = SimpleNamespace(bench=bench, state=SimpleNamespace(point=None, paths=()), edges=lambda form: (50,))
    placed = []
    monkeypatch.setattr(best_times, "screen", lambda *given: [SimpleNamespace(evidence=1.0, candidate=groups[0][4])])
    monkeypatch.setattr(best_times, "finer_rows", lambda *given: {"from5": (9.0, row)})
    monkeypatch.setattr(best_times, "placed", lambda bench, state, rows: placed.append(rows) or (bench, state))
    monkeypatch.setattr(best_times, "selected", lambda *given: Round((), trial_of(given[2][0]), (), {}))  # type: ignore[arg-type]
    monkeypatch.setattr(best_times, "at_best_times", lambda bench, trial: SimpleNamespace(bench=bench, state=None))
    made = Round((), SimpleNamespace(candidate=chosen), (), {})  # type: ignore[arg-type]
    made, _ = best_times.if_at_two_times(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert kind_of(made.chosen.candidate.paths[0].split(".")[1]) == kind
    if kind in ("between", "outside"):
        assert placed == [{f"{kind}0": (min(row, 50), max(row, 50))}]


def trial_of(candidate):
    return SimpleNamespace(candidate=candidate, state="fitted")


@pytest.mark.parametrize(
    "times, ahead, form", [(1, 8.0, "growing"), (1, 8.5, "from"), (2, 16.0, "growing"), (2, 17.0, "between")]
)
def test_a_time_must_be_worth_its_price_beside_growth(monkeypatch, times, ahead, form):
    """Two for a parameter and for the choice among 23 times each, 8.3; growth keeps the other form in its tie."""
    groups = [tuple(Candidate("a", (f"changes.{f}{k}.a",)) for k in range(1, 24)) for f in ("from", "until")]
    growing, span = Candidate("a", ("changes.growing.a",)), Candidate("a", ("changes.between0.a",))
    forms = [Forms(Candidate("a", ("a",)), (*groups, (growing,)), (span,))]
    chosen = trial_of(groups[0][3] if times == 1 else span)
    bench = SimpleNamespace(gain=lambda before, after: ahead)
    monkeypatch.setattr(best_times, "placed", lambda bench, state, rows: (bench, state))
    monkeypatch.setattr(best_times, "selected", lambda *given: Round((), trial_of(given[2][0]), (), {}))  # type: ignore[arg-type]
    monkeypatch.setattr(
        best_times, "at_best_times", lambda bench, t: SimpleNamespace(bench=bench, state=None, times=[])
    )
    reached = SimpleNamespace(bench=bench, state=None, times=[None] * times)
    made = Round((), chosen, (), {})  # type: ignore[arg-type]
    made, _ = best_times.unless_growing(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert kind_of(made.chosen.candidate.paths[0].split(".")[1]) == form
    assert made.tied == ((chosen,) if form == "growing" else ())


@pytest.mark.parametrize("ahead, form", [(16.0, ""), (17.5, "from")])
def test_a_time_must_pass_the_bar_beside_an_effect_throughout(monkeypatch, ahead, form):
    """It is 16.7 for 23 times; any effect throughout will do."""
    groups = (tuple(Candidate("a", (f"changes.from{k}.a",)) for k in range(1, 24)),)
    forms = [Forms(Candidate("a", ("a",)), groups), Forms(Candidate("b", ("effects.b",)), ())]
    bench = SimpleNamespace(gain=lambda before, after: ahead)
    monkeypatch.setattr(best_times, "placed", lambda bench, state, rows: (bench, state))
    again = lambda *given: Round((), trial_of(given[2][1]), (), {})  # type: ignore[arg-type]  # noqa: E731
    monkeypatch.setattr(best_times, "selected", again)
    monkeypatch.setattr(best_times, "at_best_times", lambda bench, t: SimpleNamespace(state=None))
    made = Round((), trial_of(groups[0][3]), (), {})  # type: ignore[arg-type]
    reached = SimpleNamespace(bench=bench, state=None)
    made, _ = best_times.unless_throughout(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert made.chosen.candidate.paths == (("effects.b",) if form == "" else groups[0][3].paths)


@pytest.mark.parametrize("objection, ahead, tied", [(INSIGNIFICANT, 1.3, 1), (INSIGNIFICANT, 9.0, 0), (UNSURE, 1.3, 0)])
def test_what_is_simpler_and_just_below_the_bar_is_tied(monkeypatch, objection, ahead, tied):
    """Growth of evidence 27, where 28 are needed, beside a time of evidence 28.3: nobody can tell which it is."""
    group, growing = (Candidate("a", ("changes.from1.a",)),), Candidate("a", ("changes.growing.a",))
    group = (*group, *(Candidate("a", (f"changes.from{k}.a",)) for k in range(2, 24)))
    forms = [Forms(None, (group, (growing,)))]
    below = SimpleNamespace(candidate=growing, state=0, total=27.0, objection=objection)
    monkeypatch.setattr(best_times, "placed", lambda bench, state, rows: (bench, state))
    monkeypatch.setattr(best_times, "selected", lambda *given: Round((below,), None, (), {}))  # type: ignore[arg-type]
    bench = SimpleNamespace(gain=lambda before, after: ahead)
    reached, made = SimpleNamespace(bench=bench, state=1, times=[None]), Round((), trial_of(group[3]), (), {})  # type: ignore[arg-type]
    found, there = best_times.unless_growing(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert found.chosen is made.chosen
    assert there is reached
    assert found.tied == (below,) * tied
