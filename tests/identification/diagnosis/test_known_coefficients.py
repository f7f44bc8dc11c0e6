"""Tests of the stated uncertainty of coefficients: a vehicle file's deviations are the priors of a diagnosis."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import REACH
from identification.diagnosis import again, diagnose, write_diagnosis
from identification.diagnosis.search import known
from identification.diagnosis.search.candidates import candidates_of
from identification.experiments.heading_control import closed_loop
from identification.fit.prediction_errors import PredictionErrors
from scripts.blind.kinds import log_of
from scripts.blind.logs import Conditions
from tests.identification.diagnosis.stand_ins import state_of

BARE = replace(load_vehicle("slocum"), deviations={})


@pytest.fixture(scope="module")
def log():
    """A glider whose rudder is 35 % more effective than believed."""
    truth = replace_at(BARE, "hull.n_delta", 1.35 * BARE.hull.n_delta)
    return closed_loop(truth, rng=np.random.default_rng(11), duration=900.0)


@pytest.mark.slow
def test_a_coefficient_within_what_was_stated_is_refitted_and_no_finding(log):
    wide = diagnose(log, replace(BARE, deviations={"hull.n_delta": 0.5 * BARE.hull.n_delta}))
    assert wide.verdict == "none", wide.summary()
    assert value_at(wide.after.plant, "hull.n_delta") == pytest.approx(1.35 * BARE.hull.n_delta, rel=0.05)
    narrow = diagnose(log, replace(BARE, deviations={"hull.n_delta": 0.1 * BARE.hull.n_delta}))
    assert narrow.verdict in ("coefficients", "tied")  # a gain acts as it does
    (wrong,) = (c for c in narrow.coefficients if c.path == "hull.n_delta")
    assert wrong.wrong
    assert not wrong.limited
    assert narrow.before is narrow.given
    assert narrow.refitted is narrow.after  # a refit is all that was done


@pytest.mark.slow
def test_an_effect_that_spares_an_unlikely_coefficient_is_tied_with_it():
    """Half of the rudder's effect is five stated deviations: evidence 25, all of it from what was stated."""
    truth = replace_at(BARE, "hull.n_delta", 0.5 * BARE.hull.n_delta)
    found = diagnose(closed_loop(truth, rng=np.random.default_rng(12), duration=900.0), BARE)
    assert (found.verdict, [e.path for e in found.effects]) == ("tied", ["effects.rudder.gain"])
    assert ("effects.rudder.gain", "hull.n_delta") in found.tied
    low, high = found.effects[0].ci95
    assert low < 0.5 < high


@pytest.mark.slow
def test_deviations_of_zero_hold_a_coefficient(log):
    held = diagnose(log, replace(BARE, deviations={"hull.n_delta": 0.0}))
    assert [c.path for c in held.coefficients] == ["hull.n_r"]
    assert value_at(held.after.plant, "hull.n_delta") == BARE.hull.n_delta
    assert any("effects.rudder.gain" in (e.path, *e.tied_with) for e in held.effects), held.summary()


def test_only_what_the_inputs_excite_and_nobody_knows_exactly_is_refitted():
    moving, still = BARE.family.coefficients
    told = {moving: 1e-3, still: 1e-9}  # by how much a change of it changes the predictions

    def free(vehicle, doubt=0.1, sizes=told):
        def columns_of(point, moves):
            return np.array([[[0.0], [sizes[path]]] for path, _ in moves])

        bench = SimpleNamespace(plant=vehicle, doubt=doubt, problem=SimpleNamespace(columns_of=columns_of))
        return known._first_coefficients(bench, state_of(vehicle))

    assert free(BARE) == (moving,)
    assert free(BARE, sizes=dict.fromkeys(told, 1.0)) == (moving, still)
    assert free(replace(BARE, deviations={moving: 0.0}), sizes=dict.fromkeys(told, 1.0)) == (still,)
    assert free(BARE, doubt=0.0) == ()


def test_doubted_coefficients_are_all_that_a_vehicle_has():
    torpedo, drifter = load_vehicle("npsauv"), load_vehicle("qiandao_float")
    assert {"hull.i_yy", "hull.added_mass.m_qdot", "hull.roll.up", "parts.rudder.lift", "parts.propeller.t_nn"} <= set(
        torpedo.doubted
    )
    assert torpedo.doubted[: len(torpedo.coefficients)] == torpedo.coefficients
    assert all(value_at(torpedo, path) for path in torpedo.doubted)
    assert not any(path.startswith(("hull.mass", "hull.density", "effects.")) for path in torpedo.doubted)
    assert drifter.doubted == (*drifter.coefficients, "hull.added_mass")
    assert torpedo.deviation("hull.i_yy", 0.1) == pytest.approx(0.1 * torpedo.hull.i_yy)
    assert torpedo.deviation("hull.mass", 0.1) == np.inf


