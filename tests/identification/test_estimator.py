"""Methods by name: every one is made, described and refused in words; those of other packages join."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from identification import estimator
from identification.estimator import Method, list_methods, make_estimator, parse_settings, summary
from identification.fit.greybox import GreyBox
from identification.linear.polynomials.arx import Arx
from identification.recursive.rwls import Rwls
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of

LINEAR = ["arx", "els", "armax", "output_error", "n4sid", "pbsid"]
NAMES = ["grey_box", *LINEAR, "rwls", "ivls", "corrected_ivls", "refined_iv", "ls_svm", "hull_ls_svm", "narx_ls_svm"]


@pytest.mark.parametrize("name", NAMES)
def test_every_method_is_made_by_its_name(name):
    method = list_methods()[name]
    given = {"plant": load_vehicle("slocum")} if method.needs_vehicle else {}
    if method.needs_channels:
        given = {"inputs": INPUTS, "outputs": OUTPUTS}
    made = make_estimator(name, {}, **given)
    assert isinstance(made, method.load())
    assert callable(made.fit)
    assert method.title.endswith(".")
    assert not method.problem
    assert set(method.settings) <= set(type(made).__dataclass_fields__)
    assert not {"plant", "inputs", "outputs"} & set(method.settings)


def test_the_registry_lists_ours_first():
    assert list(list_methods())[: len(NAMES)] == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_the_settings_are_listed_as_they_are(name):
    method = list_methods()[name]
    assert method.setting_names == replace(method, listed="").setting_names


def test_settings_take_the_types_of_their_fields():
    made = make_estimator("arx", {"n_a": [3, 2], "n_b": "2", "offset": "false"}, inputs=list(INPUTS), outputs=OUTPUTS)
    assert made == Arx(INPUTS, OUTPUTS, n_a=(3, 2), n_b=2, offset=False)
    assert make_estimator("rwls", {"known": "unity", "forgetting": 1}) == Rwls(known=("unity",))
    assert make_estimator("refined-iv") == make_estimator("refined_iv")
    slocum = load_vehicle("slocum")
    assert make_estimator("grey_box", plant=slocum) == GreyBox(slocum, free=("hull.n_r", "hull.n_delta"))
    assert make_estimator("grey_box", {"free": ["hull.n_r"]}, plant=slocum).free == ("hull.n_r",)


@pytest.mark.parametrize(
    "name, settings, given, words",
    [
        ("arxx", {}, {}, r"Did you mean 'arx' or 'armax'\? Methods: grey_box, arx"),
        (
            "arx",
            {"na": 2},
            {"inputs": INPUTS, "outputs": OUTPUTS},
            r"no setting 'na'.*Did you mean 'n_a'.*n_b \(a whole number",
        ),
        ("arx", {"n_a": "two"}, {"inputs": INPUTS, "outputs": OUTPUTS}, r"cannot take n_a = 'two'"),
        ("arx", {"n_a": 2.5}, {"inputs": INPUTS, "outputs": OUTPUTS}, r"cannot take n_a = 2\.5"),
        ("arx", {}, {"outputs": OUTPUTS}, r"arx needs inputs: give channel names"),
        ("arx", {"inputs": ["rudder_rad"]}, {"outputs": OUTPUTS}, r"no setting 'inputs'"),
        ("rwls", {}, {"inputs": ["piston_m"]}, r"rwls knows its own inputs"),
        ("rwls", {"forgetting": 2.0}, {}, r"0 < forgetting <= 1"),
        ("grey_box", {}, {}, r"needs a vehicle: give a preset"),
        ("grey_box", {"free": ["hull.n_r"]}, {}, r"needs a vehicle: give a preset"),
    ],
)
def test_what_does_not_fit_is_refused_in_words(name, settings, given, words):
    with pytest.raises(ValueError, match=words):
        make_estimator(name, settings, **given)


def test_settings_are_parsed_as_toml_has_them():
    texts = ["n_a=3", "n_b = [[2, 0], [0, 2]]", "delay=1,2", "offset=true", "known=unity", "free=hull.n_r,hull.n_q"]
    assert parse_settings([*texts, "x=1e-3"]) == {
        "n_a": 3,
        "n_b": [[2, 0], [0, 2]],
        "delay": [1, 2],
        "offset": True,
        "known": "unity",
        "free": ["hull.n_r", "hull.n_q"],
        "x": 1e-3,
    }
    for text, words in {"n_a": "KEY=VALUE", "=3": "KEY=VALUE"}.items():
        with pytest.raises(ValueError, match=words):
            parse_settings([text])
    with pytest.raises(ValueError, match="twice"):
        parse_settings(["n_a=1", "n_a=2"])


def test_the_summary_names_channels_parameters_and_intervals():
    text = summary(Arx(INPUTS, OUTPUTS, n_a=(3, 2)).fit(record_of(TRUTH, 200, np.random.default_rng(0), noise=0.01)))
    lines = text.splitlines()
    assert lines[0] == "bow_plane_rad, stern_plane_rad -> depth_m, pitch_rad, dt 4 s"
    assert len(lines) == 1 + 3 + 2 + 8 + 2
    assert lines[1].startswith("a1[depth_m]")
    assert "[" in lines[1].split("  ")[-1]


@dataclass(frozen=True)
class Mean:
    """A method of another package."""

    window: float = 3.0

    def fit(self, *records):
        return records


class Entry:
    """An entry point as packages offer them."""

    def __init__(self, name, loads):
        self.name, self.value, self._loads = name, f"other.package:{name}", loads

    def load(self):
        if isinstance(self._loads, Exception):
            raise self._loads
        return self._loads


def test_methods_of_other_packages_join_and_broken_ones_are_told(monkeypatch):
    entries = [
        Entry("mean", Method("mean", "The mean.", Mean)),
        Entry("lost", ImportError("no module named other")),
        Entry("odd", 7),
        Entry("renamed", Method("other", "x", Mean)),
        Entry("fitless", Method("fitless", "x", Entry)),
        Entry("arx", Method("arx", "Another ARX.", Mean)),
    ]
    monkeypatch.setattr(estimator, "entry_points", lambda group: entries if group == "auv_gym.methods" else [])
    known = list_methods()
    assert make_estimator("mean", {"window": 2}) == Mean(2.0)
    assert known["arx"].load() is Arx
    assert "no module named other" in known["lost"].problem
    assert "a int" in known["odd"].problem
    assert "'other'" in known["renamed"].problem
    assert known["fitless"].problem
    assert "taken name 'arx'" in known["arx (other.package:arx)"].problem
    with pytest.raises(ValueError, match=r"lost cannot be used: its entry point other\.package:lost is broken"):
        make_estimator("lost")
