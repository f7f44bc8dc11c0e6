"""Tests of a campaign's gains: tuned once for the fitted vehicle, and left out if the fit is unusable."""

import json
import shutil
from dataclasses import replace

import pytest

from auv_gym.models.files import load_model
from controllers.autopilots import autopilot
from controllers.gains import read_gains
from identification.campaign.file.reading import read_campaign
from identification.campaign.file.settings import Tune
from identification.campaign.gains import tune_fitted


def quiet(share, text):
    pass


def test_gains_are_for_the_fitted_vehicle_over_the_intervals_of_the_fit(study):
    campaign = replace(study.campaign, tune=Tune(fit="offset", evaluations=2, draws=1))
    passed, words = tune_fitted(campaign, study.folder, quiet)
    assert "95 % intervals of 1 parameter" in words[0]
    assert any(text.startswith("On held-out runs, the fit of 'offset' is 9") for text in words)
    assert not any("Warning" in text for text in words)
    assert "effects.rudder.offset" in (study.folder / "tuning.html").read_text(encoding="utf-8")
    vehicle = load_model(study.folder / "models" / "offset.toml")
    assert autopilot(vehicle, gains=study.folder / "gains.toml")
    written = (study.folder / "gains.toml").stat().st_mtime_ns
    assert tune_fitted(campaign, study.folder, quiet) == (passed, words)
    assert (study.folder / "gains.toml").stat().st_mtime_ns == written
    other = replace(study.campaign, tune=Tune(fit="offset", evaluations=0, draws=1, require=("phase_margin_deg>=89",)))
    passed, words = tune_fitted(other, study.folder, quiet)
    assert not passed
    assert words[0].startswith("Some requirements are not met: phase margin ≥ 89 deg in the heading loop")


def test_a_fit_that_is_worse_than_a_constant_is_a_warning_in_the_words_the_page_and_the_gains(study, tmp_path):
    shutil.copytree(study.folder / "models", tmp_path / "models")
    path = tmp_path / "models" / "offset.json"
    fit = json.loads(path.read_text())
    for scores in fit["scores"].values():
        scores["heading_rad"]["fit_percent"] = -659.0
    path.write_text(json.dumps(fit))
    campaign = replace(study.campaign, tune=Tune(fit="offset", evaluations=0, draws=1))
    _, words = tune_fitted(campaign, tmp_path, quiet)
    page = (tmp_path / "tuning.html").read_text(encoding="utf-8")
    for text in (words[0], page, *read_gains(tmp_path / "gains.toml")[0].notes["pid"][:1]):
        assert "the fitted model is worse than a constant (fit below 0 %: heading -659 %)" in text


@pytest.mark.parametrize(
    "name, words", [("hopeless", "the fit 'hopeless' is not done"), ("line", "'line' is a model by arx")]
)
def test_without_a_fitted_vehicle_the_words_say_why(study, name, words):
    passed, said = tune_fitted(replace(study.campaign, tune=Tune(fit=name)), study.folder, quiet)
    assert not passed
    assert words in said[0]


@pytest.mark.parametrize("fit", ["lines", "line"])
def test_tune_needs_a_fit_of_one_model(study, tmp_path, fit):
    path = tmp_path / "study.toml"
    path.write_text(study.campaign.text + f'\n[tune]\nfit = "{fit}"\n')
    with pytest.raises(
        ValueError, match=rf"tune\.fit needs the name of a fit of one model \(offset, hopeless\), got '{fit}'"
    ):
        read_campaign(path)
