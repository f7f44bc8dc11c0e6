"""The recipe from an experiment to gains: it frees what it changes, on a vehicle whose free runs can be compared."""

from pathlib import Path

import pytest

from auv_gym.plant import load_vehicle
from identification.campaign.file.plan import plan
from identification.campaign.file.reading import read_campaign
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
