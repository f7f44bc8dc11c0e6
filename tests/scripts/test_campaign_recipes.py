"""The recipe from an experiment to gains: it frees what it changes, and its gains meet the requirements."""

import json
from pathlib import Path

import pytest

from auv_gym.cli import main
from auv_gym.plant import load_vehicle
from controllers.gains import read_gains
from controllers.tuning.bench import bench_of
from controllers.tuning.requirements import parse_requirements
from controllers.tuning.tuning import judged
from identification.campaign.file.plan import plan
from identification.campaign.file.reading import read_campaign
from identification.campaign.running.staging import make_campaign_vehicle
from identification.compare.model_tests import poles_of

RECIPE = Path(__file__).parents[2] / "scripts" / "campaigns" / "gains.toml"


def test_the_fit_of_the_recipe_frees_what_its_vehicle_has_changed():
    campaign = read_campaign(RECIPE)
    (fit,) = campaign.fit
    for run in plan(campaign):
        assert run.settings.vehicle.effects
        assert run.settings.vehicle.effects.keys() <= set(fit.settings["free"])
    assert campaign.tune.fit == fit.name


def test_free_runs_of_the_vehicle_of_the_recipe_stay_near_its_logs():
    preset = plan(read_campaign(RECIPE))[0].settings.vehicle.preset
    assert max(rate for rate, _ in poles_of(load_vehicle(preset))) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_the_recipe_ends_with_gains_that_meet_its_requirements_on_the_true_vehicle(tmp_path):
    """The whole recipe; flights last 120 s and not 300 s, and tuning has 8 evaluations of 25 and 4 draws of 12."""
    text = RECIPE.read_text(encoding="utf-8")
    assert text.count("duration = 300.0") == text.count('kind = "pid"') == 1
    text = text.replace("duration = 300.0", "duration = 120.0")
    short = tmp_path / "gains.toml"
    short.write_text(text.replace('kind = "pid"', 'kind = "pid"\nevaluations = 8\ndraws = 4'), encoding="utf-8")
    out = tmp_path / "out"
    assert main(["campaign", str(short), "--out", str(out), "--jobs", "1"]) == 0
    assert {path.name for path in out.iterdir()} >= {"report.html", "gains.toml", "tuning.json", "tuning.html"}

    fitted = json.loads((out / "models" / "grey_box.json").read_text())["parameters"]
    (damping,) = (each for each in fitted if each["name"] == "effects.hull.damping_yaw")
    # Over seeds, 95 % of the intervals contain the truth; four standard errors do in every run.
    assert abs(damping["value"] + 0.2) < 4.0 * damping["error"] < 0.05

    assert json.loads((out / "tuning.json").read_text())["passed"]
    (gains,) = read_gains(out / "gains.toml")
    assert gains.vehicle == "heu_torpedo"
    assert set(gains.loops["pid"]) == {"speed", "heading", "pitch", "depth"}
    campaign = read_campaign(RECIPE)
    truth = make_campaign_vehicle(plan(campaign)[0].settings.vehicle, tmp_path)
    asked = parse_requirements(campaign.tune.require, tuple(bench_of(truth, 0).trial.steps))
    found = judged(truth, gains, "pid", asked, {}, 0, draws=0)
    assert found.passed, found.verdicts()
    assert {channel for channel, _, _, _ in found.verdicts()} == {"u_mps", "heading_rad", "depth_m"}
