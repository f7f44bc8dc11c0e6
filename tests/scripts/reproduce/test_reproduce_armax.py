"""The published experiment in its limits, and from its records to predictive control on the identified model."""

import json
from contextlib import redirect_stdout
from io import StringIO
from math import radians

import numpy as np
import pytest

from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.estimate import Estimate
from scripts.reproduce.armax import control, models
from scripts.reproduce.armax.__main__ import main
from scripts.reproduce.armax.models import DEPTH, PITCH, Verified
from scripts.reproduce.armax.records import records_of
from scripts.reproduce.armax.study import TAKEN, Row, reached

pytestmark = pytest.mark.slow  # a study; others of this folder run by default
CONTROLLERS = ("GPC, true linear form", f"GPC, {TAKEN}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("vertical_plane")


@pytest.fixture(scope="module")
def experiment(folder):
    return records_of(folder)


@pytest.fixture(scope="module")
def printed(folder, experiment):
    """What the program prints of the campaign's own records, control with one seed."""
    with redirect_stdout(StringIO()) as out:
        assert main(["--out", str(folder), "--jobs", "1", "--search", "arx", "--seeds", "0", "--runs", "1"]) == 0
    return out.getvalue()


@pytest.fixture(scope="module")
def told(folder, printed):
    """What it writes."""
    return json.loads((folder / "armax.json").read_text())


def farthest(records):
    """For each record, m from the depth that is held, and the largest pitch, deg."""
    return [(np.abs(r["depth_m"] - 50.0).max(), np.degrees(np.abs(r["pitch_rad"]).max())) for r in records.values()]


def test_the_published_experiment_stays_in_its_limits(experiment):
    assert len(experiment) == 4
    assert all(depth <= 10.0 and 2.0 < pitch <= 5.0 for depth, pitch in farthest(experiment))  # and is excited


def rows(told, model, fitted=None):
    return [r for r in told["free_runs"] if r["model"] == model and (fitted is None or r["fitted"] == fitted)]


def test_free_runs_over_fresh_data_reach_the_targets(told):
    fresh = [r["fit"] for r in rows(told, TAKEN) if r["fitted"] != str(r["seed"])]
    assert len(fresh) == 4  # either seed to the other, and both to each
    assert all(fit["pitch"] >= 95.0 and fit["differences"] >= 90.0 for fit in fresh)
    # its pole is at 1, so that both ways to differences are one
    assert all(fit["equation"] == pytest.approx(fit["differences"], abs=0.2) for fit in fresh)


def test_rounding_and_the_form_are_the_ceilings(told):
    (best,) = {round(min(r["fit"]["equation"] for r in rows(told, "7 parameters at their best")))}
    own = max(r["fit"]["differences"] for r in rows(told, TAKEN))
    assert own < best + 1.0
    longer = min(r["fit"]["differences"] for r in rows(told, models.LONGER))
    linear = max(r["fit"]["differences"] for r in rows(told, "true linear form"))
    assert best + 2.0 < longer < linear + 0.2
    for true, unrounded in zip(rows(told, "true vehicle"), rows(told, "true motion, unrounded"), strict=True):
        assert true["fit"]["pitch"] == pytest.approx(unrounded["fit"]["pitch"], abs=0.1)


def test_orders_and_coefficients_are_told(told):
    orders = told["orders"]
    assert set(orders["choices"]) == {"mdl", "aic", "bic", "parsimony"}
    assert len(orders["cells"]) == 2 * 6 * 6 * 5
    assert (orders["published"][DEPTH]["parameters"], orders["published"][PITCH]["parameters"]) == (7, 8)
    fitted = {e["path"]: e for e in told["coefficients"]["ARMAX"]["both"]}
    assert set(models.PUBLISHED) <= set(fitted)
    assert all(e["ci95"][0] < e["value"] < e["ci95"][1] for e in fitted.values())
    pole = {e["path"]: e["value"] for e in told["coefficients"][TAKEN]["both"] if e["path"].startswith("a")}
    assert 1.0 + sum(pole[f"a{k}[{DEPTH}]"] for k in (1, 2, 3)) == pytest.approx(0.0, abs=1e-9)


def test_control_on_the_identified_model_is_as_good_as_on_the_true_one(told):
    flown = {f["controller"]: f for f in told["control"]}
    true, own = (flown[name] for name in CONTROLLERS)
    assert own["cost"] < 1.03 * true["cost"] < 0.9 * flown["PID"]["cost"]
    assert own["pitch"] < control.PITCH_LIMIT + radians(1.0)
    assert all(end < 100.0 for end in own["settling"])


def test_tables_and_pictures(printed, folder):
    for words in (
        "the paper's orders",
        "b1[depth_m, stern_plane_rad]",
        "-0.00149",
        "0.975±0.049j",
        "GPC, output error",
    ):
        assert words in printed
    assert "both targets in 2 of 2 free runs" in printed
    assert (folder / "figures_11_and_12.png").stat().st_size > 20_000


def test_a_model_without_a_pole_near_one_has_no_equation():
    rng = np.random.default_rng(0)
    columns = {name: 0.1 * rng.standard_normal(60) for name in (*models.INPUTS, *models.OUTPUTS)}
    record = Record.from_arrays(4.0 * np.arange(60), columns)
    still = Polynomial.from_coefficients(
        {DEPTH: [-0.5], PITCH: [-0.5]}, {DEPTH: {"bow_plane_rad": [1.0]}, PITCH: {"stern_plane_rad": [-0.5]}}, 4.0
    )
    found = models.verify(still, record)
    assert np.isnan(found.equation)
    assert np.isfinite(found.differences)
    assert not reached([found])
    wild = Polynomial.from_coefficients(
        {DEPTH: [-1e8], PITCH: [-1e8]}, {DEPTH: {"bow_plane_rad": [1.0]}, PITCH: {"bow_plane_rad": [1.0]}}, 4.0
    )
    assert np.isnan(models.verify(wild, record).pitch)


def test_degrees_and_what_counts_as_fresh():
    value, ends, unit = models.in_degrees(Estimate("b1", "m/rad", 180.0 / np.pi, 1.0, (0.0, 360.0 / np.pi)))
    assert (value, ends, unit) == (pytest.approx(1.0), pytest.approx((0.0, 2.0)), "m/deg")
    assert [Row("m", fitted, 2, Verified(1, 1, 1)).fresh for fitted in ("1", "2", "both", "")] == [True] + 3 * [False]


def test_nothing_to_do_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--out", str(tmp_path), "--runs", "0"])
    assert "--runs: needs a whole number of at least 1, got 0" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 100])
def test_the_targets_are_reached_over_further_seeds(tmp_path, seed):
    """7 parameters leave depth differences a few percent above the target, so that a seed in some forty is below."""
    given = ["--seed", str(seed), "--search", "arx" if seed else "armax", "--runs", "10", "--jobs", "2"]
    assert main(["--out", str(tmp_path), *given]) == 0
    told = json.loads((tmp_path / "armax.json").read_text())
    own = [Verified(**r["fit"]) for r in told["spread"] if r["model"] == TAKEN]
    assert len(own) == 20
    assert sum(reached([fit]) for fit in own) >= 19
    longer = [Verified(**r["fit"]) for r in told["spread"] if r["model"] == models.LONGER]
    assert min(fit.differences for fit in longer) > 95.0
    cost = {name: np.median([f["cost"] for f in told["control"] if f["controller"] == name]) for name in CONTROLLERS}
    assert cost[CONTROLLERS[1]] < 1.03 * cost[CONTROLLERS[0]]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 20, 30])
def test_other_seeds_stay_in_the_limits_too(tmp_path, seed):
    assert all(depth <= 10.0 and pitch <= 5.0 for depth, pitch in farthest(records_of(tmp_path, seed)))
