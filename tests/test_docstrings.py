"""Every public name has an example in its docstring, and the example prints what it says."""

import doctest
import importlib
from types import ModuleType

import pytest

PACKAGES = ("auv_gym", "auv_gym.exports", "auv_gym.rl", "controllers", "identification")
EXTRAS = {  # what the example of a name needs, beside the package itself
    "auv_gym.find_log": "dbdreader",
    "auv_gym.exports.casadi_model": "casadi",
    "auv_gym.exports.control_system": "control",
    "auv_gym.exports.dataset_of_records": "minari",
    "auv_gym.exports.dataset_of_rollouts": "minari",
    "auv_gym.rl.Training": "yaml",
    "auv_gym.rl.hyperparameters_for": "yaml",
    "auv_gym.rl.train": "stable_baselines3",
    "identification.write_diagnosis": "matplotlib",
}
SHOWN_ELSEWHERE = {  # protocols, and results that a user gets and does not make, with the name whose example shows them
    "auv_gym.Model": "auv_gym.load_model",
    "auv_gym.Narx": "identification.NarxLsSvm",
    "auv_gym.exports.CasadiModel": "auv_gym.exports.casadi_model",
    "auv_gym.exports.GazeboWorld": "auv_gym.exports.gazebo_world",
    "auv_gym.rl.Trained": "auv_gym.rl.train",
    "controllers.Controller": "controllers.Pid",
    "controllers.Gains": "controllers.gains_for",
    "identification.Alarm": "identification.Monitor",
    "identification.Diagnosis": "identification.diagnose",
    "identification.Estimate": "identification.pole_intervals",
    "identification.Identified": "identification.identify",
    "identification.Method": "identification.list_methods",
}


def public() -> dict[str, object]:
    """The functions and classes that the packages' stubs offer, by dotted name."""
    packages = {name: importlib.import_module(name) for name in PACKAGES}
    offered = {f"{p}.{n}": getattr(package, n) for p, package in packages.items() for n in package.__all__}
    return {name: value for name, value in offered.items() if callable(value) and not isinstance(value, ModuleType)}


NAMES = public()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to write into, also for Minari's data sets."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    monkeypatch.setenv("MPLBACKEND", "Agg")


@pytest.mark.parametrize("name", sorted(set(NAMES) - set(SHOWN_ELSEWHERE)))
@pytest.mark.filterwarnings("ignore:`.*` is set to None:UserWarning", "ignore:env_spec is None:UserWarning")
def test_the_example_prints_what_it_says(name, folder):
    examples = doctest.DocTestParser().get_doctest(NAMES[name].__doc__ or "", {}, name, None, None)
    assert any(example.want for example in examples.examples), f"{name} has no example that prints something."
    if name in EXTRAS:
        pytest.importorskip(EXTRAS[name])
    told: list[str] = []
    failed = doctest.DocTestRunner().run(examples, out=told.append).failed
    assert failed == 0, "".join(told)


def test_what_has_no_example_of_its_own_is_shown_by_one_that_does():
    assert set(SHOWN_ELSEWHERE) | set(EXTRAS) | set(SHOWN_ELSEWHERE.values()) <= set(NAMES)
    assert not set(SHOWN_ELSEWHERE) & set(SHOWN_ELSEWHERE.values())
    assert [name for name in SHOWN_ELSEWHERE if ">>>" in (NAMES[name].__doc__ or "")] == []
