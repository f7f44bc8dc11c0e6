"""Tests of verdicts on torpedoes, wrong coefficients, mislabelled logs and unknown causes, and of their repetition."""

import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis import again, as_json, diagnose, write_diagnosis
from identification.diagnosis.judge import scoring
from identification.diagnosis.log.checking import check_log
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.search import workbench
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK


def coefficients_of(seed: int, vehicle: str = "vt690", wrong: float = 0.0) -> dict[str, float]:
    """The coefficients of a torpedo, each off by a share to one side or the other."""
    given, rng = load_vehicle(vehicle), np.random.default_rng(seed)
    return {p: value_at(given, p) * (1.0 + wrong * rng.choice([-1, 1])) for p in given.family.coefficients}


def torpedo_log(seed: int, vehicle: str = "vt690", wrong: float = 0.0, duration: float = 60.0, **effects: float):
    """A log of a torpedo whose coefficients differ from those given by a share, with effects."""
    given, values = load_vehicle(vehicle), coefficients_of(seed, vehicle, wrong)
    true = replace_at(given, values | {f"effects.{path.replace('__', '.')}": v for path, v in effects.items()})
    return given, run_mission(true, np.random.default_rng(seed), duration=duration)


def names(diagnosis) -> set[str]:
    found = {e.path for e in diagnosis.effects}
    return found | {p for group in diagnosis.tied for p in group if not found.isdisjoint(group)}


@pytest.mark.parametrize(
    "wrong, duration, effects",
    [
        (0.0, 40.0, {"current__east": 0.05}),
        pytest.param(0.1, 60.0, {"load__net_buoyancy": 0.6}, marks=pytest.mark.slow),
    ],
)
def test_a_torpedo_lacks_what_was_put_in(wrong, duration, effects):
    given, record = torpedo_log(2, wrong=wrong, duration=duration, **effects)
    found = diagnose(record, given, window=10.0)
    assert found.verdict in ("named", "tied")
    assert f"effects.{next(iter(effects)).replace('__', '.')}" in names(found)
    assert found.explained > 0.8
    assert not found.unexplained


def test_a_log_that_effects_explain_is_not_far_from_its_vehicle(monkeypatch):
    """Coefficients alone cannot make up for a large offset, which the check of the log says before any search."""
    record = run_mission(replace_at(QUICK, "effects.rudder.offset", 0.1), np.random.default_rng(6), duration=400.0)
    doubt = Doubt("the log and the vehicle are far apart", ("heading_rad",), 1.0, "check the log")
    doubting = lambda *a: replace(check_log(*a), doubts=(doubt,))  # noqa: E731
    monkeypatch.setattr(import_module("identification.diagnosis.diagnose"), "check_log", doubting)
    found = diagnose(record, QUICK, most=1)
    assert names(found) == {"effects.rudder.offset"}
    assert found.doubts == ()


@pytest.mark.slow
def test_coefficients_that_were_wrong_are_a_finding_of_their_own():
    given, record = torpedo_log(3, wrong=0.1)
    found = diagnose(record, given, window=10.0, settle=2.0)
    assert found.verdict == "coefficients"
    assert not found.effects
    wrong = {c.path for c in found.coefficients if c.wrong}
    assert {"parts.stern_plane.moment", "hull.surge.u_u"} <= wrong
    truth = coefficients_of(3, wrong=0.1)
    for c in found.coefficients:
        error = 0.5 * (c.ci95[1] - c.ci95[0]) / 1.96
        assert abs(c.value - truth.get(c.path, c.given)) < 3.0 * error  # no other coefficient was changed
    assert "With corrected coefficients the model explains this log" in found.summary()
    assert set(as_json(found)["coefficients_wrong"]) == wrong


@pytest.mark.slow
def test_a_search_that_reaches_its_limit_ends_with_what_it_has_and_says_so(monkeypatch):
    true = replace_at(QUICK, "effects.rudder.offset", 0.05)
    record = run_mission(true, np.random.default_rng(4), duration=900.0)
    assert not diagnose(record, QUICK).unfinished
    monkeypatch.setattr(workbench, "MOST_WORK", 0.0)
    found = diagnose(record, QUICK)
    assert "effects.rudder.offset" in names(found)
    assert "looked for a further effect" in found.unfinished
    assert "The search ended at its limit of computing time before it had" in found.summary()
    assert "looked for a further effect" in found.summary()
    assert as_json(found)["unfinished"] == list(found.unfinished)


