"""The gains of a campaign: tuned for what a fit found, not tuned twice, and none where the fit is of no use."""

from dataclasses import replace

import pytest

from auv_gym.models.files import load_model
from controllers.autopilots import autopilot
from identification.campaign.file.reading import read_campaign
from identification.campaign.file.settings import Tune
from identification.campaign.gains import tune_fitted


def quiet(share, text):
    pass


def test_gains_are_for_the_fitted_vehicle_over_the_intervals_of_the_fit(study):
    campaign = replace(study.campaign, tune=Tune(fit="offset", evaluations=2, draws=1))
    passed, words = tune_fitted(campaign, study.folder, quiet)
    assert "95 % intervals of 1 parameter" in words[0]
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
