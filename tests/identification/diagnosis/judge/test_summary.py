"""Tests of sentences about noises, halves of a log, and ties."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.judge.effects import AsCoefficient, Coefficient, Effect, Member
from identification.diagnosis.judge.leftover import _small, drift_sentence, left_sentence, noise_sentence
from identification.diagnosis.judge.result import RARE, VARIES, WORSE
from identification.diagnosis.judge.summary import (
    _error_sentence,
    _halves_sentence,
    _likelier_sentence,
    _refitted_sentence,
    _sentence,
    _tied_sentence,
    averaged_sentence,
    dropped_sentence,
    slight_sentence,
    unsteady_sentence,
)
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.remainder import Left
from identification.fit.noises import Noise
from tests.identification.diagnosis.stand_ins import trial_of

ONSET = "auv-gym onset looks for when the effect begins or ends."


@pytest.mark.parametrize(
    "process, words",
    [
        ({}, ""),
        ({"r_radps": (0.01, 12.0)}, "Random accelerations push the vehicle (process noise): yaw rate 0.573"),
        ({"north_m": (0.02, 30.0)}, "Random drifts push the vehicle (process noise): north 0.02 m/s RMS"),
        ({"r_radps": (0.01, 12.0), "east_m": (0.02, 30.0)}, "Random accelerations and drifts push"),
    ],
)
def test_what_pushes_at_random_is_said_in_units_for_people(process, words):
    said = noise_sentence(SimpleNamespace(noise=Noise({"heading_rad": 0.01}, process)))  # type: ignore[arg-type]
    assert said.startswith(words)
    assert ("deg/s² RMS with a correlation time of 12 s" in said) == ("r_radps" in process)
    assert bool(said) == bool(process)


@pytest.mark.parametrize(
    "process, rmse, pushed",
    [({}, 0.03, False), ({"r_radps": (0.01, 12.0)}, 0.014, False), ({"r_radps": (0.01, 12.0)}, 0.015, True)],
)
def test_that_only_random_accelerations_make_the_model_explain_a_log_is_said_first(process, rmse, pushed):
    """Free runs then err by more than the sensor noise of 0.01 rad, beyond that noise."""
    d = SimpleNamespace(verdict="none", effects=(), noise=Noise({"heading_rad": 0.01}, process))
    d.after, d.noise_of = SimpleNamespace(scores={"heading_rad": SimpleNamespace(rmse=rmse)}), lambda name: 0.01
    said = _sentence(d)  # type: ignore[arg-type]
    assert said.startswith("Together with random accelerations" if pushed else "The model explains this log")
    assert said.endswith("that this log could show." if pushed else "no known effect is missing.")


def test_effects_that_many_halves_of_the_log_do_not_choose_are_said():
    sure = Effect("effects.rudder.offset", "rudder offset", 0.1, 0.0, "rad", (0.0, 0.2), 50.0, 40.0)
    gain = AsCoefficient("hull.n_delta", "rudder effectiveness", "1", 1.0, 0.8, (0.7, 0.9))
    rare = [replace(sure, title=title, frequency=f) for title, f in (("trim", 0.55), ("drift", 0.55), ("lag", 0.799))]
    said = _halves_sentence(SimpleNamespace(added=(sure, *rare)))  # type: ignore[arg-type]
    assert said == (
        "The choice was repeated with half of the log: only 55 % of the halves that were tried choose trim and drift; "
        "only 80 % of the halves that were tried choose lag."
    )
    turned = SimpleNamespace(added=(replace(sure, frequency=0.6, coefficient=gain),))
    assert "choose change in rudder effectiveness" in _halves_sentence(turned)  # type: ignore[arg-type]
    assert _halves_sentence(SimpleNamespace(added=(sure,))) == ""  # type: ignore[arg-type]


def test_an_effect_that_only_changes_a_coefficient_is_told_with_the_given_value():
    gain = AsCoefficient("hull.n_r", "yaw damping N_r (linear)", "1", 1.0, 0.8, (0.7, 0.9))
    effect = Effect("effects.yaw.damping", "damping", 0.8, 1.0, "1", (0.7, 0.9), 50.0, 40.0, coefficient=gain)
    assert effect.told == "yaw damping N_r of 0.8 instead of 1 (95 % interval 0.7 to 0.9, linear)"
    assert effect.name == "change in yaw damping N_r (linear)"


@pytest.mark.parametrize(
    "titles, words",
    [
        ([], ""),
        (["trim"], "The search also found trim, but most halves of the log do not choose it."),
        (["trim", "lag"], "The search also found trim and lag, but most halves of the log do not choose them."),
    ],
)
def test_what_most_halves_of_the_log_do_not_choose_is_said_not_to_be_kept(titles, words):
    chosen = [SimpleNamespace(chosen=trial_of(Candidate(title, (f"effects.{title}",)))) for title in titles]
    d = SimpleNamespace(rounds=(SimpleNamespace(chosen=None), *chosen), dropped={f"effects.{t}": RARE for t in titles})
    d.dropped_for = lambda reason: Diagnosis.dropped_for(d, reason)  # type: ignore[arg-type]
    assert dropped_sentence(d) == words  # type: ignore[arg-type]
    d.dropped |= {"effects.drag": WORSE}
    worse = "effects.drag, but free runs over unseen parts of the log are worse with it than without."
    assert dropped_sentence(d).endswith(worse)  # type: ignore[arg-type]


def test_which_effects_differ_between_parts_is_said():
    trim = Effect("effects.rudder.offset", "trim", 0.1, 0.0, "rad", (0.0, 0.2), 50.0, 40.0, steady=1e-4)
    lag, drag = replace(trim, title="lag", steady=0.002), replace(trim, title="drag")
    one = SimpleNamespace(labels=[""])
    for alike, words in (((lag,), ""), ((trim,), "Its size"), ((trim, lag), "The size of trim")):
        said = unsteady_sentence(SimpleNamespace(alike=alike, record=one))  # type: ignore[arg-type]
        assert said == (words and f"{words} differs between parts of the log: {ONSET}")
    both = SimpleNamespace(alike=(trim, lag, drag), left=Left(changes=trim.path), state=None, dropped={}, record=one)
    assert unsteady_sentence(both).startswith("The size of trim and drag differs")  # type: ignore[arg-type]
    assert left_sentence(both) == ""  # type: ignore[arg-type]  # said once
    dropped = SimpleNamespace(alike=(), left=Left(changes=trim.path), state=None, dropped={trim.path: VARIES})
    assert left_sentence(dropped) == ""  # type: ignore[arg-type]  # `dropped_sentence` says it


CHANGES = (
    "The yaw moment from u r differs between parts of the log: something changed during the log. "
    "auv-gym onset looks for when that was. "
)


def test_of_a_clock_is_said_what_the_rest_acts_like_and_of_a_coefficient_that_it_differs():
    plant = load_vehicle("npsauv")
    for path, words in (
        ("effects.clock.rate", "What remains acts like a clock of the log whose rate differs between parts of it. "),
        ("hull.yaw.ur", CHANGES),
    ):
        record, state = SimpleNamespace(labels=("",)), SimpleNamespace(plant=plant)
        d = SimpleNamespace(alike=(), dropped={}, state=state, record=record, left=Left(changes=path))
        assert left_sentence(d) == words  # type: ignore[arg-type]
        d.left = Left(gusts=("r_radps",), changes=path)
        said = left_sentence(d)  # type: ignore[arg-type]
        assert said.startswith("Random accelerations (yaw rate) are stronger at some times")
        assert "acts like a clock" not in said  # a clock would not make only some of them stronger
        assert (words in said) == ("clock" not in path)


@pytest.mark.parametrize(
    "heading, yaw, words",
    [
        (0.013, 0.0041, ", but is smaller than the sensors' noise: free runs of heading miss by 0.476 deg beyond it"),
        (
            0.010,
            0.0050,
            ", but is smaller than the sensors' noise: free runs of yaw rate miss by 0.172 deg/s beyond it",
        ),
        (0.015, 0.0041, ""),  # 0.011 rad beyond a noise of 0.010
    ],
)
def test_what_remains_is_said_to_be_small_where_it_is_less_than_the_noise_of_each_sensor(heading, yaw, words):
    scores = {"heading_rad": SimpleNamespace(rmse=heading), "r_radps": SimpleNamespace(rmse=yaw)}
    labels = {"heading_rad": "heading", "r_radps": "yaw rate"}
    after = SimpleNamespace(scores=scores, unseen=SimpleNamespace(label=labels.get))
    d = SimpleNamespace(after=after, noise_of={"heading_rad": 0.010, "r_radps": 0.004}.get)
    assert _small(d) == words  # type: ignore[arg-type]
    unknown = SimpleNamespace(after=after, noise_of=lambda name: np.inf)
    assert _small(unknown) == ""  # type: ignore[arg-type]


def test_a_slight_difference_between_parts_is_said():
    trim = Effect("effects.rudder.offset", "trim", 0.1, 0.0, "rad", (0.0, 0.2), 50.0, 40.0, steady=1e-4, apart=0.13)
    others = replace(trim, title="lag", steady=0.5), replace(trim, title="drag", apart=0.5)
    said = slight_sentence(SimpleNamespace(added=(trim, *others)))  # type: ignore[arg-type]
    assert said == "Parts of the log differ slightly in the size of trim (by up to 13 %)."
    assert slight_sentence(SimpleNamespace(added=others)) == ""  # type: ignore[arg-type]


def test_a_member_that_is_likelier_than_the_effect_it_is_tied_with_is_said_to_be_so_and_why():
    width = ("effects.rudder.deadband", "rudder deadband", 0.1, 0.0, "rad", (0.0, 0.2), 50.0, 40.0)
    play = Member("effects.rudder.backlash", "rudder backlash", 0.72, 0.1, 0.0, "rad", (0.0, 0.2))
    spared = replace(play, spared=("effects.rudder.offset",))
    titles = {"effects.rudder.offset": "rudder offset"}

    def said(member, probability):
        effect = Effect(*width, probability=probability, members=(member,))
        return _likelier_sentence(SimpleNamespace(effects=(effect,), titles=titles))  # type: ignore[arg-type]

    assert said(spared, 0.48) == (
        "The fitted vehicle has rudder deadband; rudder backlash is more probable, since no rudder offset is needed "
        "with it."
    )
    assert said(play, 0.48).endswith("rudder backlash is more probable if all sets of effects are counted.")
    assert said(spared, 0.8) == said(spared, None) == ""
    gain = replace(play, path="effects.rudder.gain", title="rudder gain")
    effect = Effect(*width, probability=0.2, members=(play, gain))
    assert _likelier_sentence(SimpleNamespace(effects=(effect,), titles=titles)).endswith(  # type: ignore[arg-type]
        "; rudder backlash and rudder gain are more probable if all sets of effects are counted."
    )


@pytest.mark.parametrize(
    "probability, words, order",
    [
        (0.48, "rudder backlash, 5.73 deg (95 % interval 0 to 11.5 deg), or rudder deadband, 5.73 deg", (0, 1)),
        (0.7201, "rudder deadband, 5.73 deg", (1, 0)),  # as probable, to the percent
        (0.8, "rudder deadband, 5.73 deg", (1, 0)),
    ],
)
def test_a_tie_does_not_lead_with_what_is_less_probable(probability, words, order):
    width = ("effects.rudder.deadband", "rudder deadband", 0.1, 0.0, "rad", (0.0, 0.2), 50.0, 40.0)
    play = Member("effects.rudder.backlash", "rudder backlash", 0.72, 0.1, 0.0, "rad", (0.0, 0.2))
    effect = Effect(*width, probability=probability, members=(play,))
    titles = {play.path: play.title, effect.path: effect.title}
    d: Any = SimpleNamespace(
        verdict="tied", coefficients=(), effects=(effect,), tied=((effect.path, play.path),), titles=titles
    )
    d.probabilities = {play.path: play.probability, effect.path: probability}
    assert _sentence(d).startswith(f"The model is missing an effect: {words}")
    odds = "rudder backlash (72 %)", f"rudder deadband ({100.0 * probability:.0f} %)"
    assert _tied_sentence(d) == f"This log cannot tell apart: {' or '.join(odds[k] for k in order)}."


def test_readings_are_said_to_be_averaged_with_the_reason():
    said = averaged_sentence(SimpleNamespace(averaged=0.6, shortest=False))  # type: ignore[arg-type]
    assert said.startswith("The fit used readings averaged over 0.6 s, since the log is so dense that")
    said = averaged_sentence(SimpleNamespace(averaged=0.6, shortest=True))  # type: ignore[arg-type]
    assert "so long that shorter averages would take too much time. If a controller reacts faster than that" in said
    assert averaged_sentence(SimpleNamespace(averaged=0.0)) == ""  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "given, unexplained, added, words",
    [
        (0.1, True, (), "As given, the model errs less: heading 5.73 deg. A refit"),
        (0.1, False, (), "As given, the model errs less: heading 5.73 deg. Free runs do not include the random"),
        (0.1, False, ("an effect",), "As given, the model errs less: heading 5.73 deg. The refit without the effects"),
        (0.2, False, (), ""),
    ],
)
def test_a_refit_that_errs_more_than_the_given_model_is_not_passed_over(given, unexplained, added, words):
    def stage(rmse: float) -> SimpleNamespace:
        unseen = SimpleNamespace(label=lambda name: "heading")
        return SimpleNamespace(scores={"heading_rad": SimpleNamespace(rmse=rmse)}, unseen=unseen)

    before = stage(0.2)
    d = SimpleNamespace(
        before=before, refitted=before, after=stage(0.05), given=stage(given), changed=True, reach="over 100 s",
        unseen_words="parts", only_pushed=not unexplained, added=added,
    )  # fmt: skip
    said = _error_sentence(d)  # type: ignore[arg-type]
    assert said.startswith(
        "RMS error of free runs over 100 s in unseen parts: heading 11.5 deg before, 2.86 deg after."
    )
    assert (words in said) if words else said.endswith("after.")


@pytest.mark.parametrize("changed", [False, True])
@pytest.mark.parametrize("corrected", [False, True])
def test_each_error_is_that_of_the_stage_it_is_called_by(corrected, changed):
    def stage(rmse: float) -> SimpleNamespace:
        unseen = SimpleNamespace(label=lambda name: "depth")
        return SimpleNamespace(scores={"depth_m": SimpleNamespace(rmse=rmse)}, unseen=unseen)

    given, refitted = stage(0.13), stage(0.05)
    after = stage(0.01) if changed else refitted
    before = given if corrected else refitted
    d = SimpleNamespace(
        given=given, refitted=refitted, before=before, after=after, changed=changed, reach="over 100 s",
        unseen_words="parts", noise_of=lambda name: 0.03,
    )  # fmt: skip
    said = _error_sentence(d).partition("depth ")[2]  # type: ignore[arg-type]
    assert (
        said
        == {
            (False, False): "0.05 m (0.04 m beyond the sensor noise).",
            (True, False): "0.13 m as given, 0.05 m refitted (0.04 m beyond the sensor noise).",
            (False, True): "0.05 m before, 0.01 m after.",
            (True, True): "0.13 m as given, 0.01 m after.",
        }[corrected, changed]
    )


def test_coefficients_that_surely_moved_are_said_unless_they_are_already():
    drag = Coefficient("hull.drag_0", "drag", "1", 2.0, 2.4, (2.36, 2.44), moved=True)
    lift = Coefficient("hull.lift_1", "lift", "1", 0.5, 0.48, (0.3, 0.6))
    turned = Coefficient("hull.drag_2", "induced drag", "1", -4.0, -3.0, (-3.2, -2.8), wrong=True, moved=True)
    d = SimpleNamespace(verdict="none", effects=(), coefficients=(drag, lift, turned))
    both = (
        "Refitted coefficients: induced drag -25 % (95 % interval -30 to -20 %); drag +20 % (95 % interval 18 to 22 %)."
    )
    assert _refitted_sentence(d) == both  # type: ignore[arg-type]
    d.verdict = "coefficients"  # this verdict already states the wrong ones
    assert _refitted_sentence(d) == "Refitted coefficients: drag +20 % (95 % interval 18 to 22 %)."  # type: ignore[arg-type]
    d.verdict = "doubted"
    assert _refitted_sentence(d) == ""  # type: ignore[arg-type]
    named = AsCoefficient(drag.path, drag.title, "1", 2.0, 2.4, drag.ci95)
    d = SimpleNamespace(verdict="named", effects=(SimpleNamespace(coefficient=named),), coefficients=(drag, lift))
    assert _refitted_sentence(d) == ""  # type: ignore[arg-type]
    many = tuple(replace(drag, path=str(k)) for k in range(6))
    d = SimpleNamespace(verdict="none", effects=(), coefficients=many)
    assert _refitted_sentence(d).endswith("; and 2 more.")  # type: ignore[arg-type]


def test_a_size_at_the_far_end_of_its_interval_is_the_most_that_it_may_be():
    current = Effect("effects.water.current", "current", -8.31e-5, 0.0, "1/s", (-8.31e-5, 0.0), 17.0, 15.0)
    assert current.told == "current, down to -8.31e-05 1/s (95 % interval -8.31e-05 to 0 1/s)"
    for limits in ((-9e-5, 0.0), (-8.31e-5, -8.31e-5), (-9e-5, -8.31e-5)):
        assert "up to" not in replace(current, ci95=limits).told
    gain = Member("effects.rudder.gain", "rudder gain", 0.3, 1.2, 1.0, "1", (1.1, 1.2))
    assert gain.size == "up to 1.2"
    assert replace(gain, value=1.0, ci95=(1.0, 1.2)).size == "1"


@pytest.mark.parametrize(
    "time, slowest, unexplained, said",
    [
        (160.0, np.inf, False, True),
        (140.0, 185.0, False, False),
        (140.0, 140.0, False, True),
        (160.0, 185.0, True, False),
    ],
)
def test_noise_that_lasts_for_long_may_be_an_effect_that_grows(time, slowest, unexplained, said):
    """A quarter of the log, or as long as a fit allows; only if nothing else is left.  The segments last 600 s."""
    segment = np.repeat([0, 1], 7)
    record = Record.from_arrays(100.0 * np.arange(14), {"heading_rad": np.zeros(14)}, segment=segment)
    noise = Noise({"heading_rad": 0.01}, {"u_mps": (0.01, time), "r_radps": (0.01, 5.0)}, slowest=slowest)
    told = drift_sentence(SimpleNamespace(noise=noise, record=record, unexplained=unexplained))  # type: ignore[arg-type]
    assert ("forward speed through the water changes so slowly" in told and "auv-gym onset looks for" in told) is said
    assert "yaw" not in told
    assert drift_sentence(SimpleNamespace(noise=None, unexplained=False)) == ""  # type: ignore[arg-type]