def test_further_coefficients_are_refitted_unless_together_they_could_not_matter():
    torpedo = replace(load_vehicle("npsauv"), deviations={})
    further = [path for path in torpedo.doubted if path not in torpedo.coefficients]
    told = dict.fromkeys(further, 0.0) | {further[0]: 0.45, further[1]: 0.3, further[2]: 0.3}  # per deviation

    def free(vehicle, doubt=0.1, sizes=told):
        problem = SimpleNamespace(
            pulls=lambda vector, paths: (np.zeros(len(paths)), np.full(len(paths), 0.5)),
            columns_of=lambda point, moves: np.array([[[0.5 * sizes[path]], [0.0]] for path, _ in moves]),
        )
        bench = SimpleNamespace(plant=vehicle, doubt=doubt, problem=problem)
        return known._further_coefficients(bench, state_of(vehicle, *vehicle.coefficients))

    assert free(torpedo) == (further[0],)  # each by itself could be held, and two of them, not all three
    assert free(torpedo, sizes=dict.fromkeys(further, 0.0)) == ()
    assert free(torpedo, sizes=dict.fromkeys(further, 10.0)) == tuple(further)
    assert free(replace(torpedo, deviations={further[0]: 0.0})) == ()
    assert free(torpedo, doubt=0.0) == ()
    assert free(torpedo, doubt=np.inf) == ()  # of what nothing is known, nothing is held


@pytest.mark.slow
def test_a_fit_stays_within_five_deviations(log):
    plant = replace(BARE, deviations={"hull.n_delta": 1e-6})
    problem = PredictionErrors(plant, log, log.windows(120.0), doubt=0.1)
    low, high = problem.bounds("hull.n_delta")
    assert (low, high) == pytest.approx((BARE.hull.n_delta - REACH * 1e-6, BARE.hull.n_delta + REACH * 1e-6))
    pulls, rates = problem.pulls(replace_at(plant, "hull.n_delta", BARE.hull.n_delta + 2e-6).vector, ["hull.n_delta"])
    assert pulls == pytest.approx([2.0])
    assert rates == pytest.approx([problem.scale("hull.n_delta") / 1e-6])
    loose = PredictionErrors(plant, log, log.windows(120.0))  # of a fit that no doubt holds
    assert loose.pulls(plant.vector, ["hull.n_delta"])[1] == [0.0]
    found = diagnose(log, replace(BARE, deviations={"hull.n_delta": 0.05 * BARE.hull.n_delta}))
    (limited,) = (c for c in found.coefficients if c.path == "hull.n_delta")
    assert limited.value == pytest.approx(1.25 * BARE.hull.n_delta)
    assert limited.limited
    assert "as the stated uncertainty allows. If" in found.summary()


@pytest.mark.slow
def test_what_is_known_of_an_effect_holds_it_as_a_coefficient_is_held(log):
    """A rudder that does 35 % more than believed, its effectiveness exact: a gain, unless that is known, too."""
    exact, gain = {"hull.n_delta": 0.0}, "effects.rudder.gain"
    free, known_well, exactly = (replace(BARE, deviations=exact | own) for own in ({}, {gain: 0.02}, {gain: 0.0}))
    point = replace_at(BARE, gain, 1.04).vector
    pulls, rates = PredictionErrors(known_well, log, log.windows(120.0), doubt=0.1).pulls(point, [gain])
    assert pulls == pytest.approx([2.0])
    assert rates > 0.0
    assert PredictionErrors(known_well, log, log.windows(120.0), doubt=0.1).bounds(gain) == pytest.approx((0.9, 1.1))
    assert [e.path for e in diagnose(log, free).added][:1] == [gain]
    assert gain not in {e.path for e in diagnose(log, known_well).added}
    assert gain not in {p for c in candidates_of(exactly, log) for p in c.paths}


@pytest.mark.slow
def test_the_files_keep_what_was_known_and_say_which_logs_were_seen(log, tmp_path):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    plant = replace(BARE, deviations={"hull.n_delta": 0.5 * BARE.hull.n_delta})
    found = diagnose(log, plant, source="mission 7.csv")
    paths = write_diagnosis(found, tmp_path)
    written = load_vehicle(paths["vehicle.toml"])
    assert written.deviations == plant.deviations
    assert written.fitted_to == f"{plant.fitted_to}; mission 7.csv"
    repeated = again(paths["diagnosis.json"], log)
    assert np.array_equal(repeated.after.plant.vector, found.after.plant.vector)
    assert repeated.given.plant.deviations == plant.deviations
    content = json.loads(paths["diagnosis.json"].read_text())
    del content["vehicle"]["deviations"]  # as an earlier version wrote it
    paths["diagnosis.json"].write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"no diagnosis\.json of this version"):
        again(paths["diagnosis.json"], log)


@pytest.mark.slow
def test_a_torpedo_with_wrong_inertias_lacks_nothing():
    torpedo = replace(load_vehicle("vt690"), deviations={}, window=25.0, settle=5.0)
    wrong = ("hull.i_yy", "hull.added_mass.m_qdot", "hull.added_mass.y_vdot", "parts.stern_plane.lift")
    believed = replace_at(torpedo, {path: 1.15 * value_at(torpedo, path) for path in wrong})
    said = diagnose(log_of(torpedo, Conditions(1.0, 1.0, 100.0), 5), believed)
    assert said.verdict in ("none", "coefficients"), said.summary()
    assert {"hull.added_mass.m_qdot", "hull.added_mass.y_vdot"} <= {c.path for c in said.coefficients}