def test_a_mirrored_rudder_is_said_plainly_and_nothing_is_named():
    record = run_mission(load_vehicle("slocum"), np.random.default_rng(1), duration=900.0)
    mirrored = record.with_channels({"rudder_rad": -record["rudder_rad"]})
    found = diagnose(mirrored, load_vehicle("slocum"))
    assert found.verdict == "doubted"
    assert not found.effects
    assert "opposite sign" in found.summary()
    assert as_json(found)["doubts"][0]["channels"] == ["rudder_rad"]
    trusted = diagnose(mirrored, load_vehicle("slocum"), trust=True)
    assert trusted.verdict != "doubted"


@pytest.mark.slow
def test_a_log_that_nothing_explains_gets_a_term_or_a_habitat(monkeypatch):
    given = QUICK
    true = replace_at(given, "effects.discovered.yaw.sin_2heading", 0.02)
    record = run_mission(true, np.random.default_rng(2), duration=2400.0)
    found = diagnose(record, given)
    assert found.unexplained
    assert found.discovery is not None
    assert found.discovery.holds
    assert "sin_2heading" in found.discovery.terms[0].path
    assert value_at(found.after.plant, found.discovery.terms[0].path) == pytest.approx(0.02, rel=0.2)
    assert found.after.scores["heading_rad"].rmse < 0.7 * found.before.scores["heading_rad"].rmse
    assert "A term found in the data" in found.summary()
    monkeypatch.setattr(scoring, "explained_share", lambda *_: -0.1)  # free runs in unseen parts are worse with it
    worse = diagnose(record, given)
    assert not worse.discovery.holds
    assert worse.after is worse.refitted
    assert worse.discovery.rejected[-1].path == found.discovery.terms[0].path
    assert "the closest is" in worse.discovery.summary()
    assert "worse with it than without" in worse.discovery.summary()
    monkeypatch.undo()
    fixed = diagnose(record, given, doubt=0.0)
    assert not fixed.coefficients
    assert [fixed.after.plant.hull, fixed.before.plant.hull] == [given.hull, given.hull]
    assert fixed.discovery.terms[0].path == found.discovery.terms[0].path


@pytest.mark.slow
def test_coefficients_without_a_doubt_stay_as_given():
    given = load_vehicle("slocum")
    true = replace_at(given, {"effects.rudder.deadband": 0.06, "hull.n_r": 1.05 * given.hull.n_r})
    found = diagnose(run_mission(true, np.random.default_rng(2), duration=900.0), given, doubt=0.0)
    assert "effects.rudder.deadband" in names(found)
    assert found.after.plant.hull == given.hull
    assert not found.coefficients


def test_the_file_is_enough_to_repeat_a_diagnosis(tmp_path):
    true = replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.05)
    record = run_mission(true, np.random.default_rng(1), duration=600.0)
    found = diagnose(record, load_vehicle("slocum"), window=100.0, seed=3)
    file = write_diagnosis(found, tmp_path)["diagnosis.json"]
    told = json.loads(file.read_text())
    repeated = json.loads(json.dumps(as_json(again(file, record))))
    assert told.pop("versions") == repeated.pop("versions")
    assert told == repeated
    shifted = Record.from_arrays(record.time, {n: record[n] + 0.01 for n in record.names})
    with pytest.raises(ValueError, match="from another record"):
        again(file, shifted)
    file.write_text("{}")
    with pytest.raises(ValueError, match=r"no diagnosis\.json of this version"):
        again(file, record)


def test_a_log_whose_rudder_is_turned_is_doubted_beside_an_offset_that_hides_it():
    """A heading that hardly strays from its set points, and a rudder that is off by more than it moves."""
    rng, dt, rows = np.random.default_rng(7), 4.0, 400
    heading, rudder, turn, held = np.zeros(rows), np.zeros(rows), 0.0, 0.0
    psi = 0.3
    for k in range(rows):
        heading[k] = psi + rng.normal(0.0, 0.007)
        error = (np.deg2rad((20.0, 80.0, 140.0, 60.0)[4 * k // rows]) - heading[k] + np.pi) % (2.0 * np.pi) - np.pi
        held = np.clip(held + 0.006 * error, -0.15, 0.15)
        rudder[k] = np.clip(0.6 * error + held - 3.0 * turn, -0.45, 0.45)
        for _ in range(8):
            turn += 0.5 * (-0.12 * turn + 0.01 * (rudder[k] + 0.08)) + rng.normal(0.0, 1e-5)
            psi += 0.5 * turn
    given = load_vehicle("slocum")
    right = Record.from_arrays(dt * np.arange(rows), {"heading_rad": heading, "rudder_rad": rudder})
    turned = right.with_channels({"rudder_rad": -rudder})
    assert "opposite sign" not in diagnose(right, given).summary()
    found = diagnose(turned, given)
    assert found.verdict == "doubted"
    assert not found.effects
    assert "rudder effectiveness N_dr has the opposite sign" in found.summary()
